"""Publishes as many rigs, each through a sink and a session of its own; benchmarks.fleet starts a few of these.

    python -m benchmarks.fleet_rigs ENDPOINT PREFIX FIRST COUNT

Says `up` once all are there. For each line `SECONDS VERDICT_HZ` on standard input it publishes for so long, or until
an empty line, and answers with a line of JSON: how many statuses, events and verdicts each rig has sent in all.
"""

from __future__ import annotations

import json
import queue
import sched
import sys
import threading
import time
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace

from pipeline.frame import NS_PER_MS
from pipeline.rig_status import CameraStatus, PairStatus, Status
from pipeline.verdict import Basis, Cause, Event, Evidence, Level, Report, State, Verdict
from sinks.zenoh import ZenohSettings, ZenohSink

STATUS_HZ = 1.0
EVENT_HZ = 0.2
PAIR = "left-right"
AT_ONCE = 25
"""Sinks that are started or stopped side by side: each waits a while to see that nobody else publishes its rig."""


@dataclass(slots=True)
class SimulatedRig:
    """What one rig has said; statuses (in `uptime_s`) and events (in `id`) are numbered from 1, to miss none."""

    name: str
    sink: ZenohSink
    statuses: int = 0
    events: int = 0
    verdicts: int = 0

    def status(self) -> Report:
        self.statuses += 1
        pair = PairStatus(State.SYNC, None, time.time_ns(), 120_000, 240_000, 0.98, skew_p50_ns=90_000)
        camera = CameraStatus(30.0, 30.0, 30 * self.statuses, 0, jitter_p50_ns=20_000, jitter_p99_ns=90_000)
        cameras = {"left": camera, "right": replace(camera, drops=1)}
        number, latency_ns = float(self.statuses), 40 * NS_PER_MS
        return Status(self.name, time.time_ns(), Level.OK, (), {PAIR: pair}, cameras, "0", number, 0, latency_ns)

    def event(self) -> Report:
        self.events += 1
        number, text = f"{self.name}-{self.events}", "right is 33.3 ms later than left since frame 57"
        worst = {"offset_ms": 33.3}
        now_ns = time.time_ns()
        return Event(self.name, number, "async", "onset", PAIR, "right", Cause.SLIP, now_ns, None, worst, text)

    def verdict(self) -> Report:
        self.verdicts += 1
        said = Evidence(PAIR, "offset", Basis.CONTENT, State.SYNC, "both move alike", offset_frames=0.0, motion_px=4.2)
        number = self.verdicts
        return Verdict(self.name, PAIR, number, State.SYNC, Basis.CONTENT, content=said, evidence=(said,))


def publish(rigs: Sequence[SimulatedRig], for_s: float, verdict_hz: float, enough: threading.Event) -> None:
    """Every rig has its own moment within a period, as rigs that know nothing of each other do."""
    timetable = sched.scheduler()
    begun_s = time.monotonic()

    def take(rig: SimulatedRig, report: Callable[[SimulatedRig], Report]) -> None:
        rig.sink.take(report(rig))

    for report, hz in (
        (SimulatedRig.status, STATUS_HZ),
        (SimulatedRig.event, EVENT_HZ),
        (SimulatedRig.verdict, verdict_hz),
    ):
        for turn in range(round(for_s * hz)):
            for place, rig in enumerate(rigs):
                timetable.enterabs(begun_s + (turn + place / len(rigs)) / hz, 0, take, (rig, report))
    while not timetable.empty() and not enough.is_set():
        enough.wait(timetable.run(blocking=False) or 0.0)


def read(orders: queue.SimpleQueue[str], enough: threading.Event) -> None:
    """Hands on the lines of standard input, and nothing at its end; an empty line ends what was ordered before."""
    for line in sys.stdin:
        if line.strip():
            enough.clear()
            orders.put(line)
        else:
            enough.set()
    orders.put("")


def main() -> None:
    endpoint, prefix = sys.argv[1:3]
    first, count = map(int, sys.argv[3:5])
    settings = ZenohSettings(mode="client", connect=(endpoint,), prefix=prefix, required=True)
    names = [f"rig{number:03d}" for number in range(first, first + count)]
    rigs = [SimulatedRig(name, ZenohSink(settings, rig=name)) for name in names]
    with ThreadPoolExecutor(AT_ONCE) as pool:
        list(pool.map(lambda rig: rig.sink.start(), rigs))
        print("up", flush=True)
        orders: queue.SimpleQueue[str] = queue.SimpleQueue()
        enough = threading.Event()
        threading.Thread(target=read, args=(orders, enough), daemon=True).start()
        while line := orders.get():
            for_s, verdict_hz = map(float, line.split())
            publish(rigs, for_s, verdict_hz, enough)
            print(json.dumps({rig.name: [rig.statuses, rig.events, rig.verdicts] for rig in rigs}), flush=True)
        list(pool.map(lambda rig: rig.sink.stop(), rigs))


if __name__ == "__main__":
    main()
