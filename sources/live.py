"""What sources of live pictures share: names and rates in their settings, and the inbox their frames wait in."""

from __future__ import annotations

import logging
import threading
from collections import deque
from collections.abc import Callable, Iterable, Iterator, Mapping
from typing import Annotated, Generic, Protocol, TypeVar

from pydantic import Field

log = logging.getLogger("syncwatch.sources")

CameraName = Annotated[str, Field(pattern="^[a-z0-9_]+$")]
Fps = Annotated[float, Field(ge=0.001, le=10_000)]
FramesAhead = Annotated[int, Field(ge=1, le=1000)]

ARRIVAL_CLOCK = "monotonic"
"""Clock of stamps that are those of arrival: CLOCK_MONOTONIC of this machine; drivers' stamps may be of it, too."""

FRAMES_AHEAD = 16
"""Frames of a camera that may wait: half a second at 30 fps, which is as long as pairing waits for a camera."""


class Delivered(Protocol):
    @property
    def camera(self) -> str: ...


Item = TypeVar("Item", bound=Delivered)


class Inbox(Generic[Item]):
    """Frames of live cameras, or what is to become frames, on their way to a reader: many putters, one reader.

    `put` never waits: when `frames_ahead` frames of a camera are waiting, its oldest gives way, whole, and is counted
    in `dropped`, so that a camera that floods costs no other camera a frame.
    """

    def __init__(self, cameras: Iterable[str], *, frames_ahead: int = FRAMES_AHEAD) -> None:
        self._frames_ahead = frames_ahead
        self._waiting: deque[Item] = deque()
        self._changed = threading.Condition()
        self._ended = False
        self._error: Exception | None = None
        self._held = dict.fromkeys(cameras, 0)
        self._dropped = dict.fromkeys(self._held, 0)

    @property
    def dropped(self) -> Mapping[str, int]:
        """Frames that gave way, by camera."""
        return dict(self._dropped)

    def put(self, item: Item) -> bool:
        """Adds a frame; whether it was accepted: after the end none is."""
        with self._changed:
            if self._ended:
                return False
            if self._held[item.camera] >= self._frames_ahead:
                self._drop_oldest(item.camera)
            self._waiting.append(item)
            self._held[item.camera] += 1
            self._changed.notify_all()
            return True

    def read(self) -> Iterator[Item]:
        """Frames in order of arrival, until the end. Raises what `end` was given, after the last of them."""
        while True:
            with self._changed:
                while not self._waiting and not self._ended:
                    self._changed.wait()
                if not self._waiting:
                    if self._error is not None:
                        raise self._error
                    return
                item = self._waiting.popleft()
                self._held[item.camera] -= 1
            yield item

    def end(self, error: Exception | None = None) -> None:
        """No more frames will come; those that wait are still read. The first end counts."""
        with self._changed:
            if not self._ended:
                self._ended, self._error = True, error
            self._changed.notify_all()

    def stop(self) -> None:
        """Ends at once, without an error; what waits is given up."""
        with self._changed:
            self._ended, self._error = True, None
            self._waiting.clear()
            self._held = dict.fromkeys(self._held, 0)
            self._changed.notify_all()

    def say_what_was_dropped(self) -> None:
        for camera, count in self._dropped.items():
            if count:
                log.warning("%s: frames were not taken fast enough: %d dropped", camera, count)

    def _drop_oldest(self, camera: str) -> None:
        place = next(index for index, waiting in enumerate(self._waiting) if waiting.camera == camera)
        del self._waiting[place]
        self._held[camera] -= 1
        self._dropped[camera] += 1


def feed(inbox: Inbox[Item], work: Callable[[], None], name: str) -> threading.Thread:
    """Starts a thread that fills the inbox until it is told to end; should it fail, the reader gets its exception."""

    def run() -> None:
        try:
            work()
        except Exception as error:
            inbox.end(error)

    thread = threading.Thread(target=run, name=name, daemon=True)
    thread.start()
    return thread
