"""`syncwatch evaluate`: how often is it right?"""

from __future__ import annotations

import json
import os
from collections.abc import Sequence
from pathlib import Path
from statistics import median
from typing import Any

import click
from rich.console import Console
from rich.progress import Progress
from rich.table import Table

from pipeline.assemble import KINDS
from pipeline.cli.common import set_option
from pipeline.configtext.document import load_file
from pipeline.errors import InputError
from pipeline.evaluate.runner import evaluate as run_clips
from pipeline.evaluate.score import Score, Share, quantile, share
from pipeline.evaluate.suite import read_suite

SCHEMA = "syncwatch.evaluation.v1"
COLUMNS = ("windows", "decided", "whole frame", "within 0.1", "error median", "error 95 %", "in 2 sigma",
           "false async", "missed", "steps found", "after frames")  # fmt: skip


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
    file = Path(suite)
    clips = read_suite(load_file(file, os.environ, overrides), file.resolve().parent)
    for clip in clips:
        clip.plan(KINDS)
    target = None if json_file in {None, "-"} else Path(str(json_file))
    if target is not None and not target.parent.is_dir():
        raise InputError(f"{target}: cannot be written: there is no folder {target.parent}")
    scores: list[Score] = []
    with Progress(console=Console(stderr=True), transient=True) as progress:
        task = progress.add_task("clips", total=len(clips))
        for of_clip in run_clips(clips, jobs):
            scores += of_clip
            progress.advance(task)
    order = {(clip.recording, clip.manipulation, clip.seed): n for n, clip in enumerate(clips)}
    scores.sort(key=lambda item: (order[item.recording, item.manipulation, item.seed], item.pair))
    if json_file == "-":
        click.echo(json.dumps(as_json(scores), indent=1))
        return
    if target is not None:
        target.write_text(json.dumps(as_json(scores), indent=1) + "\n", encoding="utf-8")
    Console(width=200, highlight=False).print(table(scores))


def as_json(scores: Sequence[Score]) -> dict[str, Any]:
    """All scores, and a row a manipulation over all recordings."""
    return {
        "schema": SCHEMA,
        "clips": [item.to_json() for item in scores],
        "manipulations": {
            name: dict(zip(COLUMNS, _cells(group), strict=True)) for name, group in _by_manipulation(scores).items()
        },
    }


def table(scores: Sequence[Score]) -> Table:
    """A row a recording and manipulation, seeds together, then one a manipulation with intervals over clips."""
    made = Table("recording", "manipulation", *COLUMNS)
    for name, group in _by_manipulation(scores).items():
        recordings = list(dict.fromkeys(item.recording for item in group))
        for recording in recordings:
            made.add_row(recording, name, *_cells([item for item in group if item.recording == recording]))
        if len(recordings) > 1:
            made.add_row(f"all {len(recordings)}", name, *_cells(group), style="bold", end_section=True)
    return made


def _by_manipulation(scores: Sequence[Score]) -> dict[str, list[Score]]:
    groups: dict[str, list[Score]] = {}
    for item in scores:
        groups.setdefault(item.manipulation, []).append(item)
    return groups


def _cells(group: Sequence[Score]) -> list[str]:
    errors = sorted(error for item in group for error in item.errors)
    delays = sorted(delay for item in group for delay in item.delays)
    shares: list[Share] = [
        share(group, lambda item: item.decided, lambda item: item.windows),
        share(group, lambda item: item.whole_right, lambda item: item.measured),
        share(group, lambda item: item.small_error, lambda item: item.measured),
    ]
    return [
        str(sum(item.windows for item in group)),
        *map(str, shares),
        f"{median(errors):.3f}" if errors else "-",
        f"{quantile(errors, 0.95):.3f}" if errors else "-",
        str(share(group, lambda item: item.within_two_sigma, lambda item: item.with_sigma)),
        str(sum(item.false_async for item in group)),
        str(sum(item.false_sync for item in group)),
        f"{len(delays)} of {sum(item.steps for item in group)}",
        f"{median(delays):g}, 95 % {quantile(delays, 0.95)}" if delays else "-",
    ]
