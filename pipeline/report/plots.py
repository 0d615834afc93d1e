"""Drawings of one pair or camera over time, as SVG that stands inside a page and takes its text colour from it."""

from __future__ import annotations

import io
import re
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from html import escape
from typing import Any

import numpy as np
import numpy.typing as npt
from matplotlib import rc_context
from matplotlib.axes import Axes
from matplotlib.backends.backend_svg import FigureCanvasSVG
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from pipeline.detectors.offset.arrays import Floats, Mask
from pipeline.report.recorder import CameraRecord, PairRecord
from pipeline.report.series import Series
from pipeline.tally import Stretch
from pipeline.verdict import State

INK = "#010203"
"""Stands for the page's own text colour: black on white or white on black."""

COLOUR = {State.SYNC: "#2a9d5c", State.ASYNC: "#d1382c", State.UNKNOWN: "#b9a44c"}
BLUE, VIOLET, ORANGE, GREY = "#3778c2", "#8a63c9", "#d98324", "#888888"

WIDTH_IN, DPI = 6.6, 72
"""SVG counts 72 points an inch; type of 11 points is readable where the page scales the drawing to a phone."""

MARGINS_IN = 0.74, 0.78, 0.42, 0.28
"""Left, right, bottom, top."""

MOST_TICKS = 5
LABEL_LEFT, LABEL_RIGHT = -0.115, 1.13
"""Where labels stand beside the axes, as a part of their width: within the margins, however long the ticks are."""

SHARES = 120
"""Bars in which the share of frames that could be decided is drawn."""

SHOWN_SIGMAS = 2
MINUTES_FROM_S = 180.0
CAUSE_LETTER = 0.018
"""Width of a letter of a cause, as a part of the drawing's."""

STYLE: Mapping[Any, Any] = {
    "svg.fonttype": "none",
    "font.family": "sans-serif",
    "font.size": 11,
    "text.color": INK,
    "axes.labelcolor": INK,
    "axes.edgecolor": GREY,
    "axes.facecolor": "none",
    "axes.spines.top": False,
    "axes.spines.right": False,
    "xtick.color": GREY,
    "ytick.color": GREY,
    "xtick.labelcolor": INK,
    "ytick.labelcolor": INK,
    "figure.facecolor": "none",
    "legend.frameon": False,
    "legend.fontsize": 10,
    "path.simplify": True,
}


def verdict_plot(record: PairRecord) -> str:
    """A strip: green in sync, red out of sync with its cause, ochre cannot tell; marks where events begin."""
    with _drawing(f"{record.pair.name} verdict over time", 1.15) as (axes, svg):
        time = _Time(record.series, record.fps)
        shares = np.stack([_filled(record.series.mean(state.value)) for state in State])
        for place, state in enumerate(State):
            for begin, end in _stretches(shares.argmax(axis=0) == place):
                left, right = time.edges[begin], time.edges[end]
                axes.axvspan(left, right, color=COLOUR[state], linewidth=0)
        for stretch in record.tally.stretches:
            _name_cause(axes, stretch, record, time)
        begun = [mark for mark in record.marks.marks if mark.kind.endswith(" onset")]
        axes.plot([mark.at_s / time.unit_s for mark in begun], [1.12] * len(begun), "v", color=VIOLET, clip_on=False)
        axes.set_ylim(0, 1)
        axes.set_yticks([])
        axes.spines["left"].set_visible(False)
        time.label(axes)
    return svg.text


def offset_plot(record: PairRecord) -> str:
    """The offset of the second camera, with two standard errors, and the band that still counts as in sync."""
    with _drawing(f"{record.pair.name} offset over time", 2.6) as (axes, svg):
        series, time = record.series, _Time(record.series, record.fps)
        offset, sigma = series.mean("offset_ms"), _filled(series.mean("sigma_ms"))
        _tolerance(axes, record)
        low = np.fmin(offset - SHOWN_SIGMAS * sigma, series.least("offset_ms"))
        high = np.fmax(offset + SHOWN_SIGMAS * sigma, series.most("offset_ms"))
        axes.fill_between(time.middles, low, high, color=BLUE, alpha=0.28, linewidth=0, label="two standard errors")
        _line(axes, time, offset, BLUE, "offset")
        _limits(axes, record, [offset])
        axes.set_ylabel("offset, ms")
        _frames_axis(axes, record)
        axes.legend(loc="lower left", bbox_to_anchor=(0, 1), ncols=3, borderaxespad=0.2)
        time.label(axes)
    return svg.text


def witnesses_plot(record: PairRecord) -> str:
    """What stamps say beside what pictures say."""
    with _drawing(f"{record.pair.name} stamps against pictures", 2.6) as (axes, svg):
        series, time = record.series, _Time(record.series, record.fps)
        stamps, pictures = series.mean("stamps_ms"), series.mean("pictures_ms")
        _tolerance(axes, record)
        _line(axes, time, stamps, ORANGE, "stamps say", wide=True)
        _line(axes, time, pictures, BLUE, "pictures say")
        _limits(axes, record, [stamps, pictures])
        axes.set_ylabel("offset, ms")
        axes.legend(loc="lower left", bbox_to_anchor=(0, 1), ncols=3, borderaxespad=0.2)
        time.label(axes)
    return svg.text


