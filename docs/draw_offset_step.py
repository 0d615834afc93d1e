"""Draws how the content offset sees a hand-held walk whose right camera steps by a frame and back.

    python docs/draw_offset_step.py        writes docs/offset-step.png

Needs the recording boof_backyard in the folder SYNCWATCH_DATA, and OpenCV 5, which has a font of its own.
"""

from __future__ import annotations

import os
import sys
from collections.abc import Sequence
from itertools import pairwise
from pathlib import Path

import cv2
import numpy as np
import numpy.typing as npt

from pipeline.assemble import assemble, build_source
from pipeline.cli.replay import recording_plan
from pipeline.frame import NS_PER_S
from pipeline.run import Run
from pipeline.verdict import Report, State, Verdict

ROOT = Path(__file__).resolve().parent.parent
OUT = ROOT / "docs" / "offset-step.png"
RECORDING = Path(os.environ.get("SYNCWATCH_DATA", ROOT / "../shared/data")) / "boof_backyard"
FPS, STEP_S, BACK_S = 15.0, 5.0, 9.0

WIDTH, LEFT, RIGHT = 1600, 140, 1560
"""Twice the size it is shown at."""

OFFSET_TOP, OFFSET_BOTTOM = 90, 360
ERROR_TOP, ERROR_BOTTOM = 460, 630
MOTION_TOP, MOTION_BOTTOM = 730, 880
STRIP_TOP, STRIP_BOTTOM = 980, 1030
HEIGHT = 1150
MAGNIFIED = 0.05
"""Frames either way in the second panel: the error bars are too small for the first."""

Canvas = npt.NDArray[np.uint8]
Colour = tuple[int, int, int]
INK, FAINT, GRID, PAPER = (51, 51, 51), (115, 115, 115), (228, 228, 228), (255, 255, 255)
BLUE, BAND, ORANGE = (178, 114, 0), (238, 214, 176), (0, 94, 213)
COLOUR = {State.SYNC: (115, 158, 0), State.ASYNC: ORANGE, State.UNKNOWN: (190, 190, 190)}
"""Blue, green, red; after Okabe and Ito, which the colour-blind can tell apart."""

NAME = {State.SYNC: "in sync", State.ASYNC: "out of sync", State.UNKNOWN: "cannot tell"}
TEXT, HEADING, DASH = 26, 30, 18
FONT = cv2.FontFace("sans")


class Scale:
    """Maps values to rows and seconds to columns of the canvas."""

    def __init__(self, top: int, bottom: int, low: float, high: float, end_s: float) -> None:
        self.top, self.bottom = top, bottom
        self._low, self._high, self._end_s = low, high, end_s

    def x(self, at_s: float) -> int:
        return round(LEFT + (RIGHT - LEFT) * at_s / self._end_s)

    def y(self, value: float) -> int:
        share = (value - self._low) / (self._high - self._low)
        return round(self.bottom - (self.bottom - self.top) * min(max(share, 0.0), 1.0))


def main() -> None:
    fault = f"content_shift:frames=1,start_s={STEP_S},stop_s={BACK_S}"
    plan = recording_plan([str(RECORDING)], fps=FPS, faults=[fault], detectors="offset")
    source = build_source(plan)
    source.open()
    reports: list[Report] = []
    Run(assemble(plan, source, console=sys.stderr, on_report=reports.append)).execute()
    verdicts = [report for report in reports if isinstance(report, Verdict)]
    cv2.imwrite(str(OUT), draw(verdicts))


def draw(verdicts: Sequence[Verdict]) -> Canvas:
    """Offset, its error, motion and what was said, on one time axis."""
    canvas: Canvas = np.full((HEIGHT, WIDTH, 3), PAPER, np.uint8)
    end_s = len(verdicts) / FPS
    draw_offset(canvas, verdicts, Scale(OFFSET_TOP, OFFSET_BOTTOM, -0.2, 1.2, end_s))
    draw_error(canvas, verdicts, Scale(ERROR_TOP, ERROR_BOTTOM, -MAGNIFIED, MAGNIFIED, end_s))
    draw_motion(canvas, verdicts, end_s)
    draw_strip(canvas, verdicts, Scale(STRIP_TOP, STRIP_BOTTOM, 0, 1, end_s))
    return canvas


def draw_offset(canvas: Canvas, verdicts: Sequence[Verdict], scale: Scale) -> None:
    heading(canvas, scale, "Offset of the right camera, in frames")
    legend(canvas, scale, [("measured", BLUE, 4), ("2 sigma", BAND, 18), ("truth", INK, 0)])
    frame_of_axes(canvas, scale, (0.0, 0.5, 1.0), "{:.1f}")
    draw_measured(canvas, measured(verdicts), scale)
    dashed(canvas, staircase(scale, [(n, truth_of(verdict)) for n, verdict in enumerate(verdicts) if verdict.truth]))


def draw_error(canvas: Canvas, verdicts: Sequence[Verdict], scale: Scale) -> None:
    heading(canvas, scale, "The same, less the truth, magnified")
    frame_of_axes(canvas, scale, (-MAGNIFIED, 0.0, MAGNIFIED), "{:.2f}")
    near = [
        (n, value - truth_of(verdicts[n]), band)
        for n, value, band in measured(verdicts)
        if abs(value - truth_of(verdicts[n])) + band < MAGNIFIED
    ]
    draw_measured(canvas, near, scale)
    dashed(canvas, [(LEFT, scale.y(0)), (RIGHT, scale.y(0))])


def measured(verdicts: Sequence[Verdict]) -> list[tuple[int, float, float]]:
    """Frame, offset and two standard errors of what was decided and has a truth."""
    return [
        (n, best.offset_frames, 2 * (best.sigma_frames or 0.0))
        for n, best in enumerate(verdict.content for verdict in verdicts)
        if best and best.state is not State.UNKNOWN and best.offset_frames is not None and verdicts[n].truth
    ]


