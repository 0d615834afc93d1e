"""The OAK source on nodes of this machine, with real messages of depthai: what it says, and that it comes back."""

from __future__ import annotations

import threading
import time
from contextlib import contextmanager
from dataclasses import replace
from importlib.util import find_spec

import numpy as np
import pytest

if find_spec("depthai") is None:
    pytest.skip("depthai is not installed: make test-oak installs it", allow_module_level=True)

from pipeline.errors import InputError, RunError
from pipeline.frame import StampOrigin, StampReference
from pipeline.health.camera import CameraHealth
from sources.oak.device import NotThereError
from sources.oak.settings import OakSettings
from sources.oak.source import OakSource
from tests.network import wait_for
from tests.oak import PERIOD_US, PICTURE, HostBuild, shots

TWO = [
    {"device": "front", "cameras": {"left": "CAM_B", "right": "CAM_C"}},
    {"device": "back", "cameras": {"left2": "CAM_B", "right2": "CAM_C"}},
]


def oak(build, start_within_s=5.0, **settings) -> OakSource:
    return OakSource(OakSettings.model_validate(settings), build=build, start_within_s=start_within_s)


class Reading:
    def __init__(self, source) -> None:
        self.source, self.frames = source, []
        self.thread = threading.Thread(target=self._read, daemon=True)

    def _read(self) -> None:
        for item in self.source.frames():
            self.frames.append(item)

    def of(self, camera):
        return [item for item in list(self.frames) if item.camera == camera]


@contextmanager
def reading(source):
    source.open()
    read = Reading(source)
    read.thread.start()
    try:
        yield read
    finally:
        source.stop()
        read.thread.join(5)
        assert not read.thread.is_alive()
        source.close()


def both_have(read, count):
    return lambda: min(len(read.of("left")), len(read.of("right"))) >= count


def test_a_frame_says_all_that_its_device_says():
    with reading(oak(HostBuild(shots(20, host_us=5_000_000)))) as read:
        wait_for(both_have(read, 20))
    for name in ("left", "right"):
        frames = read.of(name)
        assert [item.sequence for item in frames] == list(range(20))
        assert [item.captured_ns for item in frames] == [n * PERIOD_US * 1000 for n in range(20)]
        assert {(item.clock, item.exposure_ns, item.epoch) for item in frames} == {("oak-host", 8_000_000, 0)}
        assert {item.stamp_reference for item in frames} == {StampReference.END}
        assert {item.stamp_origin for item in frames} == {StampOrigin.DEVICE}
        assert np.array_equal(frames[7].image, PICTURE)


def test_an_exposure_that_is_not_known_is_none():
    with reading(oak(HostBuild(shots(3, exposure_us=0)))) as read:
        wait_for(both_have(read, 3))
    assert {item.exposure_ns for item in read.frames} == {None}


@pytest.mark.parametrize(
    ("clock", "name", "first_ns"),
    [
        ("device", "oak-host", 0),
        ("host", "monotonic", 5_000_000_000),
        ("ptp", "ptp", 1_790_000_000_000_000_000),
    ],
)
def test_the_clock_that_is_asked_for_stamps(clock, name, first_ns):
    with reading(oak(HostBuild(shots(3, host_us=5_000_000, ptp=True)), clock=clock)) as read:
        wait_for(both_have(read, 3))
    first = read.of("left")[0]
    assert (first.clock, first.captured_ns) == (name, first_ns)


def test_several_devices_share_the_hosts_clock_and_it_is_said(caplog):
    caplog.set_level("INFO", "syncwatch.sources.oak")
    with reading(oak(HostBuild(shots(10)), devices=TWO)) as read:
        wait_for(lambda: all(len(read.of(name)) >= 10 for name in ("left", "right", "left2", "right2")))
    assert {item.clock for item in read.frames} == {"monotonic"}
    assert "oak: stamps are of this machine's clock, as depthai translates them" in caplog.messages


def test_a_device_without_ptp_is_an_error_that_says_what_to_do():
    source = oak(HostBuild(shots(3)), clock="ptp")
    source.open()
    with pytest.raises(InputError, match="the device gives no PTP time: choose clock: host"):
        list(source.frames())
    source.close()


def test_frames_that_the_device_lost_show_as_gaps_that_health_counts():
    script = [*shots(20), *shots(20, first=23)]
    with reading(oak(HostBuild(script))) as read:
        wait_for(both_have(read, 40))
    health = CameraHealth(read.source.cameras[0])
    for item in read.of("left"):
        health.take(item)
    assert health.report().drops == 3


