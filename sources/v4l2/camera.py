"""Keeps one camera alive: reads it on a thread of its own, and opens it anew whenever it fails."""

from __future__ import annotations

import logging
import threading
from collections.abc import Callable
from dataclasses import dataclass, field

from pipeline.errors import InputError
from pipeline.frame import NS_PER_S, Frame, Picture, StampOrigin
from sources.comeback import Comeback
from sources.v4l2.capture import Capture, Shot
from sources.v4l2.device import Host, TroubleError
from sources.v4l2.nodes import Node, find, find_again
from sources.v4l2.settings import V4l2CameraSettings
from sources.v4l2.stamps import MONOTONIC

log = logging.getLogger("syncwatch.sources.v4l2")

LOOK_S = 0.1
"""How often a camera that delivers nothing looks whether it is to stop."""

STARTING_NS = 5 * NS_PER_S
"""What a camera may take until its first picture: sensors and their exposure have to settle."""

SILENT_PERIODS = 10

SAY_EVERY_NS = 10 * NS_PER_S
"""How often pictures that were left out are told of."""


@dataclass(slots=True)
class Counts:
    """What one camera has been through. skipped: pictures left out, by the reason in words."""

    frames: int = 0
    skipped: dict[str, int] = field(default_factory=dict)
    restarts: int = 0

    @property
    def text(self) -> str:
        """What was out of the ordinary; empty if nothing was."""
        parts = [f"{number} pictures left out ({reason})" for reason, number in self.skipped.items()]
        if self.restarts:
            parts.append(f"opened anew {self.restarts} times")
        return ", ".join(parts)


class LiveCamera:
    """One camera of a configuration.

    `open` and `adopt` are called from one thread before `run`, which then belongs to the camera's own thread until
    `stopped` is set. put: takes every frame. wait: sleeps for some seconds and says whether to stop.
    """

    def __init__(
        self,
        name: str,
        settings: V4l2CameraSettings,
        *,
        host: Host,
        silent_after_s: float | None,
        put: Callable[[Frame], object],
        stopped: threading.Event,
        wait: Callable[[float], bool] | None = None,
    ) -> None:
        self.name = name
        self.node: Node | None = None
        self.counts = Counts()
        self._settings = settings
        self._host = host
        self._silent_after_s = silent_after_s
        self._put = put
        self._stopped = stopped
        self._wait = wait or stopped.wait
        self._capture: Capture | None = None
        self._told: list[str] = []
        self._epoch = 0
        self._epoch_has_frames = False
        self._comeback = Comeback(name, log, host.monotonic_ns)
        self._skip_said_ns: int | None = None

    @property
    def fps(self) -> float | None:
        """The rate the driver states, else the one asked for."""
        stated = None if self._capture is None else self._capture.fps
        return stated or self._settings.fps

    def find(self) -> Node:
        """Where the camera is. Raises TroubleError where it is not."""
        device = self._settings.device
        return find(device, self._host) if self.node is None else find_again(device, self.node, self._host)

    def open(self, node: Node) -> None:
        """Opens and sets it up. Raises InputError for what it cannot do, TroubleError where it fails."""
        if node.problem is not None:
            raise TroubleError(node.problem)
        self._capture = Capture(self.name, self._settings, node.path, self._host)
        self.node = node
        changes = self._capture.changes
        for text in changes if changes != self._told else ():
            log.warning("%s: %s", self.name, text)
        self._told = changes

    def run(self) -> None:
        """Delivers frames until `stopped`, whatever befalls the camera."""
        while not self._stopped.is_set():
            try:
                if self._capture is None:
                    self.open(self.find())
                self._stream()
            except (TroubleError, InputError) as error:
                wait_s = self._comeback.fell(str(error))
                self.close()
                if self._wait(wait_s):
                    break
        self.close()

    def close(self) -> None:
        if self._capture is not None:
            capture, self._capture = self._capture, None
            capture.close()

    def _stream(self) -> None:
        """Reads one opening of the camera to its end. Raises TroubleError for any but `stopped`."""
        assert self._capture is not None
        if self._epoch_has_frames:
            self._epoch, self._epoch_has_frames = self._epoch + 1, False
            self.counts.restarts += 1
        started_ns = heard_ns = self._host.monotonic_ns()
        self._capture.start()
        first = True
        while not self._stopped.is_set():
            shot = self._capture.read(LOOK_S)
            if shot is not None and first:
                first = False
                if is_stale(shot, started_ns):
                    continue
            if shot is not None and shot.picture is not None:
                heard_ns = shot.arrived_ns
                self._deliver(shot, shot.picture, self._capture.exposure_ns)
                continue
            if shot is not None:
                self._skip(shot)
            silence_ns = self._host.monotonic_ns() - heard_ns
            if self._silent_after_s is not None and silence_ns > self._patience_ns(self._silent_after_s):
                raise TroubleError(f"no picture for {silence_ns / NS_PER_S:.1f} s")

    def _patience_ns(self, silent_after_s: float) -> int:
        usual_ns = round(max(silent_after_s, SILENT_PERIODS / (self.fps or 1)) * NS_PER_S)
        return usual_ns if self._epoch_has_frames else max(usual_ns, STARTING_NS)

    def _deliver(self, shot: Shot, picture: Picture, exposure_ns: int | None) -> None:
        self._epoch_has_frames = True
        self._comeback.rose("" if self.node is None else f" at {self.node.path}")
        self.counts.frames += 1
        made_by_driver = shot.stamp.captured_ns is not None
        self._put(
            Frame(
                camera=self.name,
                sequence=shot.sequence,
                captured_ns=shot.arrived_ns if shot.stamp.captured_ns is None else shot.stamp.captured_ns,
                clock=shot.stamp.clock,
                arrived_ns=shot.arrived_ns,
                image=picture,
                epoch=self._epoch,
                exposure_ns=exposure_ns,
                stamp_reference=shot.stamp.reference,
                stamp_origin=StampOrigin.DRIVER if made_by_driver else StampOrigin.ARRIVAL,
            )
        )

    def _skip(self, shot: Shot) -> None:
        """Counts a picture that cannot be used, and says so: the first, then how many every ten seconds."""
        reason = str(shot.damage)
        self.counts.skipped[reason] = self.counts.skipped.get(reason, 0) + 1
        if self._skip_said_ns is None or shot.arrived_ns - self._skip_said_ns >= SAY_EVERY_NS:
            self._skip_said_ns = shot.arrived_ns
            total = sum(self.counts.skipped.values())
            log.warning("%s: picture %d left out: %s (%d so far)", self.name, shot.sequence, reason, total)


def is_stale(shot: Shot, started_ns: int) -> bool:
    """Whether a first picture was taken before the camera was started: some drivers begin with the last of before."""
    captured_ns = shot.stamp.captured_ns
    return captured_ns is not None and shot.stamp.clock == MONOTONIC and captured_ns < started_ns
