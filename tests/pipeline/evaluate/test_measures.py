"""What is told of many clips, how sure it is, and what stands in a cell."""

from __future__ import annotations

import math

import pytest

from pipeline.evaluate import measures
from pipeline.evaluate.columns import COLUMNS, cells
from pipeline.evaluate.measures import bootstrap
from pipeline.evaluate.score import Score


def clip(**counts) -> Score:
    return Score("r", "m", 0, **counts)


def test_a_share_weighs_clips_by_their_windows():
    assert measures.decided([clip(windows=90, decided=90), clip(windows=10, decided=0)]) == pytest.approx(0.9)


def test_nothing_measured_is_no_number():
    silent = [clip(windows=50)]
    assert measures.whole_right(silent) is measures.error_p95(silent) is measures.delay_median(silent) is None
    assert measures.decided([]) is None


def test_errors_of_all_clips_make_one_distribution():
    clips = [clip(errors=[0.01] * 60), clip(errors=[0.5] * 40)]
    assert (measures.error_median(clips), measures.error_p95(clips)) == (0.01, 0.5)


def test_a_step_that_is_not_found_is_infinitely_late():
    found, lost = clip(steps=1, delays=[3]), clip(steps=1)
    assert measures.delay_median([found, found, found, lost]) == 3
    assert math.isinf(measures.delay_p95([found, found, found, lost]))
    assert math.isinf(measures.delay_median([found, lost, lost]))


def test_one_clip_has_no_interval_and_several_have():
    one, other = clip(windows=10, decided=10), clip(windows=10, decided=0)
    assert bootstrap([one], measures.decided) is None
    interval = bootstrap([one, other] * 5, measures.decided)
    assert 0 < interval.low < 0.5 < interval.high < 1


def test_clips_that_say_nothing_make_no_interval():
    assert bootstrap([clip(windows=9, measured=9, whole_right=9), clip(windows=9)], measures.whole_right) is None


def test_equal_clips_leave_no_doubt_and_unequal_ones_more_the_fewer_they_are():
    equal = bootstrap([clip(errors=[0.1])] * 4, measures.error_median)
    assert (equal.low, equal.high) == (0.1, 0.1)

    def width(clips):
        interval = bootstrap(clips, measures.decided)
        return interval.high - interval.low

    halves = [clip(windows=10, decided=10), clip(windows=10)]
    assert width(halves * 20) < width(halves * 3)


def test_cells_tell_value_and_interval():
    one, other = clip(windows=10, decided=4), clip(windows=10, decided=6)
    assert cells([one, other], ["windows", "decided", "error median"]) == ["20", "50.0 % (40.0..60.0)", "-"]
    assert cells([one], ["decided"]) == cells([one, one], ["decided"]) == ["40.0 %"]


def test_delays_are_told_with_what_was_not_found():
    found, lost = clip(steps=2, delays=[3, 4]), clip(steps=1)
    assert cells([found], ["steps found", "after frames"]) == ["2 of 2", "4, 95 % 4"]
    assert cells([lost], ["steps found", "after frames"]) == ["0 of 1", "never, 95 % never"]
    assert cells([clip()], ["steps found", "after frames"]) == ["0 of 0", "-"]


def test_every_column_can_tell_of_a_clip_without_windows():
    assert len(cells([clip()])) == len(COLUMNS)
