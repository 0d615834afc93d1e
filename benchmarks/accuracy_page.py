"""Writes docs/accuracy.md: the protocol, goal by goal what was measured, every row, and what is not reached."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

from benchmarks import cost
from benchmarks.accuracy_goals import AIMS, SECTIONS, Aim, Section
from benchmarks.cost import Cost
from pipeline.evaluate import measures
from pipeline.evaluate.columns import by_manipulation, by_recording, cells, percent
from pipeline.evaluate.goals import LEAST_WINDOWS, Outcome, Result, judge
from pipeline.evaluate.measures import RESAMPLES
from pipeline.evaluate.score import Score

OPENING = """\
# Accuracy of the content offset

<!-- Written by `make accuracy` in {minutes:g} minutes with {jobs} processes. Do not edit: goals are in
     benchmarks/accuracy_goals.py, the protocol in accuracy_page.py, notes in docs/accuracy-notes.md. -->

How far apart in time does the detector `offset` believe two cameras to be, and how far are they really? Every number
here comes from `make accuracy`, which runs the suites of `benchmarks/suites`. Each also runs by itself:
`syncwatch evaluate benchmarks/suites/clean.yaml`.

![Offset measured on a hand-held walk whose right camera steps by a frame and back](offset-step.png)

## Protocol

- **Decided**: the pictures said sync or async (`content.state` is not unknown). Everything in the tables but *decided*
  is told of decided windows only; a window is a frame of the first camera with its neighbours.
- **Warm-up**: the first 2 s or 20 frames, whichever is longer, do not count, but at most a third of a clip.
- **A row counts** for a goal of accuracy with at least half of its windows decided, and with {least} windows or more.
- **Intervals**, in brackets, are 95 %, by bootstrap over clips ({draws} draws): frames of one clip are not independent.
  A single clip has none; one that reads like the value itself is left out.
- **Truth**: rendered footage is exact. Real recordings are taken to be in sync as stored; then the second camera's
  pictures are shifted by whole frames, or both sides are sub-sampled: every 2nd or 4th frame of the first camera, every
  2nd or 4th plus k of the second. Precision rows use `euroc`, `kitti`, `boof`, `face` and rendered footage; the truth
  of the others is not known well enough. Left out for the same reason: `p2s_single_60fps` (in sync to two frames) and
  `webcams_loose` (out of sync by an amount that changes).
- **Steps**: the second camera steps by one frame and stays there; several places, a clip each, all in one row. Delays
  count frames from the first changed one (0: told of that very frame; every verdict needs one frame more to come in).
  A step that is not found, or async said beforehand, counts as infinitely late.
