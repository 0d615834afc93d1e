"""What a monitor of many rigs hears, counted against what was sent."""

from __future__ import annotations

import math
import os
import platform
import time
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

from pipeline.fleet.messages import HeardEvent, HeardStatus, HeardVerdict
from pipeline.fleet.table import Fleet


class Heard(Fleet):
    """The monitor's table, which also keeps when and what it was told since `begin`."""

    def __init__(self) -> None:
        super().__init__(time.monotonic_ns)
        self.begin()

    def begin(self) -> None:
        self.statuses: list[tuple[str, int, float]] = []
        self.events: list[tuple[str, int]] = []
        self.verdicts: Counter[str] = Counter()
        self.latencies_ms: dict[str, list[float]] = {"status": [], "event": []}

    def hear_status(self, name: str, status: HeardStatus) -> None:
        self.latencies_ms["status"].append((time.time_ns() - status.at_ns) / 1e6)
        self.statuses.append((name, round(status.monitor.uptime_s), time.monotonic()))
        super().hear_status(name, status)

    def hear_event(self, name: str, event: HeardEvent) -> None:
        self.latencies_ms["event"].append((time.time_ns() - event.since_ns) / 1e6)
        self.events.append((name, int(event.id.rpartition("-")[2])))
        super().hear_event(name, event)

    def hear_verdict(self, name: str, pair: str, verdict: HeardVerdict) -> None:
        self.verdicts[name] += 1
        super().hear_verdict(name, pair, verdict)


@dataclass(frozen=True, slots=True)
class Delivery:
    """Messages of a kind: how many were sent, arrived, came twice, or behind a later one of the same rig."""

    sent: int
    arrived: int
    twice: int
    disordered: int


@dataclass(frozen=True, slots=True)
class Part:
    """What was measured in one part of the benchmark.

    latency_ms: median and 99 %, by kind. cpu: of one core, memory_mb: resident, by program. resumed_s: from the
    router's return until every rig's status had come; None where no router went away.
    """

    name: str
    statuses: Delivery
    events: Delivery
    verdicts_sent: int
    verdicts_arrived: Mapping[str, int]
    latency_ms: Mapping[str, Sequence[float]]
    cpu: Mapping[str, float]
    memory_mb: Mapping[str, float]
    resumed_s: float | None = None


@dataclass(frozen=True, slots=True)
class Watched:
    """What `watch --once --json` answered, with what status, and after how long."""

    heard: int
    status: int
    seconds: float


@dataclass(slots=True)
class Measured:
    """All of it, for the page."""

    rigs: int
    processes: int
    machine: str = field(default_factory=lambda: f"{os.cpu_count()} cores, {platform.machine()}")
    up_s: float = 0.0
    parts: list[Part] = field(default_factory=list)
    watched: Watched | None = None


def delivery(
    heard: Sequence[tuple[str, int]], before: Mapping[str, list[int]], after: Mapping[str, list[int]], kind: int
) -> Delivery:
    """Of the messages numbered `before` < number <= `after`; kind: their place in these."""
    latest: dict[str, int] = {}
    seen: set[tuple[str, int]] = set()
    twice = disordered = 0
    for rig, number in heard:
        if number <= before[rig][kind]:
            continue
        if (rig, number) in seen:
            twice += 1
            continue
        disordered += number < latest.get(rig, 0)
        latest[rig] = max(number, latest.get(rig, 0))
        seen.add((rig, number))
    return Delivery(sum(sent[kind] - before[rig][kind] for rig, sent in after.items()), len(seen), twice, disordered)


def first_after(statuses: Sequence[tuple[str, int, float]], back: float) -> float:
    """The moment after `back` at which every rig's status had come again; infinite where one's never did."""
    first: dict[str, float] = {}
    for rig, _, at in statuses:
        if at >= back:
            first.setdefault(rig, at)
    return max(first.get(rig, math.inf) for rig, _, _ in statuses)
