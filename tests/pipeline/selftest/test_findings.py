"""Does the selftest catch a detector that lies?"""

from __future__ import annotations

import pytest

from pipeline.selftest.findings import Outcome, Row, halves, loop, shifted, slip, swapped
from pipeline.verdict import State


def told(offsets, sigma=0.01, state=None, truth=0.0, **numbers):
    """A window for each offset; None is one that was not decided."""
    rows = []
    for index, offset in enumerate(offsets):
        if offset is None:
            rows.append(Row(index, index, State.UNKNOWN))
            continue
        said = state or (State.SYNC if abs(offset) < 0.1 else State.ASYNC)
        rows.append(Row(index, index, said, offset, sigma, truth, partner_ns=index, numbers=numbers))
    return rows


@pytest.mark.parametrize(
    ("moved", "outcome"), [(1.0, Outcome.PASSED), (1.01, Outcome.PASSED), (0.9, Outcome.FAILED), (0.0, Outcome.FAILED)]
)
def test_a_shift_must_be_followed(moved, outcome):
    assert shifted("a-b", told([0.0] * 30), told([moved] * 30), 1).outcome is outcome


@pytest.mark.parametrize(
    ("reverse", "outcome"), [(-0.5, Outcome.PASSED), (0.5, Outcome.FAILED), (-0.4, Outcome.FAILED)]
)
def test_a_swap_must_negate(reverse, outcome):
    assert swapped("a-b", told([0.5] * 30), told([reverse] * 30)).outcome is outcome


def test_few_windows_show_nothing():
    decided = [0.0] * 9 + [None] * 100
    assert shifted("a-b", told(decided), told([0.0] * 109), 1).outcome is Outcome.NOT_SHOWN


def test_windows_that_one_trial_did_not_decide_do_not_count():
    assert shifted("a-b", told([0.0] * 30), told([None] * 15 + [1.0] * 15), 1).numbers["windows"] == 15


@pytest.mark.parametrize(("down", "outcome"), [(0.0, Outcome.PASSED), (0.2, Outcome.FAILED)])
def test_halves_must_agree(down, outcome):
    numbers = {"up_frames": 0.0, "up_sigma_frames": 0.02, "down_frames": down, "down_sigma_frames": 0.02}
    assert halves("a-b", told([0.0] * 30, **numbers), "up", "down").outcome is outcome


def test_halves_that_were_not_measured_show_nothing():
    assert halves("a-b", told([0.0] * 30), "up", "down").outcome is Outcome.NOT_SHOWN


@pytest.mark.parametrize(("across", "outcome"), [(0.3, Outcome.PASSED), (0.1, Outcome.FAILED)])
def test_loops_must_close(across, outcome):
    found = loop(("a", "b", "c"), told([0.1] * 20), told([0.2] * 20), told([across] * 20))
    assert (found.outcome, found.subject) == (outcome, "a-b-c")


def slipping(delay, count=60, begin=20):
    rows = told([0.0] * count)
    return [
        row if row.at_ns < begin else Row(row.at_ns, row.frame, *said, truth=1.0)
        for row in rows
        for said in [(State.ASYNC, 1.0, 0.01) if row.at_ns >= begin + delay else (State.SYNC, 0.0, 0.01)]
    ]


@pytest.mark.parametrize(("delay", "outcome"), [(0, Outcome.PASSED), (4, Outcome.PASSED), (30, Outcome.FAILED)])
def test_a_slip_must_be_told_soon(delay, outcome):
    found = slip("a-b", told([0.0] * 60), slipping(delay), 33.3)
    assert (found.outcome, found.numbers["delay_frames"]) == (outcome, delay)


def test_a_slip_that_is_never_told_fails():
    assert slip("a-b", told([0.0] * 60), slipping(100), 33.3).outcome is Outcome.FAILED
