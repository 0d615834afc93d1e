"""Shows one moment: both frames side by side, with points as they are and where they belong."""

from __future__ import annotations

import base64
from html import escape

import cv2
import numpy as np

from pipeline.detectors.offset.arrays import Points
from pipeline.frame import NS_PER_MS, Picture
from pipeline.pictures import reduced
from pipeline.report.moments import WIDTH_PX, Moment
from pipeline.report.points import Compared, compare
from pipeline.report.recorder import PairRecord
from pipeline.verdict import State
from pipeline.words import CAUSE_WORDS, describe

JPEG_WIDTH_PX, JPEG_QUALITY = 480, 72
"""Small, so that a page with many pairs can still be mailed; what is drawn on top stays sharp."""

VISIBLE_PX, MAGNIFIED = 10.0, (1, 2, 5, 10, 20)
"""Where most lines are shorter than that, they are drawn longer by one of these factors, and it is said."""

SEEN_PX = 0.3
"""Where points moved less, nothing is to be seen of an offset."""

LONG, MOST = 75, 95
"""Percentiles of the lines' lengths: the one by which that is decided, for in a still scene only a part of the picture
moves; and the one that is told, for a few points are followed wrongly."""

ON_ROWS_PX = 4.0
"""Where points of both pictures lie on one row to this many px at the median, the rig counts as rectified."""

STYLE = """
.sight{display:grid;grid-template-columns:1fr 1fr;gap:.6rem}.sight figure{margin:0}
.sight svg{border-radius:4px;display:block}.sight figcaption,.key{font-size:13px}
@media(max-width:640px){.sight{grid-template-columns:1fr}}
.here{fill:#3db4ff}.shown{fill:#ff5a4d}.way{stroke:#fff;stroke-width:1.6}.shade{stroke:#000;stroke-width:3.4;opacity:.5}
.here,.shown{stroke:#000;stroke-width:.8}.back{fill:none;stroke:#48e07c;stroke-width:2.2}
.key i{font-style:normal;font-weight:bold}.key .h{color:#2b8fd0}.key .s{color:#d1382c}.key .b{color:#2a9d5c}
"""


def moment_html(moment: Moment, record: PairRecord) -> str:
    """A heading, what happened, both frames, and what the marks mean."""
    compared = compare(moment, record.second_period_ns)
    lengths = compared.lengths
    corrected = len(lengths) > 0 and float(np.percentile(lengths, MOST)) >= SEEN_PX
    typical = float(np.percentile(lengths, LONG)) if corrected else 0.0
    factor = next((f for f in MAGNIFIED if f * typical >= VISIBLE_PX), MAGNIFIED[-1]) if corrected else 1
    scale = [WIDTH_PX / image.shape[1] for image in (moment.first, moment.second)]
    pair = record.pair
    return (
        f'<h4>{_when(moment)}</h4><p>{escape(_what(moment))}</p><div class="sight">'
        f"{_figure(moment.first, _dots(compared.first * scale[0], 'here'), pair.first)}"
        f"{_figure(moment.second, _second(compared, scale[1], factor, corrected=corrected), pair.second)}</div>"
        f'<p class="key">{_key(moment, record, compared, factor, corrected=corrected)}</p>'
    )


def _when(moment: Moment) -> str:
    frame = "" if moment.verdict.frame is None else f", frame {moment.verdict.frame}"
    return f"At {moment.at_s:.2f} s{frame}"


def _what(moment: Moment) -> str:
    verdict = moment.verdict
    if verdict.state is State.UNKNOWN:
        return "An example, where most moved. It cannot be told whether these were taken together."
    if verdict.state is State.SYNC:
        return "An example, where most moved: nothing was out of sync for long."
    text = describe(verdict)
    cause = "" if verdict.cause is None else f" ({verdict.cause.value}: {CAUSE_WORDS[verdict.cause]})"
    return f"{text[:1].upper()}{text[1:]}{cause}."


def _figure(image: Picture, marks: str, camera: str) -> str:
    tall = WIDTH_PX * image.shape[0] / image.shape[1]
    label = f'role="img" aria-label="frame of {escape(camera)}"'
    return (
        f'<figure><svg viewBox="0 0 {WIDTH_PX} {tall:.0f}" {label}>'
        f'<image href="{_jpeg(image)}" width="{WIDTH_PX}" height="{tall:.0f}"/>{marks}</svg>'
        f"<figcaption>{escape(camera)}</figcaption></figure>"
    )


def _jpeg(image: Picture) -> str:
    data = cv2.imencode(".jpg", reduced(image, JPEG_WIDTH_PX), [cv2.IMWRITE_JPEG_QUALITY, JPEG_QUALITY])[1]
    return "data:image/jpeg;base64," + base64.b64encode(data.tobytes()).decode("ascii")


def _dots(points: Points, kind: str) -> str:
    radius = 6 if kind == "back" else 4
    return "".join(f'<circle class="{kind}" cx="{x:.1f}" cy="{y:.1f}" r="{radius}"/>' for x, y in points)


def _second(compared: Compared, scale: float, factor: int, *, corrected: bool) -> str:
    if not corrected:
        return _dots(scale * compared.second[: len(compared.first)], "here")
    known = np.isfinite(compared.moved).all(axis=1)
    shown, moved = scale * compared.second[known], scale * compared.moved[known]
    moved = shown + factor * (moved - shown)
    ends = [f'x1="{x:.1f}" y1="{y:.1f}" x2="{u:.1f}" y2="{v:.1f}"' for (x, y), (u, v) in zip(shown, moved, strict=True)]
    lines = "".join(f'<line class="shade" {end}/><line class="way" {end}/>' for end in ends)
    return lines + _dots(shown, "shown") + _dots(moved, "back")


def _key(moment: Moment, record: PairRecord, compared: Compared, factor: int, *, corrected: bool) -> str:
    first, second = escape(record.pair.first), escape(record.pair.second)
    if not corrected and not len(compared.first):
        return "No point was found in both pictures."
    if not corrected:
        apart = moment.verdict.state is State.ASYNC and moment.verdict.offset_ns is not None
        still = " Hardly anything moves, so that nothing of it is to be seen here." if apart else ""
        return f'<i class="h">Blue</i>: points that {first} and {second} both see.{still}'
    most_px = float(np.percentile(compared.lengths, MOST))
    offset_ms = (moment.verdict.offset_ns or 0) / NS_PER_MS
    drawn = f" The lines are drawn {factor} times as long as they are." if factor > 1 else ""
    return (
        f'<i class="h">Blue</i>: points of {first}. <i class="s">Red</i>: points of {second}, as delivered. '
        f'<i class="b">Green</i>: where they would be had {second} taken its picture together with {first}: each moved '
        f"back by its own speed times {offset_ms:+.1f} ms, by {most_px:.1f} px or less, in pictures "
        f"{moment.second.shape[1]} px wide.{drawn}{_rows(compared)}"
    )


def _rows(compared: Compared) -> str:
    """In a rectified rig, how far points are off their rows before and after; '' in any other."""
    both = len(compared.first)
    known = np.isfinite(compared.moved[:both]).all(axis=1)
    if not known.any():
        return ""
    before, after = (
        float(np.median(np.abs(points[:both][known, 1] - compared.first[known, 1])))
        for points in (compared.second, compared.moved)
    )
    if min(before, after) > ON_ROWS_PX:
        return ""
    return f" Points that both see are off their rows by {before:.1f} px, and once moved back by {after:.1f} px."
