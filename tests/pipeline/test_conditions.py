"""Changes that last, and the events made of them."""

from __future__ import annotations

from dataclasses import replace

from hypothesis import given
from hypothesis import strategies as st

from pipeline.conditions import CONFIRM, Conditions, Steady
from pipeline.verdict import Basis, Cause, State, Verdict
from tests.frames import RIG

LETTERS = {"s": State.SYNC, "a": State.ASYNC, "u": State.UNKNOWN}


def verdicts(letters: str) -> list[Verdict]:
    return [
        Verdict("bench", "left-right", frame, LETTERS[letter], Basis.CONTENT,
                cause=Cause.SLIP if letter == "a" else None, offset_ns=1_000_000 * frame)
        for frame, letter in enumerate(letters)
    ]  # fmt: skip


def changes(letters: str) -> list[tuple[str, int | None]]:
    steady = Steady()
    made = [steady.add(verdict) for verdict in verdicts(letters)]
    return [(change.state.value, change.first.frame) for change in made if change]


def events(letters: str) -> tuple[list[tuple[str, int]], list[str]]:
    """Phase and verdicts so far of each event, and its text."""
    now = iter(range(1, 1000))
    conditions = Conditions(RIG, lambda: next(now))
    made = [(n, event) for n, verdict in enumerate(verdicts(letters)) for event in conditions.add(verdict)]
    made += [(len(letters), event) for event in conditions.finish()]
    return [(event.phase, n) for n, event in made], [event.text for _, event in made]


def test_a_state_that_lasts_is_a_change_dated_from_its_first_verdict():
    assert changes("ssssssaaaaaa") == [("sync", 0), ("async", 6)]


def test_an_outlier_is_no_change():
    assert changes("sssssassaassaaaassss") == [("sync", 0)]


def test_an_onset_and_an_end_make_two_events():
    phases, texts = events("sssaaaaaasssss")
    assert phases == [("onset", 7), ("end", 13)]
    assert texts == ["right is 7.0 ms later than left since frame 3", "left-right in sync again from frame 9"]


def test_unknown_neither_opens_nor_closes_an_event():
    assert events("uuuuuaaaaauuuuuusssss")[0] == [("onset", 9), ("end", 20)]


def test_frames_that_cannot_be_judged_do_not_hide_a_lasting_change():
    assert changes("ssssss" + "aaaau" * 4) == [("sync", 0), ("async", 6)]
    assert changes("ssssss" + "aaaauuuuu" * 3) == [("sync", 0), ("unknown", 10)]


def test_what_is_open_at_the_end_is_closed():
    assert events("sssaaaaaa")[0] == [("onset", 7), ("end", 9)]


def test_the_end_repeats_the_onset_and_adds_until_and_the_worst_value():
    conditions = Conditions(RIG, iter(range(1, 100)).__next__)
    onset, end = (event for verdict in verdicts("sssaaaaaasssss") for event in conditions.add(verdict))
    assert (end.id, end.since_ns, end.kind, end.camera) == (onset.id, 4, "async", "right")
    assert (onset.until_ns, end.until_ns) == (None, 10)
    assert (onset.worst_offset_ns, end.worst_offset_ns) == (7_000_000, 8_000_000)


def test_the_worst_value_is_the_worst_of_all_since_the_onset():
    conditions = Conditions(RIG, iter(range(1, 100)).__next__)
    offsets = [0] * 6 + [200, 200, 200, 200, 10, 10] + [0] * 6
    told = [
        replace(verdict, offset_ns=offset)
        for verdict, offset in zip(verdicts("s" * 6 + "a" * 6 + "s" * 6), offsets, strict=True)
    ]
    onset, end = (event for verdict in told for event in conditions.add(verdict))
    assert (onset.worst_offset_ns, end.worst_offset_ns) == (200, 200)


@given(st.text("sau", max_size=60))
def test_events_alternate_and_never_outnumber_changes(letters):
    phases = [phase for phase, _ in events(letters)[0]]
    assert phases == ["onset", "end"] * (len(phases) // 2)
    assert len(phases) <= len(letters) // CONFIRM * 2
