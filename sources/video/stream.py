"""Keeps one stream alive: a process reads it, a thread takes its pictures, and it is opened anew when it fails."""

from __future__ import annotations

import json
import logging
import os
import select
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable
from concurrent.futures import Future

import cv2
import numpy as np

from pipeline.frame import NS_PER_S, Frame, Picture, StampOrigin
from sources.comeback import Comeback
from sources.live import ARRIVAL_CLOCK
from sources.video.place import Place
from sources.video.settings import VideoCameraSettings, VideoSettings
from sources.video.wire import FAILED, FRAME, LAYOUT, OPENED, Head, Order, read_head

log = logging.getLogger("syncwatch.sources.video")

LOOK_S = 0.1
"""How often a stream that shows nothing is asked whether it is to stop."""

DEFAULT_FPS = 30.0
"""Of a stream that does not tell its rate."""

SILENT_PERIODS = 10
GRACE_S = 3.0
"""How much longer than asked for a reader may take before it is taken for dead: it has to start and to explain."""

SHORT_S = 1.0
"""How much a recording may lack: what containers tell of their length is not exact."""


class FailedError(Exception):
    """A stream cannot be opened, or read on; why, in words."""


class OverError(Exception):
    """A recording is over."""


class Reader:
    """The process that reads a stream. Ended by `end`, from any thread."""

    def __init__(self) -> None:
        command = [sys.executable, "-m", "sources.video.reader"]
        self._process = subprocess.Popen(  # noqa: S603 - this very Python
            command,
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
            env={**os.environ, "PYTHONPATH": os.pathsep.join(sys.path), "OPENCV_FFMPEG_LOGLEVEL": "-8"},
            bufsize=0,
            start_new_session=True,  # Ctrl-C is for the program alone
        )
        assert self._process.stdin is not None
        assert self._process.stdout is not None
        self._orders, self._answers = self._process.stdin, self._process.stdout
        self._poll = select.poll()
        self._poll.register(self._answers, select.POLLIN)

    def ask(self, order: Order) -> None:
        self._tell(json.dumps(order._asdict()).encode() + b"\n")

    def go_on(self) -> None:
        self._tell(b"\n")

    def hear(self) -> Head | None:
        """The next head, None if nothing comes for a while. Raises FailedError when the process has ended."""
        return read_head(self.take(LAYOUT.size)) if self._poll.poll(LOOK_S * 1000) else None

    def take(self, size: int) -> bytearray:
        """What follows. Raises FailedError when the process has ended."""
        data = bytearray(size)
        view, at = memoryview(data), 0
        while at < size:
            count = self._answers.readinto(view[at:])  # type: ignore[attr-defined]
            if not count:
                raise FailedError(self._obituary())
            at += count
        return data

    @property
    def is_dead(self) -> bool:
        return self._process.poll() is not None

    def end(self) -> None:
        self._process.kill()

    def close(self) -> None:
        """After `end`, from the thread that uses it."""
        self.end()
        self._process.wait()
        self._orders.close()
        self._answers.close()

    def _tell(self, line: bytes) -> None:
        try:
            self._orders.write(line)
        except OSError:
            raise FailedError(self._obituary()) from None

    def _obituary(self) -> str:
        status = self._process.wait()
        return f"its reader has died ({signal.Signals(-status).name if status < 0 else f'status {status}'})"


