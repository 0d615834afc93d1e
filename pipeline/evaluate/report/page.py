"""Writes the report of an evaluation: what was asked, what was said, and a picture of every run over time."""

from __future__ import annotations

import os
from collections.abc import Sequence
from html import escape
from itertools import groupby
from pathlib import Path
from urllib.parse import quote

from pipeline.errors import InputError, RunError
from pipeline.evaluate.columns import COLUMNS, by_manipulation, cells
from pipeline.evaluate.failures import FAILURE_COLUMNS, by_scenario, confusion, confusions, failure_cells, upper_bound
from pipeline.evaluate.outcome import Outcome
from pipeline.evaluate.report.svg import alone, confusion_svg, timeline_svg
from pipeline.evaluate.runner import Result
from pipeline.evaluate.score import Score
from pipeline.evaluate.suite import Clip
from pipeline.html import page, table
from pipeline.sentences import said
from pipeline.timeline import Timeline

DRAWING = """
text{font:12px sans-serif;fill:currentColor}.in{fill:#fff}.count{font-size:20px}
.sync,.right{fill:#2a9d5c}.async,.wrong{fill:#d1382c}.unknown{fill:#b9a44c}
.tolerance{fill:#888;fill-opacity:.18}.error{fill:#3778c2;fill-opacity:.25}
.told,.true{fill:none;stroke-width:1.6}.told{stroke:#3778c2}.true{stroke:currentColor;stroke-dasharray:5 4}
.event{stroke:#d1382c;stroke-width:2}.note{stroke:#8a63c9;stroke-width:1.4;stroke-dasharray:2 3}
"""

STYLE = (
    """
td:nth-child(-n+2),th:nth-child(-n+2){text-align:left}
.confusion{max-width:470px}
.matrices{display:flex;flex-wrap:wrap;gap:1rem}figure{margin:0;flex:1 1 300px;max-width:470px}
"""
    + DRAWING
)


def make_folder(folder: Path) -> Path:
    """The folder of a report, which may be new. Raises InputError, before anything has run for it."""
    if folder.exists() and not folder.is_dir():
        raise InputError(f"--report {folder}: this is a file: name a folder, which may be new")
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InputError(f"--report {folder}: the folder cannot be made: {error.strerror}") from error
    if not os.access(folder, os.W_OK):
        raise InputError(f"--report {folder}: cannot be written: permission denied")
    return folder


def write_report(folder: Path, suite: str, clips: Sequence[Clip], results: Sequence[Result]) -> Path:
    """Writes `index.html`, and the confusion matrix as a file of its own, into a folder. Raises RunError."""
    outcomes = [item for result in results for item in result.outcomes]
    try:
        (folder / "index.html").write_text(_page(suite, clips, results, outcomes), encoding="utf-8")
        (folder / "confusion.svg").write_text(alone(confusion_svg(confusion(outcomes)), DRAWING), encoding="utf-8")
    except OSError as error:
        raise RunError(f"{folder}: the report cannot be written: {error.strerror}") from error
    return folder / "index.html"


def _page(suite: str, clips: Sequence[Clip], results: Sequence[Result], outcomes: Sequence[Outcome]) -> str:
    scores = [item for result in results for item in result.scores]
    body = (
        f"<h1>{escape(suite)}</h1>{_headline(outcomes)}{_wrong(outcomes)}{_tables(clips, outcomes, scores)}"
        f"<h2>What was true, and what was said</h2><p>Frames with a known truth, {_GRACE}.</p>{_matrices(outcomes)}"
        f"<h2>Every run</h2><p>{_LEGEND}</p>{_runs(clips, results)}"
    )
    return page(f"{suite}: evaluation", body, STYLE)


def _matrices(outcomes: Sequence[Outcome]) -> str:
    """Over all, and of each recording if there are several."""
    of_each = confusions(outcomes)
    drawn = {"all": confusion(outcomes), **(of_each if len(of_each) > 1 else {})}
    figures = (
        f"<figure><figcaption>{escape(name)}</figcaption>{confusion_svg(counts)}</figure>"
        for name, counts in drawn.items()
        if counts
    )
    return f'<div class="matrices">{"".join(figures)}</div>'


