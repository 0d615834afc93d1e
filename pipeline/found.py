"""What is known of a camera of this machine before any configuration names it."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from pipeline.verdict import Message


@dataclass(frozen=True, slots=True)
class Mode:
    """A format and size that a camera delivers.

    fps: its frame rates in Hz, highest first; empty where it does not say. least: the smallest size where any up to
    `size` may be had. readable: whether this program reads the format.
    """

    format: str
    size: tuple[int, int]
    fps: tuple[float, ...] = ()
    least: tuple[int, int] | None = None
    readable: bool = True

    def to_json(self) -> Message:
        return {
            "format": self.format,
            "size": list(self.size),
            "least_size": self.least and list(self.least),
            "fps": [round(rate, 3) for rate in self.fps],
            "readable": self.readable,
        }


@dataclass(frozen=True, slots=True)
class FoundCamera:
    """One camera.

    kind: the type of the source that reads it. path: where it is now. links: names of it that stay. problem: why it
    cannot be used, in words. settings: what a configuration says of it. views: how many cameras of a rig it is.
    """

    kind: str
    path: str
    name: str
    bus: str
    serial: str | None = None
    links: tuple[str, ...] = ()
    modes: tuple[Mode, ...] = ()
    problem: str | None = None
    settings: Mapping[str, Any] = field(default_factory=dict)
    views: int = 1

    def to_json(self) -> Message:
        return {
            "kind": self.kind,
            "path": self.path,
            "name": self.name,
            "bus": self.bus,
            "serial": self.serial,
            "links": list(self.links),
            "problem": self.problem,
            "modes": [mode.to_json() for mode in self.modes],
            "settings": dict(self.settings),
        }


@dataclass(frozen=True, slots=True)
class Finder:
    """Knows the cameras of one kind.

    find: those of this machine; none where that kind cannot be had, and it raises nothing. source: a configuration's
    `source` that reads these; takes the next of the names for each camera of the rig.
    """

    find: Callable[[], Sequence[FoundCamera]]
    source: Callable[[Sequence[FoundCamera], Iterator[str]], Mapping[str, Any]]


def names_of(count: int) -> list[str]:
    """Names for so many cameras of a rig."""
    return ["left", "right"] if count == 2 else [f"cam{number}" for number in range(count)]
