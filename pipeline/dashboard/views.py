"""What the page is told, as JSON."""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Mapping
from typing import Any

from pipeline.fleet.headline import WORST_FIRST, Tone, headline
from pipeline.fleet.listener import FleetListener
from pipeline.fleet.messages import HeardStatus
from pipeline.fleet.offsets import KEPT_NS, SLOT_NS, Point
from pipeline.fleet.table import Incident, RigView
from pipeline.frame import NS_PER_MS, NS_PER_S
from pipeline.words import CAUSE_WORDS

EVENTS_SHOWN = 50

MANY = 24
"""With more rigs than this, those that nothing is wrong with are told in a word each."""

SMALL_TONES = frozenset({Tone.UNSURE, Tone.GOOD})

CAUSES = {cause.value: words for cause, words in CAUSE_WORDS.items()}


def as_text(message: object) -> str:
    return json.dumps(message, separators=(",", ":"), allow_nan=False)


def fleet_view(listener: FleetListener) -> dict[str, Any]:
    """Every rig in a few words, the worst first."""
    known = listener.fleet.rigs()
    rigs = [_brief(rig, many=len(known) > MANY) for rig in known]
    rigs.sort(key=lambda rig: WORST_FIRST.index(rig["tone"]))
    return {
        "problem": listener.problem,
        "left_out": listener.fleet.left_out,
        "prefix": listener.settings.prefix,
        "where": listener.settings.where,
        "rigs": rigs,
    }


def summary_view(listener: FleetListener) -> dict[str, Any]:
    """How many rigs stand how, the worst first, and why nothing can be heard, if so."""
    counts = Counter(headline(rig).tone for rig in listener.fleet.rigs())
    return {
        "problem": listener.problem,
        "counts": [[tone.value, counts[tone]] for tone in WORST_FIRST if counts[tone]],
    }


def rig_view(rig: RigView) -> dict[str, Any]:
    """Everything about one rig but its offsets over time."""
    return {
        **_brief(rig),
        "status": rig.status and _status(rig.status),
        "events": [_event(incident) for incident in reversed(rig.incidents[-EVENTS_SHOWN:])],
        "previews": rig.previews,
    }


def offsets_view(offsets: Mapping[str, tuple[Point, ...]]) -> dict[str, Any]:
    """Rows of [t_ms, state, offset_ms, sigma_ms, low_ms, high_ms, tolerance_ms] for each pair."""
    return {
        "kept_s": KEPT_NS // NS_PER_S,
        "pairs": {pair: [_row(point) for point in points] for pair, points in offsets.items() if points},
    }


def _brief(rig: RigView, *, many: bool = False) -> dict[str, Any]:
    """many: there are so many that pairs and the last minutes are told of those in trouble only."""
    said = headline(rig)
    small = many and said.tone in SMALL_TONES
    pairs = rig.status.pairs if rig.status else {}
    brief = {
        "name": rig.name,
        "presence": rig.presence.value,
        "tone": said.tone.value,
        "word": said.word,
        "detail": said.detail,
        "small": small,
    }
    if small:
        return brief
    return brief | {
        "pairs": [
            {
                "name": name,
                "state": pair.state.value,
                "offset_ms": pair.offset_ms,
                "sigma_ms": pair.offset_sigma_ms,
            }
            for name, pair in pairs.items()
        ],
        "trail": "".join("-" if state is None else state.value[0] for state in rig.trail),
        "slot_s": SLOT_NS // NS_PER_S,
    }


def _status(status: HeardStatus) -> dict[str, Any]:
    return {
        "level": status.level.value,
        "at_ms": status.at_ns // NS_PER_MS,
        "pairs": {
            name: {
                **pair.model_dump(mode="json"),
                "since_ms": pair.since_ns // NS_PER_MS,
                "cause_words": CAUSES.get(pair.cause or ""),
            }
            for name, pair in status.pairs.items()
        },
        "cameras": {name: camera.model_dump(mode="json") for name, camera in status.cameras.items()},
        "monitor": status.monitor.model_dump(mode="json"),
    }


def _event(incident: Incident) -> dict[str, Any]:
    return {
        "id": incident.id,
        "kind": incident.kind,
        "cause": incident.cause,
        "where": incident.pair or incident.camera,
        "since_ms": incident.since_ns // NS_PER_MS,
        "until_ms": incident.until_ns and incident.until_ns // NS_PER_MS,
        "open": incident.open,
        "text": incident.text,
        "end_text": incident.end_text,
        "worst": dict(incident.worst),
    }


def _row(point: Point) -> list[Any]:
    return [
        point.at_ns // NS_PER_MS,
        point.state.value[0],
        point.offset_ms,
        point.sigma_ms,
        point.low_ms,
        point.high_ms,
        point.tolerance_ms,
    ]
