"""Scores the report's detectors on real recordings at known offsets, and writes the table of docs/classic-algorithm.md.

    python benchmarks/classic.py [RECORDINGS] [--jobs N]

Each recording is replayed with its second camera as stored, one frame ahead and one frame behind (`content_shift`, so
stamps and ids stay equal and the pictures alone can tell). Counts are verdicts of the first pair, unpaired frames left
out. Every frame is used.
"""

from __future__ import annotations

import argparse
import os
import sys
from collections import Counter
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, field
from pathlib import Path

import cv2

from pipeline.assemble import assemble, build_source
from pipeline.cli.replay import recording_plan
from pipeline.run import Run
from pipeline.verdict import State, Verdict

ROOT = Path(__file__).resolve().parent.parent
DOCUMENT = ROOT / "docs" / "classic-algorithm.md"
BEGIN, END = "<!-- table: begin -->", "<!-- table: end -->"
OFFSETS = (0, 1, -1)


@dataclass
class Score:
    """Verdicts on one recording at one true offset."""

    recording: str
    offset: int
    said: Counter[State] = field(default_factory=Counter)

    def add(self, verdict: Verdict) -> None:
        if None not in verdict.captured_ns.values():
            self.said[verdict.state] += 1


def score(job: tuple[Path, int]) -> Score:
    """The classic detector's verdicts on one recording, one pair, at one offset."""
    recording, offset = job
    cv2.setNumThreads(1)
    result = Score(recording.name, offset)
    faults = [f"content_shift:frames={offset}"] if offset else []
    first_pair = f"pairs=[{'-'.join(camera_names(recording)[:2])}]"
    plan = recording_plan([str(recording)], faults=faults, overrides=["judge.combine=classic", first_pair])
    source = build_source(plan)
    source.open()
    Run(assemble(plan, source, console=sys.stderr, on_verdict=result.add)).execute()
    return result


def camera_names(recording: Path) -> list[str]:
    source = build_source(recording_plan([str(recording)]))
    source.open()
    names = [camera.name for camera in source.cameras]
    source.close()
    return names


def table(scores: list[Score]) -> list[str]:
    """Markdown: a row a recording, and for each offset how often sync and async were said, the right one in bold."""
    lines = [
        "| recording | " + " | ".join(f"offset {offset:+d}: sync / async" for offset in OFFSETS) + " | right |",
        "|---|" + "---|" * (len(OFFSETS) + 1),
    ]
    for name in dict.fromkeys(item.recording for item in scores):
        of_name = {item.offset: item.said for item in scores if item.recording == name}
        cells = [_cell(of_name[offset], State.ASYNC if offset else State.SYNC) for offset in OFFSETS]
        right = sum(of_name[offset][State.ASYNC if offset else State.SYNC] for offset in OFFSETS)
        total = sum(said[State.SYNC] + said[State.ASYNC] for said in of_name.values())
        lines.append(f"| {name} | {' | '.join(cells)} | {100 * right / total:.0f} % |")
    return lines


def _cell(said: Counter[State], right: State) -> str:
    counts = [f"**{said[state]}**" if state is right else str(said[state]) for state in (State.SYNC, State.ASYNC)]
    unknown = f" ({said[State.UNKNOWN]} undecided)" if said[State.UNKNOWN] else ""
    return " / ".join(counts) + unknown


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    default = Path(os.environ.get("SYNCWATCH_DATA", ROOT / "../shared/data"))
    parser.add_argument("recordings", nargs="?", type=Path, default=default)
    parser.add_argument("--jobs", type=int, default=os.cpu_count())
    given = parser.parse_args()
    folders = sorted(folder for folder in given.recordings.resolve().iterdir() if folder.is_dir())
    jobs = [(folder, offset) for folder in folders for offset in OFFSETS]
    scores = []
    with ProcessPoolExecutor(given.jobs) as pool:
        for done, result in enumerate(pool.map(score, jobs), start=1):
            scores.append(result)
            print(f"{done}/{len(jobs)} {result.recording} {result.offset:+d}", file=sys.stderr)
    text = DOCUMENT.read_text(encoding="utf-8")
    before, after = text.split(BEGIN)[0], text.split(END)[1]
    DOCUMENT.write_text("\n".join([before + BEGIN, *table(scores), END + after]), encoding="utf-8")
    print(f"{DOCUMENT}: table written")


if __name__ == "__main__":
    main()
