"""A source of pictures that are read by URL: streams of network cameras, and files played as if they were live."""

from __future__ import annotations

import logging
import threading
import time
from collections.abc import Callable, Collection, Iterator, Mapping
from concurrent.futures import TimeoutError as NotYetError
from functools import partial
from pathlib import Path

from pipeline.errors import InputError
from pipeline.frame import Camera, Frame
from sources.live import Inbox, feed
from sources.video.place import place_of
from sources.video.settings import VideoSettings
from sources.video.stream import DEFAULT_FPS, GRACE_S, FailedError, Stream

log = logging.getLogger("syncwatch.sources.video")

STOP_WITHIN_S = 0.5


class VideoSource:
    """Implements Source; always `live`. It ends when every camera is a recording that has come to its end.

    Stamps are those of arrival: they pair, and prove nothing. A stream has a process that reads it and a thread; one
    that ends, fails or falls silent is opened anew, with a new epoch. Recordings (files, and URLs that tell their
    length) begin together and are played once, at their own rate. base: the folder that relative paths count from.
    """

    live = True
    frame_count = None

    def __init__(self, settings: VideoSettings, *, base: Path, clock_ns: Callable[[], int] = time.monotonic_ns) -> None:
        self._settings = settings
        self._clock_ns = clock_ns
        self._inbox: Inbox[Frame] = Inbox(settings.cameras, frames_ahead=settings.frames_ahead)
        self._go, self._stopped = threading.Event(), threading.Event()
        self._streams = [
            Stream(
                name,
                place_of(camera.url.get_secret_value(), base),
                camera,
                settings,
                put=self._inbox.put,
                go=self._go,
                stopped=self._stopped,
                clock_ns=clock_ns,
            )
            for name, camera in settings.cameras.items()
        ]
        self._threads: list[threading.Thread] = []
        self._left = len(self._streams)
        self._lock = threading.Lock()
        self.cameras: tuple[Camera, ...] = ()

    @property
    def dropped(self) -> Mapping[str, int]:
        return self._inbox.dropped

    @property
    def ended(self) -> Collection[str]:
        return {stream.name for stream in self._streams if stream.over}

    def open(self) -> None:
        """Opens every stream, all at the same time; with `wait`, those that are there."""
        self._threads = [
            feed(self._inbox, partial(self._run, stream), name=f"video-{stream.name}") for stream in self._streams
        ]
        by_s = time.monotonic() + self._settings.open_within_s + 2 * GRACE_S
        try:
            for stream in self._streams:
                self._await(stream, by_s)
        except BaseException:
            self.close()
            raise
        self.cameras = tuple(Camera(stream.name, self._fps(stream)) for stream in self._streams)

    def frames(self) -> Iterator[Frame]:
        for stream in self._streams:
            stream.zero_ns = self._clock_ns()
        self._go.set()
        yield from self._inbox.read()

    def stop(self) -> None:
        self._stopped.set()
        for stream in self._streams:
            stream.end()
        self._inbox.stop()

    def close(self) -> None:
        self.stop()
        by_s = time.monotonic() + STOP_WITHIN_S
        for thread in self._threads:
            thread.join(max(by_s - time.monotonic(), 0))
        self._inbox.say_what_was_dropped()

    def _run(self, stream: Stream) -> None:
        """The thread of one stream."""
        stream.run()
        with self._lock:
            self._left -= 1
            if self._left == 0:
                self._inbox.end()

    def _await(self, stream: Stream, by_s: float) -> None:
        try:
            stream.first.result(max(by_s - time.monotonic(), 0))
        except (FailedError, NotYetError) as error:
            why = str(error) or f"no answer within {self._settings.open_within_s:g} s"
            if not self._settings.wait:
                raise InputError(
                    f"source.cameras.{stream.name}.url: {stream.place.shown}: {why} (wait: true waits for it)"
                ) from error
            log.warning("%s: %s: not there yet: waiting for it", stream.name, stream.place.shown)

    @staticmethod
    def _fps(stream: Stream) -> float:
        if stream.fps is None:
            log.warning("%s: frame rate unknown: %g is assumed; set fps", stream.name, DEFAULT_FPS)
        return stream.fps or DEFAULT_FPS
