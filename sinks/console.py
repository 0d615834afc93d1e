"""Tells a person at a terminal what is going on: changes as they happen, and a summary at the end."""

from __future__ import annotations

import logging
import time
from collections.abc import Callable
from typing import Literal, TextIO

from rich.console import Console
from rich.markup import escape
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TaskID, TextColumn, TimeRemainingColumn

from pipeline.errors import RunError
from pipeline.frame import NS_PER_S, Rig
from pipeline.settings import Settings
from pipeline.steady import Steady
from pipeline.tally import PairTally, Tally
from pipeline.verdict import Event, Evidence, PairTruth, Report, State, Verdict, ms
from pipeline.words import REASON_WORDS

log = logging.getLogger("syncwatch.sinks.console")

COLOUR = {State.SYNC: "green", State.ASYNC: "bold red", State.UNKNOWN: "yellow"}
SAY_PROGRESS_EVERY_S = 10.0
VERDICT_WIDTH = 19
WITNESS_WIDTH = 17


class ConsoleSettings(Settings):
    """What is shown.

    style: `live` shows lasting changes of state, `classic` every frame as the report's figure 4.3 does, `progress`
    nothing but how far a recording has been read.
    """

    type: Literal["console"] = "console"
    style: Literal["live", "classic", "progress"] = "live"


class ConsoleSink:
    """Prints to `stream`; progress of a recording goes to the terminal, or now and then to the log."""

    lossless = True

    def __init__(
        self,
        settings: ConsoleSettings,
        *,
        stream: TextIO,
        rig: Rig,
        frame_count: int | None,
        now_s: Callable[[], float] = time.monotonic,
    ) -> None:
        self._style = settings.style
        self._rig = rig
        self._out = _Console(file=stream, highlight=False, soft_wrap=True, emoji=False)
        self._tally = Tally()
        self._steady = {pair.name: Steady() for pair in rig.pairs}
        self._began_ns: int | None = None
        self._progress = _Progress(self._out, frame_count, now_s)
        self._introduced = False
        self._headed = False

    def start(self) -> None:
        self._progress.start()

    def _introduce(self) -> None:
        pairs = ", ".join(pair.name for pair in self._rig.pairs)
        rates = "/".join(dict.fromkeys(f"{camera.fps:g}" for camera in self._rig.cameras))
        self._out.print(f"{escape(self._rig.name)}: {pairs} at {rates} fps")

    def take(self, report: Report) -> None:
        if not self._introduced and self._style != "progress":
            self._introduced = True
            self._introduce()
        if isinstance(report, Event) and report.kind != "async" and self._style == "live":
            self._out.print(f"[yellow]{escape(report.kind.upper())} {report.phase}[/]: {escape(report.text)}")
        if not isinstance(report, Verdict):
            return
        self._tally.add(report)
        if report.pair == self._rig.pairs[0].name:
            self._progress.advance(report.frame)
        if self._style == "classic":
            self._out.print(classic_lines(report, many_pairs=len(self._rig.pairs) > 1))
            return
        if self._style == "progress":
            return
        self._began_ns = _first_stamp(report) if self._began_ns is None else self._began_ns
        change = self._steady[report.pair].add(report)
        if change is not None:
            self._show(change.first)

    def stop(self) -> None:
        self._progress.stop()
        if not self._introduced:
            return
        for line in summary(self._tally):
            self._out.print(line)

    def _show(self, verdict: Verdict) -> None:
        if not self._headed:
            self._headed = True
            self._out.print(self._heading(verdict))
        stamp = _first_stamp(verdict)
        at = "" if stamp is None or self._began_ns is None else f"{(stamp - self._began_ns) / NS_PER_S:.1f} s"
        said = verdict.cause or verdict.reason
        word = f"{verdict.state.value.upper()} {said.value if said else ''}"
        cells = [f"{verdict.frame if verdict.frame is not None else '-':>7}", f"{at:>8}  "]
        if len(self._rig.pairs) > 1:
            cells.append(f"{verdict.pair:<{self._pair_width}}")
        cells.append(f"[{COLOUR[verdict.state]}]{word:<{VERDICT_WIDTH}}[/]")
        cells += [f"{_witness(item):<{WITNESS_WIDTH}}" for item in verdict.evidence]
        if verdict.truth is not None:
            cells.append(_truth(verdict.truth))
        self._out.print(" ".join(cells).rstrip())

    def _heading(self, verdict: Verdict) -> str:
        cells = [f"{'frame':>7}", f"{'time':>8}  "]
        if len(self._rig.pairs) > 1:
            cells.append(f"{'pair':<{self._pair_width}}")
        cells.append(f"{'verdict':<{VERDICT_WIDTH}}")
        cells += [escape(f"{item.detector:<{WITNESS_WIDTH}}") for item in verdict.evidence]
        if verdict.truth is not None:
            cells.append("injected" if verdict.truth.assumed else "truth")
        return "[bold]" + " ".join(cells).rstrip() + "[/]"

    @property
    def _pair_width(self) -> int:
        return max(len("pair"), *(len(pair.name) for pair in self._rig.pairs))


