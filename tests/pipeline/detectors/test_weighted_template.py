"""Weighted templates: what two patches are worth to each other, and which matches are removed."""

from __future__ import annotations

import numpy as np
import pytest

from pipeline.detectors.weighted_template import astray, best_of, corners, normalised, patches, similarity
from tests.frames import texture


def alike(first, second) -> float:
    one, other = (normalised(np.asarray(each, np.float32).reshape(1, 1, -1)) for each in (first, second))
    return float(similarity(one, other)[0, 0])


PATCH = texture(5)[10:21, 20:31]


def test_the_same_patch_in_other_light_is_the_same():
    assert alike(PATCH, PATCH) == pytest.approx(1)
    assert alike(PATCH, 0.4 * PATCH + 70) == pytest.approx(1, abs=1e-4)


def test_pixels_that_differ_weigh_less_than_in_plain_correlation():
    stained = PATCH.astype(np.float32)
    stained[:3, :3] = 255
    one, other = (normalised(np.asarray(each, np.float32).reshape(1, 1, -1)) for each in (PATCH, stained))
    assert alike(PATCH, stained) < 1
    weights = 1 / (1 + ((one - other) / 0.5) ** 2)
    plain, weighted = (
        float((one * other).mean()),
        float((weights * one * other).sum() / np.sqrt((weights * one * one).sum() * (weights * other * other).sum())),
    )
    assert weighted > plain


def test_other_patches_are_worth_less():
    others = [alike(PATCH, texture(seed)[10:21, 20:31]) for seed in range(6, 16)]
    assert max(others) < 0.7


def test_a_template_finds_its_place_along_the_row():
    wide = texture(7, width=100)
    first, second = wide[:, 10:90], wide[:, 14:94]
    at = corners(first, 30)
    at = at[(at[:, 0] > 20) & (at[:, 0] < 60)]
    found = similarity(normalised(patches(first, at, 0)), normalised(patches(second, at, 8)))
    values, places = best_of(found)
    assert len(at) >= 5
    assert values == pytest.approx(np.ones(len(at)), abs=1e-4)
    assert set(places - 8) == {-4}


def test_corners_keep_away_from_the_edge_so_that_templates_have_room():
    at = corners(texture(8), 200)
    assert at[:, 0].min() >= 5
    assert at[:, 1].min() >= 5
    assert at[:, 0].max() < 64 - 5
    assert at[:, 1].max() < 48 - 5


def test_a_point_is_astray_that_is_displaced_otherwise_than_its_neighbours():
    at = np.array([(x, y) for x in range(0, 60, 10) for y in range(0, 40, 10)])
    places = np.full(len(at), 20) + at[:, 0] // 20
    places[7] += 9
    assert list(np.flatnonzero(astray(at, places))) == [7]
