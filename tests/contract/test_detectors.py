"""What every kind of detector promises."""

from __future__ import annotations

import numpy as np
import pytest

from pipeline.assemble import KINDS
from pipeline.cli.recording import recording_plan
from pipeline.frame import Camera, Detector, Frame, Pair, Rig, Window
from pipeline.verdict import State
from tests.frames import PERIOD_NS, frame, texture, window

CAMERAS = tuple(Camera(name, 10) for name in ("a", "b", "c"))
RIG = Rig("bench", CAMERAS, (Pair("a", "b"), Pair("a", "c")))


@pytest.fixture(params=sorted(KINDS.tables["detectors"]))
def detector(request) -> Detector:
    kind = KINDS.tables["detectors"][request.param]
    plan = recording_plan(["nowhere"])
    made: Detector = kind.build(kind.settings.model_validate({}), name="it", rig=RIG, classic=False, plan=plan)
    return made


def at(t: int, camera: str, size: int = 96) -> Frame:
    scene = texture(7, 300, 200)
    top = 20 + (t * 5) % 23
    image = np.ascontiguousarray(scene[top : top + size * 3 // 4, t % 9 : t % 9 + size])
    return frame(camera, t * PERIOD_NS, t, group=t, image=image)


def windows(count: int, **holes: int) -> list[Window]:
    """A moving picture; a camera may miss one frame."""
    made = []
    for t in range(1, count):
        triples = {}
        for camera in CAMERAS:
            around = tuple(None if holes.get(camera.name) == k else at(k, camera.name) for k in (t - 1, t, t + 1))
            triples[camera.name] = around
        made.append(window(t, **triples))
    return made


def test_every_pair_gets_one_piece_of_evidence_under_the_detectors_name(detector):
    for made in windows(6):
        evidence = detector.observe(made)
        assert [(item.pair, item.detector) for item in evidence] == [("a-b", "it"), ("a-c", "it")]
        assert all(item.reason for item in evidence)


def test_a_hole_makes_its_own_pair_unknown_and_no_other(detector):
    for made in windows(8, b=4):
        evidence = {item.pair: item for item in detector.observe(made)}
        if made.index == 4:
            assert evidence["a-b"].state is State.UNKNOWN
            assert evidence["a-b"].offset_frames is None


def test_windows_may_be_missing(detector):
    for made in windows(12)[::3]:
        assert len(detector.observe(made)) == 2


def test_cameras_of_different_sizes_do_not_stop_it(detector):
    small = {"a": at(0, "a"), "b": at(0, "b", 64), "c": at(0, "c")}
    assert len(detector.observe(window(0, **small))) == 2


def test_it_does_not_write_to_the_pictures(detector):
    made = windows(2)[0]
    before = made.cameras["a"].current.image.copy()
    detector.observe(made)
    assert np.array_equal(before, made.cameras["a"].current.image)
