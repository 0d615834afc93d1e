"""What tests in the virtual machine share: its cameras, and a run that is watched while it goes on."""

from __future__ import annotations

import json
import logging
import os
import shutil
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from itertools import pairwise
from pathlib import Path
from typing import Any

import pytest
import yaml

from pipeline.assemble import KINDS, assemble, build_source
from pipeline.configtext.document import load_text
from pipeline.frame import NS_PER_S, Frame, Source, StampReference
from pipeline.plan import make_plan
from pipeline.run import Run
from pipeline.verdict import Event, Report, Status, Verdict
from sources.v4l2.controls import set_controls
from sources.v4l2.device import KernelDevice

LEFT, RIGHT = "/dev/video0", "/dev/video2"
RESULTS = Path(__file__).resolve().parent.parent.parent / "build/guest/results"

WAIT_S = 60
"""For anything to happen: an emulated machine on a busy one may stand still for seconds."""

QUIET_S = 5
LATE_IN_A_ROW = 12

FPS = 10
PERIOD_NS = NS_PER_S // FPS
SILENT_NS = 2 * PERIOD_NS + NS_PER_S // 2
"""Silence after which a camera is missing: the next picture would then be three periods late."""

GREY_SMALL = {"size": [320, 180], "format": "GREY", "fps": FPS, "buffers": 8}
"""What an emulated machine delivers and judges with time to spare."""


def control(device: str, **values: bool | int | str) -> None:
    """Sets controls of a camera, which may be streaming meanwhile."""
    handle = KernelDevice(Path(device))
    try:
        set_controls(handle, values)
    finally:
        handle.close()


def unplug_and_replug(between: Callable[[], object] = lambda: None) -> None:
    """Takes both virtual cameras away from the system and gives them back."""
    driver = Path("/sys/bus/platform/drivers/vivid")
    (driver / "unbind").write_text("vivid.0")
    between()
    (driver / "bind").write_text("vivid.0")


def configuration(*, left: str = LEFT, right: str = RIGHT, detectors: dict | None = None, **source: Any) -> dict:
    """A rig of two virtual cameras."""
    cameras = {"left": {"device": left, **GREY_SMALL}, "right": {"device": right, **GREY_SMALL}}
    return {
        "rig": "bench",
        "source": {"type": "v4l2", "cameras": cameras, **source},
        "detectors": detectors or {"timestamp": {}},
    }


@dataclass(frozen=True)
class Seen:
    """A frame without its picture."""

    camera: str
    sequence: int
    captured_ns: int
    arrived_ns: int
    epoch: int
    clock: str
    reference: StampReference
    shape: tuple[int, ...]


class Noting:
    """A source that notes what another one delivers."""

    def __init__(self, source: Source, seen: list[Seen]) -> None:
        self._source = source
        self._seen = seen

    def __getattr__(self, name: str) -> Any:
        return getattr(self._source, name)

    def frames(self) -> Iterator[Frame]:
        for frame in self._source.frames():
            self._seen.append(
                Seen(
                    frame.camera,
                    frame.sequence,
                    frame.captured_ns,
                    frame.arrived_ns,
                    frame.epoch,
                    frame.clock,
                    frame.stamp_reference,
                    frame.image.shape,
                )
            )
            yield frame


@dataclass
class Watched:
    """A run that is going on: what its cameras delivered, what it said, and what it logged."""

    seen: list[Seen] = field(default_factory=list)
    told: list[tuple[Report, int]] = field(default_factory=list)
    log: list[str] = field(default_factory=list)

    def of(self, camera: str, epoch: int | None = None) -> list[Seen]:
        return [one for one in list(self.seen) if one.camera == camera and epoch in {None, one.epoch}]

    @property
    def reports(self) -> list[Report]:
        return [report for report, _ in list(self.told)]

    def told_ns(self, report: Report) -> int:
        """When something was said, on the clock of frames' arrivals."""
        return next(at_ns for one, at_ns in self.told if one is report)

    @property
    def verdicts(self) -> list[Verdict]:
        return [report for report in self.reports if isinstance(report, Verdict)]

    @property
    def events(self) -> list[Event]:
        return [report for report in self.reports if isinstance(report, Event)]

    @property
    def status(self) -> Status | None:
        return next((report for report in reversed(self.reports) if isinstance(report, Status)), None)

    def missing(self, camera: str, phase: str) -> list[Event]:
        """Events that a camera is missing."""
        causes = ((one.phase, one.cause and one.cause.value, one.camera) for one in self.events)
        return [one for one, said in zip(self.events, causes, strict=False) if said == (phase, "missing", camera)]

    def until(self, happened: Callable[[], Any]) -> Any:
        """Waits for something, and returns it."""
        deadline = time.monotonic() + WAIT_S
        while not (result := happened()):
            if time.monotonic() > deadline:
                said = "\n".join([*self.log, *(event.text for event in self.events)])
                pytest.fail(f"did not happen within {WAIT_S} s; {len(self.seen)} frames\n{said}")
            time.sleep(0.05)
        return result

    def until_frames(self, camera: str, count: int, epoch: int | None = None) -> list[Seen]:
        """The first frames of a camera, in that epoch."""
        return self.until(lambda: len(self.of(camera, epoch)) >= count and self.of(camera, epoch)[:count])

    def begun(self, kind: str, camera: str) -> list[Event]:
        """Events of a camera that have begun."""
        return [one for one in self.events if (one.kind, one.camera, one.phase) == (kind, camera, "onset")]

    def wrongly_missing(self, camera: str) -> list[Event]:
        """Events that a camera is missing though its pictures came; none where this machine could not take them."""
        if self.status and any(camera.overwritten for camera in self.status.cameras.values()):
            return []
        arrived_ns = [one.arrived_ns for one in self.of(camera)]
        silences = [(begin, end) for begin, end in pairwise(arrived_ns) if end - begin > SILENT_NS]
        told = [(event, self.told_ns(event)) for event in self.missing(camera, "onset")]
        return [event for event, at in told if not any(begin < at < end + NS_PER_S for begin, end in silences)]


