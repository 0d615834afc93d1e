"""Adaptive windows: how they grow, what they weigh, and which matches count."""

from __future__ import annotations

import numpy as np
import pytest

from pipeline.detectors.adaptive_window import WINDOWS, aggregate, costs, grow, match, small
from tests.frames import texture

ARMS = (2, 4, 6)


def test_arms_are_shorter_the_more_texture_there_is():
    flat = np.full((40, 60), 100, np.uint8)
    flat[:, 40] = 104
    windows = grow(flat, ARMS, threshold=255)
    assert windows.right[20, 10] == windows.down[20, 10] == 6
    assert windows.right[20, 39] == windows.left[20, 41] == 2


def test_arms_end_at_another_colour_and_at_the_edge():
    image = np.full((20, 30, 3), 80, np.uint8)
    image[:, 15:, 2] = 140
    windows = grow(image, (6, 6, 6), threshold=20)
    assert windows.right[10, 12] == 2
    assert windows.left[10, 17] == 2
    assert (windows.left[10, 1], windows.up[2, 5], windows.down[19, 5], windows.right[10, 29]) == (1, 2, 0, 0)


def test_costs_are_summed_over_the_windows_pixel_by_pixel():
    first, second = small(texture(1)), small(texture(2))
    cost = costs(first, second, 5)
    windows = grow(texture(1), ARMS, 20)
    rows = np.array([10, 25])
    made = aggregate(cost, windows, rows)
    for place, row in enumerate(rows):
        for x in (0, 17, 63):
            means = []
            for times in range(1, WINDOWS + 1):
                arms = windows.shorter(times, WINDOWS)
                inside = [
                    cost[y, x - arms.left[y, x] : x + arms.right[y, x] + 1]
                    for y in range(row - arms.up[row, x], row + arms.down[row, x] + 1)
                ]
                means.append(np.concatenate(inside).mean(axis=0))
            assert made[place, x] == pytest.approx(np.mean(means, axis=0), abs=1e-5)


def test_pixels_near_the_centre_weigh_more():
    plain = np.full((30, 30), 90, np.uint8)
    plain[0] = 200
    windows = grow(plain, ARMS, 20)

    def weight(away: int) -> float:
        cost = np.zeros((30, 30, 1), np.float32)
        cost[15, 15 + away] = 1
        return float(aggregate(cost, windows, np.array([15]))[0, 15, 0])

    assert weight(1) > weight(5) > weight(7) == 0


def test_a_shift_along_the_rows_costs_nothing_and_is_confirmed_from_the_other_side():
    wide = texture(3, width=80)
    first, second = small(wide[:, 8:72]), small(wide[:, 11:75])
    windows = grow(wide[:, 8:72], ARMS, 20)
    lowest, confirmed = match(aggregate(costs(first, second, 6), windows, np.arange(4, 44, 4)), 6)
    inner = (slice(None), slice(12, 52))
    assert confirmed[inner].all()
    assert lowest[inner].max() < 0.2


def test_of_many_pixels_that_want_the_same_match_only_the_best_is_confirmed():
    cost = np.ones((1, 20, 21), np.float32)
    for x in range(20):
        cost[0, x, x] = 0.1 + 0.01 * abs(x - 4)
    _, confirmed = match(cost, 10)
    assert list(np.flatnonzero(confirmed[0])) == [3, 4, 5]


def test_brightness_and_contrast_do_not_matter():
    image = texture(4)
    other = np.asarray(image * 0.5 + 40, np.uint8)
    one, same = small(image), small(other)
    assert np.abs(one.level - same.level).max() < 0.1
