"""What an offset does to a range."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest

from pipeline.errors import InputError
from pipeline.frame import Pair
from pipeline.range_error import RangeCase, RangeSettings, range_case, range_error

CASE = RangeCase(baseline_m=0.075, focal_px=None, depth_m=4.0, speed_m_s=1.0)
PAIR = Pair("left", "right")


@pytest.mark.parametrize("sign", [1, -1])
def test_half_a_frame_at_walking_pace_costs_a_fifth_of_the_range(sign):
    error = range_error(CASE, sign * 16_700_000)
    assert (round(error.low_percent), round(error.high_percent or 0)) == (-18, 29)
    assert error.low_m == pytest.approx(4 * 0.075 / (0.075 + 0.0167))
    assert error.disparity_px is None


def test_without_an_offset_there_is_no_error():
    error = range_error(CASE, 0)
    assert (error.low_m, error.high_m, error.low_percent, error.high_percent) == (4, 4, 0, 0)


def test_an_object_that_moves_as_far_as_the_baseline_may_seem_anywhere_beyond():
    error = range_error(CASE, 75_000_000)
    assert (error.low_percent, error.high_m, error.high_percent) == (-50, None, None)


def test_with_a_focal_length_the_disparity_is_told():
    error = range_error(replace(CASE, focal_px=800.0), 10_000_000)
    assert error.disparity_px == pytest.approx(800 * 0.01 / 4)
    assert error.to_json()["disparity_px"] == 2.0


def test_the_geometry_comes_from_a_calibration_unless_it_is_given(tmp_path):
    rows = [[718.0, 0, 607, -x, 0, 718, 185, 0, 0, 0, 1, 0] for x in (0.0, 718.0 * 0.54)]
    (tmp_path / "calib.txt").write_text("".join(f"P{n}: {' '.join(map(str, row))}\n" for n, row in enumerate(rows)))
    settings = RangeSettings(calibration="calib.txt")
    case = range_case(settings, tmp_path, PAIR, ("left", "right"))
    assert (case.baseline_m, case.focal_px) == (pytest.approx(0.54), pytest.approx(718))
    given = settings.model_copy(update={"baseline_m": 0.1})
    assert range_case(given, tmp_path, PAIR, ("left", "right")).baseline_m == 0.1


def test_without_the_distance_of_the_cameras_it_says_what_to_do():
    with pytest.raises(InputError, match="set baseline_m, or calibration"):
        range_case(RangeSettings(), Path(), PAIR, ("left", "right"))
