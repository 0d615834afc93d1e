"""Rolls the verdicts of a rig up into one status, for lamps and other services."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from types import MappingProxyType

from pipeline.frame import NS_PER_S, Rig, Window
from pipeline.health.camera import CameraReport
from pipeline.memory import resident_bytes
from pipeline.notes import Note
from pipeline.pairing import Counters
from pipeline.quantiles import LastMinute
from pipeline.steady import CONFIRM, Steady
from pipeline.verdict import CameraStatus, Level, Pace, PairStatus, SinkStatus, State, Status, Verdict
from pipeline.words import describe

STALE_NS = 5 * NS_PER_S
STALE_PERIODS = 5
"""Without a window for this long and this many periods, what was said last is not the state of the rig any more."""


@dataclass(slots=True)
class _PairState:
    since_ns: int
    steady: Steady
    shown: Verdict | None = None
    alarm: Verdict | None = None
    verdicts: int = 0
    decided: int = 0
    latest: Verdict | None = None
    skew: LastMinute = field(default_factory=LastMinute)


class StatusKeeper:
    """Follows windows and verdicts; `status` says how things stand.

    wall_ns: the time of day in nanoseconds since 1970. monotonic_ns: the host's clock that never steps, by which
    frames arrive.
    """

    def __init__(
        self,
        rig: Rig,
        *,
        unknown_is: Level,
        version: str,
        wall_ns: Callable[[], int],
        monotonic_ns: Callable[[], int],
        confirm: int = CONFIRM,
    ) -> None:
        self._rig = rig
        self._unknown_is = unknown_is
        self._version = version
        self._wall_ns = wall_ns
        self._monotonic_ns = monotonic_ns
        self._started_ns = self._heard_ns = monotonic_ns()
        self._stale_ns = max(STALE_NS, STALE_PERIODS * max(camera.period_ns for camera in rig.cameras))
        self._pairs = {pair.name: _PairState(wall_ns(), Steady(confirm)) for pair in rig.pairs}
        self._latency = LastMinute()

    def hear(self) -> None:
        """Takes note that a window has come."""
        self._heard_ns = self._monotonic_ns()

    def judged(self, window: Window) -> None:
        """Takes note that the verdicts of a window are there: its latency counts from its last frame's arrival."""
        now_ns = self._monotonic_ns()
        arrived = [triple.current.arrived_ns for triple in window.cameras.values() if triple.current is not None]
        self._latency.add(max(0, now_ns - max(arrived)), now_ns)

    def add(self, verdict: Verdict) -> bool:
        """Takes note of a verdict; says whether the pair's lasting state, or its cause, has changed with it."""
        pair = self._pairs[verdict.pair]
        pair.latest = verdict
        pair.verdicts += 1
        if verdict.state is not State.UNKNOWN:
            pair.decided += 1
            if verdict.offset_ns is not None:
                pair.skew.add(abs(verdict.offset_ns), self._monotonic_ns())
        change = pair.steady.add(verdict, self._wall_ns())
        if change is not None:
            pair.since_ns = change.since_ns
        other_cause = pair.shown is not None and pair.shown.cause is not verdict.cause
        if verdict.state is pair.steady.state:
            pair.shown = verdict
            if verdict.state is not State.UNKNOWN:
                pair.alarm = verdict if verdict.state is State.ASYNC else None
            return change is not None or other_cause
        return change is not None

    def status(
        self,
        counters: Counters,
        health: Mapping[str, CameraReport],
        warnings: Sequence[str] = (),
        dropped_windows: int = 0,
        overwritten: Mapping[str, int] = MappingProxyType({}),
        sinks: Mapping[str, SinkStatus] = MappingProxyType({}),
    ) -> Status:
        """The rig as it stands now. warnings: what is amiss without a pair being out of sync."""
        level, reasons = self._level(warnings)
        now_ns = self._monotonic_ns()
        return Status(
            rig=self._rig.name,
            at_ns=self._wall_ns(),
            level=level,
            reasons=reasons,
            pairs={name: _pair_status(pair, now_ns) for name, pair in self._pairs.items()},
            cameras={
                name: _camera_status(name, health[name], counters, overwritten.get(name, 0))
                for name in (camera.name for camera in self._rig.cameras)
            },
            version=self._version,
            uptime_s=(now_ns - self._started_ns) / NS_PER_S,
            dropped_windows=dropped_windows,
            latency_p99_ns=self._latency.quantile(0.99, now_ns),
            memory_bytes=resident_bytes(),
            sinks=sinks,
        )

    def _level(self, warnings: Sequence[str]) -> tuple[Level, tuple[str, ...]]:
        silent_ns = self._monotonic_ns() - self._heard_ns
        if silent_ns > self._stale_ns:
            return Level.STALE, (f"no frames for {silent_ns / NS_PER_S:.0f} s",)
        wrong = [pair for pair in self._pairs.values() if pair.alarm is not None]
        if wrong:
            return Level.ERROR, tuple(_complaint(pair) for pair in wrong)
        if warnings:
            return Level.WARN, tuple(warnings)
        unsure = [v for v in self._shown() if v.state is State.UNKNOWN]
        if unsure and self._unknown_is is not Level.OK:
            return self._unknown_is, tuple(
                f"{v.pair}: cannot tell ({v.reason.value if v.reason else ''})" for v in unsure
            )
        return Level.OK, ()

    def _shown(self) -> list[Verdict]:
        return [pair.shown for pair in self._pairs.values() if pair.shown is not None]


def _complaint(pair: _PairState) -> str:
    """What is wrong with a pair; being unable to tell does not put it right."""
    assert pair.alarm is not None
    cause = f" ({pair.alarm.cause.value})" if pair.alarm.cause else ""
    since = "; cannot tell any more" if pair.steady.state is State.UNKNOWN else ""
    return f"{pair.alarm.pair}: {describe(pair.alarm)}{cause}{since}"


def _pair_status(pair: _PairState, now_ns: int) -> PairStatus:
    shown = pair.shown
    return PairStatus(
        state=shown.state if shown else State.UNKNOWN,
        cause=shown.cause if shown else None,
        since_ns=pair.since_ns,
        offset_ns=shown.offset_ns if shown else None,
        sigma_ns=shown.sigma_ns if shown else None,
        coverage=pair.decided / pair.verdicts if pair.verdicts else 0.0,
        drift=pair.latest.drift if pair.latest else Pace(),
        skew_p50_ns=pair.skew.quantile(0.5, now_ns),
        skew_p99_ns=pair.skew.quantile(0.99, now_ns),
    )


def _camera_status(name: str, health: CameraReport, counters: Counters, overwritten: int) -> CameraStatus:
    return CameraStatus(
        fps=health.fps,
        expected_fps=health.expected_fps,
        frames=counters.frames[name],
        drops=health.drops,
        overwritten=overwritten,
        unpaired=counters.holes[name],
        duplicates=health.duplicates,
        restarts=health.restarts,
        jitter_p50_ns=health.jitter_p50_ns,
        jitter_p99_ns=health.jitter_p99_ns,
        conditions=tuple(note.value for note in health.notes),
        stalls=health.stalls,
        frozen=Note.FROZEN in health.notes,
        clock=health.clock,
        epoch=health.epoch,
    )
