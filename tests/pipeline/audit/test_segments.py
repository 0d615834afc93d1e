"""What is said of a pair, cut into segments."""

from __future__ import annotations

from dataclasses import replace

from pipeline.audit.segments import Segments
from pipeline.frame import Pair
from pipeline.verdict import Basis, Cause, Reason, State, Verdict

PERIOD_NS = 50_000_000


def said(frame, letter, since=None, at_ns=None):
    """s: in sync, a: one frame apart, u: cannot tell."""
    state = {"s": State.SYNC, "a": State.ASYNC, "u": State.UNKNOWN}[letter]
    return Verdict(
        "bench",
        "left-right",
        frame,
        state,
        Basis.CONTENT,
        cause=Cause.SLIP if letter == "a" else None,
        reason=Reason.NO_MOTION if letter == "u" else None,
        offset_ns={"s": 0, "a": PERIOD_NS, "u": None}[letter],
        offset_frames={"s": 0.0, "a": 1.0, "u": None}[letter],
        since_frame=since,
        captured_ns={"left": 7_000_000_000 + frame * PERIOD_NS if at_ns is None else at_ns, "right": None},
    )


def cut(verdicts):
    segments = Segments(Pair("left", "right"), 20)
    for verdict in verdicts:
        segments.add(verdict)
    return segments


def told(timeline):
    """
    Segments as text: uuuuuuuuuussssssssss -> u0-9 s10-19
    """
    segments = cut([said(frame, letter) for frame, letter in enumerate(timeline)])
    return " ".join(f"{one.state.value[0]}{one.first_frame}-{one.last_frame}" for one in segments.all())


def test_every_frame_is_in_one_segment():
    assert told("u" * 10 + "s" * 10) == "u0-9 s10-19"
    assert told("s" * 10 + "a" * 10 + "s" * 10) == "s0-9 a10-19 s20-29"
    assert told("s" * 10 + "u" * 10 + "s" * 10) == "s0-9 u10-19 s20-29"


def test_what_does_not_last_makes_no_segment():
    assert told("s" * 10 + "aa" + "s" * 10) == "s0-21"
    assert told("s" * 10 + "uu" + "s" * 10) == "s0-21"


def test_a_camera_that_was_missing_for_a_while_is_a_segment_of_its_own():
    """Whatever the judge says of since when the others have been in sync."""
    missing = [replace(said(frame, "a"), cause=Cause.MISSING, offset_ns=None) for frame in range(20, 30)]
    verdicts = [said(n, "s", since=0) for n in range(20)] + missing + [said(n, "s", since=0) for n in range(30, 50)]
    segments = [(one.first_frame, one.last_frame, one.state, one.cause) for one in cut(verdicts).all()]
    assert segments == [
        (0, 19, State.SYNC, None),
        (20, 29, State.ASYNC, Cause.MISSING),
        (30, 49, State.SYNC, None),
    ]


def test_too_few_frames_are_undecided():
    assert told("sss") == "u0-2"
    assert cut([]).all() == []


def test_a_bad_segment_begins_where_the_judge_says_it_began():
    verdicts = [said(frame, "s") for frame in range(20)] + [said(frame, "a", since=16) for frame in range(20, 30)]
    good, bad = cut(verdicts).all()
    assert (good.last_frame, bad.first_frame) == (15, 16)


def test_frames_that_could_not_be_judged_stay_undecided():
    verdicts = [said(frame, "s", since=0) for frame in range(10)] + [said(frame, "u") for frame in range(10, 20)]
    verdicts += [said(frame, "s", since=0) for frame in range(20, 30)]
    assert [one.first_frame for one in cut(verdicts).all()] == [0, 10, 20]


def test_times_count_from_the_first_frame_by_its_stamps():
    good, bad = cut([said(frame, "s" if frame < 10 else "a") for frame in range(20)]).all()
    assert (good.start_s, good.stop_s, bad.start_s, bad.stop_s) == (0.0, 0.5, 0.5, 1.0)
    assert (bad.cause, bad.offset_ms, good.offset_ms) == (Cause.SLIP, 50.0, 0.0)


def test_time_never_runs_backwards_even_where_a_clock_does():
    verdicts = [said(frame, "s") for frame in range(10)] + [said(frame, "a", at_ns=frame) for frame in range(10, 20)]
    segments = cut(verdicts)
    assert all(0 <= one.start_s <= one.stop_s for one in segments.all())
    assert segments.frames == 20
