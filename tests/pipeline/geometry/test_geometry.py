"""Cameras that were knocked, that creep, or that were exchanged."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
import yaml

from pipeline.assemble import KINDS, build_rig, build_source
from pipeline.buffer import WindowBuffer
from pipeline.configtext.document import load_text
from pipeline.frame import Frame, Picture, Triple, Window
from pipeline.geometry.rig import Finding, RigGeometry
from pipeline.plan import make_plan
from tests.frames import RIG, frame, window

ROOM = {"type": "synthetic", "duration_s": 11, "fps": 10, "width": 320, "height": 240}


def findings(source: dict[str, Any], *faults: dict[str, Any], base: Path = Path()) -> list[tuple[float, Finding]]:
    """What is found, each with the stream time in seconds."""
    config = {"source": source, "faults": list(faults), "detectors": {"timestamp": {}}}
    plan = make_plan(load_text(yaml.safe_dump(config), "test", {}, quoted=False), KINDS, base)
    footage = build_source(plan)
    footage.open()
    rig = build_rig(plan, footage)
    geometry, fps = RigGeometry(rig), rig.cameras[0].fps
    found = [(each.index / fps, one) for each in windows(footage.frames(), rig, plan) for one in geometry.see(each)]
    footage.close()
    return found


def windows(frames: Iterator[Frame], rig: Any, plan: Any) -> Iterator[Window]:
    buffer = WindowBuffer(rig.cameras, plan.config.buffer)
    for item in frames:
        yield from buffer.push(item)
    yield from buffer.flush()


@pytest.mark.parametrize("motion", ["handheld", "drive", "still"])
def test_a_scene_that_moves_is_no_knock(motion):
    assert findings({**ROOM, "motion": motion}) == []


@pytest.mark.parametrize(("turn", "roll_deg"), [("roll_deg", 0.5), ("roll_deg", -1.0), ("pitch_deg", 0.6)])
@pytest.mark.parametrize("motion", ["handheld", "still"])
def test_a_knock_is_told_within_seconds_and_measured(motion, turn, roll_deg):
    knock = {"type": "knock", turn: roll_deg, "start_s": 6}
    ((at_s, found),) = findings({**ROOM, "motion": motion}, knock)
    assert (found.kind, found.phase, found.pair) == ("geometry_shift", "onset", "left-right")
    assert 6 < at_s < 9
    told = found.worst["roll_deg"]
    assert told is not None
    assert told == pytest.approx(roll_deg if turn == "roll_deg" else 0, abs=0.1)
    if turn == "pitch_deg":
        assert found.worst["shift_px"] == pytest.approx(math.radians(roll_deg) * 0.7 * 320, abs=0.5)


def test_a_knock_that_is_put_right_ends():
    found = findings({**ROOM, "duration_s": 14, "motion": "still"}, {"type": "knock", "start_s": 5, "stop_s": 10})
    assert [one.phase for _, one in found] == ["onset", "end"]
    assert found[1][0] > 10


def turned(image: Picture, degrees: float) -> Picture:
    height, width = image.shape[:2]
    matrix = cv2.getRotationMatrix2D(((width - 1) / 2, (height - 1) / 2), degrees, 1.0)
    return np.asarray(cv2.warpAffine(image, matrix, (width, height), borderMode=cv2.BORDER_REFLECT_101), np.uint8)


def test_a_creep_adds_up_to_a_shift():
    config = {"source": {**ROOM, "duration_s": 1, "motion": "still"}, "detectors": {"timestamp": {}}}
    plan = make_plan(load_text(yaml.safe_dump(config), "test", {}, quoted=False), KINDS, Path())
    footage = build_source(plan)
    footage.open()
    first, second = (next(f for f in footage.frames() if f.camera == name) for name in ("left", "right"))
    geometry = RigGeometry(RIG)
    found = []
    for n in range(300):
        creeping = replace(second, image=turned(second.image, max(0, n - 60) * 0.5 / 240))
        seen = Window(n, {"left": Triple(first, first, first, n), "right": Triple(None, creeping, None, n)})
        found += [(n, one) for one in geometry.see(seen)]
    ((at, creep),) = found
    assert creep.kind == "geometry_shift"
    assert 100 < at < 300


@pytest.mark.parametrize(("motion", "start_s"), [("handheld", 0), ("drive", 0), ("handheld", 6), ("still", 6)])
def test_exchanged_cameras_are_told(motion, start_s):
    source = {**ROOM, "fps": 20, "width": 480, "height": 360, "motion": motion}
    found = findings(source, {"type": "swap", "start_s": start_s})
    assert [(one.kind, one.phase) for _, one in found] == [("swapped", "onset")]
    assert start_s < found[0][0] < start_s + 11


def test_without_motion_cameras_that_were_always_exchanged_are_not_accused():
    assert findings({**ROOM, "motion": "still"}, {"type": "swap"}) == []


@pytest.mark.parametrize("recording", ["kitti_odo_seq1", "euroc_v101_start", "webcams_loose", "robot_static"])
def test_nothing_is_found_in_real_recordings(recording, recordings):
    assert findings({"type": "replay", "path": str(recordings / recording)}) == []


@pytest.mark.parametrize(
    "pictures",
    [
        (np.zeros((120, 160), np.uint8), np.zeros((120, 160), np.uint8)),
        (np.zeros((3, 3), np.uint8), np.zeros((120, 160, 3), np.uint8)),
        (np.full((120, 160), 255, np.uint8), np.zeros((240, 320), np.uint8)),
    ],
)
def test_pictures_with_nothing_in_them_tell_nothing(pictures: Sequence[Picture]):
    geometry = RigGeometry(RIG)
    for n in range(100):
        left, right = (frame(name, n, image=image) for name, image in zip(("left", "right"), pictures, strict=True))
        assert geometry.see(window(n, left=left, right=right if n % 3 else None)) == []


def test_pairs_that_are_out_of_sync_are_not_looked_at():
    geometry = RigGeometry(RIG)
    broken = frame("left", 0, image=np.zeros((2, 2), np.uint8))
    assert geometry.see(window(0, left=broken, right=broken), apart={"left-right"}) == []
