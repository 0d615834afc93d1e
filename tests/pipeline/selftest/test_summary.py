"""What the footage is said to show, from made-up series."""

from __future__ import annotations

from dataclasses import replace
from math import nan

import pytest

from pipeline.selftest.findings import Row
from pipeline.selftest.summary import summary
from pipeline.verdict import State

PERIOD_MS = 100.0


def rows(*offsets: float | None, sigma: float = 0.02) -> list[Row]:
    """A window an offset; None is one that could not be decided."""
    return [_row(frame, offset, sigma) for frame, offset in enumerate(offsets)]


def _row(frame: int, offset: float | None, sigma: float) -> Row:
    if offset is None:
        return Row(frame, frame, State.UNKNOWN, nan, nan, reason="too few corners: 3")
    return Row(frame, frame, State.SYNC if abs(offset) < 0.1 else State.ASYNC, offset, sigma)


def said(series: list[Row]) -> str:
    return summary("left-right", series).sentences(PERIOD_MS)


def test_the_smallest_offset_is_two_standard_errors():
    found = summary("left-right", rows(*[0.01] * 30))
    assert found.smallest == pytest.approx(0.04)
    assert "can show is 4 ms (0.040 frames)" in found.sentences(PERIOD_MS)


def test_in_sync_and_out_of_sync_are_told():
    assert said(rows(*[0.01] * 30)).startswith("in sync (offset +0.010 ± 0.020 frames, +1.0 ± 2.0 ms).")
    assert said(rows(*[-0.5] * 30)).startswith("OUT OF SYNC by -0.500 ± 0.020 frames, -50.0 ± 2.0 ms.")


def test_an_offset_that_changes_is_told_with_its_frames():
    text = said(rows(*[-1.0] * 20, *[None] * 5, *[1.0] * 20))
    assert text.startswith("OUT OF SYNC, and the offset changes:")
    assert "-1.00 frames at frame 0 to 19, +1.00 frames at frame 25 to 44" in text


def test_an_offset_that_keeps_changing_is_told_as_a_range():
    text = said(rows(*[0.05 * frame for frame in range(200)]))
    assert "times, between +0." in text
    assert "and +9." in text


def test_a_few_strays_are_no_change():
    assert "changes" not in said(rows(*[0.0] * 15, *[1.0] * 4, *[0.0] * 15))
    assert "changes" not in said(rows(1.0, 1.0, *[0.0] * 30))


def test_a_difference_within_the_errors_is_no_change():
    assert "changes" not in said(rows(*[0.0] * 15, *[0.05] * 15))
    assert "changes" in said(rows(*[0.0] * 15, *[0.07] * 15))


def test_too_few_windows_are_told_with_what_kept_the_others_and_never_as_in_sync():
    found = summary("left-right", rows(*[0.0] * 5, *[None] * 40, 0.9))
    text = found.sentences(PERIOD_MS)
    assert not found.can_prove
    assert text.startswith(
        "cannot tell: 6 of 46 windows could be decided; what kept most of the others: too few corners"
    )
    assert "too few to rest on, say +0.00 frames at frame 0 to 4, +0.90 frames at frame 45 to 45" in text
    assert "in sync" not in text


def test_a_state_without_an_offset_is_not_decided():
    series = [replace(row, offset=nan) for row in rows(*[0.0] * 30)]
    assert summary("left-right", series).decided == 0
