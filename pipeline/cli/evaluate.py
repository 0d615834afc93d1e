"""`syncwatch evaluate`: how often is it right?"""

from __future__ import annotations

import json
import os
import time
from collections.abc import Iterator, Sequence
from contextlib import closing
from pathlib import Path
from typing import Any

import click
from rich.console import Console
from rich.progress import Progress, TaskID, TimeElapsedColumn
from rich.table import Table

from pipeline.cli.common import set_option
from pipeline.configtext.document import nearest
from pipeline.errors import InputError, RunError
from pipeline.evaluate.columns import COLUMNS, by_manipulation, by_recording, cells
from pipeline.evaluate.failures import FAILURE_COLUMNS, by_scenario, confusion, confusions, failure_cells
from pipeline.evaluate.outcome import Outcome
from pipeline.evaluate.report.page import make_folder, write_report
from pipeline.evaluate.runner import Result, check
from pipeline.evaluate.runner import evaluate as run_clips
from pipeline.evaluate.score import Score
from pipeline.evaluate.suite import Clip, load_suite

SCHEMA = "syncwatch.evaluation.v1"

SAY_EVERY_S = 30
"""How often a log, which shows no bar, is told how far clips have come that take long."""


@click.command()
@click.argument("suite")
@click.option("--json", "json_file", metavar="FILE", help="Write every score as JSON; - is standard output.")
@click.option("--only", multiple=True, metavar="NAME", help="This scenario or manipulation alone. May be given again.")
@click.option("--report", "report_dir", metavar="DIR", help="Write a page with every run over time: DIR/index.html.")
@click.option(
    "--jobs", type=click.IntRange(1, 256), default=os.cpu_count() or 1, help="Processes (default: one a core)."
)
@set_option
def evaluate(
    suite: str,
    json_file: str | None,
    only: tuple[str, ...],
    report_dir: str | None,
    jobs: int,
    overrides: tuple[str, ...],
) -> None:
    """Run the recordings of SUITE, with what its manipulations and scenarios do to them, against the truth.

    The truth is that of a rendered scene, or that a recording is in sync apart from what was done to it.
    """
    clips = chosen(load_suite(Path(suite), os.environ, overrides), only)
    target = None if json_file in {None, "-"} else _writable(Path(str(json_file)))
    expected = check(clips)
    folder = None if report_dir is None else make_folder(Path(report_dir))
    results = run(clips, jobs, expected)
    if folder is not None:
        page = write_report(folder, Path(suite).stem, clips, results)
        click.echo(f"report: {page}", err=True)
    if json_file == "-":
        click.echo(json.dumps(as_json(clips, results), indent=1))
        return
    if target is not None:
        try:
            target.write_text(json.dumps(as_json(clips, results), indent=1) + "\n", encoding="utf-8")
        except OSError as error:
            raise RunError(f"{target}: cannot be written: {error.strerror}") from error
    console = Console(width=220, highlight=False)
    for made in tables(clips, results):
        console.print(made)


def chosen(clips: Sequence[Clip], only: Sequence[str]) -> Sequence[Clip]:
    """The clips of these names; all, if none are given. Raises InputError for a name that there is not."""
    known = list(dict.fromkeys(clip.manipulation for clip in clips))
    for name in only:
        if name not in known:
            raise InputError(f"--only {name}: the suite has no such scenario or manipulation{nearest(name, known)}")
    return [clip for clip in clips if not only or clip.manipulation in only]


def _writable(target: Path) -> Path:
    """Raises InputError for a file that cannot be written, before anything has run for it."""
    if target.is_dir():
        raise InputError(f"--json {target}: this is a folder: name a file")
    if not target.parent.is_dir():
        raise InputError(f"--json {target}: cannot be written: there is no folder {target.parent}")
    if not os.access(target if target.exists() else target.parent, os.W_OK):
        raise InputError(f"--json {target}: cannot be written: permission denied")
    return target


