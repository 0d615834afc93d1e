"""Drawings of timelines and of confusion matrices, as SVG; colours are classes of the page's style."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from html import escape

from pipeline.timeline import Point, Span, Timeline

WIDTH, LEFT, RIGHT = 960, 90, 12
BAND, GAP, CURVE = 16, 6, 110
STATES = ("sync", "async", "unknown")


def timeline_svg(timeline: Timeline) -> str:
    """Truth above, verdict below, the offset with its error band under both, events and notes as marks."""
    scale = (WIDTH - LEFT - RIGHT) / max(timeline.duration_s, 1e-9)

    def x(at_s: float) -> float:
        return LEFT + at_s * scale

    top_said, top_curve = BAND + GAP, 2 * (BAND + GAP)
    height = top_curve + CURVE + 22
    parts = [
        _label("truth", BAND - 4),
        *_band(timeline.truth, x, 0),
        _label("verdict", top_said + BAND - 4),
        *_band(timeline.said, x, top_said),
        *_curve(timeline, x, top_curve),
        *_axis(timeline.duration_s, x, top_curve + CURVE),
    ]
    for mark in timeline.marks:
        at = f'{x(mark.at_s):.1f}" x2="{x(mark.at_s):.1f}'
        title = f"<title>{mark.at_s:.2f} s: {escape(mark.kind)}: {escape(mark.text)}</title>"
        kind = "note" if mark.kind == "note" else "event"
        parts.append(f'<line class="{kind}" x1="{at}" y1="{top_said}" y2="{top_curve + CURVE}">{title}</line>')
    label = 'role="img" aria-label="truth, verdict and offset over time"'
    return f'<svg viewBox="0 0 {WIDTH} {height}" {label}>{"".join(parts)}</svg>'


def _label(text: str, y: float) -> str:
    return f'<text x="{LEFT - 8}" y="{y:.1f}" text-anchor="end">{escape(text)}</text>'


def _band(spans: Sequence[Span], x: Callable[[float], float], top: float) -> list[str]:
    made = []
    for span in spans:
        state, _, why = span.what.partition(" ")
        width = max(x(span.to_s) - x(span.from_s), 0.5)
        title = f"{span.from_s:.2f} to {span.to_s:.2f} s: {span.what}"
        made.append(
            f'<rect class="{state}" x="{x(span.from_s):.1f}" y="{top}" width="{width:.1f}" height="{BAND}">'
            f"<title>{escape(title)}</title></rect>"
        )
        if why and width > 7 * len(why):
            middle = x(span.from_s) + width / 2
            made.append(
                f'<text class="in" x="{middle:.1f}" y="{top + BAND - 4}" text-anchor="middle">{escape(why)}</text>'
            )
    return made


def _curve(timeline: Timeline, x: Callable[[float], float], top: float) -> list[str]:
    """True and told offset; the band is two standard errors wide either way, the grey one the tolerance."""
    known = [value for point in timeline.points for value in (point.true_ms, point.told_ms) if value is not None]
    most = 1.15 * max([abs(value) for value in known] + [3 * timeline.tolerance_ms, 1e-6])
    middle = top + CURVE / 2

    def y(value_ms: float) -> float:
        return middle - max(-1.0, min(1.0, value_ms / most)) * CURVE / 2

    tolerance = timeline.tolerance_ms
    band = f'y="{y(tolerance):.1f}" width="{WIDTH - LEFT - RIGHT}" height="{y(-tolerance) - y(tolerance):.1f}"'
    parts = [f'<rect class="tolerance" x="{LEFT}" {band}/>']
    levels = (most / 1.15, 0.0, -most / 1.15)
    parts += [_label(f"{value:+.3g} ms" if value else "0", y(value) + 4) for value in levels]
    for run in _runs(timeline.points):
        upper = [f"{x(p.at_s):.1f},{y((p.told_ms or 0) + 2 * (p.sigma_ms or 0)):.1f}" for p in run]
        lower = [f"{x(p.at_s):.1f},{y((p.told_ms or 0) - 2 * (p.sigma_ms or 0)):.1f}" for p in reversed(run)]
        parts.append(f'<polygon class="error" points="{" ".join(upper + lower)}"/>')
        parts.append(_line([(x(p.at_s), y(p.told_ms or 0)) for p in run], "told"))
    true = [(x(p.at_s), y(p.true_ms)) for p in timeline.points if p.true_ms is not None]
    parts.append(_line(true, "true"))
    return parts


def _runs(points: Sequence[Point]) -> list[list[Point]]:
    """Points that were told an offset, cut where one was not."""
    runs: list[list[Point]] = [[]]
    for point in points:
        if point.told_ms is None:
            runs.append([])
        else:
            runs[-1].append(point)
    return [run for run in runs if run]


def _line(points: Sequence[tuple[float, float]], kind: str) -> str:
    steps = " ".join(f"{x:.1f},{y:.1f}" for x, y in points)
    return f'<polyline class="{kind}" points="{steps}"/>'


def _axis(duration_s: float, x: Callable[[float], float], top: float) -> list[str]:
    step = next((step for step in (1, 2, 5, 10, 30, 60, 300, 600, 1800) if duration_s / step <= 12), 3600)
    ticks = range(0, int(duration_s) + 1, step)
    return [f'<text x="{x(at):.1f}" y="{top + 16}" text-anchor="middle">{at} s</text>' for at in ticks]


def confusion_svg(counts: Mapping[str, Mapping[str, int]]) -> str:
    """Rows: what was true; columns: what was said; each cell shaded by its share of the row."""
    cell, left, top = 120, 110, 44
    parts = [f'<text x="{left + 1.5 * cell}" y="14" text-anchor="middle">said</text>']
    for column, said in enumerate(STATES):
        parts.append(f'<text x="{left + (column + 0.5) * cell}" y="{top - 10}" text-anchor="middle">{said}</text>')
    for row, (true, of_row) in enumerate(counts.items()):
        total = sum(of_row.values())
        y = top + row * cell
        parts.append(f'<text x="{left - 10}" y="{y + cell / 2}" text-anchor="end">truly {true}</text>')
        for column, said in enumerate(STATES):
            count = of_row.get(said, 0)
            share = count / total if total else 0.0
            kind = "right" if said == true else "unknown" if said == "unknown" else "wrong"
            x = left + column * cell
            parts.append(
                f'<rect class="{kind}" x="{x}" y="{y}" width="{cell - 3}" height="{cell - 3}" '
                f'fill-opacity="{0.12 + 0.88 * share:.2f}"/>'
                f'<text class="count" x="{x + cell / 2}" y="{y + cell / 2}" text-anchor="middle">{count}</text>'
                f'<text x="{x + cell / 2}" y="{y + cell / 2 + 20}" text-anchor="middle">{100 * share:.1f} %</text>'
            )
    height = top + len(counts) * cell
    label = 'role="img" aria-label="confusion matrix: what was true by what was said"'
    return f'<svg class="confusion" viewBox="0 0 {left + 3 * cell} {height}" {label}>{"".join(parts)}</svg>'


def alone(svg: str, style: str) -> str:
    """The drawing as a file of its own."""
    start, rest = svg.split(">", 1)
    return f'{start} xmlns="http://www.w3.org/2000/svg"><style>{style}</style>{rest}\n'
