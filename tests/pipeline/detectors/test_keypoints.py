"""Matching corners: which are the same, which agree on a geometry, and of which class that is."""

from __future__ import annotations

import numpy as np
import pytest

from pipeline.assemble import KINDS
from pipeline.cli.replay import recording_plan
from pipeline.configtext.document import ConfigError
from pipeline.detectors.epipolar_classes import classify, distances, fitted, moments_of
from pipeline.detectors.keypoints import keypoints, of_one_geometry, same
from pipeline.detectors.orb import in_rows
from pipeline.verdict import State
from tests.frames import RIG, texture
from tests.pipeline.detectors.test_candidates import LATE, over, scene

CHANCE = np.random.default_rng(1)


def seen_from(position: np.ndarray, turn: np.ndarray, points: np.ndarray) -> np.ndarray:
    """N x 3 rays, in half widths of a camera with a view of 90 degrees, to points in space."""
    local = (points - position) @ turn.T
    return local / local[:, 2:]


def rotation(pitch: float, yaw: float) -> np.ndarray:
    (sp, cp), (sy, cy) = ((np.sin(a), np.cos(a)) for a in (pitch, yaw))
    return np.array([[1, 0, 0], [0, cp, -sp], [0, sp, cp]]) @ np.array([[cy, 0, sy], [0, 1, 0], [-sy, 0, cy]])


POINTS = np.column_stack([CHANCE.uniform(-2, 2, 120), CHANCE.uniform(-1.5, 1.5, 120), CHANCE.uniform(2, 8, 120)])
FIRST = seen_from(np.zeros(3), np.eye(3), POINTS)
ASIDE = seen_from(np.array([0.3, 0, 0]), np.eye(3), POINTS)
AHEAD = seen_from(np.array([0.0, 0, 0.5]), np.eye(3), POINTS)


def kind_of(second):
    return classify(fitted([moments_of(FIRST, second)]), FIRST, second, half_px=320)


def test_cameras_side_by_side_have_their_epipoles_at_infinity():
    kind = kind_of(ASIDE)
    assert (kind.first_infinite, kind.second_infinite, kind.full_rank, kind.even, kind.tight) == (
        True, True, False, True, True,
    )  # fmt: skip


def test_a_camera_ahead_of_the_other_is_seen_by_it():
    kind = kind_of(AHEAD)
    assert (kind.first_infinite, kind.second_infinite, kind.full_rank, kind.tight) == (False, False, False, True)


def test_a_scene_that_is_not_rigid_fits_loosely():
    assert not kind_of(ASIDE + np.column_stack([CHANCE.normal(0, 0.02, (120, 2)), np.zeros(120)])).tight


def test_distances_are_those_from_epipolar_lines():
    matrix = fitted([moments_of(FIRST, ASIDE)])
    assert distances(matrix, FIRST, ASIDE).max() < 1e-6
    lower = ASIDE + np.array([0, 0.01, 0])
    assert distances(matrix, FIRST, lower) == pytest.approx(np.full(120, 0.01), rel=0.01)


def test_matches_that_no_geometry_explains_are_left_out():
    first = np.asarray(320 + 320 * FIRST[:, :2], np.float32)
    second = np.asarray(320 + 320 * ASIDE[:, :2], np.float32)
    second[:30] += CHANCE.uniform(20, 60, (30, 2)).astype(np.float32)
    agree = of_one_geometry(first, second, 1.0)
    assert agree[30:].mean() > 0.9
    assert agree[:30].mean() < 0.3
    assert np.array_equal(agree, of_one_geometry(first, second, 1.0))


@pytest.mark.parametrize("count", [0, 3, 7])
def test_too_few_matches_have_no_geometry(count):
    points = np.zeros((count, 2), np.float32)
    assert not of_one_geometry(points, points, 1.0).any()
    assert len(in_rows(points, points, 1.0)) == count


def test_matches_all_in_one_place_do_not_stop_it():
    points = np.full((40, 2), 12.0, np.float32)
    assert len(of_one_geometry(points, points, 1.0)) == 40


def test_rows_may_be_shifted_alike():
    first = np.asarray(CHANCE.uniform(0, 300, (50, 2)), np.float32)
    second = first + np.float32([9, 4])
    second[:5, 1] += 3
    assert list(np.flatnonzero(~in_rows(first, second, 1.0))) == [0, 1, 2, 3, 4]


def test_the_corners_of_a_shifted_picture_are_the_same():
    wide = texture(2, 340, 240)
    first, second = keypoints(wide[:, :320], 300), keypoints(wide[:, 20:], 300)
    here, there = same(first, second, 0.8)
    assert len(here) > 100
    assert list(here) == sorted(here)
    shift = second.at[there] - first.at[here]
    assert np.median(shift, axis=0) == pytest.approx([-20, 0], abs=0.5)


def test_pictures_without_corners_match_nowhere():
    nothing, something = keypoints(np.zeros((60, 80), np.uint8), 100), keypoints(texture(1), 100)
    assert len(nothing.at) == 0
    assert [len(places) for places in same(nothing, something, 0.8)] == [0, 0]


def test_orb_may_take_any_epipolar_geometry_in_place_of_rows():
    evidence = over("orb", scene("handheld"), 1, geometry="epipolar", always_answer=True)
    assert [one.offset_frames for one in evidence] == [1.0] * len(LATE)


@pytest.mark.parametrize(
    ("settings", "told"),
    [
        ("orb: {ratio: 2}", "ratio"),
        ("adaptive_window: {arms_px: [3, 6]}", "arms_px"),
        ("adaptive_window: {arms_px: [3, 6, -1]}", "arms_px"),
        ("weighted_template: {points: 1}", "points"),
        ("epipolar_classes: {history: 3}", "history"),
        ("spatial: {picture: colour}", "picture"),
    ],
)
def test_settings_out_of_bounds_are_refused(settings, told):
    with pytest.raises(ConfigError, match=told):
        recording_plan(["nowhere"], overrides=[f"detectors={{{settings}}}"])


def test_a_history_is_bounded():
    kind = KINDS.tables["detectors"]["epipolar_classes"]
    detector = kind.build(kind.settings.model_validate({"history": 20}), name="it", rig=RIG)
    assert {each.maxlen for each in detector._histories.values()} == {20}
    assert State.UNKNOWN in {one.state for one in over("epipolar_classes", scene("still"))}
