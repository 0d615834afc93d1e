"""Streams of two cameras whose pictures tell the moment they show, and faults around them."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from pipeline.assemble import KINDS
from pipeline.faults.base import Fault
from pipeline.faults.source import FaultedSource
from pipeline.frame import NS_PER_S, Camera, Frame, Picture, Truth
from tests.frames import frame

COUNT = 10


class Scripted:
    """Two cameras; the picture, stamp and id of frame n all say n. Groups, if any, count from 100."""

    live = False

    def __init__(self, *, grouped: bool = True, count: int = COUNT, fps: float = 10) -> None:
        self.cameras: Sequence[Camera] = (Camera("left", fps), Camera("right", fps))
        self.closed = False
        self.frame_count = count
        self._grouped = grouped

    @property
    def period_ns(self) -> int:
        return self.cameras[0].period_ns

    def open(self) -> None:
        pass

    def frames(self) -> Iterator[Frame]:
        for n in range(self.frame_count):
            for camera in self.cameras:
                moment_ns = round(n * NS_PER_S / camera.fps)
                group = n + 100 if self._grouped else None
                yield frame(camera.name, moment_ns, n, group=group, image=self.shown(moment_ns))

    def shown(self, moment_ns: int) -> Picture:
        return np.full((2, 2), moment_ns // self.period_ns % 256, np.uint8)

    def stop(self) -> None:
        pass

    def close(self) -> None:
        self.closed = True


class Rendered(Scripted):
    """The same, but any moment can be shown: the picture is the moment in tenths of a period."""

    def frames(self) -> Iterator[Frame]:
        for item in super().frames():
            yield replace(item, truth=Truth(item.captured_ns))

    def shown(self, moment_ns: int) -> Picture:
        return np.full((2, 2), 10 * moment_ns // self.period_ns % 256, np.uint8)

    def picture_at(self, _: str, shown_ns: int) -> Picture:
        return self.shown(shown_ns)


def faulted(*faults: dict[str, Any], source: Scripted | None = None, seed: int = 0) -> FaultedSource:
    inner = source or Scripted()
    renderer = inner if isinstance(inner, Rendered) else None

    def make(cameras: Sequence[Camera]) -> list[Fault]:
        kinds = [(KINDS.tables["faults"][fault["type"]], fault) for fault in faults]
        return [
            kind.build(kind.settings.model_validate(fault), tuple(cameras), seed, renderer) for kind, fault in kinds
        ]

    return FaultedSource(inner, make)


def delivered(*faults: dict[str, Any], camera: str | None = None, **options: Any) -> list[Frame]:
    """All frames, or those of one camera."""
    source = faulted(*faults, **options)
    source.open()
    return [item for item in source.frames() if camera in {None, item.camera}]


def seconds(count: float, *, rendered: bool = True) -> Scripted:
    """So many seconds at 30 fps."""
    return (Rendered if rendered else Scripted)(count=round(30 * count), fps=30)


def periods(time_ns: int, fps: float = 30) -> float:
    return time_ns * fps / NS_PER_S
