"""Writes the report on a recording: what is wrong, what to do about it, and the numbers and pictures behind it."""

from __future__ import annotations

import re
from collections.abc import Sequence
from html import escape

from pipeline.answer import HEADLINE, Answer
from pipeline.html import page, table
from pipeline.report import sight
from pipeline.report.numbers import to_message
from pipeline.report.plots import (
    cadence_plot,
    coverage_plot,
    drift_plot,
    offset_plot,
    verdict_plot,
    witnesses_plot,
)
from pipeline.report.recorder import CameraRecord, PairRecord, Recorder
from pipeline.sentences import NOTE_WORDS
from pipeline.verdict import Basis, Message, Reason, State
from pipeline.words import REASON_WORDS

STYLE = (
    """
.verdict{font-size:24px;font-weight:bold;margin:.2rem 0}.told{font-size:17px}.told p{margin:.3rem 0}
.unsure{color:#a08a2c}.do{background:var(--soft);padding:.5rem 1rem;border-radius:6px}
.facts{display:flex;flex-wrap:wrap;gap:.6rem;padding:0;list-style:none;margin:1rem 0}
.facts li{background:var(--soft);border-radius:6px;padding:.4rem .8rem;min-width:7rem}
.facts b{display:block;font-size:18px}
.plot{overflow-x:auto}.plot svg{min-width:370px;max-width:740px;display:block}
.small,.facts{font-size:13px}h3{margin:1.6rem 0 .2rem}h3+p{margin:.2rem 0}h4{margin:1rem 0 .2rem}
td:first-child,th:first-child{text-align:left}
.words td,.words th{text-align:left}.words td:last-child{white-space:normal;min-width:16rem}
code{background:var(--soft);padding:0 .2rem;border-radius:3px}
"""
    + sight.STYLE
)

KIND = {State.SYNC: "good", State.ASYNC: "bad", State.UNKNOWN: "unsure"}
BY = {
    Basis.CONTENT.value: "by the pictures",
    Basis.TIMESTAMPS.value: "by the stamps",
    Basis.NONE.value: "because a camera was missing",
}
GEOMETRY = ("geometry_shift", "swapped")
SEEN_DRIFT = 3.0
"""Standard errors from which a drift is told as one."""


def report_page(
    recorder: Recorder, answer: Answer, version: str, paths: Sequence[str], unread: str | None = None
) -> str:
    """The whole page. paths: what was asked about, as it was given. unread: why not all of it could be read."""
    numbers = to_message(recorder, answer, version, unread)
    several = len(recorder.pairs) > 1
    body = (
        f"<h1>{escape(recorder.rig.name)}</h1>"
        f'<p class="verdict {KIND[answer.state]}">{HEADLINE[answer.state]}</p>'
        f'<div class="told">{_told(numbers, several=several)}</div>'
        f"{'' if unread is None else f'<p>The recording could be read in part only: {escape(unread)}.</p>'}"
        f'<div class="do"><b>What to do</b>{_list(numbers["advice"])}</div>'
        f"{_overview(numbers) if several else ''}"
        f"{''.join(_pair(record, numbers['pairs'][name]) for name, record in recorder.pairs.items())}"
        f"{_cameras(recorder, numbers)}{_footer(numbers, paths)}"
    )
    return page(f"{recorder.rig.name}: syncwatch report", body, STYLE)


def _told(numbers: Message, *, several: bool) -> str:
    lines = []
    for name, pair in numbers["pairs"].items():
        head = f"<b>{escape(name)}</b>: " if several else ""
        lines.append(f"<p>{head}{escape(' '.join(pair['told']))}</p>")
        if pair["notes"]:
            lines.append(f'<p class="small">Noticed besides: {escape(_noticed(pair["notes"]))}.</p>')
    first = next(iter(numbers["cameras"].values()))
    if first["stamps_made_up"] and "expected_fps" in first:
        rate = f"{first['expected_fps']:g} frames a second"
        lines.append(f'<p class="small">The recording has no timestamps: all times here count {rate}.</p>')
    return "".join(lines)


def _noticed(notes: Sequence[str]) -> str:
    return "; ".join(NOTE_WORDS.get(note, note) for note in notes)


def _list(sentences: Sequence[str]) -> str:
    """Plain text, with what stands in backticks as code."""
    items = (re.sub(r"`([^`]+)`", r"<code>\1</code>", escape(sentence)) for sentence in sentences)
    return "<ul>" + "".join(f"<li>{item}</li>" for item in items) + "</ul>"


def _overview(numbers: Message) -> str:
    rows = []
    for name, pair in numbers["pairs"].items():
        rows.append([name, pair["state"], _range(pair["offset_ms"]), _percent(pair["coverage"]), str(pair["frames"])])
    return "<h2>Pairs</h2>" + table(["pair", "verdict", "offset, mean (least to most)", "judged", "frames"], rows)


