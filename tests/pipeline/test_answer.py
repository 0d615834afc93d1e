"""One answer for a whole recording."""

from __future__ import annotations

import pytest

from pipeline.answer import answer
from pipeline.tally import Tally
from pipeline.verdict import Basis, Cause, PairTruth, Reason, State, Verdict
from pipeline.words import CAUSE_ADVICE, REASON_ADVICE

LETTERS = {"s": State.SYNC, "a": State.ASYNC, "u": State.UNKNOWN}


def tallied(said: str, truth: str | None = None, pair: str = "left-right") -> Tally:
    tally = Tally()
    for frame, letter in enumerate(said):
        known = None if truth is None else PairTruth(0, LETTERS[truth[frame]])
        tally.add(Verdict("bench", pair, frame, LETTERS[letter], Basis.CONTENT, truth=known))
    return tally


@pytest.mark.parametrize(
    ("said", "state"),
    [
        ("s" * 100, State.SYNC),
        ("s" * 95 + "a" * 5, State.SYNC),
        ("a" * 100, State.ASYNC),
        ("s" * 80 + "a" * 20, State.ASYNC),
        ("s" * 40 + "a" * 12 + "s" * 40, State.ASYNC),
        ("s" * 40 + "a" * 30 + "s" * 40 + "a" * 30 + "s" * 40, State.ASYNC),
        ("ssa" * 40, State.UNKNOWN),
        ("ssa" * 30 + "a" * 11 + "ssa" * 30, State.UNKNOWN),
        ("u" * 100, State.UNKNOWN),
        ("u" * 91 + "a" * 9, State.UNKNOWN),
        ("", State.UNKNOWN),
    ],
)
def test_the_answer_follows_what_lasts_and_not_what_flickers(said, state):
    assert answer(tallied(said)).state is state


def test_the_worst_pair_decides():
    tally = tallied("s" * 50)
    for frame in range(50):
        tally.add(Verdict("bench", "left-top", frame, State.ASYNC, Basis.CONTENT))
    result = answer(tally)
    assert result.state is State.ASYNC
    assert "left-right: 50 of 50 frames could be judged, all of them in sync." in result.text
    assert (
        "left-top: 50 of 50 frames could be judged, all of them out of sync. Frames 0 to 49: left and top"
        in result.text
    )


def test_it_tells_how_the_offset_changed():
    tally = Tally()
    for frame in range(60):
        later = 33_000_000 if frame >= 30 else -33_000_000
        said = Verdict(
            "bench", "left-right", frame, State.ASYNC, Basis.CONTENT,
            cause=Cause.SLIP, offset_ns=later, offset_frames=later / 33_000_000,
        )  # fmt: skip
        tally.add(said)
    text = answer(tally).text
    assert "Frames 0 to 29: right is 33.0 ms earlier than left (slip: whole frames apart" in text
    assert "Frames 30 to 59: right is 33.0 ms later than left (slip" in text


def test_it_tells_why_it_cannot_tell():
    tally = Tally()
    for frame in range(60):
        reason = Reason.DARK if frame < 20 else Reason.NO_MOTION
        tally.add(Verdict("bench", "left-right", frame, State.UNKNOWN, Basis.NONE, reason=reason))
    text = answer(tally).text
    assert (
        "none of 60 frames could be judged, mostly because nothing moves in a way that tells time (no_motion)" in text
    )
    assert text.endswith(f"What to do: {REASON_ADVICE[Reason.NO_MOTION]}")


def test_a_detector_that_sticks_is_not_credited_with_what_it_cannot_have_seen():
    said = "s" * 20 + "a" * 60 + "s" * 20
    truth = "s" * 20 + "a" * 20 + "s" * 20 + "a" * 2 + "s" * 38
    pair = tallied(said, truth).pairs["left-right"]
    assert [stretch.found for stretch in pair.injected] == [0, None]
    assert pair.false_alarms == 0
    assert pair.wrong == 20 + 18


def test_an_alarm_outside_every_fault_is_false():
    pair = tallied("s" * 20 + "a" * 10 + "s" * 20, "s" * 50).pairs["left-right"]
    assert (pair.false_alarms, pair.injected, pair.wrong) == (1, [], 10)


def test_a_camera_of_which_nothing_came_at_all_is_named():
    tally = Tally()
    for _ in range(2):
        tally.add(Verdict("bench", "left-right", None, State.ASYNC, Basis.NONE, cause=Cause.MISSING, camera="left"))
    said = f"OUT OF SYNC. left-right: no frame of left came. What to do: {CAUSE_ADVICE[Cause.MISSING]}"
    assert (answer(tally).state, answer(tally).text) == (State.ASYNC, said)
