"""When a run counts as right, and what is counted beside."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from pipeline.evaluate.failures import FAILURE_COLUMNS, confusion, failure_cells, upper_bound
from pipeline.evaluate.outcome import Outcome, outcome_of
from pipeline.evaluate.suite import Clip, Expected, Scenario
from pipeline.timeline import Span, timeline_of
from pipeline.verdict import Basis, Cause, Event, Pace, PairTruth, Reason, Report, State, Verdict

FPS = 10
STATES = {"s": State.SYNC, "a": State.ASYNC, "u": State.UNKNOWN}


def clip(truth: str = "known", **expect: Any) -> Clip:
    wanted = {"row": "F0", "recording": "room", "truth": truth, "expect": expect}
    scenario = Scenario.model_validate(wanted) if expect else None
    return Clip("room", "what", 0, {}, None, Path(), 0, 0, scenario)


def verdicts(truth: str, said: str, cause: Cause = Cause.SLIP, notes: tuple[str, ...] = ()) -> list[Verdict]:
    """A letter a frame: s, a, u; `-` in the truth: no partner."""
    return [
        Verdict(
            "bench", "left-right", n, STATES[one], Basis.CONTENT,
            cause=cause if one == "a" else None,
            reason=Reason.NO_MOTION if one == "u" else None,
            offset_ns=100_000_000 if one == "a" else 0,
            tolerance_ns=5_000_000,
            drift=Pace(stamps_ppm=95.0),
            notes=notes,
            truth=None if true == "-" else PairTruth(100_000_000 if true == "a" else 0, STATES[true]),
        )
        for n, (true, one) in enumerate(zip(truth, said, strict=True))
    ]  # fmt: skip


def event(kind: str = "async", cause: Cause | None = Cause.SLIP, camera: str = "right") -> Event:
    pair = "left-right" if kind in {"async", "swapped"} else None
    return Event("bench", "1", kind, "onset", pair, camera, cause, 0, None, {}, f"{camera} {kind}")


def outcome(truth: str, said: str, *events: tuple[int, Event], **expect: Any) -> Outcome:
    """events: each with the frame after whose verdict it comes."""
    cause = Cause(expect.pop("said_cause", "slip"))
    stream: list[Report] = list(verdicts(truth, said, cause))
    for at, one in sorted(events, key=lambda pair: -pair[0]):
        stream.insert(at + 1, one)
    return outcome_of(clip(**expect), "left-right", FPS, stream)


SLIP = {"state": "async", "cause": "slip"}
FAULT = "s" * 30 + "a" * 40
FOUND = "s" * 34 + "a" * 36


def test_a_fault_found_in_time_and_named_is_right():
    made = outcome(FAULT, FOUND, (36, event()), **SLIP)
    assert (made.right, made.wrong) == (True, [])
    assert (made.state, made.cause, made.event, made.notes) == (True, True, True, None)
    assert (made.delay_frames, made.delay_s, made.false_async, made.false_alarms) == (4, 0.4, 0, 0)
    assert made.confusion["async"] == {"sync": 0, "async": 25, "unknown": 0}


@pytest.mark.parametrize(
    ("said", "events", "expect", "wrong"),
    [
        ("s" * 70, (), SLIP, "0 of 25 frames async"),
        ("s" * 30 + "u" * 40, (), SLIP, "0 of 25 frames decided"),
        ("s" * 60 + "a" * 10, ((62, event()),), SLIP, "10 of 25 frames async"),
        (FOUND, ((36, event()),), {**SLIP, "said_cause": "phase"}, "cause phase in place of slip"),
        (FOUND, (), SLIP, "events none in place of async/slip of right"),
        (FOUND, ((36, event()), (40, event("dark", None))), SLIP, "events async/slip of right, dark of right"),
        (FOUND, ((36, event(camera="left")),), SLIP, "async/slip of left in place of async/slip of right"),
        (FOUND, ((36, event()),), {**SLIP, "notes": ["drop"]}, "no note drop"),
        (FOUND, ((36, event()),), {**SLIP, "stamps_ppm": 200}, "drift by stamps 95.0 ppm, not 200"),
        (FOUND, ((36, event()),), {**SLIP, "pictures_ppm": 200}, "drift by pictures unknown, not 200"),
    ],
)
def test_what_is_not_as_it_must_be_is_said(said, events, expect, wrong):
    made = outcome(FAULT, said, *events, **expect)
    assert not made.right
    assert wrong in "; ".join(made.wrong)


def test_a_drift_within_a_tenth_is_right():
    made = outcome(FAULT, FOUND, (36, event()), **SLIP, stamps_ppm=100)
    assert (made.drift, made.right) == (True, True)
    assert made.drift_error == pytest.approx(0.05)


def test_where_all_is_well_not_one_frame_may_be_called_out_of_sync():
    assert outcome("s" * 60, "u" * 5 + "s" * 55, state="sync").right
    one = outcome("s" * 60, "s" * 40 + "a" + "s" * 19, state="sync")
    assert (one.state, one.false_async, one.false_alarms) == (False, 1, 0)
    alarm = outcome("s" * 60, "s" * 40 + "a" * 20, (44, event()), state="sync")
    assert (alarm.false_async, alarm.false_alarms, alarm.event) == (20, 1, False)


def test_an_alarm_about_a_fault_that_has_just_ended_is_not_false():
    made = outcome("s" * 20 + "a" * 20 + "s" * 20, "s" * 24 + "a" * 20 + "s" * 16, (26, event()), **SLIP)
    assert (made.false_async, made.false_alarms) == (0, 0)


def test_a_missing_camera_is_judged_by_its_gap():
    made = outcome(
        "s" * 30 + "-" * 30, "s" * 30 + "u" * 8 + "a" * 22, (38, event(cause=Cause.MISSING)),
        state="async", cause="missing", said_cause="missing",
    )  # fmt: skip
    assert (made.right, made.delay_frames, made.false_alarms) == (True, 8, 0)


def test_an_event_that_comes_twice_is_one_too_many():
    made = outcome(FAULT, FOUND, (36, event()), (50, event()), **SLIP)
    assert (made.right, made.wrong) == (False, ["events 2 async/slip of right in place of async/slip of right"])


def test_what_was_said_before_the_fault_is_not_found_but_false():
    made = outcome(FAULT, "s" * 20 + "a" * 50, (22, event()), **SLIP)
    assert (made.delay_frames, made.event, made.false_alarms) == (None, False, 1)
    assert "10 of 30 frames in sync called out of sync" in "; ".join(made.wrong)
    assert "an event began while all was well" in made.wrong


def test_a_fault_that_is_over_must_not_be_called_for_ever():
    truth = "s" * 30 + "a" * 30 + "s" * 60
    assert outcome(truth, "s" * 34 + "a" * 30 + "s" * 56, (36, event()), **SLIP).right
    made = outcome(truth, "s" * 34 + "a" * 86, (36, event()), **SLIP)
    assert made.wrong == ["45 of 75 frames in sync called out of sync"]


def test_an_offset_that_grows_may_be_told_when_it_is_half_a_tolerance():
    def ramp(first_async: int) -> Outcome:
        stream: list[Report] = []
        for n, verdict in enumerate(verdicts("s" * 10 + "a" * 40, "s" * first_async + "a" * (50 - first_async))):
            truth = PairTruth(500_000 * n, State.ASYNC if n > 10 else State.SYNC)
            stream.append(replace(verdict, truth=truth))
        return outcome_of(clip(**SLIP), "left-right", FPS, stream)

    assert (ramp(13).delay_frames, ramp(8).delay_frames, ramp(4).delay_frames) == (2, 0, None)


def test_a_frame_without_a_partner_must_be_unknown():
    assert outcome("s" * 30 + "-" + "s" * 29, "s" * 30 + "u" + "s" * 29, state="sync").right
    made = outcome("s" * 30 + "-" + "s" * 29, "s" * 60, state="sync")
    assert made.wrong == ["1 frames without a partner were decided"]


def test_silence_is_right_only_where_it_is_allowed():
    assert not outcome("s" * 60, "s" * 10 + "u" * 50, state="sync").right
    assert outcome("s" * 60, "s" * 10 + "u" * 50, state="sync", unknown=True).right
    assert not outcome("s" * 60, "u" * 40 + "a" + "u" * 19, state="sync", unknown=True).right


def test_a_fault_may_have_to_be_found_in_time():
    assert outcome(FAULT, FOUND, (36, event()), **SLIP, within_frames=4).right
    assert outcome(FAULT, FOUND, (36, event()), **SLIP, within_frames=3).wrong == ["found after 4 frames, not within 3"]


def test_where_the_truth_is_unknown_what_is_said_most_counts():
    def loose(said: str, **expect: Any) -> Outcome:
        stream: list[Report] = [*verdicts("s" * 60, said)]
        stream[40:40] = [event(), event()]
        return outcome_of(clip("unknown", **expect), "left-right", FPS, stream)

    made = loose("u" * 10 + "a" * 50, state="async")
    assert (made.right, made.false_async, made.false_alarms, made.confusion) == (True, 0, 0, {})
    assert (made.has_onset, made.hours_in_sync) == (False, 0)
    assert not loose("s" * 60, state="async").right
    silent = outcome_of(clip("unknown", state="async"), "left-right", FPS, verdicts("s" * 60, "a" * 60))
    assert silent.event is False
    assert loose("u" * 10 + "a" * 50, state="async", cause="phase").wrong == ["cause slip in place of phase"]


def test_only_time_in_sync_counts_for_false_alarms():
    made = outcome(FAULT, FOUND, (36, event()), **SLIP)
    assert (made.hours, made.hours_in_sync) == (pytest.approx(7 / 3600), pytest.approx(3 / 3600))
    assert dict(zip(FAILURE_COLUMNS, failure_cells([made]), strict=True))["false alarms/h"] == "0 (< 3.6e+03)"


def test_nothing_may_be_said_where_nothing_can():
    assert outcome("s" * 60, "u" * 60, state="unknown").right
    assert not outcome("s" * 60, "u" * 59 + "s", state="unknown").right


def test_a_cause_without_async_is_refused():
    with pytest.raises(ValueError, match="a cause belongs to the state async"):
        Expected.model_validate({"state": "sync", "cause": "slip"})


@pytest.mark.parametrize(("events", "bound"), [(0, 2.996), (1, 4.744), (2, 6.296), (10, 16.96)])
def test_the_upper_bound_is_that_of_a_poisson_process(events, bound):
    assert upper_bound(events, 1.0) == pytest.approx(bound, rel=1e-3)
    assert upper_bound(events, 2.0) == pytest.approx(bound / 2, rel=1e-3)


def test_without_time_there_is_no_bound():
    assert upper_bound(0, 0.0) is None


def test_the_table_joins_seeds_and_counts_what_was_not_found_as_never():
    runs = [outcome(FAULT, FOUND, (36, event()), **SLIP), outcome(FAULT, "s" * 70, **SLIP)]
    cells = dict(zip(FAILURE_COLUMNS, failure_cells(runs), strict=True))
    assert (cells["right"], cells["state"], cells["event"], cells["notes"]) == ("1/2", "1/2", "1/2", "-")
    assert cells["frames p50 / p95"] == "never / never"
    assert confusion(runs)["async"] == {"sync": 25, "async": 25, "unknown": 0}


def test_a_timeline_holds_stretches_curves_and_marks():
    stream: list[Report] = list(verdicts(FAULT, FOUND, notes=("drop",)))
    stream.insert(37, event())
    made = timeline_of(stream, "left-right", FPS)
    assert made.truth == [Span(0.0, 3.0, "sync"), Span(3.0, 7.0, "async")]
    assert made.said == [Span(0.0, 3.4, "sync"), Span(3.4, 7.0, "async slip")]
    assert [(mark.at_s, mark.kind) for mark in made.marks] == [(0.0, "note"), (3.6, "async onset")]
    assert len(made.points) == 70


@given(st.text("sau", min_size=1, max_size=120), st.data())
def test_every_frame_of_a_known_truth_is_counted_once_at_most(truth, data):
    truth = truth.replace("u", "s")
    said = data.draw(st.text("sau", min_size=len(truth), max_size=len(truth)))
    made = outcome(truth, said)
    assert sum(count for row in made.confusion.values() for count in row.values()) <= len(truth)
    assert (made.state, made.wrong) == (None, [])
