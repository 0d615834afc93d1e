"""Publishes as hundreds of rigs through two routers to one monitor, and writes what arrives into docs/fleet.md.

    python -m benchmarks.fleet [--rigs 300] [--processes 4] [--seconds 20] [--no-page]

All of it runs on this machine, over loopback, and ends by itself after a few minutes. The rigs publish through the
sink `zenoh`, the routers read examples/fleet, the monitor is what `watch` and `dashboard` listen with.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import IO

import numpy as np

from benchmarks import fleet_page
from benchmarks.fleet_heard import Heard, Measured, Part, Watched, delivery, first_after
from benchmarks.fleet_rigs import EVENT_HZ
from benchmarks.loopback import free_endpoint
from pipeline.fleet.listener import FleetListener
from sinks.zenoh import ZenohSettings

ROOT = Path(__file__).resolve().parent.parent
DOCUMENT = ROOT / "docs" / "fleet.md"
EXAMPLES = ROOT / "examples"
PREFIX = "benchmark/hall"

VERDICT_HZ = 10.0
SETTLE_S = 2.0
OUTAGE_AFTER_S, OUTAGE_S, AFTERWARDS_S = 3.0, 3.0, 14.0
WAIT_S, CLOSE_S = 90.0, 20.0
MOST_SECONDS = 50.0
"""Less than for how long somebody is taken to look at a rig."""

TICKS_HZ = os.sysconf("SC_CLK_TCK")


class Router:
    """examples/router.py with a configuration of examples/fleet, on a free port of this machine."""

    def __init__(self, name: str, upstream: str | None = None) -> None:
        self.name = name
        self.endpoint = free_endpoint()
        config = str(EXAMPLES / "fleet" / f"{name}-router.json5")
        self._command = [sys.executable, str(EXAMPLES / "router.py"), "--config", config, "--listen", self.endpoint]
        if upstream:
            self._command += ["--connect", upstream]
        self.process = self._start()

    def _start(self) -> subprocess.Popen[str]:
        process = subprocess.Popen(self._command, stdout=subprocess.PIPE, text=True)
        assert process.stdout is not None
        if not process.stdout.readline():
            raise SystemExit(f"the {self.name} router does not start")
        return process

    def kill(self) -> None:
        self.process.kill()
        self.process.communicate()

    def restart(self) -> None:
        self.process = self._start()


class Publishers:
    """The processes that publish."""

    def __init__(self, endpoint: str, rigs: int, processes: int) -> None:
        self._running: list[subprocess.Popen[str]] = []
        self.sent: dict[str, list[int]] = {}
        for number in range(processes):
            first, last = rigs * number // processes, rigs * (number + 1) // processes
            command = [sys.executable, "-m", "benchmarks.fleet_rigs", endpoint, PREFIX, str(first), str(last - first)]
            pipe = subprocess.PIPE
            self._running.append(subprocess.Popen(command, cwd=ROOT, stdin=pipe, stdout=pipe, text=True))
        for process in self._running:
            if _lines(process).readline().strip() != "up":
                raise SystemExit("a process of rigs does not start")

    def begin(self, for_s: float, verdict_hz: float) -> None:
        self._say(f"{for_s} {verdict_hz}\n")

    def cut_short(self) -> None:
        self._say("\n")

    def _say(self, line: str) -> None:
        for process in self._running:
            assert process.stdin is not None
            process.stdin.write(line)
            process.stdin.flush()

    def end(self) -> Mapping[str, list[int]]:
        """Waits until all is sent: how many statuses, events and verdicts each rig has sent so far."""
        for process in self._running:
            self.sent.update(json.loads(_lines(process).readline()))
        return dict(self.sent)

    def close(self) -> None:
        for process in self._running:
            try:
                process.communicate(timeout=CLOSE_S)
            except subprocess.TimeoutExpired:
                process.kill()
                process.communicate()


class Bench:
    """Routers, rigs and a monitor that are up, and the parts that are measured with them."""

    def __init__(self, measured: Measured, opened: ExitStack) -> None:
        self.measured = measured
        self._routers = [Router("regional")]
        opened.callback(self._routers[0].kill)
        self._routers.append(Router("site", self._routers[0].endpoint))
        opened.callback(self._routers[1].kill)
        self._listener = FleetListener(ZenohSettings(mode="client", connect=(self.regional.endpoint,), prefix=PREFIX))
        self._heard = self._listener.fleet = Heard()
        opened.enter_context(self._listener)
        begun = time.monotonic()
        self._publishers = Publishers(self.site.endpoint, measured.rigs, measured.processes)
        opened.callback(self._publishers.close)
        _wait(lambda: len(self._heard.rigs()) == measured.rigs, "all rigs")
        measured.up_s = time.monotonic() - begun

    @property
    def regional(self) -> Router:
        return self._routers[0]

    @property
    def site(self) -> Router:
        return self._routers[1]

    def steady(self, name: str, for_s: float, *, verdict_hz: float = 0.0, look: bool = False) -> None:
        """look: as if a dashboard's page were open for every rig, so that their verdicts are asked for."""
        if look:
            for rig in self._heard.rigs():
                self._listener.look_at(rig.name)
            time.sleep(SETTLE_S)
        with self._part(name, for_s, verdict_hz):
            pass

    def restart(self, router: Router) -> None:
        """The router is killed, and comes back OUTAGE_S later."""
        for_s = OUTAGE_AFTER_S + OUTAGE_S + AFTERWARDS_S
        with self._part(f"the {router.name} router is killed, and back after {OUTAGE_S:.0f} s", for_s) as back:
            time.sleep(OUTAGE_AFTER_S)
            router.kill()
            time.sleep(OUTAGE_S)
            router.restart()
            back.append(time.monotonic())

    def watch(self, verdict_hz: float = 0.0) -> None:
        """`watch --once --json` comes, answers and goes."""
        with self._part("the same, while `watch --once` comes and goes", WAIT_S, verdict_hz):
            begun = time.monotonic()
            command = [sys.executable, "-m", "syncwatch", "watch", PREFIX, "--connect", self.regional.endpoint]
            done = subprocess.run(
                [*command, "--once", "--json"], cwd=ROOT, capture_output=True, text=True, timeout=WAIT_S, check=False
            )
            seconds = time.monotonic() - begun
            self._publishers.cut_short()
        rigs = json.loads(done.stdout)["rigs"].values()
        self.measured.watched = Watched(sum(rig["ok"] for rig in rigs), done.returncode, seconds)

    @contextmanager
    def _part(self, name: str, for_s: float, verdict_hz: float = 0.0) -> Iterator[list[float]]:
        """Publishes for so long; yields a list for the moment at which a router was back."""
        before = self._sent()
        self._heard.begin()
        back: list[float] = []
        cpu, begun = self._cpu(), time.monotonic()
        self._publishers.begin(for_s, verdict_hz)
        yield back
        after = self._publishers.end()
        time.sleep(SETTLE_S)
        seconds = time.monotonic() - begun
        heard = self._heard
        statuses = [(rig, number) for rig, number, _ in heard.statuses]
        part = Part(
            name,
            delivery(statuses, before, after, 0),
            delivery(heard.events, before, after, 1),
            sum(sent[2] - before[rig][2] for rig, sent in after.items()),
            dict(heard.verdicts),
            {kind: [float(np.percentile(values, q)) for q in (50, 99)] for kind, values in heard.latencies_ms.items()},
            {} if back else {key: (used - cpu[key]) / seconds for key, used in self._cpu().items()},
            {router.name: _memory_mb(router.process.pid) for router in self._routers},
            first_after(heard.statuses, back[0]) - back[0] if back else None,
        )
        self.measured.parts.append(part)
        print(f"{name}: {len(heard.statuses)} statuses, {len(heard.events)} events", file=sys.stderr, flush=True)

    def _sent(self) -> Mapping[str, list[int]]:
        nothing = {f"rig{number:03d}": [0, 0, 0] for number in range(self.measured.rigs)}
        return nothing | {rig: list(sent) for rig, sent in self._publishers.sent.items()}

    def _cpu(self) -> dict[str, float]:
        """CPU seconds so far."""
        used = {router.name: _cpu_s(router.process.pid) for router in self._routers}
        return {**used, "monitor": time.process_time()}


