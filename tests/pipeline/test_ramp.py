"""Steady growth told from jumps and from noise."""

from __future__ import annotations

import numpy as np
import pytest

from pipeline.ramp import Ramp, Slope


def slope(samples: np.ndarray, least: float = 5.0) -> Slope | None:
    ramp = Ramp()
    for sample in samples.tolist():
        ramp.add(sample)
    return ramp.slope(least)


@pytest.mark.parametrize("count", [10, 15, 40, 100])
@pytest.mark.parametrize("sign", [1, -1])
def test_a_ramp_is_seen_and_its_slope_is_right(count, sign):
    found = slope(sign * 2.0 * np.arange(count))
    assert found is not None
    assert found.ns == pytest.approx(sign * 2.0)


def test_a_ramp_under_noise_is_seen_in_more_samples():
    rng = np.random.default_rng(1)
    found = slope(np.arange(40) + rng.normal(0, 3, 40))
    assert found is not None
    assert abs(found.ns - 1) < 4 * found.sigma_ns


@pytest.mark.parametrize("at", range(1, 40, 3))
def test_a_jump_is_no_ramp_wherever_it_is(at):
    rng = np.random.default_rng(at)
    clean = np.where(np.arange(40) < at, 0.0, 33.0)
    assert slope(clean) is None
    assert slope(clean + rng.normal(0, 1, 40)) is None


def test_noise_is_no_ramp():
    rng = np.random.default_rng(2)
    assert all(slope(rng.normal(0, 5, 40), 0.0) is None for _ in range(2000))


def test_too_slow_a_ramp_and_too_few_samples_are_passed_over():
    assert slope(0.1 * np.arange(40)) is None
    assert slope(np.arange(9.0)) is None


def test_a_ramp_is_forgotten_when_it_stops():
    assert slope(np.concatenate([np.arange(40.0), np.full(40, 40.0)])) is None
