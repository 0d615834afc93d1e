"""Measures the content offset against its goals and writes docs/accuracy.md.

    python -m benchmarks.accuracy [--jobs N] [--scores FILE]

Every table is a suite of benchmarks/suites, run as `syncwatch evaluate` runs it. The scores are kept in
build/accuracy.json; `--scores build/accuracy.json` writes the page again without measuring.
"""

from __future__ import annotations

import argparse
import json
import os
import sys
import time
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

from benchmarks import accuracy_page as page
from benchmarks import cost
from benchmarks.accuracy_goals import SUITES
from pipeline.cli.common import report
from pipeline.cli.evaluate import run
from pipeline.errors import InputError, SyncwatchError
from pipeline.evaluate.runner import check
from pipeline.evaluate.score import Score
from pipeline.evaluate.suite import Clip, load_suite

ROOT = Path(__file__).resolve().parent.parent
FOLDER = ROOT / "benchmarks" / "suites"
DOCUMENT = ROOT / "docs" / "accuracy.md"
NOTES = ROOT / "docs" / "accuracy-notes.md"
KEPT = ROOT / "build" / "accuracy.json"
SECONDS_PER_MINUTE = 60


def measure(jobs: int) -> page.Measured:
    """Runs every suite, then the costs, alone. Raises SyncwatchError."""
    started_s = time.monotonic()
    clips: list[tuple[str, Clip]] = []
    for suite in SUITES:
        clips += [(suite, clip) for clip in load_suite(FOLDER / f"{suite}.yaml", os.environ)]
    check([clip for _, clip in clips])
    scores: dict[str, list[Score]] = {suite: [] for suite in SUITES}
    for (suite, _), of_clip in zip(clips, run([clip for _, clip in clips], jobs), strict=True):
        scores[suite] += of_clip.scores
    costs = list(cost.measure_all())
    return page.Measured(scores, costs, jobs, round((time.monotonic() - started_s) / SECONDS_PER_MINUTE, 1))


def keep(measured: page.Measured, file: Path) -> None:
    file.parent.mkdir(exist_ok=True)
    file.write_text(json.dumps(asdict(measured)), encoding="utf-8")


def kept(file: Path) -> page.Measured:
    """What `keep` wrote. Raises InputError."""
    try:
        told: Mapping[str, Any] = json.loads(file.read_text(encoding="utf-8"))
        scores = {suite: [Score(**item) for item in items] for suite, items in told["scores"].items()}
        costs = [cost.Cost(**item) for item in told["costs"]]
        return page.Measured(scores, costs, told["jobs"], told["minutes"])
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise InputError(f"{file}: not scores that this version kept ({error}): leave --scores out") from None


def main(arguments: Sequence[str] | None = None) -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--jobs", type=int, default=os.cpu_count() or 1, help="processes (default: one a core)")
    parser.add_argument("--scores", type=Path, help="write the page from these scores instead of measuring")
    given = parser.parse_args(arguments)
    try:
        measured = measure(given.jobs) if given.scores is None else kept(given.scores)
    except SyncwatchError as error:
        return report(error)
    if given.scores is None:
        keep(measured, KEPT)
    DOCUMENT.write_text(page.write(measured, NOTES.read_text(encoding="utf-8")), encoding="utf-8")
    print(f"{DOCUMENT}: written")
    return 0


if __name__ == "__main__":
    sys.exit(main())
