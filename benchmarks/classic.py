"""Scores the report's detectors on real recordings at known offsets, and writes the table of docs/classic-algorithm.md.

    python -m benchmarks.classic [--jobs N]

Each recording is replayed with its second camera as stored, one frame ahead and one frame behind (`content_shift`, so
stamps and ids stay equal and the pictures alone can tell): benchmarks/suites/classic.yaml. Counts are verdicts of the
first pair, unpaired frames left out. Every frame is used.
"""

from __future__ import annotations

import argparse
import os
import sys
from collections.abc import Sequence
from pathlib import Path

from pipeline.cli.common import report
from pipeline.cli.evaluate import run
from pipeline.errors import SyncwatchError
from pipeline.evaluate.columns import by_recording
from pipeline.evaluate.runner import check
from pipeline.evaluate.score import Score
from pipeline.evaluate.suite import load_suite
from pipeline.verdict import State

ROOT = Path(__file__).resolve().parent.parent
SUITE = ROOT / "benchmarks" / "suites" / "classic.yaml"
DOCUMENT = ROOT / "docs" / "classic-algorithm.md"
BEGIN, END = "<!-- table: begin -->", "<!-- table: end -->"
IN_SYNC = "+0"


def table(scores: Sequence[Score]) -> list[str]:
    """Markdown: a row a recording, and for each offset how often sync and async were said, the right one in bold."""
    offsets = list(dict.fromkeys(item.manipulation for item in scores))
    lines = [
        "| recording | " + " | ".join(f"offset {offset}: sync / async" for offset in offsets) + " | right |",
        "|---|" + "---|" * (len(offsets) + 1),
    ]
    for name, of_name in by_recording(scores).items():
        right = sum(item.verdicts.get(_truth(item), 0) for item in of_name)
        decided = sum(item.verdicts.get(state, 0) for item in of_name for state in (State.SYNC, State.ASYNC))
        lines.append(f"| {name} | {' | '.join(map(_cell, of_name))} | {100 * right / decided:.0f} % |")
    return lines


def _truth(score: Score) -> State:
    return State.SYNC if score.manipulation == IN_SYNC else State.ASYNC


def _cell(score: Score) -> str:
    counts = [(state, score.verdicts.get(state, 0)) for state in (State.SYNC, State.ASYNC)]
    unknown = score.verdicts.get(State.UNKNOWN, 0)
    return " / ".join(f"**{said}**" if state is _truth(score) else str(said) for state, said in counts) + (
        f" ({unknown} undecided)" if unknown else ""
    )


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--jobs", type=int, default=os.cpu_count() or 1)
    jobs = parser.parse_args().jobs
    try:
        clips = load_suite(SUITE, os.environ)
        check(clips)
        scores = [item for of_clip in run(clips, jobs) for item in of_clip.scores]
    except SyncwatchError as error:
        return report(error)
    text = DOCUMENT.read_text(encoding="utf-8")
    before, after = text.split(BEGIN)[0], text.split(END)[1]
    DOCUMENT.write_text("\n".join([before + BEGIN, *table(scores), END + after]), encoding="utf-8")
    print(f"{DOCUMENT}: table written")
    return 0


if __name__ == "__main__":
    sys.exit(main())
