"""What every method keeps to that asks which frame of the second camera belongs to the first's t."""

from __future__ import annotations

import functools
import io

import cv2
import numpy as np
import pytest

from pipeline.assemble import KINDS, assemble, build_source
from pipeline.cli.recording import RecordingOptions, recording_plan
from pipeline.frame import Frame, Picture, Window
from pipeline.run import Run
from pipeline.verdict import Evidence, Reason, State, Verdict
from sources.synthetic.settings import SyntheticSettings
from sources.synthetic.source import START_NS, SyntheticSource
from tests.frames import PERIOD_NS, RIG, frame, texture, window

METHODS = ("adaptive_window", "epipolar_classes", "orb", "spatial", "weighted_template")
COUNT = 40
LATE = range(COUNT - 10, COUNT - 2, 3)
"""Windows that are judged: those before are history."""

FPS = 30


@functools.cache
def scene(motion: str, *, colour: bool = False, gain: float = 1.0) -> dict[str, list[Picture]]:
    """COUNT pictures a camera."""
    settings = SyntheticSettings.model_validate(
        {"motion": motion, "width": 320, "height": 240, "colour": colour, "cameras": [{}, {"gain": gain}]}
    )
    source = SyntheticSource(settings, seed=3)
    source.open()
    moments_ns = [START_NS + round(n * 1e9 / FPS) for n in range(COUNT)]
    return {name: [source.picture_at(name, at_ns) for at_ns in moments_ns] for name in ("left", "right")}


def picture(camera: str, image: Picture, index: int) -> Frame:
    return frame(camera, index * PERIOD_NS, index, image=image)


def window_at(pictures: dict[str, list[Picture]], index: int, shift: int = 0) -> Window:
    right = tuple(picture("right", pictures["right"][n + shift], n) for n in (index - 1, index, index + 1))
    return window(index, left=picture("left", pictures["left"][index], index), right=right)


def said(method: str, windows: list[Window], **settings: object) -> list[Evidence]:
    kind = KINDS.tables["detectors"][method]
    plan = recording_plan(["nowhere"])
    chosen = kind.settings.model_validate(settings)
    detector = kind.build(chosen, name="it", rig=RIG, classic=False, plan=plan)
    return [one for each in windows for one in detector.observe(each)]


def over(method: str, pictures: dict[str, list[Picture]], shift: int = 0, **settings: object) -> list[Evidence]:
    """What is said of LATE; of all that come before, too, where they count as history."""
    steps = range(2, COUNT - 2) if method == "epipolar_classes" else LATE
    evidence = said(method, [window_at(pictures, n, shift) for n in steps], **settings)
    return [one for n, one in zip(steps, evidence, strict=True) if n in LATE]


def found(evidence: list[Evidence], shift: int) -> list[Evidence]:
    """What was decided: most, and all of it right."""
    decided = [one for one in evidence if one.state is not State.UNKNOWN]
    assert 3 * len(decided) >= 2 * len(LATE), [one.reason for one in evidence]
    assert {one.offset_frames for one in decided} == {shift}
    return decided


@pytest.mark.parametrize("shift", [0, 1, -1])
@pytest.mark.parametrize("method", METHODS)
def test_the_right_frame_is_found_while_the_rig_moves(method, shift):
    evidence = over(method, scene("handheld"), shift, always_answer=False)
    decided = found(evidence, shift)
    assert {(one.offset_ns, one.state) for one in decided} == {
        (shift * PERIOD_NS, State.ASYNC if shift else State.SYNC)
    }
    assert all("matches best" in one.reason for one in decided)


@pytest.mark.parametrize("method", METHODS)
def test_colour_is_judged_as_well_as_grey(method):
    found(over(method, scene("handheld", colour=True), 1, always_answer=False), 1)


@pytest.mark.parametrize("method", METHODS)
def test_a_darker_second_camera_is_no_hindrance(method):
    found(over(method, scene("handheld", gain=0.5), -1, always_answer=True), -1)


@pytest.mark.parametrize("method", METHODS)
def test_where_nothing_moves_it_abstains_and_says_that_candidates_are_alike(method):
    evidence = over(method, scene("still"), always_answer=False)
    assert {one.state for one in evidence} == {State.UNKNOWN}
    assert {one.silence for one in evidence} == {Reason.NO_MOTION}
    assert all("match alike" in one.reason and "chance" in one.reason for one in evidence)
    assert all(one.offset_frames is None for one in evidence)
    assert all(len(one.numbers) == 3 for one in evidence)


@pytest.mark.parametrize("method", METHODS)
def test_set_to_answer_always_it_answers_even_then(method):
    evidence = over(method, scene("still"), always_answer=True)
    assert all(one.offset_frames in {-1.0, 0.0, 1.0} for one in evidence)


