"""`syncwatch evaluate`: how often is it right?"""

from __future__ import annotations

import json
import os
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import click
from rich.console import Console
from rich.progress import Progress, TimeElapsedColumn
from rich.table import Table

from pipeline.cli.common import set_option
from pipeline.configtext.document import nearest
from pipeline.errors import InputError
from pipeline.evaluate.columns import COLUMNS, by_manipulation, by_recording, cells
from pipeline.evaluate.failures import FAILURE_COLUMNS, by_scenario, confusion, failure_cells
from pipeline.evaluate.outcome import Outcome
from pipeline.evaluate.report.page import write_report
from pipeline.evaluate.runner import Result, check
from pipeline.evaluate.runner import evaluate as run_clips
from pipeline.evaluate.score import Score
from pipeline.evaluate.suite import Clip, load_suite

SCHEMA = "syncwatch.evaluation.v1"


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
    target = None if json_file in {None, "-"} else Path(str(json_file))
    if target is not None and not target.parent.is_dir():
        raise InputError(f"{target}: cannot be written: there is no folder {target.parent}")
    folder = None if report_dir is None else Path(report_dir)
    if folder is not None and folder.exists() and not folder.is_dir():
        raise InputError(f"--report {folder}: this is a file: name a folder, which may be new")
    check(clips)
    results = run(clips, jobs)
    if folder is not None:
        page = write_report(folder, Path(suite).stem, clips, results)
        click.echo(f"report: {page}", err=True)
    if json_file == "-":
        click.echo(json.dumps(as_json(clips, results), indent=1))
        return
    if target is not None:
        target.write_text(json.dumps(as_json(clips, results), indent=1) + "\n", encoding="utf-8")
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


def run(clips: Sequence[Clip], jobs: int) -> list[Result]:
    """The result of every clip, in order; how far it has come is said on standard error meanwhile."""
    console = Console(stderr=True)
    done: dict[int, Result] = {}
    columns = (*Progress.get_default_columns(), TimeElapsedColumn())
    with Progress(*columns, console=console, transient=True, disable=not console.is_terminal) as progress:
        task = progress.add_task("clips", total=len(clips))
        for place, result in run_clips(clips, jobs):
            done[place] = result
            progress.advance(task)
            if not console.is_terminal:
                clip = clips[place]
                click.echo(f"{len(done)}/{len(clips)} {clip.recording} {clip.manipulation}", err=True)
    return [done[place] for place in range(len(clips))]


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
