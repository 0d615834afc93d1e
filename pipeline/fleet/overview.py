"""All rigs at one moment: as a message for programs and as a table for people."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from rich.table import Table
from rich.text import Text

from pipeline.fleet.headline import Tone, ago, headline
from pipeline.fleet.messages import HeardPair, HeardStatus
from pipeline.fleet.table import Presence, RigView
from pipeline.frame import NS_PER_S
from pipeline.terms import FLEET_SCHEMA, Level, Message, State

COLOURS = {Tone.BAD: "bold red", Tone.AWAY: "magenta", Tone.WARN: "yellow", Tone.UNSURE: "cyan", Tone.GOOD: "green"}
STATE_COLOURS = {State.SYNC: "green", State.ASYNC: "bold red", State.UNKNOWN: "cyan"}
COLUMNS = ("rig", "", "pair", "state", "offset", "cause", "since", "heard")


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


def fleet_table(rigs: Sequence[RigView]) -> Table:
    """A row a pair; what is not of now is dim."""
    table = Table(box=None, pad_edge=False, header_style="dim")
    for name in COLUMNS:
        table.add_column(name, justify="right" if name in {"offset", "since", "heard"} else "left", no_wrap=True)
    for rig in rigs:
        said = headline(rig)
        head = (Text(rig.name), Text(said.word, COLOURS[said.tone]))
        heard = Text(ago(rig.silent_ns)) if rig.status else Text("never")
        style = "dim" if said.tone is Tone.AWAY else ""
        for number, cells in enumerate(_pair_rows(rig)):
            table.add_row(*(head if number == 0 else ("", "")), *cells, heard if number == 0 else "", style=style)
    return table


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
            Text(name),
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