@pytest.mark.parametrize("method", METHODS)
def test_of_equals_t_wins_or_nobody(method):
    same = {name: [pictures[0]] * COUNT for name, pictures in scene("still").items()}
    windows = [window_at(same, n) for n in range(2, 15)]
    assert {one.state for one in said(method, windows[:2], always_answer=True)} == {State.SYNC}
    *_, careful = said(method, windows, always_answer=False)
    assert careful.silence is Reason.NO_MOTION


@pytest.mark.parametrize("always_answer", [True, False])
@pytest.mark.parametrize("method", METHODS)
def test_pictures_of_nothing_are_unknown_for_want_of_texture(method, always_answer):
    flat = {name: [np.full((240, 320), 90, np.uint8)] * COUNT for name in ("left", "right")}
    evidence = over(method, flat, always_answer=always_answer)
    assert {(one.state, one.silence) for one in evidence} == {(State.UNKNOWN, Reason.NO_TEXTURE)}


@pytest.mark.parametrize("always_answer", [True, False])
@pytest.mark.parametrize("method", METHODS)
def test_pictures_of_a_few_pixels_do_not_stop_it(method, always_answer):
    for height, width in ((1, 1), (2, 3), (240, 1), (1, 700), (62, 63), (9, 640)):
        left, *right = (picture("right", texture(n, width, height), 1) for n in range(4))
        (evidence,) = said(method, [window(1, left=left, right=tuple(right))], always_answer=always_answer)
        assert evidence.reason, (height, width)


@pytest.mark.parametrize("method", METHODS)
def test_set_to_answer_always_it_makes_do_with_little_to_see(method):
    """A few corners in an empty picture, where it otherwise abstains."""
    moving = {
        name: [np.where(blob_mask(), image, 90).astype(np.uint8) for image in images]
        for name, images in scene("handheld").items()
    }
    assert State.UNKNOWN in {one.state for one in over(method, moving, always_answer=False)}
    bold = over(method, moving, always_answer=True)
    assert State.UNKNOWN not in {one.state for one in bold}, [one.reason for one in bold]


@functools.cache
def blob_mask() -> np.ndarray:
    mask = np.zeros((240, 320), bool)
    mask[108:136, 140:172] = True
    return mask


@pytest.mark.parametrize("method", METHODS)
def test_the_same_pictures_get_the_same_answer_whatever_random_numbers_were_drawn_before(method):
    windows = [window_at(scene("handheld"), n) for n in range(2, 10)]
    once = said(method, windows, always_answer=True)
    cv2.setRNGSeed(12345)
    assert said(method, windows, always_answer=True) == once


@pytest.mark.parametrize("method", METHODS)
def test_without_a_neighbour_of_t_it_answers_only_if_set_to(method):
    first = 2 if method == "epipolar_classes" else LATE[0]
    *whole, last = (window_at(scene("handheld"), n) for n in range(first, LATE[0] + 1))
    triple = last.cameras["right"]
    cut = window(LATE[0], left=last.cameras["left"].current, right=(None, triple.current, triple.following))
    *_, careful = said(method, [*whole, cut], always_answer=False)
    assert (careful.state, careful.silence) == (State.UNKNOWN, Reason.UNPAIRED)
    assert careful.reason == "no frame of right at t-1, which may be the one"
    *_, bold = said(method, [*whole, cut], always_answer=True)
    assert bold.state is State.SYNC


@pytest.mark.parametrize("method", METHODS)
def test_candidates_of_another_size_cannot_be_compared(method):
    moving = scene("handheld")
    small = picture("right", moving["right"][4][::2, ::2], 4)
    right = (small, picture("right", moving["right"][5], 5), picture("right", moving["right"][6], 6))
    (evidence,) = said(method, [window(5, left=picture("left", moving["left"][5], 5), right=right)])
    assert (evidence.state, evidence.reason) == (State.UNKNOWN, "picture sizes differ: left 320x240, right 160x120")


def test_they_work_together_on_a_recording(tmp_path):
    for camera, pictures in scene("handheld").items():
        (tmp_path / camera).mkdir()
        for n, image in enumerate(pictures[:6]):
            cv2.imwrite(str(tmp_path / camera / f"{n}.png"), image)
    plan = recording_plan([str(tmp_path)], RecordingOptions(fps=FPS), detectors=",".join(METHODS))
    source, reports = build_source(plan), []
    source.open()
    Run(assemble(plan, source, console=io.StringIO(), on_report=reports.append)).execute()
    verdicts = [report for report in reports if isinstance(report, Verdict)]
    assert len(verdicts) == 6
    assert {tuple(one.detector for one in verdict.evidence) for verdict in verdicts} == {METHODS}
    decided = {one.detector for verdict in verdicts for one in verdict.evidence if one.offset_frames == 0}
    assert decided == set(METHODS) - {"epipolar_classes"}
    warming = {one.silence for v in verdicts for one in v.evidence if one.detector == "epipolar_classes"}
    assert warming == {Reason.WARMING_UP}
