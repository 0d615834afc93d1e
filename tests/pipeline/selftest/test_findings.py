"""Findings on made-up series: an honest detector passes, one that lies is caught, too little shows nothing."""

from __future__ import annotations

from dataclasses import replace

import pytest

from pipeline.selftest.findings import Outcome, Row, halves, loop, shifted, slip, swapped
from pipeline.verdict import State

PERIOD_NS = 100_000_000
SIGMA = 0.02
TOLERANCE = 0.05
COUNT = 60


def rows(offset: float = 0.0, count: int = COUNT, sigma: float = SIGMA, **numbers: float) -> list[Row]:
    """Windows that all tell one offset."""
    return [row(frame, offset, sigma, **numbers) for frame in range(count)]


def row(frame: int, offset: float, sigma: float = SIGMA, **numbers: float) -> Row:
    state = State.SYNC if abs(offset) <= TOLERANCE else State.ASYNC
    at_ns = frame * PERIOD_NS
    return Row(at_ns, frame, state, offset, sigma, partner_ns=at_ns + 7, numbers=numbers)


def silenced(series: list[Row], keep: range) -> list[Row]:
    return [item if item.frame in keep else replace(item, state=State.UNKNOWN) for item in series]


@pytest.mark.parametrize(("frames", "told"), [(1, 1.01), (-2, -1.97)])
def test_an_offset_that_follows_a_shift_passes(frames, told):
    found = shifted("left-right", rows(0.3), rows(0.3 + told), frames)
    assert (found.outcome, found.test) == (Outcome.PASSED, f"shift by {frames:+d}")
    assert f"{told:+.3f}" in found.text


@pytest.mark.parametrize("told", [0.0, -1.0, 0.9, 2.0])
def test_an_offset_that_does_not_follow_a_shift_fails(told):
    assert shifted("left-right", rows(0.0), rows(told), 1).outcome is Outcome.FAILED


def test_windows_are_not_taken_for_independent():
    """0.05 is within two joint standard errors of one window, and would not be of the mean of 1000 of them."""
    assert shifted("left-right", rows(0.0, 1000), rows(1.05, 1000), 1).outcome is Outcome.PASSED
    assert shifted("left-right", rows(0.0, 1000), rows(1.06, 1000), 1).outcome is Outcome.FAILED


def test_an_offset_that_changes_is_compared_window_by_window():
    drifting = [row(frame, 0.05 * frame) for frame in range(COUNT)]
    moved = [replace(item, offset=item.offset + 1) for item in drifting]
    found = shifted("left-right", drifting, silenced(moved, range(40, 60)), 1)
    assert (found.outcome, found.numbers["windows"]) == (Outcome.PASSED, 20)


@pytest.mark.parametrize(("windows", "decided"), [(60, 9), (200, 19)])
def test_few_windows_show_nothing(windows, decided):
    found = shifted("left-right", rows(0.0, windows), silenced(rows(0.0, windows), range(decided)), 1)
    assert found.outcome is Outcome.NOT_SHOWN
    assert f"only {decided} of {windows} windows" in found.text


def test_a_swap_negates():
    assert swapped("left-right", rows(0.4), rows(-0.41)).outcome is Outcome.PASSED


def test_a_swap_that_keeps_the_sign_fails():
    assert swapped("left-right", rows(0.4), rows(0.4)).outcome is Outcome.FAILED


def test_a_swap_that_always_says_zero_passes_only_at_zero():
    assert swapped("left-right", rows(0.0), rows(0.0)).outcome is Outcome.PASSED
    assert swapped("left-right", rows(0.2), rows(0.0)).outcome is Outcome.FAILED


def of_halves(odd: float, even: float, systematic: float = 0.1) -> list[Row]:
    told = {"odd_frames": odd, "odd_sigma_frames": 0.01, "even_frames": even, "even_sigma_frames": 0.01}
    return rows(0.0, **told, sigma_systematic_frames=systematic)