def _pair(record: PairRecord, numbers: Message) -> str:
    return (
        f"<section><h2>{escape(record.pair.name)}</h2>{_facts(numbers)}"
        f'<h3>Verdict over time</h3><p class="small">{_STRIP}</p>{_plot(verdict_plot(record))}'
        f"{_offset(record, numbers)}{_moments(record)}{_witnesses(record, numbers)}{_drift(record, numbers)}"
        f"{_coverage(record, numbers)}{_geometry(record)}{_events(record)}</section>"
        if record.tally.total
        else f"<section><h2>{escape(record.pair.name)}</h2><p>No two frames came together.</p></section>"
    )


_STRIP = (
    '<span class="good">Green</span>: in sync. <span class="bad">Red</span>: out of sync, with its cause. '
    '<span class="unsure">Ochre</span>: cannot tell. Triangles: something begins, told under Events.'
)


def _facts(numbers: Message) -> str:
    drift = _main_drift(numbers)
    facts = {
        **_main_offset(numbers),
        "drift, last seen": _NO_DRIFT[bool(numbers["decided"])] if drift is None else f"{drift:+.1f} ppm",
        "of the frames judged": _percent(numbers["coverage"]),
        f"{numbers['frames']} frames": f"{numbers['duration_s']:.1f} s",
        "counts as in sync": f"± {numbers['tolerance_ms']:.1f} ms",
    }
    return '<ul class="facts">' + "".join(f"<li><b>{value}</b>{name}</li>" for name, value in facts.items()) + "</ul>"


_NO_DRIFT = {True: "none seen", False: "unknown"}


def _main_offset(numbers: Message) -> dict[str, str]:
    """The offset to tell in one number."""
    known = [stretch["offset_ms"] for stretch in numbers["stretches"] if stretch["offset_ms"] is not None]
    if numbers["state"] == State.ASYNC.value and known:
        worst = max(known, key=lambda offset_ms: abs(offset_ms - numbers["expected_offset_ms"]))
        return {"offset, at its worst": f"{worst:+.1f} ms"}
    average = "unknown" if numbers["offset_ms"] is None else f"{numbers['offset_ms']['mean']:+.1f} ms"
    return {"offset, on average": average}


def _plot(svg: str) -> str:
    return f'<div class="plot">{svg}</div>'


def _offset(record: PairRecord, numbers: Message) -> str:
    head = "<h3>Offset</h3>"
    second = escape(record.pair.second)
    if numbers["offset_ms"] is None:
        return f"{head}<p>None was told: {_mostly(numbers['reasons'])}.</p>"
    return (
        f"{head}<p>How much later {second} takes its pictures: {_range(numbers['offset_ms'])}. The blue band is "
        f"two standard errors wide either way; inside the green one a pair is in sync.</p>{_plot(offset_plot(record))}"
    )


def _witnesses(record: PairRecord, numbers: Message) -> str:
    head = "<h3>Stamps against pictures</h3>"
    stamps, pictures, share = numbers["stamps_ms"], numbers["pictures_ms"], numbers["contradictions"]
    if stamps is None:
        made_up = "The recording has no timestamps of its own, so that only the pictures tell the time."
        why = made_up if record.synthesised else f"Stamps cannot be compared: {escape(record.stamps_reason)}."
        return f"{head}<p>{why}</p>"
    if pictures is None:
        return f"{head}<p>Stamps say {_range(stamps)}; the pictures could not tell: {_mostly(numbers['silences'])}.</p>"
    if not share:
        words = "Wherever both could be heard, they agree." if share is not None else "They never spoke of one frame."
    else:
        words = f"They contradict each other in {_percent(share)} of the frames in which both could be heard."
    return (
        f"{head}<p>{words} Stamps say {_range(stamps)}, pictures {_range(pictures)}.</p>{_plot(witnesses_plot(record))}"
    )


def _drift(record: PairRecord, numbers: Message) -> str:
    head, drift = "<h3>Drift</h3>", numbers["drift"]
    seen = record.series.known("drift_stamps_ppm").any() or record.series.known("drift_pictures_ppm").any()
    if not numbers["decided"]:
        return f"{head}<p>Nothing is known of it: no frame could be judged.</p>"
    if not seen:
        return f"{head}<p>No drift was seen that is more than chance.</p>"
    told = [
        f"{drift[f'{who}_ppm']:+.1f} ± {drift[f'{who}_sigma_ppm'] or 0:.1f} ppm by {who}"
        for who in ("stamps", "pictures")
        if drift[f"{who}_ppm"] is not None
    ]
    words = f"Last seen {' and '.join(told)}. "
    return (
        f"{head}<p>{words}One ppm is a microsecond a second; positive means that {escape(record.pair.second)} falls "
        f"ever further behind.</p>{_plot(drift_plot(record))}"
    )


def _coverage(record: PairRecord, numbers: Message) -> str:
    why = ""
    if numbers["reasons"]:
        rows = [[name, str(count), REASON_WORDS[Reason(name)]] for name, count in numbers["reasons"].items()]
        why = table(["why not", "frames", ""], rows, "words")
    basis = " and ".join(f"{count} {BY[name]}" for name, count in numbers["basis"].items())
    words = f"{numbers['decided']} of {numbers['frames']} frames could be judged{f': {basis}' if basis else ''}."
    return f"<h3>How much could be judged</h3><p>{words}</p>{_plot(coverage_plot(record))}{why}"


