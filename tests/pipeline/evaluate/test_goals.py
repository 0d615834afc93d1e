"""Which rows count for a goal, and whether it is met."""

from __future__ import annotations

import pytest

from benchmarks.accuracy_goals import AIMS
from pipeline.evaluate import measures
from pipeline.evaluate.goals import Goal, Outcome, at_least, at_most, both, judge
from pipeline.evaluate.score import Score

WHOLE = Goal("right whole frame", "whole", ">= 90 %", ("whole frame",), at_least(measures.whole_right, 0.9))
COVERAGE = Goal("decided", "decided", ">= 90 %", ("decided",), at_least(measures.decided, 0.9), accuracy=False)


def clip(windows=100, decided=100, right=100, **more) -> Score:
    return Score("r", "m", 0, windows=windows, decided=decided, measured=decided, whole_right=right, **more)


@pytest.mark.parametrize(
    ("row", "outcome"),
    [
        (clip(), Outcome.MET),
        (clip(right=89), Outcome.NOT_MET),
        (clip(decided=49, right=49), Outcome.NOT_COUNTED),
        (clip(decided=50, right=20), Outcome.NOT_MET),
        (clip(windows=9, decided=9, right=9), Outcome.NOT_COUNTED),
        (clip(windows=0, decided=0, right=0), Outcome.NOT_COUNTED),
    ],
)
def test_an_accuracy_counts_only_with_enough_decided_windows(row, outcome):
    assert WHOLE.of_row([row]) is outcome


def test_coverage_counts_however_little_is_decided():
    assert COVERAGE.of_row([clip(decided=0, right=0)]) is Outcome.NOT_MET


def test_windows_of_all_seeds_count_together():
    assert WHOLE.of_row([clip(windows=6, decided=6, right=6)] * 2) is Outcome.MET


def test_a_goal_may_be_met_over_all_and_missed_by_a_row():
    result = judge(WHOLE, {("a",): [clip(windows=1000, decided=1000, right=1000)], ("b",): [clip(right=50)]})
    assert result.outcome is Outcome.MET
    assert result.rows == {("a",): Outcome.MET, ("b",): Outcome.NOT_MET}
    assert [result.how_many(outcome) for outcome in Outcome] == [1, 1, 0]


def test_what_does_not_count_is_left_out_of_the_whole():
    wrong = clip(decided=40, right=0)
    assert judge(WHOLE, {("a",): [clip()], ("b",): [wrong]}).outcome is Outcome.MET
    assert judge(WHOLE, {("b",): [wrong]}).outcome is Outcome.NOT_COUNTED


def test_bounds_are_kept_when_touched_and_never_by_nothing():
    exact = [clip(right=90)]
    assert at_least(measures.whole_right, 0.9)(exact)
    assert at_most(measures.whole_right, 0.9)(exact)
    assert not both(at_least(measures.whole_right, 0.9), at_most(measures.whole_right, 0.8))(exact)
    assert not at_most(measures.error_median, 1)([clip()])


@pytest.mark.parametrize(
    ("inside", "sigma", "met"),
    [(95, 0.2, True), (92, 0.01, False), (99, 0.05, True), (99, 0.06, False), (98, 0.3, True), (93, 0.3, True)],
)
def test_error_bars_are_honest_or_small(inside, sigma, met):
    aims = [aim for aim in AIMS if aim.goal.short == "2 sigma"]
    assert aims
    row = clip(with_sigma=100, within_two_sigma=inside, sigmas=[sigma] * 100)
    assert [aim.goal.holds([row]) for aim in aims] == [met] * len(aims)


def test_a_step_that_is_missed_in_one_of_ten_is_too_late():
    (aim,) = [aim for aim in AIMS if "step" in aim.goal.name]
    steps = [clip(steps=1, delays=[4])] * 19
    assert aim.goal.holds([*steps, *steps, clip(steps=1)])
    assert not aim.goal.holds([*steps[:9], clip(steps=1)])
