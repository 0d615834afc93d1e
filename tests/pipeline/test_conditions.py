"""Changes that last, and the events made of them."""

from __future__ import annotations

from dataclasses import replace

import pytest
from hypothesis import given
from hypothesis import strategies as st

from pipeline.conditions import Conditions
from pipeline.health.observer import Observation
from pipeline.notes import Note
from pipeline.steady import CONFIRM, Steady
from pipeline.verdict import Basis, Cause, Reason, State, Verdict
from tests.frames import PERIOD_NS, RIG

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


@pytest.mark.parametrize(("reason", "is_back"), [(Reason.NO_MOTION, True), (Reason.UNPAIRED, False)])
def test_a_missing_camera_is_back_when_its_frames_come_though_nothing_can_be_told_of_them(reason, is_back):
    conditions = Conditions(RIG, lambda: 0)
    gone = replace(verdicts("a")[0], cause=Cause.MISSING, camera="right", offset_ns=None)
    made = [one for said in [gone, gone] for one in conditions.add(said)]
    waiting = [replace(said, reason=Reason.UNPAIRED) for said in verdicts("u" * 9)]
    made += [one for said in waiting for one in conditions.add(said)]
    made += [one for said in verdicts("u" * 5) for one in conditions.add(replace(said, reason=reason))]
    assert [(one.phase, one.cause) for one in made] == [
        ("onset", Cause.MISSING),
        *([("end", Cause.MISSING)] if is_back else []),
    ]
    assert made[-1].text == ("right delivers again" if is_back else made[0].text)


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
    assert (onset.worst, end.worst) == ({"offset_ms": 7.0}, {"offset_ms": 8.0})


def test_the_worst_value_is_the_worst_of_all_since_the_onset():
    conditions = Conditions(RIG, iter(range(1, 100)).__next__)
    offsets = [0] * 6 + [200_000] * 4 + [10_000] * 2 + [0] * 6
    told = [
        replace(verdict, offset_ns=offset)
        for verdict, offset in zip(verdicts("s" * 6 + "a" * 6 + "s" * 6), offsets, strict=True)
    ]
    onset, end = (event for verdict in told for event in conditions.add(verdict))
    assert (onset.worst, end.worst) == ({"offset_ms": 0.2}, {"offset_ms": 0.2})


def said(frame: int, cause: Cause | None, offset_frames: float | None = None, camera: str | None = None) -> Verdict:
    state = State.ASYNC if cause else State.SYNC
    offset_ns = None if offset_frames is None else round(offset_frames * PERIOD_NS)
    return Verdict(
        "bench", "left-right", frame, state, Basis.CONTENT,
        cause=cause, offset_ns=offset_ns, offset_frames=offset_frames, camera=camera,
    )  # fmt: skip


def told(stream: list[Verdict], confirm: int = 2) -> list[tuple[str, str | None, str]]:
    conditions = Conditions(RIG, lambda: 0, confirm=confirm)
    made = [event for verdict in stream for event in conditions.add(verdict)]
    return [(event.phase, event.cause and event.cause.value, event.text) for event in made]


def test_another_cause_ends_the_event_and_begins_the_next():
    stream = [said(n, Cause.PHASE, 0.2) for n in range(6)] + [said(n, Cause.FREE_RUN, 0.3) for n in range(6, 12)]
    assert [event[:2] for event in told(stream)] == [("onset", "phase"), ("end", "phase"), ("onset", "free_run")]


def test_an_offset_that_jumps_is_told_and_one_that_creeps_is_not():
    jumping = [said(n, Cause.SLIP, 1.0) for n in range(6)] + [said(n, Cause.SLIP, -1.0) for n in range(6, 12)]
    assert [event[0] for event in told(jumping)] == ["onset", "end", "onset"]
    assert told(jumping)[-1][2] == "right is 100.0 ms earlier than left since frame 6"
    creeping = [said(n, Cause.FREE_RUN, 0.1 * n) for n in range(30)]
    assert [event[0] for event in told(creeping)] == ["onset"]


