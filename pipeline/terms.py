"""The words in which verdicts, events and status are said, and the units of their JSON messages."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from enum import Enum
from typing import Any, TypeAlias

Message: TypeAlias = dict[str, Any]
"""A JSON object with a `schema` member."""

VERDICT_SCHEMA = "syncwatch.verdict.v1"
EVENT_SCHEMA = "syncwatch.event.v1"
STATUS_SCHEMA = "syncwatch.status.v1"
ALIGNED_SCHEMA = "syncwatch.aligned.v1"
FLEET_SCHEMA = "syncwatch.fleet.v1"
INCIDENT_SCHEMA = "syncwatch.incident.v1"


class State(str, Enum):
    """Were the frames of a pair taken together?"""

    SYNC = "sync"
    ASYNC = "async"
    UNKNOWN = "unknown"


class Basis(str, Enum):
    """What a judgement rests on."""

    CONTENT = "content"
    TIMESTAMPS = "timestamps"
    NONE = "none"


class Cause(str, Enum):
    """Why a pair is out of sync (words.py says it to people)."""

    SLIP = "slip"
    PHASE = "phase"
    STAMPS_LIE = "stamps_lie"
    FREE_RUN = "free_run"
    FROZEN = "frozen"
    MISSING = "missing"


class Reason(str, Enum):
    """Why nothing can be said of a pair (words.py says it to people)."""

    NO_MOTION = "no_motion"
    NO_OVERLAP = "no_overlap"
    NO_TEXTURE = "no_texture"
    DARK = "dark"
    WARMING_UP = "warming_up"
    UNPAIRED = "unpaired"
    WIDE_ERROR = "wide_error"
    STAMPS_DISPROVED = "stamps_disproved"
    NO_EVIDENCE = "no_evidence"


class Level(str, Enum):
    """The state of a whole rig, for lamps and pagers."""

    OK = "ok"
    WARN = "warn"
    ERROR = "error"
    STALE = "stale"


@dataclass(frozen=True, slots=True)
class Pace:
    """How fast the offset of a pair grows, as stamps and as pictures have it: ppm, 1 ppm = 1 us a second.

    Positive: the second camera falls ever further behind. sigma: one standard error. None: not known yet, or no drift
    that is more than chance.
    """

    stamps_ppm: float | None = None
    stamps_sigma_ppm: float | None = None
    pictures_ppm: float | None = None
    pictures_sigma_ppm: float | None = None

    def to_json(self) -> Message:
        return {name: rounded(value, 3) for name, value in asdict(self).items()}


def ms(value_ns: int | None) -> float | None:
    """Nanoseconds to milliseconds, to the microsecond."""
    return None if value_ns is None else round(value_ns / 1e6, 3)


def rounded(value: float | None, digits: int = 4) -> float | None:
    return None if value is None else round(float(value), digits)
