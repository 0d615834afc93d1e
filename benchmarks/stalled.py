"""Prints what a subscriber that never reads costs: latency of verdicts with one and without, by turns in one run.

    python -m benchmarks.stalled

A rendered rig of 320 x 240 at 15 fps with the default detectors publishes verdicts, statuses and previews. The
subscriber is another process that is stopped (SIGSTOP) once it is connected, so that its link fills up.
"""

from __future__ import annotations

import signal
import statistics
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager

from benchmarks.loopback import free_endpoint
from pipeline.deadline import leave
from sources.synthetic.settings import SyntheticSettings
from sources.synthetic.source import SyntheticSource
from syncwatch import Frame, Monitor, Status, Verdict

FPS, SECONDS, TURNS = 15, 8, 3
PREFIX = "bench/stalled"
SUBSCRIBER = """
import json, sys, time, zenoh
config = zenoh.Config()
for key, value in {"mode": "client", "connect/endpoints": [sys.argv[1]], "scouting/multicast/enabled": False}.items():
    config.insert_json5(key, json.dumps(value))
for _ in range(100):
    try:
        session = zenoh.open(config)
        break
    except zenoh.ZError:
        time.sleep(0.1)
heard = session.declare_subscriber(sys.argv[2])
while heard.try_recv() is None:
    time.sleep(0.05)
print("heard", flush=True)
time.sleep(3600)
"""


def main() -> None:
    rendered = SyntheticSource(SyntheticSettings(width=320, height=240, fps=FPS, duration_s=SECONDS), seed=0)
    rendered.open()
    frames = list(rendered.frames())
    told: dict[bool, list[Status]] = {False: [], True: []}
    print(f"latency from a frame's arrival to its verdict, p99 over {SECONDS} s at {FPS} fps")
    for _ in range(TURNS):
        for stalled in (False, True):
            status, verdicts = _measured(frames, stalled=stalled)
            told[stalled].append(status)
            print(
                f"  {'stalled' if stalled else 'nobody':8} {_latency_ms(status):6.1f} ms, {verdicts} verdicts, "
                f"{status.dropped_windows} windows dropped, sink lost {_lost(status)}"
            )
    without, with_one = (statistics.median(map(_latency_ms, told[stalled])) for stalled in (False, True))
    ratio = with_one / without
    print(f"median p99 with a stalled subscriber {with_one:.1f} ms, without {without:.1f} ms: ratio {ratio:.2f}")


def _measured(frames: list[Frame], *, stalled: bool) -> tuple[Status, int]:
    """The last status of a run at real speed, and how many verdicts it had."""
    endpoint = free_endpoint()
    zenoh = {"listen": [endpoint], "prefix": PREFIX, "preview": {"every_s": 0.1, "width": 320}}
    statuses: list[Status] = []
    verdicts: list[Verdict] = []
    config = {"source": {"type": "push"}, "detectors": {"timestamp": {}, "offset": {}}, "sinks": {"zenoh": zenoh}}
    cameras = {"left": FPS, "right": FPS}
    with _subscriber(endpoint, stalled=stalled):
        with Monitor(config, cameras, on_verdict=verdicts.append, on_status=statuses.append) as monitor:
            began = time.monotonic()
            for number, frame in enumerate(frames):
                time.sleep(max(0.0, began + number // 2 / FPS - time.monotonic()))
                monitor.push(frame.camera, frame.image, captured_ns=frame.captured_ns, sequence=frame.sequence)
        return statuses[-1], len(verdicts)


@contextmanager
def _subscriber(endpoint: str, *, stalled: bool) -> Iterator[None]:
    """One that stops for good as soon as it has heard something."""
    if not stalled:
        yield
        return
    command = [sys.executable, "-c", SUBSCRIBER, endpoint, f"{PREFIX}/**"]
    with subprocess.Popen(command, stdout=subprocess.PIPE) as process:  # noqa: S603
        assert process.stdout is not None
        stopper = _Stopper(process)
        try:
            yield
        finally:
            process.kill()
            stopper.check()


class _Stopper:
    """Stops the subscriber once it says that it has heard something."""

    def __init__(self, process: subprocess.Popen[bytes]) -> None:
        self._process = process
        self._stopped = False
        threading.Thread(target=self._stop, daemon=True).start()

    def _stop(self) -> None:
        assert self._process.stdout is not None
        if self._process.stdout.readline():
            self._process.send_signal(signal.SIGSTOP)
            self._stopped = True

    def check(self) -> None:
        if not self._stopped:
            print("  (the subscriber never connected: this turn says nothing)")


def _latency_ms(status: Status) -> float:
    return (status.latency_p99_ns or 0) / 1e6


def _lost(status: Status) -> str:
    lost = status.sinks["zenoh"]
    return f"{lost.dropped_reports} reports and {lost.dropped_frames} frames"


if __name__ == "__main__":
    main()
    leave(0)  # sessions that a stalled subscriber keeps from closing go on in the background