def _geometry(record: PairRecord) -> str:
    marks = [mark for mark in record.marks.marks if mark.kind.partition(" ")[0] in GEOMETRY]
    lines = [f"At {mark.at_s:.1f} s: {mark.text}." for mark in marks]
    words = _list(lines) if lines else "<p>No camera was seen to move against the other, or to be exchanged.</p>"
    return f"<h3>How the cameras stand to one another</h3>{words}"


def _events(record: PairRecord) -> str:
    rows = []
    for mark in record.marks.marks:
        since = "" if mark.since_s is None else f"{mark.since_s:.2f} s"
        what = "noticed" if mark.kind == "note" else mark.kind.replace("_", " ")
        cause = f" ({mark.cause})" if mark.cause and mark.kind.endswith("onset") else ""
        rows.append([f"{mark.at_s:.2f} s", since, what + cause, NOTE_WORDS.get(mark.text, mark.text)])
    if not rows:
        return "<h3>Events</h3><p>None.</p>"
    left_out = record.marks.left_out
    more = f"<p>And {left_out} more, which are not listed.</p>" if left_out else ""
    return "<h3>Events</h3>" + table(["told at", "so since", "what", "in words"], rows, "words") + more


def _moments(record: PairRecord) -> str:
    moments = record.moments.worst()
    if not moments:
        return ""
    worst = any(moment.verdict.state is State.ASYNC for moment in moments)
    head = "The worst moments" if worst else "What the cameras saw"
    return f"<h3>{head}</h3>{''.join(sight.moment_html(moment, record) for moment in moments)}"


def _cameras(recorder: Recorder, numbers: Message) -> str:
    titles = [
        "camera",
        "picture",
        "fps",
        "expected",
        "frames",
        "lost",
        "unpaired",
        "doubled",
        "restarts",
    ]
    rows = []
    for name, camera in numbers["cameras"].items():
        size = "" if camera["width"] is None else f"{camera['width']} × {camera['height']}"
        fps = "-" if camera.get("fps") is None else f"{camera['fps']:.3f}"
        counts = [str(camera.get(what, "-")) for what in ("frames", "drops", "unpaired", "duplicates", "restarts")]
        jitter = [_ms(camera.get(what)) for what in ("jitter_p50_ms", "jitter_p99_ms")]
        rows.append([name, size, fps, f"{camera.get('expected_fps', 0):g}", *counts, *jitter])
    made_up = all(record.synthesised for record in recorder.cameras.values())
    plots = MADE_UP if made_up else "".join(map(_cadence, recorder.cameras.values()))
    return (
        f"<section><h2>Cameras: lost frames and jitter</h2>"
        f"{table([*titles, 'jitter, usual', '1 in 100'], rows)}{plots}</section>"
    )


MADE_UP = "<p>The recording has no timestamps of its own: nothing is known of the time between frames.</p>"


def _cadence(record: CameraRecord) -> str:
    head = f"<h3>{escape(record.camera.name)}: time between frames</h3>"
    if record.synthesised or not record.series.known("interval_ms").any():
        return f"{head}{MADE_UP}"
    return (
        f"{head}<p>By the camera's own stamps; the grey line is what its frame rate asks for. Width is jitter, red "
        f"dots are gaps in which frames were lost.</p>{_plot(cadence_plot(record))}"
    )


def _footer(numbers: Message, paths: Sequence[str]) -> str:
    return (
        f'<section class="small"><p>As <code>syncwatch check</code> says it: {escape(numbers["text"])}</p>'
        f"<p>Offsets are the second camera's against the first's; positive means that its picture shows a later "
        f"moment. Seconds count from the first frame judged, by the nominal frame rate. Made by syncwatch "
        f"{escape(numbers['version'])} of {escape(', '.join(paths))}.</p></section>"
    )


def _main_drift(numbers: Message) -> float | None:
    """The drift to tell in one number: by pictures where they know it; None where it may be chance."""
    drift = numbers["drift"]
    for who in ("pictures", "stamps"):
        ppm, sigma = drift[f"{who}_ppm"], drift[f"{who}_sigma_ppm"]
        if ppm is not None and abs(ppm) > SEEN_DRIFT * (sigma or 0.0):
            return float(ppm)
    return None


def _mostly(reasons: Message) -> str:
    reason = next(iter(reasons), None)
    return "no offset describes it" if reason is None else escape(REASON_WORDS[Reason(reason)])


def _range(values: Message | None) -> str:
    if values is None:
        return "unknown"
    return f"{values['mean']:+.1f} ms on average ({values['min']:+.1f} to {values['max']:+.1f} ms)"


def _percent(share: float) -> str:
    return f"{100 * share:.0f} %"


def _ms(value: float | None) -> str:
    return "-" if value is None else f"{value:.2f} ms"