@contextmanager
def watched(config: dict) -> Iterator[Watched]:
    """Runs a configuration as `syncwatch run` does, without sinks, until the block is left."""
    seen = Watched()
    handler = logging.Handler()
    handler.emit = lambda record: seen.log.append(record.getMessage())
    log = logging.getLogger("syncwatch")
    log.addHandler(handler)
    plan = make_plan(load_text(yaml.safe_dump(config), "guest", {}, []), KINDS, Path.cwd())
    source = build_source(plan, wrap=lambda made: Noting(made, seen.seen))
    failures: list[BaseException] = []
    try:
        source.open()
        run = Run(
            assemble(
                plan,
                source,
                console=sys.stderr,
                on_report=lambda report: seen.told.append((report, time.monotonic_ns())),
            )
        )

        def work() -> None:
            try:
                run.execute()
            except BaseException as error:  # noqa: BLE001 - told in the test's thread
                failures.append(error)

        thread = threading.Thread(target=work, daemon=True)
        thread.start()
        try:
            yield seen
        finally:
            run.stop()
            thread.join(WAIT_S)
    finally:
        log.removeHandler(handler)
    assert not thread.is_alive(), "it did not stop"
    if failures:
        raise failures[0]


@dataclass
class Program:
    """`syncwatch run` as a process of its own, which writes its verdicts to a file."""

    process: subprocess.Popen[str]
    file: Path

    def lines(self) -> list[dict[str, Any]]:
        """The verdicts so far; of the last line, perhaps only a part is there."""
        whole = self.file.read_text().rpartition("\n")[0] if self.file.exists() else ""
        return [json.loads(line) for line in whole.splitlines()]

    def until(self, happened: Callable[[list[dict[str, Any]]], Any], within_s: float = WAIT_S) -> Any:
        """Waits for something that the verdicts tell, and returns it."""
        deadline = time.monotonic() + within_s
        while not (result := happened(self.lines())):
            if self.process.poll() is not None or time.monotonic() > deadline:
                self.process.kill()
                last = [json.dumps(line) for line in self.lines()[-3:]]
                pytest.fail("\n".join([f"did not happen within {within_s} s", *self.process.communicate(), *last]))
            time.sleep(0.5)
        return result

    def until_quiet(self) -> None:
        """Waits until no frame is left to be judged."""
        judged, before = self.judged(), []
        while len(judged) > len(before):
            time.sleep(QUIET_S)
            judged, before = self.judged(), judged

    def judged(self) -> list[dict[str, Any]]:
        """The verdicts on frames; the others tell of silence."""
        return [line for line in self.lines() if line["frame"] is not None]

    def memory_kb(self) -> int:
        status = Path(f"/proc/{self.process.pid}/status").read_text()
        return int(next(line.split()[1] for line in status.splitlines() if line.startswith("VmRSS")))

    def terminate(self) -> tuple[str, str]:
        """Sends SIGTERM; what it printed and what it logged."""
        self.process.send_signal(signal.SIGTERM)
        output, log = self.process.communicate(timeout=WAIT_S)
        assert self.process.returncode == 143, log
        return output, log


@contextmanager
def running(config: dict, folder: Path) -> Iterator[Program]:
    """Runs a configuration as users do."""
    file = folder / "verdicts.jsonl"
    text = yaml.safe_dump({**config, "sinks": {"console": {}, "jsonl": {"path": str(file)}}})
    (folder / "config.yaml").write_text(text)
    command = [sys.executable, "-m", "syncwatch", "run", "config.yaml"]
    pipes = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE, "text": True}
    root = Path(__file__).resolve().parent.parent.parent
    with subprocess.Popen(command, cwd=folder, env={**os.environ, "PYTHONPATH": str(root)}, **pipes) as process:
        try:
            yield Program(process, file)
        finally:
            process.kill()
            if file.exists():
                shutil.copy(file, RESULTS / f"{folder.name}.jsonl")


def gaps_agree(stamps: list[tuple[int, int]], period_ns: int) -> None:
    """Asserts of counters with their stamps that what is missing by one is missing by the other.

    A virtual camera whose thread gets no processor stamps a few frames late, and counts the periods that it slept
    through. Were a frame lost that is not counted, or counted that was not lost, all after it would be a period off.
    """
    first, first_ns = stamps[0]
    late_ns = [stamp_ns - first_ns - (number - first) * period_ns for number, stamp_ns in stamps]
    least = [min(late_ns[place : place + LATE_IN_A_ROW]) for place in range(max(1, len(late_ns) - LATE_IN_A_ROW + 1))]
    assert all(after > before for (before, _), (after, _) in pairwise(stamps))
    off = [place for place, each in enumerate(least) if abs(each - least[0]) > period_ns / 2]
    assert not off, f"from frame {off[0]} of {len(stamps)} on, by {(least[off[0]] - least[0]) / period_ns:.2f} periods"
