"""Taps of somebody's own depthai pipeline, on nodes of this machine."""

from __future__ import annotations

from contextlib import contextmanager
from importlib.util import find_spec

import numpy as np
import pytest

if find_spec("depthai") is None:
    pytest.skip("depthai is not installed: make test-oak installs it", allow_module_level=True)

from pipeline.verdict import Cause, State
from syncwatch import Monitor
from syncwatch.oak import tap
from tests.network import wait_for
from tests.oak import HostRig, dai, shots

CONFIG = {"detectors": {"timestamp": {}}}
CAMERAS = {"left": 30, "right": 30}


@contextmanager
def tapped(monitor, script, cameras=("left", "right")):
    pipeline = dai.Pipeline(createImplicitDevice=False)
    rig = pipeline.create(HostRig)
    rig.shots, rig.pace_s = script, 0.01
    taps = tap(pipeline, monitor, dict(zip(cameras, (rig.left, rig.right), strict=True)))
    pipeline.start()
    try:
        yield rig
    finally:
        pipeline.stop()
        pipeline.wait()
        assert len(taps) == 2


@pytest.mark.parametrize(("right_us", "state"), [(0, State.SYNC), (12_000, State.ASYNC)])
def test_what_the_device_says_is_judged(right_us, state):
    with Monitor(CONFIG, CAMERAS) as monitor, tapped(monitor, shots(60, right_us=right_us)) as rig:
        assert rig.done.wait(10)
        said = list(monitor.verdicts(timeout_s=0.3))
    numbered = [one for one in said if one.frame is not None]
    assert numbered[-1].state is state
    assert numbered[-1].sequence["left"] == numbered[-1].sequence["right"]


def test_a_counter_that_falls_is_a_restart_of_the_camera():
    with Monitor(CONFIG, CAMERAS) as monitor, tapped(monitor, [*shots(20), *shots(20)]) as rig:
        assert rig.done.wait(10)
    assert {name: camera.restarts for name, camera in monitor.status.cameras.items()} == {"left": 1, "right": 1}


def test_a_camera_that_delivers_nothing_is_missing():
    with Monitor(CONFIG, CAMERAS) as monitor, tapped(monitor, shots(150, right=False)):
        wait_for(lambda: [one for one in monitor.verdicts(timeout_s=0) if one.cause is Cause.MISSING])


def test_a_picture_that_cannot_be_taken_is_said_once_and_the_pipeline_lives(caplog):
    script = [*shots(3), *shots(20, first=3, image=np.zeros((8, 8), np.uint8)), *shots(3, first=23)]
    with Monitor(CONFIG, CAMERAS) as monitor, tapped(monitor, script) as rig:
        assert rig.done.wait(10)
        wait_for(lambda: len(caplog.messages) >= 2)
    refusals = [line for line in caplog.messages if "8x8 pixels, but the pictures before had 6x4" in line]
    assert len(refusals) == 2


def test_a_monitor_that_has_ended_does_not_end_the_pipeline():
    monitor = Monitor(CONFIG, CAMERAS)
    with tapped(monitor, shots(40)) as rig:
        monitor.close()
        assert rig.done.wait(10)


def test_a_name_the_monitor_does_not_know_is_said(caplog):
    with Monitor(CONFIG, CAMERAS) as monitor, tapped(monitor, shots(5), cameras=("left", "rihgt")) as rig:
        assert rig.done.wait(10)
        wait_for(lambda: "no camera 'rihgt': this rig has left, right" in caplog.messages)