def truth_of(verdict: Verdict) -> float:
    assert verdict.truth is not None
    return verdict.truth.offset_ns * FPS / NS_PER_S


def draw_measured(canvas: Canvas, values: Sequence[tuple[int, float, float]], scale: Scale) -> None:
    """Bands, then lines, broken where nothing was measured."""
    breaks = [place for place in range(1, len(values)) if values[place][0] != values[place - 1][0] + 1]
    runs = [values[start:stop] for start, stop in pairwise([0, *breaks, len(values)])]
    for run in runs:
        upper = staircase(scale, [(n, value + band) for n, value, band in run])
        lower = staircase(scale, [(n, value - band) for n, value, band in run])
        cv2.fillPoly(canvas, [np.array(upper + lower[::-1], np.int32)], BAND, cv2.LINE_AA)
    for run in runs:
        path(canvas, staircase(scale, [(n, value) for n, value, _ in run]), BLUE, 3)


def staircase(scale: Scale, values: Sequence[tuple[int, float]]) -> list[tuple[int, int]]:
    """Points of a line that holds each frame's value until the next."""
    return [(scale.x((n + more) / FPS), scale.y(value)) for n, value in values for more in (0, 1)]


def draw_motion(canvas: Canvas, verdicts: Sequence[Verdict], end_s: float) -> None:
    seen = [(n, v.content.motion_px) for n, v in enumerate(verdicts) if v.content and v.content.motion_px]
    top = 2.0 * max(int(np.ceil(max((px for _, px in seen), default=0.0) / 2)), 1)
    scale = Scale(MOTION_TOP, MOTION_BOTTOM, 0, top, end_s)
    heading(canvas, scale, "Motion that can tell, in pixels a frame")
    frame_of_axes(canvas, scale, (0.0, top / 2, top), "{:g}")
    path(canvas, staircase(scale, seen), BLUE, 3)


def draw_strip(canvas: Canvas, verdicts: Sequence[Verdict], scale: Scale) -> None:
    heading(canvas, scale, "What the pictures say")
    legend(canvas, scale, [(NAME[state], COLOUR[state], 18) for state in State])
    for n, verdict in enumerate(verdicts):
        state = verdict.content.state if verdict.content else State.UNKNOWN
        corner, other = (scale.x(n / FPS), scale.top), (scale.x((n + 1) / FPS), scale.bottom)
        cv2.rectangle(canvas, corner, other, COLOUR[state], cv2.FILLED)
    for second in range(0, int(len(verdicts) / FPS) + 1, 2):
        x = scale.x(second)
        cv2.line(canvas, (x, scale.bottom), (x, scale.bottom + 10), FAINT, 2)
        label = f"{second} s"
        write(canvas, label, (x - width_of(label) // 2, scale.bottom + 46), FAINT)
    told = f"boof_backyard, a walk in a yard. From {STEP_S:g} to {BACK_S:g} s right pictures are from a frame later."
    write(canvas, told, (LEFT, HEIGHT - 20), FAINT)


def heading(canvas: Canvas, scale: Scale, text: str) -> None:
    cv2.putText(canvas, text, (LEFT, scale.top - 30), INK, FONT, HEADING, 600)


def frame_of_axes(canvas: Canvas, scale: Scale, ticks: Sequence[float], form: str) -> None:
    for tick in ticks:
        cv2.line(canvas, (LEFT, scale.y(tick)), (RIGHT, scale.y(tick)), GRID, 2)
        label = form.format(tick)
        write(canvas, label, (LEFT - 20 - width_of(label), scale.y(tick) + 9), FAINT)
    for at_s in (STEP_S, BACK_S):
        cv2.line(canvas, (scale.x(at_s), scale.top), (scale.x(at_s), scale.bottom), GRID, 2)


def legend(canvas: Canvas, scale: Scale, entries: Sequence[tuple[str, Colour, int]]) -> None:
    """Right-aligned above a panel: swatches of a thickness in px (0: dashed), each with its name."""
    x, y = RIGHT, scale.top - 38
    for name, colour, thickness in reversed(entries):
        x -= width_of(name)
        write(canvas, name, (x, y + 9), FAINT)
        x -= 64
        if thickness:
            cv2.rectangle(canvas, (x, y - thickness // 2), (x + 50, y + thickness // 2), colour, cv2.FILLED)
        else:
            dashed(canvas, [(x, y), (x + 50, y)])
        x -= 36


def path(canvas: Canvas, points: Sequence[tuple[int, int]], colour: Colour, thickness: int) -> None:
    cv2.polylines(canvas, [np.array(points, np.int32).reshape(-1, 1, 2)], False, colour, thickness, cv2.LINE_AA)


def dashed(canvas: Canvas, points: Sequence[tuple[int, int]]) -> None:
    """A line of dashes of equal length, steps included."""
    walked = 0.0
    for (x0, y0), (x1, y1) in pairwise(points):
        length = float(np.hypot(x1 - x0, y1 - y0))
        for px in range(int(length)):
            if (walked + px) % (2 * DASH) < DASH:
                at = (round(x0 + (x1 - x0) * px / length), round(y0 + (y1 - y0) * px / length))
                cv2.circle(canvas, at, 2, INK, cv2.FILLED)
        walked += length


def write(canvas: Canvas, text: str, at: tuple[int, int], colour: Colour) -> None:
    cv2.putText(canvas, text, at, colour, FONT, TEXT, 400)


def width_of(text: str) -> int:
    _, _, width, _ = cv2.getTextSize((WIDTH, HEIGHT), text, (0, 0), FONT, TEXT, 400)
    return width


if __name__ == "__main__":
    main()