def run(clips: Sequence[Clip], jobs: int, expected: Sequence[int | None] | None = None) -> list[Result]:
    """The result of every clip, in order; how far it has come is said on standard error meanwhile.

    expected: how many verdicts each clip will come to, as `check` has it; None where it is not known.
    """
    console = Console(stderr=True)
    done: dict[int, Result] = {}
    columns = (*Progress.get_default_columns(), TimeElapsedColumn())
    with Progress(*columns, console=console, transient=True, disable=not console.is_terminal) as progress:
        teller = _Teller(progress, expected or [], len(clips))
        with closing(run_clips(clips, jobs, teller.tell)) as running:
            for place, result in running:
                done[place] = result
                teller.done = len(done)
                if not console.is_terminal:
                    clip = clips[place]
                    click.echo(f"{len(done)}/{len(clips)} {clip.recording} {clip.manipulation}", err=True)
    return [done[place] for place in range(len(clips))]


class _Teller:
    """Says how far the clips have come: as a bar on a terminal, else as a line now and then."""

    def __init__(self, progress: Progress, expected: Sequence[int | None], clips: int) -> None:
        counts = [count for count in expected if count is not None]
        self._total = sum(counts) if counts and len(counts) == len(expected) else None
        self._clips = clips
        self._progress = progress
        self._task: TaskID = progress.add_task(f"0/{clips} clips", total=self._total)
        self._begun = self._told = time.monotonic()
        self.done = 0

    def tell(self, verdicts: int) -> None:
        self._progress.update(self._task, completed=verdicts, description=f"{self.done}/{self._clips} clips")
        now = time.monotonic()
        if not self._progress.disable or self._total is None or now < self._told + SAY_EVERY_S:
            return
        self._told = now
        share = min(verdicts / self._total, 1.0)
        left = f", about {(now - self._begun) * (1 / share - 1) / 60:.0f} min left" if share > 0 else ""
        click.echo(f"{100 * share:.0f} % of {self._total} frames{left}", err=True)


def as_json(clips: Sequence[Clip], results: Sequence[Result]) -> dict[str, Any]:
    """All scores and outcomes, a row a manipulation over all recordings, and a row a scenario over all seeds."""
    scores, outcomes = _scores(results), _staged(clips, results)
    return {
        "schema": SCHEMA,
        "clips": [item.to_json() for item in scores],
        "manipulations": {
            name: dict(zip(COLUMNS, cells(group), strict=True)) for name, group in by_manipulation(scores).items()
        },
        "runs": [item.to_json() for item in outcomes],
        "scenarios": {
            name: {"row": row, **dict(zip(FAILURE_COLUMNS, failure_cells(group), strict=True))}
            for (row, name), group in by_scenario(outcomes).items()
        },
        "confusion": confusion([item for result in results for item in result.outcomes]),
        "confusion_by_recording": confusions([item for result in results for item in result.outcomes]),
    }


def tables(clips: Sequence[Clip], results: Sequence[Result]) -> Iterator[Table]:
    """A row a scenario, seeds together; and of what else there is, one a recording and manipulation."""
    staged = _staged(clips, results)
    if staged:
        made = Table("row", "scenario", *FAILURE_COLUMNS)
        for (row, name), group in by_scenario(staged).items():
            made.add_row(row, name, *failure_cells(group))
        made.add_section()
        made.add_row("", "all", *failure_cells(staged), style="bold")
        yield made
    plain = [item for item in _scores(results) if item.manipulation not in {run.scenario for run in staged}]
    if plain:
        yield _score_table(plain)


def _score_table(scores: Sequence[Score]) -> Table:
    """A row a recording and manipulation, then one a manipulation with intervals over clips."""
    made = Table("recording", "manipulation", *COLUMNS)
    for name, group in by_manipulation(scores).items():
        recordings = by_recording(group)
        for recording, of_recording in recordings.items():
            made.add_row(recording, name, *cells(of_recording))
        if len(recordings) > 1:
            made.add_row(f"all {len(recordings)}", name, *cells(group), style="bold", end_section=True)
    return made


def _scores(results: Sequence[Result]) -> list[Score]:
    return [item for result in results for item in result.scores]


def _staged(clips: Sequence[Clip], results: Sequence[Result]) -> list[Outcome]:
    """The outcomes of scenarios."""
    return [
        item
        for clip, result in zip(clips, results, strict=True)
        if clip.scenario is not None
        for item in result.outcomes
    ]
