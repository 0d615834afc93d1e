"""The content offset: its regression on simulated points, its motion signals, and whole runs on pictures."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from pipeline.detectors.offset.blocks import Block
from pipeline.detectors.offset.drift import Drift
from pipeline.detectors.offset.geometry import Memory, design
from pipeline.detectors.offset.motion_signal import MotionSignal, signal_offset
from pipeline.detectors.offset.regression import halves, learn, solve
from pipeline.detectors.offset.working import work_on
from pipeline.verdict import State
from sources.replay.settings import ReplaySettings
from sources.replay.source import ReplaySource
from tests.observe import observed, pictures, rendered

TERMS = np.array([0.01, 0.005, -0.003, 0.002, 0.004, -0.002, 0.003, 0.001])
WIDTH = 640.0


def simulated(tau, frames=12, points=80, speed=1.5, noise=0.1, seed=0, terms=TERMS):
    """Blocks of points of a rig whose second camera is `tau` frames later, moving up and down."""
    rng = np.random.default_rng(seed)
    u, v = rng.uniform(-0.5, 0.5, points), rng.uniform(-0.35, 0.35, points)
    blocks = []
    for index in range(frames):
        my = speed * (rng.standard_normal() + 0.3 * rng.standard_normal(points))
        dx = -rng.uniform(5, 60, points)
        dy = design(u, v, dx / WIDTH) @ terms * WIDTH + tau * my + noise * rng.standard_normal(points)
        jitter = noise / 2 * rng.standard_normal(points)
        blocks.append(block(index, u, v, dx, dy, my + jitter, variance=(noise / 2) ** 2))
    return blocks


def block(index, u, v, dx, dy, my, variance=0.0):
    """A block of points that move across the rows at constant speed."""
    path = np.zeros((len(u), 4))
    path[:, 0] = my
    return Block(
        index, 0, WIDTH, np.arange(len(u)), np.ones(len(u), np.int64), u, v, dx, dy, path, path[:, :2],
        np.zeros(len(u)), np.full(len(u), variance), 0.0,
    )  # fmt: skip


@pytest.mark.parametrize("tau", [-0.75, 0.0, 0.25, 1.0])
def test_geometry_and_offset_are_recovered_together(tau):
    fit = solve(simulated(tau), Memory(), 0.0)
    assert fit.tau == pytest.approx(tau, abs=0.02)
    assert fit.motion_px > 1


def test_the_error_bar_holds_the_truth():
    fits = [solve(simulated(0.3, noise=0.3, seed=seed), Memory(), 0.0) for seed in range(60)]
    held = np.mean([abs(fit.tau - 0.3) < 2 * fit.sigma for fit in fits])
    assert held >= 0.85
    assert np.median([fit.sigma for fit in fits]) < 0.05


def test_without_motion_most_of_what_moves_is_noise():
    fit = solve(simulated(0.5, speed=0.0), Memory(), 0.0)
    assert fit.motion_px < fit.scale_px


def test_a_lasting_offset_is_not_learned_as_geometry():
    memory = Memory()
    for seed in range(40):
        blocks = simulated(1.0, frames=6, seed=seed)
        fit = solve(blocks, memory, 1.0)
        learn(memory, blocks[0], fit)
    assert fit.tau == pytest.approx(1.0, abs=0.03)
    assert memory.terms == pytest.approx(TERMS, abs=0.002)


def test_constant_forward_speed_keeps_the_offset_near_the_truth_by_the_prior():
    """Motion proportional to y d is what a camera mounted ahead of the other would show."""
    rng = np.random.default_rng(1)
    u, v = rng.uniform(-0.5, 0.5, 200), rng.uniform(-0.3, 0.3, 200)
    blocks = []
    for index in range(12):
        dx = -rng.uniform(5, 60, 200)
        my = v * -dx * 2
        dy = my + 0.1 * rng.standard_normal(200)
        blocks.append(block(index, u, v, dx, dy, my))
    fit = solve(blocks, Memory(), 0.0)
    assert abs(fit.tau - 1) < 3 * fit.sigma
    assert fit.tau > 0.8


@pytest.mark.parametrize("lag", [-3, 0, 4])
def test_the_lag_of_two_pans_is_found_from_the_motion_of_whole_pictures(lag):
    rng = np.random.default_rng(2)
    path = np.cumsum(cv2.GaussianBlur(rng.standard_normal((120, 1)), (1, 9), 2).ravel() * 6)
    texture = cv2.GaussianBlur(rng.integers(0, 256, (120, 600), np.uint8), (0, 0), 3)
    texture = cv2.normalize(texture, None, 0, 255, cv2.NORM_MINMAX)

    def shown(t):
        shift = np.float32([[1, 0, -200 + path[t]], [0, 1, 0]])
        return work_on(cv2.warpAffine(texture, shift, (160, 120), borderMode=cv2.BORDER_REFLECT), 640)

    first, second = MotionSignal(10), MotionSignal(10)
    for t in range(11, 109):
        first.add(t, shown(t - 1), shown(t))
        second.add(t, shown(t + lag - 1), shown(t + lag))
    found = signal_offset(first, second, 10)
    assert found is not None
    assert abs(found.tau - lag) < max(2 * found.sigma, 0.1)
    assert found.sigma < 0.2


def test_two_motions_that_have_nothing_in_common_have_no_lag():
    rng = np.random.default_rng(3)
    first, second = MotionSignal(10), MotionSignal(10)
    for signal in (first, second):
        values = np.abs(cv2.GaussianBlur(rng.standard_normal((150, 3)), (1, 9), 2))
        signal.values.extend(enumerate(values))
    assert signal_offset(first, second, 10) is None


def test_halves_of_the_points_agree_on_a_true_offset_and_name_leaked_geometry():
    memory = Memory()
    blocks = simulated(0.4, frames=16)
    fit = solve(blocks, memory, 0.0)
    found = halves(blocks, memory, fit)
    for name in ("odd", "even", "up", "down", "slow", "fast", "near", "far"):
        assert abs(found[f"{name}_frames"] - 0.4) < 3 * found[f"{name}_sigma_frames"] + 0.01


def test_an_error_that_is_underrated_is_learned_from_how_the_estimate_wanders():
    rng = np.random.default_rng(4)
    honest, bragging = Drift(16), Drift(16)
    for index in range(0, 640, 16):
        error = 0.03 * rng.standard_normal()
        honest.add(index, error, 0.03)
        bragging.add(index, error, 0.01)
    assert honest.calibrated
    assert honest.factor < 1.5
    assert 2 < bragging.factor < 4.5


def test_a_steady_drift_of_the_clock_is_no_error():
    drift = Drift(16)
    for index in range(0, 640, 16):
        drift.add(index, 0.0004 * index, 0.01)
    assert drift.factor == 1


@pytest.fixture(scope="module")
def handheld():
    return pictures(rendered(motion="handheld", duration_s=1.7), 50)


@pytest.mark.parametrize("shift", [0, 1, -2])
def test_a_rendered_handheld_rig_is_measured_from_the_first_frame_on(handheld, shift):
    left, right = handheld
    if shift:
        left, right = (left[:-shift], right[shift:]) if shift > 0 else (left[-shift:], right[:shift])
    late = observed(left, right, 30)[25:-1]
    assert all(e.state is (State.ASYNC if shift else State.SYNC) for e in late)
    assert all(abs(e.offset_frames - shift) < 0.05 for e in late)


def test_a_slip_is_seen_within_ten_frames(handheld):
    left, right = handheld
    found = observed(left, right[:32] + right[33:], 30)
    onset = next(n for n, e in enumerate(found) if n >= 32 and e.state is State.ASYNC and e.offset_frames > 0.5)
    assert onset - 32 <= 10


def test_holes_are_survived_and_said(handheld):
    left, right = (list(side) for side in handheld)
    right[20] = None
    found = observed(left, right, 30)
    assert (found[20].state, found[20].reason) == (State.UNKNOWN, "no frame of right")
    assert found[-2].state is State.SYNC


def test_a_still_scene_is_never_decided():
    found = observed(*pictures(rendered(motion="still", duration_s=1.2), 35), 30)
    assert {e.state for e in found} == {State.UNKNOWN}


def test_black_pictures_are_never_decided():
    black = [np.zeros((120, 160), np.uint8)] * 25
    assert {e.state for e in observed(black, black)} == {State.UNKNOWN}


@pytest.mark.parametrize("shift", [0, 1])
def test_driving_is_measured_on_real_pictures(recordings, shift):
    left, right = pictures(ReplaySource(ReplaySettings(path="kitti_odo_seq1", fps=10), base=recordings), 36)
    late = observed(left[: 36 - shift], right[shift:])[22:-1]
    assert all(e.state is (State.ASYNC if shift else State.SYNC) for e in late)
    assert all(abs(e.offset_frames - shift) < 0.05 for e in late)


@pytest.mark.parametrize("shift", [0, 2])
def test_codec_flicker_is_never_decided(recordings, shift):
    left, right = pictures(ReplaySource(ReplaySettings(path="robot_static", fps=30), base=recordings), 60)
    assert {e.state for e in observed(left[: 60 - shift], right[shift:], 30)} == {State.UNKNOWN}
