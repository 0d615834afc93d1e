"""What people see."""

from __future__ import annotations

import io
import logging

from pipeline.frame import Camera, Pair, Rig
from pipeline.verdict import Basis, Cause, Evidence, Level, PairTruth, Reason, State, Status, Verdict
from sinks.console import ConsoleSettings, ConsoleSink, classic_lines
from tests.frames import PERIOD_NS, RIG


def verdict(frame: int, state: State, *, truth: PairTruth | None = None, pair: str = "left-right") -> Verdict:
    wrong = state is State.ASYNC
    stamps = {"left": frame * PERIOD_NS, "right": (frame + wrong) * PERIOD_NS}
    said = Evidence(pair, "timestamp", Basis.TIMESTAMPS, state, "stamps", offset_ns=wrong * PERIOD_NS)
    return Verdict(
        "bench", pair, frame, state, Basis.TIMESTAMPS, cause=Cause.SLIP if wrong else None, offset_ns=wrong * PERIOD_NS,
        reason=Reason.NO_MOTION if state is State.UNKNOWN else None, evidence=(said,), captured_ns=stamps, truth=truth,
    )  # fmt: skip


def shown(*verdicts: Verdict, rig: Rig = RIG, style: str = "live", **options: object) -> str:
    stream = io.StringIO()
    settings = ConsoleSettings.model_validate({"style": style})
    sink = ConsoleSink(settings, stream=stream, rig=rig, frame_count=None, **options)
    sink.start()
    for item in verdicts:
        sink.take(item)
    sink.stop()
    return stream.getvalue()


def stretch(*lengths: tuple[State, int]) -> list[Verdict]:
    states = [state for state, count in lengths for _ in range(count)]
    return [verdict(frame, state) for frame, state in enumerate(states)]


SYNC, ASYNC, UNKNOWN = State.SYNC, State.ASYNC, State.UNKNOWN


def test_only_lasting_changes_are_shown_dated_from_their_first_frame():
    text = shown(*stretch((SYNC, 8), (ASYNC, 2), (SYNC, 8), (ASYNC, 8), (UNKNOWN, 6)))
    words = [line.split()[:5] for line in text.splitlines()[2:5]]
    assert words == [
        ["0", "0.0", "s", "SYNC", "sync"],
        ["18", "1.8", "s", "ASYNC", "slip"],
        ["26", "2.6", "s", "UNKNOWN", "no_motion"],
    ]


def test_the_summary_counts_and_says_the_share_that_was_decided():
    text = shown(*stretch((SYNC, 6), (ASYNC, 1), (UNKNOWN, 3)))
    assert text.splitlines()[-2] == "left-right: 10 frames: 6 sync, 1 async, 3 unknown (70 % decided)"


def test_the_summary_says_why_nothing_was_known():
    text = shown(*stretch((SYNC, 6), (UNKNOWN, 3)))
    assert text.splitlines()[-1] == "left-right: unknown because nothing moves in a way that tells time (3)"
    assert "because" not in shown(*stretch((SYNC, 6), (ASYNC, 1)))


def test_the_summary_compares_with_the_truth_where_it_is_known():
    bad, good = PairTruth(PERIOD_NS, ASYNC, ("slip",)), PairTruth(0, SYNC)
    told = [verdict(n, SYNC, truth=good) for n in range(10)]
    told += [verdict(n, ASYNC, truth=bad) for n in range(10, 20)]
    told += [verdict(n, SYNC, truth=good) for n in range(20, 30)]
    told += [verdict(n, ASYNC, truth=good) for n in range(30, 40)]
    told += [verdict(n, SYNC, truth=bad) for n in range(40, 50)]
    text = shown(*told)
    assert (
        text.splitlines()[-1]
        == "left-right: 1 of 2 injected faults found (after 0 frames), 1 false alarm, 20 frames misjudged"
    )
    assert "async +100.0 ms (slip)" in text


def test_the_pair_is_named_where_there_are_several():
    rig = Rig("bench", (*RIG.cameras, Camera("top", 10)), (*RIG.pairs, Pair("left", "top")))
    told = [verdict(n, SYNC, pair=pair) for n in range(6) for pair in ("left-right", "left-top")]
    assert [line.split()[3] for line in shown(*told, rig=rig).splitlines()[2:4]] == ["left-right", "left-top"]


def test_the_classic_style_is_that_of_the_reports_terminal():
    assert classic_lines(verdict(48, SYNC), many_pairs=False) == "Frame: 48    Sync"
    assert classic_lines(verdict(50, ASYNC), many_pairs=False) == (
        "Frame: 50    Async\nInterval: 100000000\nTimestamps--> Left: 5000000000--> Right: 5100000000"
    )


def test_progress_is_said_now_and_then_where_there_is_no_terminal(caplog):
    seconds = iter(range(0, 1000, 4))
    stream = io.StringIO()
    sink = ConsoleSink(ConsoleSettings(), stream=stream, rig=RIG, frame_count=10, now_s=lambda: float(next(seconds)))
    sink.start()
    with caplog.at_level(logging.INFO):
        for item in stretch((SYNC, 10)):
            sink.take(item)
    sink.stop()
    said = [record.getMessage() for record in caplog.records]
    assert said[0] == "frame 3 of 10 (30 %)"
    assert 2 <= len(said) <= 5


def test_the_progress_style_prints_nothing():
    assert shown(*stretch((SYNC, 8), (ASYNC, 8)), style="progress") == ""


def test_a_run_in_which_nothing_came_together_says_so():
    stream = io.StringIO()
    sink = ConsoleSink(ConsoleSettings(), stream=stream, rig=RIG, frame_count=None)
    sink.start()
    sink.take(Status("bench", 1, Level.OK, (), {}, {}, "0", 1.0, 0))
    sink.stop()
    assert stream.getvalue().splitlines()[-1] == "nothing was judged: no two frames came together"


def test_a_run_that_never_began_prints_nothing():
    assert shown() == ""