def _runs(clips: Sequence[Clip], results: Sequence[Result]) -> str:
    """A section each; of a scenario with many seeds, those that were right are folded away behind the first."""
    made = ""
    runs = [
        (clip, outcome, timeline)
        for clip, result in zip(clips, results, strict=True)
        for outcome, timeline in zip(result.outcomes, result.timelines, strict=True)
    ]
    for _, group in groupby(runs, key=lambda run: (run[1].recording, run[1].scenario)):
        first, *others = group
        shown = [run for run in others if run[1].wrong or run[1].state is None]
        folded = [run for run in others if run not in shown]
        made += "".join(_section(*run) for run in [first, *shown])
        if folded:
            seeds = f"{len(folded)} more {'run' if len(folded) == 1 else 'runs'}, as must be"
            made += f"<details><summary>{seeds}</summary>{''.join(_section(*run) for run in folded)}</details>"
    return made


_GRACE = "those within a second and a half of a change left out"
_LEGEND = (
    "The upper band is the truth, the lower one what was said: green in sync, red out of sync with its cause, ochre "
    "cannot tell with the reason. Below, the offset of the second camera: dashed as it was, blue as measured, with two "
    "standard errors; the grey band is what still counts as in sync. Red lines are events, violet ones notes: point at "
    "them to read them."
)


def _headline(outcomes: Sequence[Outcome]) -> str:
    asked = [run for run in outcomes if run.state is not None]
    right = sum(run.right for run in asked)
    alarms, hours = sum(run.false_alarms for run in outcomes), sum(run.hours_in_sync for run in outcomes)
    words = f"{right} of {len(asked)} runs were judged as they must be. " if asked else ""
    words += f"{alarms} false alarm{'' if alarms == 1 else 's'} in {60 * hours:.1f} minutes of footage in sync"
    bound = upper_bound(alarms, hours)
    words += "." if bound is None else f": fewer than {bound:.3g} an hour, with 95 % confidence."
    return f'<p class="lead">{words}</p>'


def _wrong(outcomes: Sequence[Outcome]) -> str:
    """What was not as it must be, each with a way to it."""
    lines = [
        f'<li><a href="#{_anchor(run)}">{escape(f"{run.row} {run.scenario}".strip())}</a>, seed {run.seed}: '
        f"{escape('; '.join(run.wrong))}</li>"
        for run in outcomes
        if run.wrong
    ]
    return f'<ul class="bad">{"".join(lines)}</ul>' if lines else ""


def _anchor(run: Outcome) -> str:
    """The name of a run's section: letters, digits and what may stand in an address."""
    return quote(f"{run.recording}/{run.scenario}/{run.pair}/{run.seed}", safe="/-_")


def _tables(clips: Sequence[Clip], outcomes: Sequence[Outcome], scores: Sequence[Score]) -> str:
    made = ""
    staged = {clip.manipulation for clip in clips if clip.scenario is not None}
    runs = [run for run in outcomes if run.scenario in staged]
    if runs:
        rows = [[row, name, *failure_cells(group)] for (row, name), group in by_scenario(runs).items()]
        rows.append(["", "all", *failure_cells(runs)])
        made += "<h2>Failures</h2>" + table(["row", "scenario", *FAILURE_COLUMNS], rows)
    plain = [item for item in scores if item.manipulation not in staged]
    if plain:
        rows = [[name, "", *cells(group)] for name, group in by_manipulation(plain).items()]
        made += "<h2>Offset from the pictures</h2>" + table(["manipulation", "", *COLUMNS], rows)
    return made


def _section(clip: Clip, outcome: Outcome, timeline: Timeline) -> str:
    scenario = clip.scenario
    name = f"{scenario.row} {clip.manipulation}" if scenario else f"{clip.recording}: {clip.manipulation}"
    where = f"{clip.recording}, {outcome.pair}, seed {clip.seed}"
    about = f"<p>{escape(scenario.about)}</p>" if scenario and scenario.about else ""
    return (
        f'<section id="{_anchor(outcome)}"><h3>{escape(name)} <small>{escape(where)}</small></h3>{about}'
        f"<p><b>{escape(said(timeline))}</b></p>{_rightness(outcome)}{timeline_svg(timeline)}{_happened(timeline)}</section>"
    )


def _rightness(outcome: Outcome) -> str:
    if outcome.state is None:
        return ""
    if outcome.right:
        late = "" if outcome.delay_frames is None else f", {outcome.delay_frames} frames after the onset"
        return f'<p class="good">As it must be{late}.</p>'
    return f'<p class="bad">Not as it must be: {escape("; ".join(outcome.wrong))}.</p>'


def _happened(timeline: Timeline) -> str:
    if not timeline.marks:
        return ""
    lines = "".join(f"<li>{mark.at_s:.2f} s: {escape(mark.kind)}: {escape(mark.text)}</li>" for mark in timeline.marks)
    return f"<details><summary>Events and notes</summary><ul>{lines}</ul></details>"
