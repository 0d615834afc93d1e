"""Writes the report of an evaluation: what was asked, what was said, and a picture of every run over time."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from html import escape
from pathlib import Path

from pipeline.errors import InputError, RunError
from pipeline.evaluate.columns import COLUMNS, by_manipulation, cells
from pipeline.evaluate.failures import FAILURE_COLUMNS, by_scenario, confusion, failure_cells
from pipeline.evaluate.outcome import Outcome
from pipeline.evaluate.report.svg import alone, confusion_svg, timeline_svg
from pipeline.evaluate.runner import Result
from pipeline.evaluate.score import Score
from pipeline.evaluate.suite import Clip
from pipeline.evaluate.timeline import Timeline
from pipeline.verdict import Cause
from pipeline.words import CAUSE_WORDS

DRAWING = """
text{font:12px sans-serif;fill:currentColor}.in{fill:#fff}.count{font-size:20px}
.sync,.right{fill:#2a9d5c}.async,.wrong{fill:#d1382c}.unknown{fill:#b9a44c}
.tolerance{fill:#888;fill-opacity:.18}.error{fill:#3778c2;fill-opacity:.25}
.told,.true{fill:none;stroke-width:1.6}.told{stroke:#3778c2}.true{stroke:currentColor;stroke-dasharray:5 4}
.event{stroke:#d1382c;stroke-width:2}.note{stroke:#8a63c9;stroke-width:1.4;stroke-dasharray:2 3}
"""

STYLE = (
    """
:root{color-scheme:light dark;--line:#8884;--soft:#8882}
body{font:15px/1.5 system-ui,sans-serif;max-width:1040px;margin:2rem auto;padding:0 1rem}
table{border-collapse:collapse;font-size:13px;display:block;overflow-x:auto}
td,th{padding:.25rem .6rem;border-bottom:1px solid var(--line);text-align:right;white-space:nowrap}
td:nth-child(-n+2),th:nth-child(-n+2){text-align:left}
section{border-top:1px solid var(--line);margin-top:2rem;padding-top:.5rem}
svg{width:100%;height:auto}.confusion{max-width:470px}
.good{color:#2a9d5c}.bad{color:#d1382c}.lead{font-size:17px}
ul{margin:.3rem 0}details{background:var(--soft);padding:.3rem .8rem;border-radius:6px}
"""
    + DRAWING
)


def write_report(folder: Path, suite: str, clips: Sequence[Clip], results: Sequence[Result]) -> Path:
    """Writes `index.html`, and the confusion matrix as a file of its own. Raises InputError or RunError."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InputError(f"{folder}: a folder for the report cannot be made: {error.strerror}") from error
    outcomes = [item for result in results for item in result.outcomes]
    matrix = confusion_svg(confusion(outcomes))
    page = _page(suite, clips, results, outcomes, matrix)
    try:
        (folder / "index.html").write_text(page, encoding="utf-8")
        (folder / "confusion.svg").write_text(alone(matrix, DRAWING), encoding="utf-8")
    except OSError as error:
        raise RunError(f"{folder}: the report cannot be written: {error.strerror}") from error
    return folder / "index.html"


def _page(
    suite: str, clips: Sequence[Clip], results: Sequence[Result], outcomes: Sequence[Outcome], matrix: str
) -> str:
    sections = [
        _section(clip, outcome, timeline)
        for clip, result in zip(clips, results, strict=True)
        for outcome, timeline in zip(result.outcomes, result.timelines, strict=True)
    ]
    scores = [item for result in results for item in result.scores]
    return (
        '<!doctype html><html lang="en"><head><meta charset="utf-8">'
        '<meta name="viewport" content="width=device-width,initial-scale=1">'
        f"<title>{escape(suite)}: evaluation</title><style>{STYLE}</style></head><body>"
        f"<h1>{escape(suite)}</h1>{_headline(outcomes)}{_tables(clips, outcomes, scores)}"
        f"<h2>What was true, and what was said</h2><p>Frames with a known truth, {_GRACE}.</p>{matrix}"
        f"<h2>Every run</h2><p>{_LEGEND}</p>{''.join(sections)}</body></html>\n"
    )


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
    alarms, hours = sum(run.false_alarms for run in outcomes), sum(run.hours for run in outcomes)
    words = f"{right} of {len(asked)} runs were judged as they must be. " if asked else ""
    words += f"{alarms} false alarm{'' if alarms == 1 else 's'} in {60 * hours:.1f} minutes of footage."
    return f'<p class="lead">{words}</p>'


def _tables(clips: Sequence[Clip], outcomes: Sequence[Outcome], scores: Sequence[Score]) -> str:
    made = ""
    staged = {clip.manipulation for clip in clips if clip.scenario is not None}
    runs = [run for run in outcomes if run.scenario in staged]
    if runs:
        rows = [[row, name, *failure_cells(group)] for (row, name), group in by_scenario(runs).items()]
        made += "<h2>Failures</h2>" + _table(["row", "scenario", *FAILURE_COLUMNS], rows)
    plain = [item for item in scores if item.manipulation not in staged]
    if plain:
        rows = [[name, "", *cells(group)] for name, group in by_manipulation(plain).items()]
        made += "<h2>Offset from the pictures</h2>" + _table(["manipulation", "", *COLUMNS], rows)
    return made


def _table(titles: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    head = "".join(f"<th>{escape(title)}</th>" for title in titles)
    body = "".join("<tr>" + "".join(f"<td>{escape(cell)}</td>" for cell in row) + "</tr>" for row in rows)
    return f"<table><thead><tr>{head}</tr></thead><tbody>{body}</tbody></table>"


def _section(clip: Clip, outcome: Outcome, timeline: Timeline) -> str:
    scenario = clip.scenario
    name = f"{scenario.row} {clip.manipulation}" if scenario else f"{clip.recording}: {clip.manipulation}"
    where = f"{clip.recording}, {outcome.pair}, seed {clip.seed}"
    about = f"<p>{escape(scenario.about)}</p>" if scenario and scenario.about else ""
    return (
        f"<section><h3>{escape(name)} <small>{escape(where)}</small></h3>{about}"
        f"<p><b>{escape(said(timeline))}</b></p>{_rightness(outcome)}{timeline_svg(timeline)}{_happened(timeline)}</section>"
    )


def said(timeline: Timeline) -> str:
    """What was said of the rig, in a sentence or two."""
    begun = [mark for mark in timeline.marks if mark.kind.endswith(" onset")]
    notes = [mark.text.replace("_", " ") for mark in timeline.marks if mark.kind == "note"]
    words = [
        f"{mark.text[:1].upper()}{mark.text[1:]} ({mark.at_s:.1f} s){_why(timeline, mark.at_s)}." for mark in begun[:4]
    ]
    if len(begun) > 4:
        words.append(f"And {len(begun) - 4} more events.")
    if not begun:
        held = {span.what.split(" ")[0] for span in timeline.said}
        words.append("Nothing is wrong with this rig." if "sync" in held else "Nothing can be said of this rig.")
    if notes:
        words.append(f"Noticed besides: {', '.join(notes)}.")
    return " ".join(words)


def _why(timeline: Timeline, at_s: float) -> str:
    """The cause in words, of what was said when an event began."""
    here = next((span.what for span in timeline.said if span.from_s <= at_s < span.to_s), "")
    state, _, cause = here.partition(" ")
    words = _causes().get(cause) if state == "async" else None
    return f": {words}" if words else ""


def _causes() -> Mapping[str, str]:
    return {cause.value: CAUSE_WORDS[cause] for cause in Cause}


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
