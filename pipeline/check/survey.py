"""What the headers of a recording say: stamps, sequences and losses of all of it, without decoding a picture."""

from __future__ import annotations

from array import array
from bisect import bisect_left
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Protocol, TextIO, runtime_checkable

from pipeline.assemble import assemble
from pipeline.frame import NS_PER_S, Camera, Frame, Source, StampOrigin
from pipeline.health.observer import Observer
from pipeline.plan import Plan
from pipeline.run import Parts
from pipeline.steady import Steady
from pipeline.verdict import CameraStatus, Report, State, Status, Verdict

MOST_SUSPECTS = 4
"""Places that are remembered; each is looked at."""


@runtime_checkable
class Headed(Protocol):
    """What a source of recordings can do besides: tell its frames without their pictures.

    `headers` gives every frame with a plain picture in place of its own, and when it is due, in ns from the start.
    """

    @property
    def stamp_origin(self) -> StampOrigin: ...

    def headers(self) -> Iterator[tuple[Frame, int]]: ...


@dataclass(slots=True)
class Survey:
    """What the headers of a recording say.

    fps: the first camera's nominal rate in Hz. at_s: when each of its frames is due, from the start; never falls.
    suspects_s: where stamps say that cameras fall out of sync. cameras: how all did; empty where stamps are made up.
    """

    fps: float
    at_s: array[float] = field(default_factory=lambda: array("d"))
    suspects_s: list[float] = field(default_factory=list)
    cameras: Mapping[str, CameraStatus] = field(default_factory=dict)

    @property
    def frames(self) -> int:
        return len(self.at_s)

    @property
    def duration_s(self) -> float:
        return self.at_s[-1] if self.at_s else 0.0

    def frames_before(self, at_s: float) -> int:
        """How many frames the first camera has before `at_s`."""
        return bisect_left(self.at_s, at_s)

    @property
    def told(self) -> str:
        """What all the headers say of losses, in a sentence; none where stamps are made up."""
        if not self.cameras:
            return ""
        lost = [said for name, camera in self.cameras.items() if (said := _losses(name, camera))]
        return f"The headers of all {self.frames} frames were read: {'; '.join(lost) or 'no frame is lost'}."


def _losses(name: str, camera: CameraStatus) -> str:
    counts = ((camera.drops, "lost"), (camera.duplicates, "delivered twice"), (camera.restarts, "restarts"))
    said = ", ".join(f"{count} {what}" for count, what in counts if count)
    return f"{name} {said}" if said else ""


def by_length(camera: Camera, frame_count: int) -> Survey:
    """Of a recording without timestamps, nothing but its length is known."""
    return Survey(camera.fps, array("d", (index / camera.fps for index in range(frame_count))))


def by_headers(plan: Plan, source: Source, headed: Headed, console: TextIO) -> tuple[Survey, Parts]:
    """What fills the survey when it is run: everything that judges stamps and counters, nothing that needs pictures.

    source, headed: the same recording, open.
    """
    first = source.cameras[0]
    found = Survey(first.fps)
    steady: dict[str, Steady] = {}

    def take(report: Report) -> None:
        if isinstance(report, Status):
            found.cameras = report.cameras
        if not isinstance(report, Verdict):
            return
        change = steady.setdefault(report.pair, Steady()).add(report)
        if change is None or change.state is not State.ASYNC or len(found.suspects_s) >= MOST_SUSPECTS:
            return
        if change.first.frame is not None and found.at_s:
            found.suspects_s.append(found.at_s[min(change.first.frame, len(found.at_s) - 1)])

    def note(frame: Frame, at_ns: int) -> None:
        if frame.camera == first.name:
            found.at_s.append(max(at_ns / NS_PER_S, found.duration_s))

    parts = assemble(plan, _HeadersOnly(source, headed, note), console=console, on_report=take)
    detectors = {name: parts.detectors[name] for name in parts.detectors if name == "timestamp"}
    observer = Observer(source.cameras, pictures=False)
    return found, replace(parts, observer=observer, detectors=detectors, geometry=None, aligner=None)


class _HeadersOnly:
    """The headers of a source, as a source."""

    live = False

    def __init__(self, source: Source, headed: Headed, note: Callable[[Frame, int], None]) -> None:
        self._source = source
        self._headed = headed
        self._note = note

    @property
    def cameras(self) -> Sequence[Camera]:
        return self._source.cameras

    @property
    def frame_count(self) -> int | None:
        return self._source.frame_count

    @property
    def pairs(self) -> Sequence[tuple[str, str]] | None:
        told: Sequence[tuple[str, str]] | None = getattr(self._source, "pairs", None)
        return told

    def open(self) -> None:
        self._source.open()

    def frames(self) -> Iterator[Frame]:
        for frame, at_ns in self._headed.headers():
            self._note(frame, at_ns)
            yield frame

    def stop(self) -> None:
        self._source.stop()

    def close(self) -> None:
        self._source.close()
