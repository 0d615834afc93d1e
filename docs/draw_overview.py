"""Draws the README's picture: left and right at the moment of a fault, and truth and verdict over time.

python docs/draw_overview.py        writes docs/overview.png
"""

from __future__ import annotations

import os
import sys
from pathlib import Path

import cv2
import numpy as np
import numpy.typing as npt

from pipeline.assemble import KINDS, assemble, build_source
from pipeline.cli.common import shipped_config
from pipeline.configtext.document import load_text
from pipeline.frame import Frame, Picture
from pipeline.plan import make_plan
from pipeline.run import Run
from pipeline.verdict import Report, State, Verdict

OUT = Path(__file__).with_name("overview.png")
WIDTH, MARGIN, STRIP = 1280, 24, 34
INK, PAPER = (40, 40, 40), (255, 255, 255)
COLOUR = {State.SYNC: (96, 168, 64), State.ASYNC: (48, 48, 208), State.UNKNOWN: (0, 176, 224)}
SHOWN_AT = 150
Canvas = npt.NDArray[np.uint8]


def main() -> None:
    plan = make_plan(
        load_text(shipped_config(), "config.yaml", os.environ, ["sinks={}", "rig=bench"]), KINDS, Path.cwd()
    )
    reports: list[Report] = []
    source = build_source(plan)
    source.open()
    Run(assemble(plan, source, console=sys.stderr, on_report=reports.append)).execute()
    verdicts = [report for report in reports if isinstance(report, Verdict)]
    again = build_source(plan)
    again.open()
    pictures = {frame.camera: frame for frame in again.frames() if shown(frame)}
    again.close()
    cv2.imwrite(str(OUT), draw([frame.image for frame in pictures.values()], verdicts))


def shown(frame: Frame) -> bool:
    return frame.group == SHOWN_AT


def draw(pictures: list[Picture], verdicts: list[Verdict]) -> Canvas:
    """Pictures side by side above a timeline, on white."""
    width = (WIDTH - MARGIN) // 2
    scaled = [
        cv2.resize(item, (width, item.shape[0] * width // item.shape[1]), interpolation=cv2.INTER_AREA)
        for item in pictures
    ]
    height = scaled[0].shape[0]
    canvas: Canvas = np.full((height + 3 * STRIP + 5 * MARGIN, WIDTH, 3), PAPER, np.uint8)
    for index, (name, image) in enumerate(zip(("left", "right"), scaled, strict=True)):
        x = index * (width + MARGIN)
        canvas[:height, x : x + width] = image[:, :, None] if image.ndim == 2 else image
        write(canvas, f"{name}, frame {SHOWN_AT}", (x + 10, 30), PAPER)
    truth = [verdict.truth.state for verdict in verdicts if verdict.truth]
    rows = {"truth": truth, "verdict": [verdict.state for verdict in verdicts]}
    for row, (name, states) in enumerate(rows.items()):
        y = height + MARGIN + row * (STRIP + MARGIN // 2)
        write(canvas, name, (0, y + STRIP - 9))
        strip(canvas[y : y + STRIP, 130:], states)
    y = height + MARGIN + 2 * (STRIP + MARGIN // 2) + MARGIN
    for index, text in enumerate(("0 s", "4 s", "8 s", "12 s", "16 s", "20 s")):
        write(canvas, text, (min(130 + (WIDTH - 130) * index // 5, WIDTH - 62), y - 4))
    for index, state in enumerate(State):
        x = 130 + index * 220
        canvas[y + 16 : y + 16 + STRIP // 2, x : x + STRIP] = COLOUR[state]
        write(canvas, {"sync": "in sync", "async": "out of sync"}.get(state.value, "cannot tell"), (x + 44, y + 32))
    return canvas


def strip(area: Canvas, states: list[State]) -> None:
    for x in range(area.shape[1]):
        area[:, x] = COLOUR[states[x * len(states) // area.shape[1]]]


def write(canvas: Canvas, text: str, at: tuple[int, int], colour: tuple[int, int, int] = INK) -> None:
    cv2.putText(canvas, text, at, cv2.FONT_HERSHEY_SIMPLEX, 0.7, colour, 2, cv2.LINE_AA)


if __name__ == "__main__":
    main()