def test_halves_that_agree_pass_and_others_fail():
    assert halves("left-right", of_halves(0.01, -0.01), "odd", "even", alike=True).outcome is Outcome.PASSED
    assert halves("left-right", of_halves(0.05, -0.05), "odd", "even", alike=True).outcome is Outcome.FAILED


def test_only_halves_of_different_kinds_may_differ_by_the_systematic_error():
    assert halves("left-right", of_halves(0.05, -0.05), "odd", "even").outcome is Outcome.PASSED
    assert halves("left-right", of_halves(0.05, -0.05, systematic=0.01), "odd", "even").outcome is Outcome.FAILED


def test_halves_that_were_not_measured_show_nothing():
    found = halves("left-right", rows(0.0), "near", "far")
    assert (found.outcome, found.text) == (Outcome.NOT_SHOWN, "not measured")


def later(series: list[Row]) -> list[Row]:
    """The series of a pair whose first camera is stamped as the second of `rows`."""
    return [replace(item, at_ns=item.at_ns + 7) for item in series]


def test_a_loop_closes_or_fails():
    names = ("a", "b", "c")
    assert loop(names, rows(0.3), later(rows(-0.5)), rows(-0.2)).outcome is Outcome.PASSED
    assert loop(names, rows(0.3), later(rows(-0.5)), rows(0.2)).outcome is Outcome.FAILED


def test_a_loop_whose_pairs_are_never_decided_together_shows_nothing():
    first, second = silenced(rows(0.0), range(30)), later(silenced(rows(0.0), range(30, 60)))
    assert loop(("a", "b", "c"), first, second, rows(0.0)).outcome is Outcome.NOT_SHOWN


def slipped(at: int, found_after: int | None, offset: float = 0.0, change: float = 1.0) -> list[Row]:
    """A slip of `change` frames at frame `at`, told `found_after` frames later."""
    series = []
    for frame in range(COUNT):
        told = found_after is not None and frame >= at + found_after
        series.append(replace(row(frame, offset + change * told), truth=change * (frame >= at)))
    return series


@pytest.mark.parametrize("offset", [0.0, -1.0])
def test_a_slip_that_is_found_passes_and_says_when(offset):
    found = slip("left-right", rows(offset), slipped(30, 4, offset), 33.3)
    assert found.outcome is Outcome.PASSED
    assert "found 4 frames (133 ms) after it began at frame 30" in found.text


def test_a_change_from_sync_to_async_is_enough():
    assert slip("left-right", rows(0.0), slipped(30, 4, change=0.3), 33.3).numbers["delay_frames"] == 4


def test_a_slip_that_is_found_late_fails():
    found = slip("left-right", rows(0.0), slipped(20, 21), 33.3)
    assert found.outcome is Outcome.FAILED
    assert "21 windows told the old offset" in found.text


def test_windows_that_abstain_after_a_slip_are_no_lie():
    honest = silenced(slipped(20, 25), range(44, 60))
    assert slip("left-right", rows(0.0), honest, 33.3).outcome is Outcome.PASSED


def test_a_slip_that_is_never_found_fails():
    assert slip("left-right", rows(0.0), slipped(30, None), 33.3).outcome is Outcome.FAILED


def test_a_slip_to_the_wrong_side_is_not_found():
    wrong = [replace(item, offset=-item.offset) for item in slipped(30, 3)]
    assert slip("left-right", rows(0.0), wrong, 33.3).outcome is Outcome.FAILED


def test_a_slip_just_before_the_end_shows_nothing():
    assert slip("left-right", rows(0.0), slipped(50, None), 33.3).outcome is Outcome.NOT_SHOWN


def test_a_slip_that_was_not_put_in_shows_nothing():
    assert slip("left-right", rows(0.0), rows(0.0), 33.3).outcome is Outcome.NOT_SHOWN
