"""The report's Algorithm 3, against an independent reference and at its edges."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import pipeline.detectors.spatial as module
from pipeline.buffer import BufferSettings, WindowBuffer
from pipeline.detectors.spatial import SpatialDetector, SpatialSettings
from pipeline.frame import Camera, Frame, Pair, Picture, Rig
from pipeline.verdict import Evidence, State
from sources.replay.settings import ReplaySettings
from sources.replay.source import ReplaySource
from tests.frames import PERIOD_NS, RIG, frame, texture, window


def reference_winner(left: Picture, candidates: dict[int, Picture]) -> int:
    """The report's Algorithm 3 in plain numpy: explicit Sobel sums, explicit sliding, float64."""

    def gradient(image: Picture) -> npt.NDArray[np.float64]:
        p = np.pad(image.astype(np.float64), 1, mode="reflect")
        columns = p[:-2] + 2 * p[1:-1] + p[2:]
        rows = p[:, :-2] + 2 * p[:, 1:-1] + p[:, 2:]
        return np.hypot(columns[:, 2:] - columns[:, :-2], rows[2:] - rows[:-2])

    def best(target: npt.NDArray[np.float64]) -> float:
        views = np.lib.stride_tricks.sliding_window_view(target, width, axis=1)
        products = np.einsum("yxk,yk->x", views, template)
        return float((products / np.sqrt((template**2).sum() * np.einsum("yxk,yxk->x", views, views))).max())

    width = left.shape[1] // 2
    start = (left.shape[1] - width) // 2
    template = gradient(left)[:, start : start + width]
    return max(candidates, key=lambda offset: (best(gradient(candidates[offset])), offset == 0))


def detector(rig: Rig = RIG) -> SpatialDetector:
    return SpatialDetector(SpatialSettings(), name="spatial", rig=rig)


def picture(camera: str, image: Picture, index: int = 0) -> Frame:
    return frame(camera, index * PERIOD_NS, index, image=image)


def said(left: Picture, previous: Picture | None, current: Picture | None, following: Picture | None) -> Evidence:
    right = [None if image is None else picture("right", image) for image in (previous, current, following)]
    (evidence,) = detector().observe(window(left=picture("left", left), right=(right[0], right[1], right[2])))
    return evidence


A, B, C = (texture(seed) for seed in range(3))


@pytest.mark.parametrize(
    ("right", "state", "offset"),
    [((A, B, C), State.ASYNC, 1.0), ((C, A, B), State.SYNC, 0.0), ((B, C, A), State.ASYNC, -1.0)],
)
def test_the_frame_that_looks_like_the_left_one_tells_the_offset(right, state, offset):
    evidence = said(A, *right)
    assert (evidence.state, evidence.offset_frames, evidence.offset_ns) == (state, offset, offset * PERIOD_NS)


def test_a_tie_goes_to_t():
    assert said(A, B, B, B).state is State.SYNC


def test_at_the_ends_the_candidates_are_those_that_exist():
    first, last = said(A, None, B, A), said(A, A, B, None)
    assert (first.offset_frames, last.offset_frames) == (-1.0, 1.0)
    assert said(A, None, B, None).state is State.SYNC


def test_a_horizontal_shift_of_the_view_is_slid_over():
    shifted = np.roll(A, 9, axis=1)
    assert said(A, B, shifted, C).state is State.SYNC


@pytest.mark.parametrize(
    ("left", "current", "reason"),
    [
        (A, None, "no frame of right"),
        (A, texture(3, width=80), "picture sizes differ: left 64x48, right 80x48"),
        (A, np.full_like(A, 7), "no edges in the pictures"),
        (np.zeros_like(A), A, "no edges in the pictures"),
    ],
)
def test_what_cannot_be_compared_is_unknown_and_says_why(left, current, reason):
    evidence = said(left, None, current, None)
    assert (evidence.state, evidence.reason) == (State.UNKNOWN, reason)


def test_colour_is_judged_as_grey():
    coloured = np.repeat(A[:, :, None], 3, axis=2)
    assert said(coloured, B, coloured, C).state is State.SYNC


def test_a_gradient_is_computed_once_a_frame(monkeypatch):
    calls = []
    genuine = module.gradient_magnitude
    monkeypatch.setattr(module, "gradient_magnitude", lambda image: calls.append(1) or genuine(image))
    cameras = tuple(Camera(name, 10) for name in ("a", "b", "c"))
    rig = Rig("bench", cameras, (Pair("a", "b"), Pair("a", "c")))
    test, buffer = detector(rig), WindowBuffer(cameras, BufferSettings())
    frames = [frame(c.name, n * PERIOD_NS, n, group=n, image=texture(n)) for n in range(6) for c in cameras]
    windows = [made for item in frames for made in buffer.push(item)] + list(buffer.flush())
    for made in windows:
        test.observe(made)
    assert len(calls) == len(frames)


