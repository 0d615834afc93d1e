"""OAKs made of nodes that run on this machine and send real dai.ImgFrame messages. Import only where depthai is."""

from __future__ import annotations

import threading
from collections.abc import Sequence
from dataclasses import dataclass, field
from datetime import datetime, timedelta, timezone
from typing import Any

import numpy as np

from pipeline.errors import SyncwatchError
from sources.oak.device import Built
from sources.oak.library import load

dai = load(telemetry=False)

PERIOD_US = 33_333
PICTURE = np.arange(24, dtype=np.uint8).reshape(4, 6)


@dataclass(frozen=True)
class Shot:
    """One round of a rig: what both cameras send, and what is different on the right."""

    number: int
    host_us: int = 0
    right_us: int = 0
    right: bool = True
    exposure_us: int = 8000
    ptp: bool = False
    image: np.ndarray = field(default_factory=lambda: PICTURE)


def shots(count: int, first: int = 0, **fields: Any) -> list[Shot]:
    return [Shot(number, **fields) for number in range(first, first + count)]


def message(shot: Shot, shift_us: int = 0) -> Any:
    made = dai.ImgFrame()
    height, width = shot.image.shape
    made.setType(dai.ImgFrame.Type.GRAY8)
    made.setWidth(width)
    made.setHeight(height)
    made.setData(shot.image.reshape(-1))
    made.setSequenceNum(shot.number)
    stamp_us = shot.number * PERIOD_US + shift_us
    made.setTimestampDevice(timedelta(microseconds=stamp_us))
    made.setTimestamp(timedelta(microseconds=stamp_us + shot.host_us))
    if shot.ptp:
        made.setTimestampSystem(datetime.fromtimestamp(1_790_000_000, timezone.utc) + timedelta(microseconds=stamp_us))
    made.cam.exposureTimeUs = shot.exposure_us
    return made


class HostRig(dai.node.ThreadedHostNode):
    """Sends its shots on `left` and `right`, `pace_s` apart, then goes on for ever without a word."""

    def __init__(self) -> None:
        super().__init__()
        self.left = self.createOutput()
        self.right = self.createOutput()
        self.shots: Sequence[Shot] = ()
        self.pace_s = 0.002
        self.done = threading.Event()
        self._never = threading.Event()

    def run(self) -> None:
        for shot in self.shots:
            if not self.isRunning():
                return
            self.left.send(message(shot))
            if shot.right:
                self.right.send(message(shot, shot.right_us))
            self._never.wait(self.pace_s)
        self.done.set()


class HostBuild:
    """Takes the place of build_on_device: each build gets the next script, an error or shots; the last one repeats."""

    def __init__(self, *scripts: Sequence[Shot] | SyncwatchError, pace_s: float = 0.002) -> None:
        self._scripts = list(scripts)
        self._pace_s = pace_s
        self.built: list[Built] = []
        self.rigs: list[HostRig] = []
        self.closed = 0

    def __call__(self, _: Any, wanted: Any, settings: Any) -> Built:
        script = self._scripts.pop(0) if len(self._scripts) > 1 else self._scripts[0]
        if isinstance(script, SyncwatchError):
            raise script
        pipeline = dai.Pipeline(createImplicitDevice=False)
        rig = pipeline.create(HostRig)
        rig.shots, rig.pace_s = script, self._pace_s
        outputs = dict(zip(wanted.cameras, (rig.left, rig.right), strict=False))
        built = Built(wanted.device or "host", pipeline, outputs, self._close)
        self.built.append(built)
        self.rigs.append(rig)
        return built

    def _close(self) -> None:
        self.closed += 1