def test_what_was_told_is_not_told_again_after_a_while_of_not_knowing():
    blind = [Verdict("bench", "left-right", n, State.UNKNOWN, Basis.NONE) for n in range(6, 20)]
    stream = [said(n, Cause.SLIP, 1.0) for n in range(6)] + blind + [said(n, Cause.SLIP, 1.0) for n in range(20, 30)]
    assert [event[0] for event in told(stream)] == ["onset"]


@pytest.mark.parametrize(("cause", "words"), [(Cause.MISSING, "delivers nothing"), (Cause.FROZEN, "the same picture")])
def test_a_missing_or_frozen_camera_is_told_at_once_and_named(cause, words):
    conditions = Conditions(RIG, lambda: 0)
    (event,) = conditions.add(said(7, cause, camera="left"))
    assert (event.kind, event.camera, event.pair, event.cause) == ("async", "left", "left-right", cause)
    assert event.text.startswith("left")
    assert words in event.text


def test_a_dark_camera_is_an_event_of_its_own_and_a_single_black_frame_is_none():
    conditions = Conditions(RIG, lambda: 0)
    dark = Observation(lasting={"left": (), "right": (Note.DARK,)})
    fine = Observation(lasting={"left": (), "right": ()})
    made = [event for seen in [fine, dark, fine, fine] + [dark] * 9 + [fine] * 9 for event in conditions.observe(seen)]
    assert [(event.kind, event.phase, event.camera, event.pair) for event in made] == [
        ("dark", "onset", "right", None),
        ("dark", "end", "right", None),
    ]
    assert made[0].id == made[1].id
    assert conditions.open == []


def test_a_condition_found_elsewhere_has_one_onset_and_one_end():
    conditions = Conditions(RIG, lambda: 5)
    worst = {"rotation_deg": 0.5}
    assert conditions.tell("geometry_shift", "left-right", "end", {}, "") is None
    onset = conditions.tell("geometry_shift", "left-right", "onset", worst, "right was knocked")
    assert onset is not None
    assert (onset.pair, onset.camera, onset.worst, onset.text) == ("left-right", "right", worst, "right was knocked")
    assert conditions.tell("geometry_shift", "left-right", "onset", worst, "again") is None
    end = conditions.tell("geometry_shift", "left-right", "end", {}, "")
    assert end is not None
    assert (end.phase, end.id, end.worst, end.until_ns) == ("end", onset.id, worst, 5)


@given(st.text("sau", max_size=60))
def test_events_alternate_and_never_outnumber_changes(letters):
    phases = [phase for phase, _ in events(letters)[0]]
    assert phases == ["onset", "end"] * (len(phases) // 2)
    assert len(phases) <= len(letters) // CONFIRM * 2


def told_of(notes: list[tuple[Note, ...]]) -> list[tuple[int, str, str]]:
    """Frame, kind and phase of each event that frames of the right camera with these notes make."""
    conditions = Conditions(RIG, lambda: 7)
    made = [(n, event) for n, each in enumerate(notes) for event in conditions.observe(Observation({"right": each}))]
    assert {event.camera for _, event in made} <= {"right"}
    return [(n, event.kind, event.phase) for n, event in made]


def test_a_camera_that_keeps_losing_frames_is_an_event_and_one_loss_is_none():
    lost, well = (Note.DROP,), ()
    assert told_of([lost, *[well] * 40, lost, lost, *[well] * 40]) == []
    assert told_of([lost, *[well] * 10, lost, lost, *[well] * 40]) == [(12, "drop", "onset"), (42, "drop", "end")]


def test_a_camera_that_was_started_anew_is_an_event_at_once():
    assert told_of([(), (Note.RESTARTED,), *[()] * 9]) == [(1, "restarted", "onset"), (6, "restarted", "end")]
