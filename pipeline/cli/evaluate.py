"""`syncwatch evaluate`: how often is it right?"""

from __future__ import annotations

import json
import os
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import click
from rich.console import Console
from rich.progress import Progress, TimeElapsedColumn
from rich.table import Table

from pipeline.cli.common import set_option
from pipeline.errors import InputError
from pipeline.evaluate.columns import COLUMNS, by_manipulation, by_recording, cells
from pipeline.evaluate.runner import check
from pipeline.evaluate.runner import evaluate as run_clips
from pipeline.evaluate.score import Score
from pipeline.evaluate.suite import Clip, load_suite

SCHEMA = "syncwatch.evaluation.v1"


@click.command()
@click.argument("suite")
@click.option("--json", "json_file", metavar="FILE", help="Write every score as JSON; - is standard output.")
@click.option(
    "--jobs", type=click.IntRange(1, 256), default=os.cpu_count() or 1, help="Processes (default: one a core)."
)
@set_option
def evaluate(suite: str, json_file: str | None, jobs: int, overrides: tuple[str, ...]) -> None:
    """Run the recordings of SUITE, manipulated as it says, against the truth.

    The truth is that of a rendered scene, or that a recording is in sync apart from what was done to it.
    """
    clips = load_suite(Path(suite), os.environ, overrides)
    target = None if json_file in {None, "-"} else Path(str(json_file))
    if target is not None and not target.parent.is_dir():
        raise InputError(f"{target}: cannot be written: there is no folder {target.parent}")
    check(clips)
    scores = [item for of_clip in run(clips, jobs) for item in of_clip]
    if json_file == "-":
        click.echo(json.dumps(as_json(scores), indent=1))
        return
    if target is not None:
        target.write_text(json.dumps(as_json(scores), indent=1) + "\n", encoding="utf-8")
    Console(width=200, highlight=False).print(table(scores))


def run(clips: Sequence[Clip], jobs: int) -> list[list[Score]]:
    """The scores of every clip, in order, one a pair; how far it has come is said on standard error meanwhile."""
    console = Console(stderr=True)
    done: dict[int, list[Score]] = {}
    columns = (*Progress.get_default_columns(), TimeElapsedColumn())
    with Progress(*columns, console=console, transient=True, disable=not console.is_terminal) as progress:
        task = progress.add_task("clips", total=len(clips))
        for place, of_clip in run_clips(clips, jobs):
            done[place] = sorted(of_clip, key=lambda item: item.pair)
            progress.advance(task)
            if not console.is_terminal:
                clip = clips[place]
                click.echo(f"{len(done)}/{len(clips)} {clip.recording} {clip.manipulation}", err=True)
    return [done[place] for place in range(len(clips))]


def as_json(scores: Sequence[Score]) -> dict[str, Any]:
    """All scores, and a row a manipulation over all recordings."""
    return {
        "schema": SCHEMA,
        "clips": [item.to_json() for item in scores],
        "manipulations": {
            name: dict(zip(COLUMNS, cells(group), strict=True)) for name, group in by_manipulation(scores).items()
        },
    }


def table(scores: Sequence[Score]) -> Table:
    """A row a recording and manipulation, seeds together, then one a manipulation with intervals over clips."""
    made = Table("recording", "manipulation", *COLUMNS)
    for name, group in by_manipulation(scores).items():
        recordings = by_recording(group)
        for recording, of_recording in recordings.items():
            made.add_row(recording, name, *cells(of_recording))
        if len(recordings) > 1:
            made.add_row(f"all {len(recordings)}", name, *cells(group), style="bold", end_section=True)
    return made