class Stream:
    """One camera. `run` belongs to its own thread until `stopped` is set and `end` called.

    put: takes every frame. go: waited for after opening; `zero_ns`, set before it, is when recordings begin.
    first: done once it could be opened, or failed with why it could not, as FailedError. over: whether a recording has
    come to its end. epoch rises whenever it is opened anew.
    """

    def __init__(
        self,
        name: str,
        place: Place,
        camera: VideoCameraSettings,
        settings: VideoSettings,
        *,
        put: Callable[[Frame], object],
        go: threading.Event,
        stopped: threading.Event,
        clock_ns: Callable[[], int] = time.monotonic_ns,
    ) -> None:
        self.name = name
        self.place = place
        self.first: Future[None] = Future()
        self.over = False
        self.told_fps: float | None = None
        self.zero_ns = 0
        self._camera = camera
        self._settings = settings
        self._put = put
        self._go = go
        self._stopped = stopped
        self._clock_ns = clock_ns
        self._comeback = Comeback(name, log, clock_ns)
        self._reader: Reader | None = None
        self._epoch, self._epoch_has_frames = 0, False
        self._size: tuple[int, int] | None = None
        self._told_size: tuple[int, int] | None = None

    @property
    def fps(self) -> float | None:
        return self._camera.fps or self.told_fps

    def run(self) -> None:
        """Delivers frames until `stopped` or the end of a recording, whatever befalls the stream."""
        try:
            while not self._stopped.is_set():
                try:
                    self._play()
                except FailedError as error:
                    self._leave_the_dead()
                    if self._gives_up(str(error)):
                        return
        except OverError:
            return
        finally:
            if self._reader is not None:
                self._reader.close()

    def end(self) -> None:
        """Ends what `run` waits for; `stopped` is set before."""
        if self._reader is not None:
            self._reader.end()

    def _leave_the_dead(self) -> None:
        if self._reader is not None and self._reader.is_dead:
            self._reader.close()
            self._reader = None

    def _gives_up(self, why: str) -> bool:
        """Waits for the next try; whether there is none."""
        if self._stopped.is_set():
            return True
        if not self.first.done():
            self.first.set_exception(FailedError(why))
            if not self._settings.wait:
                return True
        return self._stopped.wait(self._comeback.fell(why))

    def _play(self) -> None:
        """One opening of the stream, to its end. Raises FailedError, OverError at the end of a recording."""
        if (trouble := self.place.trouble) is not None:
            raise FailedError(trouble)
        if self._reader is None:
            self._reader = Reader()
        reader = self._reader
        reader.ask(self._order())
        head = self._heard(reader, self._settings.open_within_s)
        if head.kind == FAILED:
            raise FailedError(reader.take(head.size).decode())
        assert head.kind == OPENED
        self.told_fps = head.number or None
        if not self.first.done():
            self.first.set_result(None)
        while not self._go.wait(LOOK_S):
            if self._stopped.is_set():
                return
        if self._epoch_has_frames:
            self._epoch, self._epoch_has_frames = self._epoch + 1, False
        reader.go_on()
        if self.place.is_recording or head.size:
            self._replay(reader, head.size)
        self._watch(reader)

    def _order(self) -> Order:
        options = {"rtsp_transport": "tcp", **self._camera.options}
        return Order(
            url=self.place.url,
            options="|".join(f"{key};{value}" for key, value in options.items()),
            open_within_ms=round(self._settings.open_within_s * 1000),
            silent_after_ms=round(self._silent_after_s * 1000),
            period_s=1 / self._camera.fps if self._camera.fps else 0.0,
            is_file=self.place.is_recording,
        )

    @property
    def _silent_after_s(self) -> float:
        return max(self._settings.silent_after_s, SILENT_PERIODS / (self.fps or DEFAULT_FPS))

    def _heard(self, reader: Reader, within_s: float) -> Head:
        """The next head. Raises FailedError when none comes, or `stopped`."""
        by_s = time.monotonic() + within_s + GRACE_S
        while not self._stopped.is_set() and time.monotonic() < by_s:
            head = reader.hear()
            if head is not None:
                return head
        reader.end()
        raise FailedError(f"no answer within {within_s:g} s")

    def _watch(self, reader: Reader) -> None:
        """Delivers a stream. Raises FailedError when it fails."""
        while not self._stopped.is_set():
            head = self._heard(reader, self._silent_after_s)
            data = reader.take(head.size)
            if head.kind == FAILED:
                raise FailedError(data.decode())
            assert head.kind == FRAME
            self._comeback.rose()
            self._deliver(self._picture(head, data), head.arrived_ns)

    def _replay(self, reader: Reader, told: int) -> None:
        """Delivers a recording at its own rate. Raises OverError at its end."""
        period_s = 1 / (self.fps or DEFAULT_FPS)
        first_s, due_s, count = 0.0, 0.0, 0
        while not self._stopped.is_set():
            try:
                head = self._heard(reader, self._silent_after_s)
                data = reader.take(head.size)
            except FailedError as error:
                if count and not self._stopped.is_set():  # played anew, it would begin again
                    log.warning("%s: %s ends after %d pictures (%s)", self.name, self.place.shown, count, error)
                    raise OverError from error
                raise
            if head.kind == FAILED:
                self._ends(data.decode(), count, told)
            self._comeback.rose()
            picture = self._picture(head, data)
            first_s = head.number if count == 0 else first_s
            rises = self._camera.fps is None and head.number - first_s > due_s
            due_s = head.number - first_s if rises else max(due_s, count * period_s)
            count += 1
            early_s = self.zero_ns / NS_PER_S + due_s - self._clock_ns() / NS_PER_S
            if self._stopped.wait(max(early_s, 0)):
                return
            self._deliver(picture, self._clock_ns())

    def _ends(self, why: str, count: int, told: int) -> None:
        """Ends a recording; one that lacks more than a second has failed."""
        lacks = told - count
        if lacks > SHORT_S * (self.told_fps or DEFAULT_FPS):
            log.warning("%s: %s ends after %d of %d pictures (%s)", self.name, self.place.shown, count, told, why)
        else:
            self.over = True
        raise OverError

    def _picture(self, head: Head, data: bytearray) -> Picture:
        """As it is, or brought to the size of the first one."""
        shape = (head.height, head.width, head.channels) if head.channels > 1 else (head.height, head.width)
        picture: Picture = np.frombuffer(data, np.uint8).reshape(shape)
        size = (head.width, head.height)
        self._size = self._size or size
        if size != self._size:
            if size != self._told_size:
                log.warning("%s: pictures are %dx%d now, brought to %dx%d as before", self.name, *size, *self._size)
            picture = np.asarray(cv2.resize(picture, self._size, interpolation=cv2.INTER_AREA), np.uint8)
        self._told_size = size
        return picture

    def _deliver(self, picture: Picture, arrived_ns: int) -> None:
        self._epoch_has_frames = True
        self._put(
            Frame(
                camera=self.name,
                sequence=None,
                captured_ns=arrived_ns,
                clock=ARRIVAL_CLOCK,
                arrived_ns=arrived_ns,
                image=picture,
                epoch=self._epoch,
                stamp_origin=StampOrigin.ARRIVAL,
            )
        )