- **Met** is judged over all rows that count together; how many rows meet the goal alone stands beside it.
- Offsets, errors and sigma (the median of the detector's own standard error) are in frames.
"""

Key = tuple[str, ...]
"""Suite, recording, manipulation: a row."""


@dataclass(frozen=True, slots=True)
class Measured:
    """All that was measured: scores by suite, CPU costs, with how many processes and in what time."""

    scores: Mapping[str, Sequence[Score]]
    costs: Sequence[Cost]
    jobs: int
    minutes: float


def write(measured: Measured, notes: str) -> str:
    """The whole page; `notes` are kept by hand and stand at its end."""
    rows = rows_of(measured)
    results = {aim: judge(aim.goal, {key: row for key, row in rows.items() if aim.about(*key[:2])}) for aim in AIMS}
    lines = [
        OPENING.format(minutes=measured.minutes, jobs=measured.jobs, draws=RESAMPLES, least=LEAST_WINDOWS),
        *_summary(results, measured.costs),
        "## Every row",
        "",
        *(line for section in SECTIONS for line in _table(section, rows, results)),
        *_cost_table(measured.costs),
        *_shortfalls(rows, results, measured.costs),
        notes.rstrip(),
    ]
    return "\n".join(lines) + "\n"


def rows_of(measured: Measured) -> dict[Key, list[Score]]:
    """The clips of every row."""
    return {
        (suite, recording, manipulation): row
        for suite, scores in measured.scores.items()
        for recording, of_recording in by_recording(scores).items()
        for manipulation, row in _manipulations(suite, of_recording).items()
    }


def _manipulations(suite: str, scores: Sequence[Score]) -> dict[str, list[Score]]:
    groups = by_manipulation(scores)
    together = any(section.together for section in SECTIONS if section.suite == suite)
    return {f"all {len(groups)}": list(scores)} if together else groups


def _summary(results: Mapping[Aim, Result], costs: Sequence[Cost]) -> Iterator[str]:
    yield "## Goals"
    yield ""
    yield "| goal | wanted | measured | clips, windows | rows: met, not met, do not count | |"
    yield "|---|---|---|---|---|---|"
    for aim, result in results.items():
        goal = aim.goal
        shown = ", ".join(_named(title, text) for title, text in _values(result)) if result.counted else "-"
        size = f"{len(result.counted)}, {sum(item.windows for item in result.counted)}"
        rows = ", ".join(str(result.how_many(outcome)) for outcome in Outcome)
        yield f"| {goal.name} | {goal.limit} | {shown} | {size} | {rows} | **{_outcome(result)}** |"
    for (width, height), limit in cost.GOALS.items():
        of_size = [item for item in costs if (item.width, item.height) == (width, height)]
        worst = max(of_size, key=lambda item: item.ratio)
        outcome = Outcome.MET if all(item.met for item in of_size) else Outcome.NOT_MET
        yield (
            f"| CPU a pair beside `spatial`, {width}x{height} | <= {limit:g} | {_ratio(worst)} ({worst.motion}) "
            f"| {len(of_size)}, {len(of_size) * cost.REPEATS * cost.MEASURED} "
            f"| {sum(item.met for item in of_size)}, {sum(not item.met for item in of_size)}, 0 | **{outcome.value}** |"
        )
    yield ""


def _values(result: Result) -> list[tuple[str, str]]:
    columns = result.goal.columns
    return list(zip(columns, cells(result.counted, columns), strict=True))


def _named(title: str, text: str) -> str:
    return f"{title} {text}"


def _table(section: Section, rows: Mapping[Key, Sequence[Score]], results: Mapping[Aim, Result]) -> Iterator[str]:
    yield f"### {section.title}"
    yield ""
    yield f"`benchmarks/suites/{section.suite}.yaml`"
    yield ""
    yield f"| recording | manipulation | clips | {' | '.join(section.columns)} | goals |"
    yield "|---|---|" + "---|" * (len(section.columns) + 2)
    mine = {key: row for key, row in rows.items() if key[0] == section.suite}
    for key, row in mine.items():
        texts = [key[1], key[2], str(len(row)), *cells(row, section.columns), _goals_of(key, results)]
        yield f"| {' | '.join(texts)} |"
    everything = [item for row in mine.values() for item in row]
    texts = ["all", "", str(len(everything)), *cells(everything, section.columns)]
    yield f"| {' | '.join(f'**{text}**' if text else text for text in texts)} | |"
    yield ""


def _goals_of(key: Key, results: Mapping[Aim, Result]) -> str:
    """What a row makes of the goals it takes part in."""
    taken = [(aim, result.rows[key]) for aim, result in results.items() if key in result.rows and not aim.in_parts]
    outcomes = [(outcome, aim.goal.short) for aim, outcome in taken]
    parts = [
        f"{outcome.value}: {', '.join(names)}"
        for outcome in (Outcome.NOT_MET, Outcome.NOT_COUNTED)
        if (names := [short for reached, short in outcomes if reached is outcome])
    ]
    return "; ".join(parts) or ("met" if outcomes else "")


def _cost_table(costs: Sequence[Cost]) -> Iterator[str]:
    yield "### CPU"
    yield ""
    yield f"`make bench`: median of {cost.REPEATS} repeats of {cost.MEASURED} windows; lowest and highest in brackets."
    yield ""
    yield "| pictures | motion | offset / spatial | goal |"
    yield "|---|---|---|---|"
    for item in costs:
        yield (
            f"| {item.width}x{item.height} | {item.motion} | {_ratio(item)} "
            f"| {'met' if item.met else 'not met'} (<= {cost.GOALS[item.width, item.height]:g}) |"
        )
    yield ""


def _ratio(item: Cost) -> str:
    return f"{item.ratio:.2f} ({min(item.ratios):.2f}..{max(item.ratios):.2f})"


def _shortfalls(
    rows: Mapping[Key, Sequence[Score]], results: Mapping[Aim, Result], costs: Sequence[Cost]
) -> Iterator[str]:
    yield "## What is not reached, and why"
    yield ""
    for aim, result in results.items():
        missed = [key for key, outcome in result.rows.items() if outcome is Outcome.NOT_MET]
        left_out = [key for key, outcome in result.rows.items() if outcome is Outcome.NOT_COUNTED]
        if (missed or left_out) and not aim.in_parts:
            yield f"**{aim.goal.name}** ({aim.goal.limit}): {_outcome(result)}."
            yield ""
            for recording in dict.fromkeys(key[1] for key in missed):
                texts = [_shown(key[2], rows[key], aim.goal.columns) for key in missed if key[1] == recording]
                yield f"- not met by {recording}: {'; '.join(texts)}"
            for recording in dict.fromkeys(key[1] for key in left_out):
                yield f"- {_left_out(recording, [rows[key] for key in left_out if key[1] == recording])}"
            yield ""
    dear = [item for item in costs if not item.met]
    if dear:
        yield "**CPU a pair beside `spatial`**: not met."
        yield ""
        yield from (f"- not met at {item.width}x{item.height}, {item.motion}: {_ratio(item)}" for item in dear)
        yield ""


def _shown(name: str, row: Sequence[Score], columns: Sequence[str]) -> str:
    """A row in words. A single column needs no title."""
    texts = cells(row, columns)
    if len(columns) == 1:
        return f"{name} {texts[0]}"
    return f"{name} {', '.join(_named(title, text) for title, text in zip(columns, texts, strict=True))}"


def _left_out(recording: str, rows: Sequence[Sequence[Score]]) -> str:
    shares = sorted({percent(measures.decided(row) or 0.0) for row in rows}, key=float)
    decided = shares[0] if len(shares) == 1 else f"{shares[0]}..{shares[-1]}"
    few = sum(1 for row in rows if sum(item.windows for item in row) < LEAST_WINDOWS)
    short = f", {few} of them with fewer than {LEAST_WINDOWS} windows" if few else ""
    return f"{recording} does not count: {len(rows)} row{'s' * (len(rows) > 1)}, {decided} % decided{short}"


def _outcome(result: Result) -> str:
    if result.outcome is Outcome.MET and result.how_many(Outcome.NOT_MET):
        return "met over all, not by every row"
    return result.outcome.value
