"""Sets every method of the report beside the default configuration and writes docs/methods.md and its picture.

    python -m benchmarks.methods [--jobs N] [--scores FILE]

All methods are given the same windows of benchmarks/suites/methods.yaml, and all frames of methods-report.yaml. What
was said is kept in build/methods.json; `--scores build/methods.json` writes the page again without measuring.
"""

from __future__ import annotations

import argparse
import json
import os
import random
import sys
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import Future, as_completed
from dataclasses import asdict
from pathlib import Path
from typing import Any

import click
from rich.console import Console
from rich.progress import Progress, TimeElapsedColumn

from benchmarks import methods_page as page
from benchmarks import methods_picture as picture
from benchmarks.methods_scores import Confusion, Measured, Method, Seen
from pipeline.assemble import KINDS, build_rig
from pipeline.buffer import WindowBuffer
from pipeline.cli.common import report
from pipeline.errors import InputError, SyncwatchError
from pipeline.evaluate.runner import check, opened
from pipeline.evaluate.score import Row, Score, period_of, score
from pipeline.evaluate.suite import Clip, load_suite
from pipeline.frame import Detector, Pair, Rig, Window
from pipeline.health.observer import Observation, Observer
from pipeline.judge import Judge, JudgeSettings
from pipeline.verdict import Evidence, State
from pipeline.workers import workers

ROOT = Path(__file__).resolve().parent.parent
FOLDER = ROOT / "benchmarks" / "suites"
DOCUMENT = ROOT / "docs" / "methods.md"
PICTURE = ROOT / "docs" / "methods.svg"
KEPT = ROOT / "build" / "methods.json"

BLOCKS, BLOCK = 6, 10
"""Windows of a clip that count: so many runs of so many in a row, drawn with the clip's seed."""

FROM_HISTORY = ("timestamp", "offset", "epipolar_classes")
"""Methods that see every window of a clip up to the last that counts, as their answers rest on those before."""

COMBINED: Mapping[str, tuple[str, tuple[str, str]]] = {
    page.REPORT: ("classic", ("timestamp", "spatial")),
    page.DEFAULT: ("evidence", ("timestamp", "offset")),
}
"""The report's algorithm and the default configuration: how evidence is combined, and whose."""

SECONDS_PER_MINUTE = 60


def compare(clip: Clip, expected: int) -> tuple[str, str, list[Seen]]:
    """What every method makes of the windows of a clip that count, out of `expected`."""
    counted = drawn(clip, expected)
    fresh = {index for index in counted if index - 1 not in counted}
    seen: dict[str, Seen] = {}
    said: dict[str, list[tuple[Row, Row]]] = {}
    for window, _, rig, detectors in watched(clip):
        if window.index > max(counted):
            break
        truth_frames = true_offset(window, rig)
        for name, detector in detectors.items():
            if window.index not in counted and name not in FROM_HISTORY:
                continue
            started_ns = time.thread_time_ns()
            evidence = next(iter(detector.observe(window)))
            spent_ns = time.thread_time_ns() - started_ns
            if window.index in counted and truth_frames is not None:
                rows = (row(window.index, truth_frames, evidence, forced=forced) for forced in (False, True))
                said.setdefault(name, []).append((next(rows), next(rows)))
                seen.setdefault(name, Seen(name))
                if window.index not in fresh:
                    seen[name].spent_ms.append(spent_ns / 1e6)
    for name, pairs in said.items():
        empty = Score(clip.recording, clip.manipulation, clip.seed)
        seen[name].said, seen[name].forced = (
            score(empty, [pair[place] for pair in pairs], fps=1.0, warm_up_s=0, warm_up_frames=0) for place in (0, 1)
        )
    return clip.recording, clip.manipulation, list(seen.values())


def drawn(clip: Clip, expected: int) -> set[int]:
    """Indices of windows: BLOCKS runs of BLOCK, after the warm-up, before the last."""
    source = opened(clip)
    fps = source.cameras[0].fps
    source.close()
    lead = round(min(max(clip.warm_up_s * fps, clip.warm_up_frames), expected / 3))
    starts = range(lead, expected - BLOCK - 1, BLOCK)
    chance = random.Random(f"{clip.recording} {clip.manipulation} {clip.seed}")
    chosen = chance.sample(starts, min(BLOCKS, len(starts)))
    return {index for start in chosen for index in range(start, start + BLOCK)}


def experiment(clip: Clip) -> tuple[str, dict[str, Confusion]]:
    """What every method, and each combination of two, makes of every frame of a clip."""
    counts: dict[str, Confusion] = {}
    judges: dict[str, Judge] = {}
    for window, observation, rig, detectors in watched(clip):
        judges = judges or {
            name: Judge(JudgeSettings.model_validate({"combine": combine}), rig)
            for name, (combine, _) in COMBINED.items()
        }
        truth_frames = true_offset(window, rig)
        if truth_frames is None:
            continue
        truth = State.SYNC if round(truth_frames) == 0 else State.ASYNC
        evidence = {name: next(iter(detector.observe(window))) for name, detector in detectors.items()}
        states = {name: item.state for name, item in evidence.items()}
        for name, (_, pair) in COMBINED.items():
            (verdict,) = judges[name].judge(window, [evidence[each] for each in pair], observation)
            states[name] = verdict.state
        for name, state in states.items():
            of_truth = counts.setdefault(name, {}).setdefault(truth.value, {})
            of_truth[state.value] = of_truth.get(state.value, 0) + 1
    return clip.recording, counts