def _lines(process: subprocess.Popen[str]) -> IO[str]:
    assert process.stdout is not None
    return process.stdout


def _cpu_s(pid: int) -> float:
    fields = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) / TICKS_HZ


def _memory_mb(pid: int) -> float:
    pages = int(Path(f"/proc/{pid}/statm").read_text().split()[1])
    return pages * os.sysconf("SC_PAGE_SIZE") / 1e6


def _wait(condition: Callable[[], bool], what: str) -> None:
    deadline = time.monotonic() + WAIT_S
    while not condition():
        if time.monotonic() > deadline:
            raise SystemExit(f"waited {WAIT_S:.0f} s for {what} in vain")
        time.sleep(0.1)


def measure(measured: Measured, for_s: float) -> Measured:
    with ExitStack() as opened:
        bench = Bench(measured, opened)
        bench.steady(f"statuses, and an event a rig every {1 / EVENT_HZ:.0f} s", for_s)
        bench.watch()
        unseen = f"the same, and {VERDICT_HZ:.0f} verdicts/s a rig that nobody looks at"
        bench.steady(unseen, for_s, verdict_hz=VERDICT_HZ)
        bench.steady("the same, looked at, thinned by the site router", for_s, verdict_hz=VERDICT_HZ, look=True)
        bench.restart(bench.site)
        bench.restart(bench.regional)
    return measured


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--rigs", type=int, choices=range(1, 1001), default=300, metavar="N", help="1 to 1000")
    parser.add_argument("--processes", type=int, choices=range(1, 17), default=4, metavar="N", help="1 to 16")
    parser.add_argument("--seconds", type=float, default=20.0, help="of each part without an outage")
    parser.add_argument("--no-page", action="store_true", help="print, and leave docs/fleet.md as it is")
    given = parser.parse_args()
    measured = measure(Measured(given.rigs, min(given.processes, given.rigs)), min(given.seconds, MOST_SECONDS))
    written = fleet_page.section(measured)
    print(written)
    if not given.no_page:
        DOCUMENT.write_text(fleet_page.put_in(DOCUMENT.read_text(encoding="utf-8"), written), encoding="utf-8")


if __name__ == "__main__":
    main()
