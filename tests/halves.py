"""A live camera of a rendered rig on a clock of its own, as a user's own kind of source: one half of a rig."""

from __future__ import annotations

import threading
import time
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Literal

from pipeline.frame import NS_PER_MS, NS_PER_S, Camera, Frame, Picture
from pipeline.settings import Settings
from sources.synthetic.settings import SyntheticSettings
from sources.synthetic.source import START_NS, SyntheticSource

FPS = 20
CYCLE = 80
RENDERED: dict[tuple[str, int], Picture] = {}
STARTS: dict[str, int] = {}
TOGETHER_NS = 10 * NS_PER_S
STARTING = threading.Lock()


def _start_ns(camera: str) -> int:
    """When a half begins: with the other one, however much later a busy machine asks it to."""
    with STARTING:
        now_ns = time.monotonic_ns()
        others = [at_ns for name, at_ns in STARTS.items() if name != camera and now_ns - at_ns < TOGETHER_NS]
        if others:
            STARTS.clear()
            return others[0]
        STARTS[camera] = now_ns
        return now_ns


class HalfSettings(Settings):
    """clock_ms: what its clock is ahead; shows_ms: how much later its pictures are; stop_s: when it falls silent."""

    type: Literal["tests.halves:Half"] = "tests.halves:Half"
    camera: Literal["left", "right"]
    clock_ms: float = 0.0
    shows_ms: float = 0.0
    stop_s: float = 60.0


@dataclass
class Half:
    """Implements Source."""

    Settings = HalfSettings
    live = True
    frame_count = None
    settings: HalfSettings

    def __post_init__(self) -> None:
        self._stopped = threading.Event()
        self._rig = SyntheticSource(SyntheticSettings(width=192, height=144, fps=FPS, duration_s=60), seed=3)

    @property
    def cameras(self) -> list[Camera]:
        return [Camera(self.settings.camera, FPS)]

    def open(self) -> None:
        self._rig.open()
        for number in range(CYCLE):
            self._picture(number)

    def frames(self) -> Iterator[Frame]:
        started_ns = _start_ns(self.settings.camera)
        for number in range(round(self.settings.stop_s * FPS)):
            moment_ns = number * NS_PER_S // FPS
            if self._stopped.wait(max(0, started_ns + moment_ns - time.monotonic_ns()) / NS_PER_S):
                return
            yield Frame(
                camera=self.settings.camera,
                sequence=number,
                captured_ns=moment_ns + round(self.settings.clock_ms * NS_PER_MS),
                clock="device",
                arrived_ns=time.monotonic_ns(),
                image=self._picture(number % CYCLE),
                group=number + 7 * (self.settings.camera == "right"),
            )

    def _picture(self, number: int) -> Picture:
        """Rendered beforehand, and once for all tests: rendering is slower than a machine that tests much may be."""
        key = (self.settings.camera, START_NS + number * NS_PER_S // FPS + round(self.settings.shows_ms * NS_PER_MS))
        if key not in RENDERED:
            RENDERED[key] = self._rig.picture_at(*key)
        return RENDERED[key]

    def stop(self) -> None:
        self._stopped.set()

    def close(self) -> None:
        self._rig.close()
