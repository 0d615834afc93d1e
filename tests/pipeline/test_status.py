"""How a rig stands, as other programs are told."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from pipeline.frame import NS_PER_S
from pipeline.verdict import Status
from tests.frames import PERIOD_NS, texture
from tests.monitor import LATENCY_NS, Monitor, stereo


def shown(items) -> Status:
    monitor = Monitor()
    for item in items:
        monitor.take(item)
    return monitor.status()


def test_the_skew_of_the_last_minute_is_told_in_quantiles():
    status = shown([*stereo(500, right_ns=1_000_000), *stereo(90, 500, right_ns=-30_000_000)])
    pair = status.pairs["left-right"]
    assert pair.skew_p50_ns == pytest.approx(1_000_000, rel=0.01)
    assert pair.skew_p99_ns == pytest.approx(30_000_000, rel=0.01)
    pair = shown([*stereo(90, right_ns=-30_000_000), *stereo(700, 90, right_ns=1_000_000)]).pairs["left-right"]
    assert pair.skew_p99_ns == pytest.approx(1_000_000, rel=0.01)


def test_a_pair_that_was_never_decided_has_no_skew():
    left_only = [item for item in stereo(20) if item.camera == "left"]
    pair = shown(left_only[:2]).to_message()["pairs"]["left-right"]
    assert (pair["skew_p50_ms"], pair["skew_p99_ms"]) == (None, None)


def test_latency_counts_from_the_arrival_of_the_frame_that_was_judged():
    status = shown(stereo(100))
    assert status.latency_p99_ns == pytest.approx(PERIOD_NS + LATENCY_NS, rel=0.01)
    assert status.to_message()["monitor"]["latency_p99_ms"] == pytest.approx(107, rel=0.01)


def test_the_monitor_tells_its_memory_and_version():
    monitor = shown(stereo(3)).to_message()["monitor"]
    assert 10**6 < monitor["memory_bytes"] < 10**11
    assert monitor["version"] == "1.2"


def test_a_camera_that_comes_back_with_another_clock_is_a_restart_and_its_counts_go_on():
    before = stereo(40)
    after = stereo(40, 45, epoch=1, clock="rig2")
    camera = shown([*before, *after]).to_message()["cameras"]["right"]
    assert (camera["restarts"], camera["epoch"], camera["clock"], camera["frames"]) == (1, 1, "rig2", 80)


def test_every_silence_is_one_stall():
    items = [
        item
        for item in stereo(200)
        if not (item.camera == "right" and (50 <= item.sequence < 56 or 90 <= item.sequence < 130))
    ]
    status = shown(items)
    assert status.cameras["right"].stalls == 2
    assert status.cameras["left"].stalls == 0


def test_a_frozen_camera_says_so():
    items = []
    for item in stereo(60):
        n = 0 if item.camera == "right" and item.sequence > 20 else item.sequence
        items.append(replace(item, image=np.ascontiguousarray(texture(3, 200, 60)[:48, 2 * n : 2 * n + 64])))
    cameras = shown(items).to_message()["cameras"]
    assert (cameras["left"]["frozen"], cameras["right"]["frozen"]) == (False, True)
    assert cameras["right"]["conditions"] == ["frozen"]


def test_nothing_seen_yet_is_told_without_numbers():
    status = Monitor().status()
    message = status.to_message()
    assert message["monitor"]["latency_p99_ms"] is None
    assert (message["cameras"]["left"]["clock"], message["cameras"]["left"]["epoch"]) == (None, None)
    assert status.uptime_s * NS_PER_S == 0