def watched(clip: Clip) -> Iterator[tuple[Window, Observation, Rig, Mapping[str, Detector]]]:
    """The windows of a clip with what is known of its cameras' health, the rig, and all detectors of its suite."""
    plan = clip.plan(KINDS)
    source = opened(clip)
    try:
        rig = build_rig(plan, source)
        detectors = {
            name: chosen.build(chosen.settings, name=name, rig=rig, classic=False, plan=plan)
            for name, chosen in plan.detectors.items()
        }
        observer, buffer = Observer(rig.cameras), WindowBuffer(rig.cameras, plan.config.buffer)
        for frame in source.frames():
            observer.push(frame)
            for window in buffer.push(frame):
                yield window, observer.see(window), rig, detectors
        for window in buffer.flush():
            yield window, observer.see(window), rig, detectors
    finally:
        source.stop()
        source.close()


def true_offset(window: Window, rig: Rig) -> float | None:
    """In frames; None where a frame is missing."""
    pair: Pair = rig.pairs[0]
    first, second = window.cameras[pair.first].current, window.cameras[pair.second].current
    if first is None or second is None or first.truth is None or second.truth is None:
        return None
    return (second.truth.shown_ns - first.truth.shown_ns) / period_of(rig.camera(pair.first).fps)


def row(index: int, truth_frames: float, evidence: Evidence, *, forced: bool) -> Row:
    """What was said of a window; forced: what would have been, had nobody been allowed to abstain."""
    truth, state, offset = (
        State.SYNC if round(truth_frames) == 0 else State.ASYNC,
        evidence.state,
        evidence.offset_frames,
    )
    if forced and state is State.UNKNOWN:
        offset = best_guess(evidence)
        state = State.UNKNOWN if offset is None else State.SYNC if round(offset) == 0 else State.ASYNC
    return Row(index, truth_frames, truth, state, offset, None, state)


def best_guess(evidence: Evidence) -> float | None:
    """The offset that an undecided piece of evidence leans to."""
    scores = {
        offset: value
        for moment, offset in (("_t", 0.0), ("_t-1", 1.0), ("_t+1", -1.0))
        for name, value in evidence.numbers.items()
        if name.endswith(moment)
    }
    return max(scores, key=lambda offset: (scores[offset], offset == 0)) if scores else evidence.offset_frames


def measure(jobs: int) -> Measured:
    """Runs both suites, clips in parallel. Raises SyncwatchError."""
    started_s = time.monotonic()
    clips = [*load_suite(FOLDER / "methods.yaml", os.environ)]
    experiments = [*load_suite(FOLDER / "methods-report.yaml", os.environ)]
    expected = check([*clips, *experiments])
    made = Measured({}, {}, jobs)
    console = Console(stderr=True)
    columns = (*Progress.get_default_columns(), TimeElapsedColumn())
    with (
        Progress(*columns, console=console, transient=True, disable=not console.is_terminal) as progress,
        workers(jobs) as pool,
    ):
        task = progress.add_task("clips", total=len(clips) + len(experiments))
        tell = _teller(console, len(clips) + len(experiments))
        compared = [pool.submit(compare, clip, count or 0) for clip, count in zip(clips, expected, strict=False)]
        tried = [pool.submit(experiment, clip) for clip in experiments]
        jobs_running: list[Future[Any]] = [*compared, *tried]
        for future in as_completed(jobs_running):
            future.result()
            progress.advance(task)
            tell()
    for name in clips[0].config["detectors"]:
        of_method = [seen for each in compared for seen in each.result()[2] if seen.name == name]
        made.methods[name] = Method(of_method)
    made.experiments.update(each.result() for each in tried)
    made.minutes = round((time.monotonic() - started_s) / SECONDS_PER_MINUTE, 1)
    return made


def _teller(console: Console, total: int) -> Callable[[], None]:
    """Says in a log, which shows no bar, how many clips are done."""
    done = 0

    def tell() -> None:
        nonlocal done
        done += 1
        if not console.is_terminal:
            click.echo(f"{done}/{total} clips", err=True)

    return tell


def main(arguments: Sequence[str] | None = None) -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--jobs", type=_processes, default=os.cpu_count() or 1, help="processes (default: one a core)")
    parser.add_argument("--scores", type=Path, help="write the page from these scores instead of measuring")
    given = parser.parse_args(arguments)
    try:
        measured = measure(given.jobs) if given.scores is None else kept(given.scores)
    except SyncwatchError as error:
        return report(error)
    if given.scores is None:
        KEPT.parent.mkdir(exist_ok=True)
        KEPT.write_text(json.dumps(asdict(measured)), encoding="utf-8")
    picture.draw(measured, PICTURE)
    DOCUMENT.write_text(page.write(measured), encoding="utf-8")
    print(f"{DOCUMENT}: written")
    return 0


def _processes(text: str) -> int:
    if not text.isdecimal() or int(text) < 1:
        raise argparse.ArgumentTypeError(f"{text!r} is not a number of processes: 1 or more")
    return int(text)


def kept(file: Path) -> Measured:
    """What an earlier run kept. Raises InputError."""
    try:
        return Measured.from_json(json.loads(file.read_text(encoding="utf-8")))
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise InputError(f"{file}: not scores that this version kept ({error}): leave --scores out") from None


if __name__ == "__main__":
    sys.exit(main())