def drift_plot(record: PairRecord) -> str:
    """How fast the offset grows."""
    with _drawing(f"{record.pair.name} drift over time", 2.2) as (axes, svg):
        time = _Time(record.series, record.fps)
        axes.axhline(0, color=GREY, linewidth=0.8)
        for who, colour in (("stamps", ORANGE), ("pictures", BLUE)):
            ppm, sigma = (record.series.mean(f"drift_{who}_{name}ppm") for name in ("", "sigma_"))
            band = SHOWN_SIGMAS * _filled(sigma)
            axes.fill_between(time.middles, ppm - band, ppm + band, color=colour, alpha=0.2, linewidth=0)
            _line(axes, time, ppm, colour, f"by {who}", wide=who == "stamps")
        axes.set_ylabel("drift, ppm")
        axes.legend(loc="lower left", bbox_to_anchor=(0, 1), ncols=2, borderaxespad=0.2)
        time.label(axes)
    return svg.text


def coverage_plot(record: PairRecord) -> str:
    """The share of frames that were in sync, out of sync, or could not be decided."""
    with _drawing(f"{record.pair.name} share of frames decided", 1.9) as (axes, svg):
        series, time = record.series, _Time(record.series, record.fps)
        every = -(-series.bins // SHARES)
        starts = np.arange(0, series.bins, every)
        counts = {state: np.add.reduceat(_filled(series.sums(state.value)), starts) for state in State}
        total = np.maximum(sum(counts.values()), 1)
        edges = time.edges[np.r_[starts, series.bins]]
        below: Floats = np.zeros(len(edges))
        for state, word in WORD.items():
            share = 100 * counts[state] / total
            above = below + np.r_[share, share[-1]]
            axes.fill_between(edges, below, above, step="post", color=COLOUR[state], linewidth=0, label=word)
            below = above
        axes.set_ylim(0, 100)
        axes.set_ylabel("frames, %")
        axes.legend(loc="lower left", bbox_to_anchor=(0, 1), ncols=3, borderaxespad=0.2)
        time.label(axes)
    return svg.text


WORD = {State.SYNC: "in sync", State.ASYNC: "out of sync", State.UNKNOWN: "cannot tell"}


def cadence_plot(record: CameraRecord) -> str:
    """The time between two frames of a camera, by its own stamps: noise is jitter, peaks of whole periods are drops."""
    with _drawing(f"{record.camera.name} time between frames", 1.9) as (axes, svg):
        series, time = record.series, _Time(record.series, record.camera.fps)
        period_ms = 1000 / record.camera.fps
        axes.axhline(period_ms, color=GREY, linewidth=0.8)
        mean, least, most = (get("interval_ms") for get in (series.mean, series.least, series.most))
        axes.fill_between(time.middles, least, most, color=BLUE, alpha=0.35, linewidth=0.8)
        _line(axes, time, mean, BLUE, "")
        lost = most > 1.5 * period_ms
        axes.plot(time.middles[lost], most[lost], ".", color=COLOUR[State.ASYNC], markersize=5)
        top = max(float(np.nanmax(most, initial=0.0)), 1.25 * period_ms)
        axes.set_ylim(min(float(np.nanmin(least, initial=np.inf)), 0.75 * period_ms), 1.05 * top)
        axes.set_ylabel("ms")
        time.label(axes)
    return svg.text


def _name_cause(axes: Axes, stretch: Stretch, record: PairRecord, time: _Time) -> None:
    """Writes the cause of a stretch into it, where there is room."""
    cause, begin, end = stretch.first.cause, stretch.first.frame, stretch.last_frame
    if cause is None or begin is None or end is None:
        return
    if end - begin > CAUSE_LETTER * len(cause.value) * record.series.count:
        middle = (begin + end + 1) / 2 / record.fps / time.unit_s
        axes.text(middle, 0.5, cause.value, color="#ffffff", ha="center", va="center")


class _Time:
    """The bins of a series in seconds, or in minutes where these are many."""

    def __init__(self, series: Series, fps: float) -> None:
        edges_s = series.edges() / fps
        minutes = len(edges_s) > 0 and edges_s[-1] >= MINUTES_FROM_S
        self.unit_s = 60.0 if minutes else 1.0
        self._unit = "min" if minutes else "s"
        self.edges: Floats = edges_s / self.unit_s
        self.middles: Floats = (self.edges[:-1] + self.edges[1:]) / 2

    def label(self, axes: Axes) -> None:
        axes.set_xlim(0, max(float(self.edges[-1]), 1e-9))
        axes.set_xlabel(f"time, {self._unit}", labelpad=1)


class _Svg:
    text = ""


@contextmanager
def _drawing(title: str, height_in: float) -> Iterator[tuple[Axes, _Svg]]:
    """Axes to draw on, then the drawing. Its ids come of its title, so that drawings of one page do not clash."""
    made = _Svg()
    with rc_context({**STYLE, "svg.hashsalt": title}):
        figure = Figure(figsize=(WIDTH_IN, height_in), dpi=DPI)
        FigureCanvasSVG(figure)
        axes = figure.add_axes(_place(height_in))
        axes.yaxis.set_major_locator(MaxNLocator(MOST_TICKS))
        axes.yaxis.set_major_formatter("{x:g}")
        axes.yaxis.set_label_coords(LABEL_LEFT, 0.5)
        yield axes, made
        buffer = io.StringIO()
        figure.savefig(buffer, format="svg", metadata={"Date": None}, transparent=True)
    made.text = _inline(buffer.getvalue(), title)


def _place(height_in: float) -> tuple[float, float, float, float]:
    """Left, bottom, width and height as parts of the drawing: margins are alike, so that time axes stand in line."""
    left, right, bottom, top = MARGINS_IN
    width, height = WIDTH_IN - left - right, height_in - bottom - top
    return left / WIDTH_IN, bottom / height_in, width / WIDTH_IN, height / height_in


def _inline(text: str, title: str) -> str:
    """Without what only a file of its own needs, and with the page's text colour."""
    text = text[text.index("<svg") :]
    text = re.sub(r"<metadata>.*?</metadata>|<!--.*?-->", "", text, flags=re.DOTALL)
    head, rest = text.split(">", 1)
    box = re.search(r'viewBox="[^"]*"', head)
    used = set(re.findall(r'(?:href="#|url\(#)([^")]+)', rest))
    rest = re.sub(r' id="([^"]+)"', lambda match: match[0] if match[1] in used else "", rest)
    rest = rest.replace("xlink:href", "href").replace(INK, "currentColor")
    rest = re.sub(r' (?:d|x|y|transform)="[^"]*"', lambda match: re.sub(r"(?<=\.\d\d)\d+", "", match[0]), rest)
    rest = re.sub(r"\s*\n\s*", " ", rest)
    return f'<svg {box[0] if box else ""} role="img" aria-label="{escape(title)}">{rest.strip()}'


def _line(axes: Axes, time: _Time, values: Floats, colour: str, label: str, *, wide: bool = False) -> None:
    """Single points that no line would show are dots."""
    known = np.isfinite(values)
    alone = known & ~np.r_[False, known[:-1]] & ~np.r_[known[1:], False]
    axes.plot(time.middles, values, color=colour, linewidth=3.2 if wide else 1.6, alpha=0.8 if wide else 1, label=label)
    axes.plot(time.middles[alone], values[alone], ".", color=colour, markersize=4)


def _tolerance(axes: Axes, record: PairRecord) -> None:
    expected_ms = record.pair.expected_offset_ns / 1e6
    low, high = expected_ms - record.tolerance_ms, expected_ms + record.tolerance_ms
    axes.axhspan(low, high, color=COLOUR[State.SYNC], alpha=0.18, linewidth=0, label="counts as in sync")
    axes.axhline(0, color=GREY, linewidth=0.8)


def _limits(axes: Axes, record: PairRecord, curves: Sequence[Floats]) -> None:
    """What is measured fills the drawing; a wide error band may leave it."""
    expected_ms = record.pair.expected_offset_ns / 1e6
    known = np.concatenate([*curves, [expected_ms - 2 * record.tolerance_ms, expected_ms + 2 * record.tolerance_ms]])
    low, high = float(np.nanmin(known)), float(np.nanmax(known))
    margin = 0.12 * max(high - low, 1e-6)
    axes.set_ylim(low - margin, high + margin)


def _frames_axis(axes: Axes, record: PairRecord) -> None:
    """The same in frames, at the right."""

    def to_frames(value_ms: npt.ArrayLike) -> npt.ArrayLike:
        return np.asarray(value_ms) / record.period_ms

    def to_ms(frames: npt.ArrayLike) -> npt.ArrayLike:
        return np.asarray(frames) * record.period_ms

    frames = axes.secondary_yaxis("right", functions=(to_frames, to_ms))
    frames.yaxis.set_major_locator(MaxNLocator(MOST_TICKS))
    frames.yaxis.set_major_formatter("{x:g}")
    axes.text(LABEL_RIGHT, 0.5, "frames", transform=axes.transAxes, rotation="vertical", ha="center", va="center")


def _stretches(held: Mask) -> list[tuple[int, int]]:
    """Begin and end of each run of true values."""
    edges = np.flatnonzero(np.diff(np.r_[False, held, False].astype(np.int8)))
    return [(int(begin), int(end)) for begin, end in zip(edges[0::2], edges[1::2], strict=True)]


def _filled(values: Floats) -> Floats:
    return np.asarray(np.nan_to_num(values), np.float64)
