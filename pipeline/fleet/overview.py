"""All rigs at one moment: as a message for programs and as a table for people."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Sequence

from rich.table import Table
from rich.text import Text

from pipeline.fleet.headline import WORST_FIRST, Headline, Tone, ago, headline
from pipeline.fleet.messages import HeardPair, HeardStatus
from pipeline.fleet.table import Presence, RigView
from pipeline.frame import NS_PER_S
from pipeline.terms import FLEET_SCHEMA, Level, Message, State

COLOURS = {Tone.BAD: "bold red", Tone.AWAY: "magenta", Tone.WARN: "yellow", Tone.UNSURE: "cyan", Tone.GOOD: "green"}
STATE_COLOURS = {State.SYNC: "green", State.ASYNC: "bold red", State.UNKNOWN: "cyan"}
COLUMNS = ("rig", "", "pair", "state", "offset", "cause", "since")
FIRST_COLUMNS = ("rig", "", "offset")
WIDE = 72
"""Letters in a line that all columns need, so that names can still be read."""

SHORTENED = {"rig": 10, "pair": 8}
"""Columns that give way where there is no room, and the letters they keep."""

LONGEST_NAME = 40

TONE_WORDS = {
    Tone.BAD: "in trouble",
    Tone.AWAY: "not heard",
    Tone.WARN: "with warnings",
    Tone.UNSURE: "unsure",
    Tone.GOOD: "in sync",
}


def is_well(rig: RigView) -> bool:
    """Whether the rig was heard just now and says that all is in order."""
    return rig.presence is Presence.ALIVE and rig.status is not None and rig.status.level is Level.OK


def all_well(rigs: Sequence[RigView]) -> bool:
    """Whether there are rigs at all, and all of them are well."""
    return bool(rigs) and all(is_well(rig) for rig in rigs)


def fleet_message(
    prefix: str, rigs: Sequence[RigView], *, at_ns: int, problem: str | None, left_out: int = 0
) -> Message:
    """at_ns: the time of day. problem: why nothing can be heard. left_out: rigs there was no room for."""
    return {
        "schema": FLEET_SCHEMA,
        "prefix": prefix,
        "at_ns": at_ns,
        "ok": all_well(rigs),
        "problem": problem,
        "left_out": left_out,
        "rigs": {rig.name: _rig_json(rig) for rig in rigs},
    }


def fleet_table(
    rigs: Sequence[RigView], *, lines: int | None = None, width: int = WIDE
) -> tuple[Table, Sequence[RigView]]:
    """A row a pair, the worst rigs first, and the rigs that had no room. What is not of now is dim.

    lines, width: what there is room for, in letters.
    """
    table = Table(box=None, pad_edge=False, header_style="dim")
    columns = COLUMNS if width >= WIDE else FIRST_COLUMNS
    for name in columns:
        shortened = SHORTENED.get(name)
        right = name in {"offset", "since"}
        table.add_column(name, justify="right" if right else "left", no_wrap=shortened is None, min_width=shortened)
    ordered = sorted(rigs, key=lambda rig: WORST_FIRST.index(headline(rig).tone))
    for shown, rig in enumerate(ordered):
        rows = list(_pair_rows(rig))
        if lines is not None and table.row_count + len(rows) >= lines:
            return table, ordered[shown:]
        said = headline(rig)
        head = (_shortened(rig.name), Text(_word(rig, said), COLOURS[said.tone]))
        style = "dim" if said.tone is Tone.AWAY else ""
        for number, cells in enumerate(rows):
            row = dict(zip(COLUMNS, (*(head if number == 0 else ("", "")), *cells), strict=True))
            table.add_row(*(row[name] for name in columns), style=style)
    return table, ()


def counted(rigs: Sequence[RigView]) -> Text:
    """How many rigs stand how, the worst first."""
    tones = Counter(headline(rig).tone for rig in rigs)
    parts = (Text(f"{tones[tone]} {TONE_WORDS[tone]}", COLOURS[tone]) for tone in WORST_FIRST if tones[tone])
    return Text(", ").join(parts)


def _word(rig: RigView, said: Headline) -> str:
    return f"{said.word}, {ago(rig.silent_ns)}" if said.tone is Tone.AWAY else said.word


def _shortened(name: str) -> Text:
    """On one line, whatever its column has room for."""
    text = Text(name, no_wrap=True, overflow="ellipsis")
    text.truncate(LONGEST_NAME, overflow="ellipsis")
    return text


def _rig_json(rig: RigView) -> Message:
    status = rig.status
    return {
        "ok": is_well(rig),
        "presence": rig.presence.value,
        "headline": headline(rig).word,
        "silent_s": round(rig.silent_ns / NS_PER_S, 3),
        "level": status and status.level.value,
        "reasons": [] if status is None else list(status.reasons),
        "pairs": {} if status is None else {name: _pair_json(pair) for name, pair in status.pairs.items()},
        "open": [
            {
                "id": incident.id,
                "kind": incident.kind,
                "pair": incident.pair,
                "camera": incident.camera,
                "cause": incident.cause,
                "since_ns": incident.since_ns,
                "text": incident.text,
            }
            for incident in rig.incidents
            if incident.open
        ],
    }


def _pair_json(pair: HeardPair) -> Message:
    return {
        "state": pair.state.value,
        "cause": pair.cause,
        "since_ns": pair.since_ns,
        "offset_ms": pair.offset_ms,
        "offset_sigma_ms": pair.offset_sigma_ms,
        "coverage": pair.coverage,
    }


def _pair_rows(rig: RigView) -> Iterator[tuple[Text | str, ...]]:
    """Pair, state, offset, cause and since; one row of nothing where no pair is known."""
    if rig.status is None or not rig.status.pairs:
        yield ("",) * 5
        return
    for name, pair in rig.status.pairs.items():
        yield (
            _shortened(name),
            Text(pair.state.value, STATE_COLOURS[pair.state]),
            _offset(pair),
            Text(pair.cause or ""),
            _since(rig, rig.status, pair),
        )


def _offset(pair: HeardPair) -> str:
    if pair.offset_ms is None:
        return ""
    sigma = "" if pair.offset_sigma_ms is None else f" ± {pair.offset_sigma_ms:.1f}"
    return f"{round(pair.offset_ms, 1) + 0.0:+.1f}{sigma} ms"  # the sum takes the sign off a zero


def _since(rig: RigView, status: HeardStatus, pair: HeardPair) -> str:
    """By the monitor's own clock until it said so, and by ours from then on: the two need not agree."""
    return ago(max(0, status.at_ns - pair.since_ns) + rig.silent_ns)
