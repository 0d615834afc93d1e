"""Keeps just enough of the stream to show every detector frames t-1, t and t+1 of all cameras."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Annotated, Literal

from pydantic import Field

from pipeline.errors import InputError
from pipeline.frame import NS_PER_MS, Camera, Frame, Triple, Window
from pipeline.pairing import Counters, Pairer, Slot
from pipeline.settings import Settings


class BufferSettings(Settings):
    """How frames are paired over cameras.

    pairing_tolerance_ms: how far apart two stamps may be to be handed on together (auto: half a period).
    max_pending: how many frames of one camera wait for the others before these are given up (auto: as many as come in
                 half a second and three periods of the slowest camera, 4 to 64).
    """

    pairing_tolerance_ms: Literal["auto"] | Annotated[float, Field(gt=0, le=1e9)] = "auto"
    max_pending: Literal["auto"] | Annotated[int, Field(ge=2, le=1000)] = "auto"


def make_pairer(cameras: Sequence[Camera], settings: BufferSettings) -> Pairer:
    """A pairer as configured. Raises InputError for a tolerance that reaches beyond the next frame: above a period."""
    tolerance = settings.pairing_tolerance_ms
    max_pending = None if settings.max_pending == "auto" else settings.max_pending
    if tolerance == "auto":
        return Pairer(cameras, max_pending=max_pending)
    tolerance_ns = round(tolerance * NS_PER_MS)
    period_ns = min(camera.period_ns for camera in cameras)
    if tolerance_ns > period_ns:
        raise InputError(
            f"buffer.pairing_tolerance_ms: {tolerance:g} is more than a period ({period_ns / NS_PER_MS:g} ms): "
            "frames would be paired with others than their own"
        )
    return Pairer(cameras, tolerance_ns=tolerance_ns, max_pending=max_pending)


class WindowBuffer:
    """Frames in, windows out, one slot late.

    ::

        slots in     0   1   2   -   4        (- nothing of any camera: a gap)
        windows out      0   1   2       4
        its t-1          .   0   1       -
        its t+1          1   2   -       .    (. beyond the ends of the stream)

    Slots are moments of the rig, as frequent as its fastest camera's frames: t-1 and t+1 of a slower camera are holes
    unless it took a frame at that very moment. Its own neighbours lie further away in time than `Window.index` tells.
    """

    def __init__(self, cameras: Sequence[Camera], settings: BufferSettings) -> None:
        self._pairer = make_pairer(cameras, settings)
        self._names = tuple(camera.name for camera in cameras)
        self._nothing: Slot = dict.fromkeys(self._names)
        self._previous: Slot = self._nothing
        self._current: Slot | None = None
        self._index = -1
        self._numbers = dict.fromkeys(self._names, 0)

    @property
    def counters(self) -> Counters:
        return self._pairer.counters

    def push(self, frame: Frame) -> Iterator[Window]:
        """Takes one frame and yields the windows that it completes."""
        for slot in self._pairer.push(frame):
            yield from self._advance(slot)

    def flush(self) -> Iterator[Window]:
        """Yields the windows of the last slots: the stream has ended."""
        for slot in self._pairer.flush():
            yield from self._advance(slot)
        yield from self._advance(self._nothing)

    def _advance(self, following: Slot) -> Iterator[Window]:
        current = self._current
        if current is not None and any(frame is not None for frame in current.values()):
            self._index += 1
            yield self._window(self._previous, current, following)
        self._previous = current or self._nothing
        self._current = following

    def _window(self, previous: Slot, current: Slot, following: Slot) -> Window:
        triples = {}
        for name in self._names:
            frame = current[name]
            triples[name] = Triple(
                previous[name], frame, following[name], None if frame is None else self._numbers[name]
            )
            self._numbers[name] += frame is not None
        return Window(self._index, triples)
