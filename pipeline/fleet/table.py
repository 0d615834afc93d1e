"""What is known of every rig that was heard: bounded, whatever comes, and safe to read from any thread."""

from __future__ import annotations

import threading
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from enum import Enum

from pipeline.fleet.messages import HeardEvent, HeardStatus, HeardVerdict
from pipeline.fleet.offsets import Offsets, Point, Trail
from pipeline.frame import NS_PER_S
from pipeline.verdict import State

STALE_AFTER_NS = 5 * NS_PER_S
"""A status comes once a second: after five that did not come, the last one says nothing of now."""

FORGET_AFTER_NS = 24 * 3600 * NS_PER_S
"""A rig whose monitor has been gone for a day is not missed any more."""

MAX_RIGS = 1000
MAX_EVENTS = 200
MAX_PARTS = 64
"""Pairs and cameras a rig may have here."""


class Presence(str, Enum):
    """Is the monitor of a rig there?"""

    ALIVE = "alive"
    STALE = "stale"  # its token is there, and it does not say how the rig stands
    GONE = "gone"  # its token has vanished: it was ended, or has died, or its machine cannot be reached
    UNHEARD = "unheard"  # this listener is cut off itself


@dataclass(frozen=True, slots=True)
class Incident:
    """A condition with its onset and, once it has ended, its end; text is the onset's, end_text the end's."""

    id: str
    kind: str
    pair: str | None
    camera: str | None
    cause: str | None
    since_ns: int
    until_ns: int | None
    worst: Mapping[str, float | None]
    text: str
    end_text: str | None

    @property
    def open(self) -> bool:
        return self.end_text is None


@dataclass(frozen=True, slots=True)
class Preview:
    """The latest small picture of a camera. number: counts the pictures that came."""

    number: int
    at_ns: int
    jpeg: bytes


@dataclass(frozen=True, slots=True)
class RigView:
    """A rig as it stands. name: its key below the prefix; with a prefix of several sites it holds slashes.

    status: the last one, None before there was any. silent_ns: since it was heard, or since the rig was first noticed.
    incidents: the last MAX_EVENTS, oldest first. previews: the number of the latest picture of each camera.
    trail: the worst state of any pair in each SLOT_NS of the last minutes, oldest first, None where nothing was heard.
    """

    name: str
    presence: Presence
    status: HeardStatus | None
    silent_ns: int
    incidents: tuple[Incident, ...]
    previews: Mapping[str, int]
    trail: tuple[State | None, ...]


@dataclass(slots=True)
class _Rig:
    heard_ns: int
    here: bool = True
    changed_ns: int = 0
    status: HeardStatus | None = None
    incidents: dict[str, Incident] = field(default_factory=dict)
    listed: tuple[Incident, ...] = ()
    offsets: dict[str, Offsets] = field(default_factory=dict)
    previews: dict[str, Preview] = field(default_factory=dict)
    trail: Trail = field(default_factory=Trail)


