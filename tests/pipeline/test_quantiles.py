"""Quantiles of the last minute."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from pipeline.frame import NS_PER_S
from pipeline.quantiles import LastMinute


@given(st.lists(st.integers(1_000, 10**14), min_size=1, max_size=200), st.sampled_from([0.0, 0.5, 0.9, 0.99, 1.0]))
def test_a_quantile_is_exact_to_one_percent(values, share):
    kept = LastMinute()
    for value in values:
        kept.add(value, 0)
    expected = np.quantile(values, share, method="inverted_cdf")
    assert kept.quantile(share, 0) == pytest.approx(float(expected), rel=0.0101, abs=1)


def test_nothing_is_no_quantile_and_zero_is_zero():
    kept = LastMinute()
    assert kept.quantile(0.5, 0) is None
    kept.add(0, 0)
    assert kept.quantile(0.99, 0) == 0


def test_what_is_older_than_a_minute_is_forgotten():
    kept = LastMinute()
    for second in range(120):
        kept.add(10**9 if second < 60 else 10**6, second * NS_PER_S)
        if second == 59:
            assert kept.quantile(0.5, second * NS_PER_S) == pytest.approx(10**9, rel=0.01)
    assert kept.quantile(1.0, 120 * NS_PER_S) == pytest.approx(10**6, rel=0.01)
    assert kept.quantile(0.5, 200 * NS_PER_S) is None


def test_memory_does_not_grow_with_rate_or_spread():
    kept = LastMinute()
    spread = np.random.default_rng(1).integers(0, 10**18, 20_000)
    for n, value in enumerate(spread):
        kept.add(int(value), n * NS_PER_S // 100)
    assert sum(len(bins) for _, bins in kept._slices) <= 12 * 1400
    assert len(kept._slices) <= 12
