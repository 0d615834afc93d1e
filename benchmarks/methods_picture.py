"""Draws docs/methods.svg: what each method says of moving and of still scenes, and four confusion matrices."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from statistics import median
from typing import Any

import matplotlib as mpl
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle

from benchmarks.methods_page import DEFAULT, REPORT
from benchmarks.methods_scores import BASE, Confusion, Measured, abstained, count, frames, right_frames, right_of_all
from pipeline.evaluate.measures import Scores
from pipeline.verdict import State

GOOD, QUIET, BAD = "#009E73", "#d0d0d0", "#D55E00"
"""Right, abstained, wrong; after Okabe and Ito, which the colour-blind can tell apart."""

WHOSE = {REPORT: "the report", DEFAULT: "default"}

FIXED: dict[Any, Any] = {
    "svg.hashsalt": "methods",
    "svg.fonttype": "none",
    "font.family": "sans-serif",
    "font.size": 10,
}
"""The same measurements give the same file."""


def draw(measured: Measured, file: Path) -> None:
    with mpl.rc_context(FIXED):
        figure = Figure(figsize=(11, 7.6), layout="constrained")
        grid = figure.add_gridspec(2, 8, height_ratios=(1.45, 1))
        names = list(measured.methods)[::-1]
        moving, still = figure.add_subplot(grid[0, :5]), figure.add_subplot(grid[0, 5:])
        _bars(moving, names, [measured.methods[name].moving() for name in names], guess=False)
        _bars(still, names, [measured.methods[name].still() for name in names], guess=True)
        moving.set_yticks(range(len(names)), [_label(measured, name) for name in names])
        moving.set_title("Things move (0.5×: half the CPU of spatial)", loc="left", fontsize=11)
        still.set_yticks([])
        still.set_title("Nothing moves: who answers guesses", loc="left", fontsize=11)
        figure.legend(*moving.get_legend_handles_labels(), loc="outside upper right", ncols=3, frameon=False)
        places = [(experiment, rule) for experiment in measured.experiments for rule in (REPORT, DEFAULT)]
        for place, (experiment, rule) in enumerate(places):
            axes = figure.add_subplot(grid[1, 2 * place : 2 * place + 2])
            _matrix(axes, measured.experiments[experiment][rule])
            axes.set_title(f"{experiment} scene, {WHOSE[rule]}:\n{rule}", fontsize=9)
        figure.savefig(file, format="svg", metadata={"Date": None})


def _label(measured: Measured, name: str) -> str:
    ratios = measured.methods[name].ratios_to(measured.methods[BASE])
    return f"{name}  {median(ratios):.1f}×"


def _bars(axes: Axes, names: Sequence[str], scores: Sequence[Scores], *, guess: bool) -> None:
    """Stacked shares of all windows."""
    quiet = [100 * (abstained(each) or 0.0) for each in scores]
    good = [0.0 if guess else 100 * (right_of_all(each) or 0.0) for each in scores]
    bad = [100 - one - other for one, other in zip(good, quiet, strict=True)]
    left = [0.0] * len(names)
    for label, widths, colour in (("right", good, GOOD), ("abstained", quiet, QUIET), ("wrong or guessed", bad, BAD)):
        axes.barh(range(len(names)), widths, left=left, color=colour, label=label, height=0.72)
        for place, (start, width) in enumerate(zip(left, widths, strict=True)):
            if width >= 5:
                ink = "black" if colour == QUIET else "white"
                axes.text(start + width / 2, place, f"{width:.0f}", ha="center", va="center", color=ink, fontsize=9)
        left = [start + width for start, width in zip(left, widths, strict=True)]
    axes.set_xlim(0, 100)
    axes.set_xlabel("% of windows")
    axes.spines[["top", "right"]].set_visible(False)


def _matrix(axes: Axes, confusion: Confusion) -> None:
    said, truths = (State.SYNC, State.ASYNC, State.UNKNOWN), (State.SYNC, State.ASYNC)
    for y, truth in enumerate(truths):
        for x, state in enumerate(said):
            number = count(confusion, truth, state)
            colour = "white" if not number else GOOD if state is truth else QUIET if state is State.UNKNOWN else BAD
            axes.add_patch(Rectangle((x, y), 1, 1, facecolor=colour, edgecolor="#909090", linewidth=0.8))
            ink = "white" if colour in {GOOD, BAD} else "black"
            axes.text(x + 0.5, y + 0.5, str(number), ha="center", va="center", color=ink, fontsize=12)
    axes.set_xlim(0, len(said))
    axes.set_ylim(len(truths), 0)
    axes.set_xticks([x + 0.5 for x in range(len(said))], [f"said\n{state.value}" for state in said], fontsize=8)
    axes.set_yticks([y + 0.5 for y in range(len(truths))], [f"is {truth.value}" for truth in truths], fontsize=8)
    axes.tick_params(length=0)
    axes.spines[:].set_visible(False)
    axes.set_xlabel(f"{right_frames(confusion)} of {frames(confusion)} right", fontsize=10)