@settings(max_examples=30)
@given(st.integers(0, 10_000))
def test_it_agrees_with_the_reference_on_noise(seed):
    left, *right = (texture(seed * 4 + k, 33, 21) for k in range(4))
    blend = np.asarray(0.5 * left + 0.5 * right[seed % 3], np.uint8)
    right[seed % 3] = blend
    expected = reference_winner(left, {1: right[0], 0: right[1], -1: right[2]})
    assert said(left, *right).offset_frames == expected


def test_it_agrees_with_the_reference_on_every_frame_of_a_recording(recordings):
    source = ReplaySource(ReplaySettings(path=str(recordings / "boof_backyard"), fps=10), base=recordings)
    source.open()
    test, buffer = detector(), WindowBuffer(source.cameras, BufferSettings())
    windows = [made for item in source.frames() for made in buffer.push(item)] + list(buffer.flush())
    source.close()
    assert len(windows) == 191
    for made in windows:
        left, right = made.cameras["left"].current, made.cameras["right"]
        frames = {1: right.previous, 0: right.current, -1: right.following}
        candidates = {offset: grey(item.image) for offset, item in frames.items() if item is not None}
        (evidence,) = test.observe(made)
        assert evidence.offset_frames == reference_winner(grey(left.image), candidates), made.index


def grey(image: Picture) -> Picture:
    """Rec. 601 luma, rounded as 8-bit pictures are."""
    if image.ndim == 2:
        return image
    return np.asarray(np.rint(image @ np.array([0.114, 0.587, 0.299])), np.uint8)


def staggered(offset_frames: float) -> Rig:
    return Rig("bench", RIG.cameras, (Pair("left", "right", round(offset_frames * PERIOD_NS)),))


def test_a_pair_staggered_by_whole_frames_is_in_sync_when_it_matches_that_frame():
    right = (picture("right", A), picture("right", B), picture("right", C))
    (evidence,) = detector(staggered(1)).observe(window(left=picture("left", A), right=right))
    assert (evidence.state, evidence.offset_frames) == (State.SYNC, 1.0)
    (evidence,) = detector(staggered(0)).observe(window(left=picture("left", A), right=right))
    assert evidence.state is State.ASYNC


def test_a_pair_staggered_by_half_a_frame_is_beyond_it():
    (evidence,) = detector(staggered(0.5)).observe(window(left=picture("left", A), right=picture("right", A)))
    assert evidence.state is State.UNKNOWN
    assert evidence.reason == "an expected offset of 0.50 frames lies between whole frames"


@pytest.mark.parametrize("picture_of", ["gradient", "grey"])
@pytest.mark.parametrize("correlation", ["plain", "zero_mean"])
def test_every_variant_finds_the_frame_that_looks_like_the_left_one(picture_of, correlation):
    chosen = SpatialSettings(picture=picture_of, correlation=correlation)
    right = (picture("right", A), picture("right", B), picture("right", C))
    test = SpatialDetector(chosen, name="spatial", rig=RIG)
    (evidence,) = test.observe(window(left=picture("left", A), right=right))
    assert evidence.offset_frames == 1.0


def test_plain_correlation_of_grey_pictures_takes_bright_for_alike_and_zero_mean_does_not():
    bright = np.asarray(np.clip(B / 8 + 200, 0, 255), np.uint8)
    right = (picture("right", bright), picture("right", np.asarray(A // 4, np.uint8)), picture("right", bright))
    dim = np.asarray(A // 8 + 100, np.uint8)
    answers = {}
    for correlation in ("plain", "zero_mean"):
        chosen = SpatialSettings(picture="grey", correlation=correlation)
        (evidence,) = SpatialDetector(chosen, name="spatial", rig=RIG).observe(
            window(left=picture("left", dim), right=right)
        )
        answers[correlation] = evidence.offset_frames
    assert answers["zero_mean"] == 0
    assert answers["plain"] != 0


@pytest.mark.parametrize("correlation", ["plain", "zero_mean"])
def test_grey_pictures_without_contrast_are_unknown(correlation):
    chosen = SpatialSettings(picture="grey", correlation=correlation)
    black = np.zeros_like(A)
    right = (picture("right", black), picture("right", black), picture("right", black))
    (evidence,) = SpatialDetector(chosen, name="spatial", rig=RIG).observe(
        window(left=picture("left", black), right=right)
    )
    assert (evidence.state, evidence.reason) == (State.UNKNOWN, "no contrast in the pictures")


@pytest.mark.parametrize("zero_mean", [True, False])
def test_the_mean_over_bands_is_the_correlation(zero_mean):
    method = module.cv2.TM_CCOEFF_NORMED if zero_mean else module.cv2.TM_CCORR_NORMED
    template, target = (np.asarray(each, np.float32) for each in (A[:, 16:48], B))
    best, x = module.best_place(template, target, method)
    bands = module.by_bands(template, target[:, x : x + 32], zero_mean=zero_mean)
    assert bands.mean() == pytest.approx(best, abs=1e-4)