class _Console(Console):
    """Says that its reader has gone away; rich would end the thread."""

    def on_broken_pipe(self) -> None:
        raise RunError("the reader of standard output has gone away")


class _Progress:
    """A bar on a terminal; elsewhere a line in the log now and then."""

    def __init__(self, out: Console, frame_count: int | None, now_s: Callable[[], float]) -> None:
        self._total = frame_count
        self._now_s = now_s
        self._said_s = now_s()
        screen = out if out.is_terminal else Console(stderr=True)
        columns = (TextColumn("frame"), MofNCompleteColumn(), BarColumn(), TimeRemainingColumn())
        self._bar = Progress(*columns, console=screen, transient=True)
        self._shown = screen.is_terminal and frame_count is not None
        self._task: TaskID | None = None

    def start(self) -> None:
        if self._shown:
            self._task = self._bar.add_task("", total=self._total)
            self._bar.start()

    def advance(self, frame: int | None) -> None:
        if frame is None or self._total is None:
            return
        if self._task is not None:
            self._bar.update(self._task, completed=frame + 1)
        elif self._now_s() - self._said_s > SAY_PROGRESS_EVERY_S:
            self._said_s = self._now_s()
            log.info("frame %d of %d (%d %%)", frame + 1, self._total, 100 * (frame + 1) // self._total)

    def stop(self) -> None:
        if self._task is not None:
            self._bar.stop()


def classic_lines(verdict: Verdict, *, many_pairs: bool) -> str:
    """A verdict as the report's terminal shows it (figure 4.3); stamps and interval are integers in nanoseconds."""
    pair = f" {verdict.pair}" if many_pairs else ""
    lines = [f"Frame: {verdict.frame}{pair}    {verdict.state.value.capitalize()}"]
    if verdict.state is State.ASYNC:
        stamps = [f"{name.capitalize()}: {stamp}" for name, stamp in verdict.captured_ns.items()]
        lines += [f"Interval: {verdict.interval_ns}", f"Timestamps--> {'--> '.join(stamps)}"]
    return "\n".join(lines)


def summary(tally: Tally) -> list[str]:
    """What was said of each pair, why nothing where nothing was, and what of it was true where that is known."""
    lines = []
    for name, pair in tally.pairs.items():
        shares = ", ".join(f"{pair.states[state]} {state.value}" for state in State)
        lines.append(f"{name}: {pair.total} frames: {shares} ({100 * pair.decided / pair.total:.0f} % decided)")
        if pair.reasons:
            why = ", ".join(f"{REASON_WORDS[reason]} ({frames})" for reason, frames in pair.reasons.most_common())
            lines.append(f"{name}: unknown because {why}")
        if pair.truth_known:
            lines.append(f"{name}: {_against_truth(pair)}")
    return lines or ["nothing was judged: no two frames came together"]


def _against_truth(pair: PairTally) -> str:
    found = [stretch.found for stretch in pair.injected if stretch.found is not None]
    after = f" (after {', '.join(map(str, found))} frames)" if found else ""
    faults = f"{len(found)} of {len(pair.injected)} injected faults found{after}"
    alarms = f"{pair.false_alarms} false alarm{'' if pair.false_alarms == 1 else 's'}"
    caveat = ", if the recording itself is in sync" if pair.truth_assumed else ""
    return f"{faults if pair.injected else 'nothing out of sync'}, {alarms}, {pair.wrong} frames misjudged{caveat}"


def _witness(item: Evidence) -> str:
    offset = ms(item.offset_ns)
    return item.state.value if offset is None else f"{item.state.value} {offset:+.1f} ms"


def _truth(truth: PairTruth) -> str:
    faults = f" ({', '.join(truth.faults)})" if truth.faults else ""
    return f"{truth.state.value} {truth.offset_ns / 1e6:+.1f} ms{faults}"


def _first_stamp(verdict: Verdict) -> int | None:
    return next(iter(verdict.captured_ns.values()), None)
