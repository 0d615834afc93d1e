"""Values over time in constant memory."""

from __future__ import annotations

import itertools

import numpy as np
import pytest

from pipeline.report.series import MOST_BINS, Series


def filled(count):
    values = np.random.default_rng(3).normal(size=count)
    series = Series(["x", "rare"])
    for n, value in enumerate(values):
        series.add({"x": value, **({"rare": 1.0} if n % 500 == 0 else {})})
    return series, values


@pytest.mark.parametrize("count", [1, 7, MOST_BINS, MOST_BINS + 1, 5 * MOST_BINS + 3])
def test_bins_hold_the_mean_the_least_and_the_most_of_their_steps(count):
    series, values = filled(count)
    edges = series.edges().astype(int)
    assert series.count == edges[-1] == count
    parts = [values[begin:end] for begin, end in itertools.pairwise(edges)]
    np.testing.assert_allclose(series.mean("x"), [part.mean() for part in parts])
    np.testing.assert_array_equal(series.least("x"), [part.min() for part in parts])
    np.testing.assert_array_equal(series.most("x"), [part.max() for part in parts])
    assert series.summary("x") == pytest.approx({"mean": values.mean(), "min": values.min(), "max": values.max()})


def test_however_many_steps_there_are_never_more_bins_than_a_screen_has_columns():
    series, _ = filled(9 * MOST_BINS)
    assert MOST_BINS // 2 < series.bins <= MOST_BINS
    assert series.bin_steps == 16


def test_what_is_not_known_is_nan_and_not_zero():
    series, _ = filled(1200)
    assert series.known("rare").sum() == 3
    assert np.isnan(series.mean("rare")).sum() == series.bins - 3
    assert Series(["x"]).summary("x") is None