def test_a_queue_that_overflows_loses_the_oldest_and_shows_as_a_gap(monkeypatch):
    monkeypatch.setattr("sources.oak.source.QUEUE_FRAMES", 4)
    build = HostBuild(shots(60), pace_s=0.0)
    source = oak(build)
    gate = threading.Event()
    take = source._take
    source._take = lambda *arguments: (gate.wait(5), take(*arguments))
    with reading(source) as read:
        assert build.rigs[0].done.wait(5)
        gate.set()
        wait_for(lambda: read.of("right") and read.of("right")[-1].sequence == 59)
        sequences = [item.sequence for item in read.of("right")]
    assert sequences == sorted(sequences)
    assert len(sequences) < 12


def test_a_pipeline_that_dies_is_built_anew_in_a_new_epoch(caplog):
    build = HostBuild(shots(10), shots(10))
    with reading(oak(build)) as read:
        wait_for(both_have(read, 10))
        build.built[0].pipeline.stop()
        wait_for(both_have(read, 20))
    assert [item.epoch for item in read.of("left")] == [0] * 10 + [1] * 10
    assert [item.sequence for item in read.of("left")] == [*range(10), *range(10)]
    assert build.closed == 2
    assert "OAK host: its pipeline has ended; opening it anew" in caplog.messages


def test_silence_of_all_cameras_opens_the_device_anew(caplog):
    build = HostBuild(shots(5), shots(5))
    with reading(oak(build, stall_s=0.2)) as read:
        wait_for(both_have(read, 10))
    assert {item.epoch for item in read.frames} == {0, 1}
    assert "OAK host: no frames for 0.2 s; opening it anew" in caplog.messages


def test_one_silent_camera_does_not_restart_the_other():
    build = HostBuild(shots(120, right=False))
    with reading(oak(build, stall_s=0.1)) as read:
        wait_for(lambda: len(read.of("left")) >= 120)
    assert len(build.built) == 1


def test_a_device_that_is_gone_is_looked_for_until_it_is_back(caplog, monkeypatch):
    monkeypatch.setattr("sources.oak.source.AGAIN_AFTER_S", 0.02)
    gone = InputError("no OAK 'front' is found")
    build = HostBuild(shots(5), gone, gone, RunError("it cannot be opened"), shots(5))
    with reading(oak(build)) as read:
        wait_for(both_have(read, 5))
        build.built[0].pipeline.stop()
        wait_for(both_have(read, 10))
    said = [line for line in caplog.messages if "trying on" in line]
    assert said == ["OAK host: no OAK 'front' is found; trying on", "OAK host: it cannot be opened; trying on"]


def test_one_lost_device_does_not_hold_up_another(monkeypatch):
    monkeypatch.setattr("sources.oak.source.AGAIN_AFTER_S", 0.02)
    lost = InputError("gone")
    build = HostBuild(shots(3), shots(300), lost)
    with reading(oak(build, devices=TWO, stall_s=0.2)) as read:
        wait_for(lambda: len(read.of("left2")) >= 300)
    assert {item.epoch for item in read.of("left2")} == {0}


def test_a_device_that_is_absent_at_the_start_is_waited_for_if_the_configuration_says_so(caplog, monkeypatch):
    monkeypatch.setattr("sources.oak.source.AGAIN_AFTER_S", 0.02)
    absent = NotThereError("no OAK 'back' is found")
    with pytest.raises(InputError, match=r"no OAK 'back' is found \(wait: true waits for it\)"):
        oak(HostBuild(absent)).open()
    build = HostBuild(absent, absent, shots(5))
    with reading(oak(build, wait=True)) as read:
        wait_for(both_have(read, 5))
    assert {item.epoch for item in read.frames} == {0}
    assert "no OAK 'back' is found; waiting for it" in caplog.messages


def test_counters_that_fall_begin_a_new_epoch():
    with reading(oak(HostBuild([*shots(10), *shots(10)]))) as read:
        wait_for(both_have(read, 20))
    assert [item.epoch for item in read.of("right")] == [0] * 10 + [1] * 10


def test_a_device_that_does_not_answer_at_the_end_is_given_up(monkeypatch, caplog):
    monkeypatch.setattr("sources.oak.source.STOP_WITHIN_S", 0.1)
    build, never = HostBuild(shots(3)), threading.Event()

    def hanging(*arguments):
        return replace(build(*arguments), close=lambda: never.wait(20))

    began = time.monotonic()
    with reading(oak(hanging)) as read:
        wait_for(both_have(read, 3))
    assert time.monotonic() - began < 5
    never.set()
    assert "OAK host: its pipeline did not end within 0 s" in caplog.messages


def test_of_devices_that_cannot_all_be_opened_none_stays_open():
    build = HostBuild(shots(3), InputError("no OAK 'back' is found"))
    source = oak(build, devices=TWO)
    with pytest.raises(InputError, match="no OAK 'back' is found"):
        source.open()
    assert build.closed == 1


def test_it_can_be_closed_without_having_been_read():
    build = HostBuild(shots(3))
    source = oak(build)
    source.open()
    source.close()
    assert build.closed == 1