class Fleet:
    """Takes what was heard of rigs by name; views say how they stand.

    connected: set by the listener; while false, nothing is known of anybody. left_out: rigs there was no room for.
    monotonic_ns: a clock that never steps.
    """

    def __init__(self, monotonic_ns: Callable[[], int]) -> None:
        self._monotonic_ns = monotonic_ns
        self._lock = threading.Lock()
        self._rigs: dict[str, _Rig] = {}
        self.connected = False
        self.left_out = 0

    def hear_alive(self, name: str, *, here: bool) -> None:
        with self._lock:
            if not here and name not in self._rigs:
                return
            rig = self._rig(name)
            if rig is None:
                return
            if here and not rig.here:
                rig.heard_ns = self._monotonic_ns()  # a new monitor has time to say how the rig stands
            rig.here = here
            rig.changed_ns = self._monotonic_ns()

    def hear_status(self, name: str, status: HeardStatus) -> None:
        with self._lock:
            rig = self._rig(name)
            if rig is None:
                return
            if rig.status is not None and status.monitor.uptime_s < rig.status.monitor.uptime_s:
                _close_before(rig, status.at_ns - round(status.monitor.uptime_s * NS_PER_S))
            rig.status = status
            rig.heard_ns = self._monotonic_ns()
            rig.trail.add((pair.state for pair in status.pairs.values()), rig.heard_ns)
            for pair, said in status.pairs.items():
                if (offsets := self._offsets(rig, pair)) is not None:
                    offsets.fill(said, rig.heard_ns)

    def hear_event(self, name: str, event: HeardEvent) -> None:
        with self._lock:
            rig = self._rig(name)
            if rig is None:
                return
            before = rig.incidents.get(event.id)
            rig.incidents[event.id] = merged(before, event)
            if len(rig.incidents) > MAX_EVENTS:
                oldest = min(rig.incidents.values(), key=lambda incident: incident.since_ns)
                del rig.incidents[oldest.id]
            rig.listed = _in_order(rig)

    def hear_verdict(self, name: str, pair: str, verdict: HeardVerdict) -> None:
        with self._lock:
            rig = self._rig(name)
            if rig is not None and (offsets := self._offsets(rig, pair)) is not None:
                offsets.add(verdict, self._monotonic_ns())

    def hear_preview(self, name: str, camera: str, jpeg: bytes) -> None:
        with self._lock:
            rig = self._rig(name)
            if rig is None or (camera not in rig.previews and len(rig.previews) >= MAX_PARTS):
                return
            number = rig.previews[camera].number + 1 if camera in rig.previews else 1
            rig.previews[camera] = Preview(number, self._monotonic_ns(), jpeg)

    def rigs(self) -> tuple[RigView, ...]:
        """All rigs, by name."""
        forget_ns = self._monotonic_ns() - FORGET_AFTER_NS
        with self._lock:
            for name in [name for name, rig in self._rigs.items() if not rig.here and rig.changed_ns < forget_ns]:
                del self._rigs[name]
            return tuple(self._view(name) for name in sorted(self._rigs))

    def rig(self, name: str) -> RigView | None:
        with self._lock:
            return self._view(name) if name in self._rigs else None

    def knows(self, name: str) -> bool:
        with self._lock:
            return name in self._rigs

    def forget_previews(self, name: str) -> None:
        with self._lock:
            if name in self._rigs:
                self._rigs[name].previews.clear()

    def offsets(self, name: str, since_ns: int = 0) -> Mapping[str, tuple[Point, ...]]:
        """The offset of every pair of a rig over the last minutes; the last point may still change."""
        with self._lock:
            rig = self._rigs.get(name)
            now_ns = self._monotonic_ns()
            return {} if rig is None else {pair: o.since(since_ns, now_ns) for pair, o in rig.offsets.items()}

    def preview(self, name: str, camera: str) -> Preview | None:
        with self._lock:
            rig = self._rigs.get(name)
            return None if rig is None else rig.previews.get(camera)

    def _rig(self, name: str) -> _Rig | None:
        """The rig of that name, new if need be; the one that has been gone longest gives way to it."""
        if name not in self._rigs:
            if len(self._rigs) >= MAX_RIGS:
                gone = [(rig.changed_ns, other) for other, rig in self._rigs.items() if not rig.here]
                if not gone:
                    self.left_out += 1
                    return None
                del self._rigs[min(gone)[1]]
            self._rigs[name] = _Rig(heard_ns=self._monotonic_ns())
        return self._rigs[name]

    def _offsets(self, rig: _Rig, pair: str) -> Offsets | None:
        """The pair's, new if need be; None when there is no room."""
        if pair not in rig.offsets and len(rig.offsets) < MAX_PARTS:
            rig.offsets[pair] = Offsets()
        return rig.offsets.get(pair)

    def _view(self, name: str) -> RigView:
        rig = self._rigs[name]
        now_ns = self._monotonic_ns()
        silent_ns = now_ns - rig.heard_ns
        return RigView(
            name=name,
            presence=self._presence(rig, silent_ns),
            status=rig.status,
            silent_ns=silent_ns,
            incidents=rig.listed,
            previews={camera: preview.number for camera, preview in rig.previews.items()},
            trail=rig.trail.until(now_ns),
        )

    def _presence(self, rig: _Rig, silent_ns: int) -> Presence:
        if not self.connected:
            return Presence.UNHEARD
        if not rig.here:
            return Presence.GONE
        return Presence.STALE if silent_ns > STALE_AFTER_NS else Presence.ALIVE


def _in_order(rig: _Rig) -> tuple[Incident, ...]:
    return tuple(sorted(rig.incidents.values(), key=lambda incident: incident.since_ns))


def _close_before(rig: _Rig, started_ns: int) -> None:
    """A monitor that died says of nothing that it has ended; the next one knows nothing of it."""
    for incident in rig.listed:
        if incident.open and incident.since_ns < started_ns:
            rig.incidents[incident.id] = replace(incident, end_text="unknown: the monitor was started anew")
    rig.listed = _in_order(rig)


def merged(before: Incident | None, event: HeardEvent) -> Incident:
    """Onset and end of a condition may come in either order, and more than once."""
    ended = event.phase == "end"
    known = before or Incident(
        id=event.id,
        kind=event.kind,
        pair=event.pair,
        camera=event.camera,
        cause=event.cause,
        since_ns=event.since_ns,
        until_ns=None,
        worst=event.worst,
        text=event.text,
        end_text=None,
    )
    if not ended:
        return replace(known, text=event.text)
    return replace(known, until_ns=event.until_ns, worst=event.worst, end_text=event.text)
