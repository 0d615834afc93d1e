"""Watches the frames on their way into windows and says of each window what is remarkable about its cameras."""

from __future__ import annotations

import threading
from collections import deque
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field
from typing import TypeAlias

from pipeline.frame import Camera, Frame, Window
from pipeline.health.camera import CameraReport
from pipeline.health.rig import RigHealth
from pipeline.notes import Note

MOST_WAITING = 256
"""Frames of a camera that may be on their way into windows; pairing holds fewer."""

SILENCE = frozenset({Note.MISSING, Note.STALLED})

Notes: TypeAlias = Mapping[str, tuple[Note, ...]]


@dataclass(frozen=True, slots=True)
class Observation:
    """What is remarkable at one window, by camera: `moment` of its frame, and the conditions that last."""

    moment: Notes = field(default_factory=dict)
    lasting: Notes = field(default_factory=dict)

    def notes(self, camera: str) -> tuple[Note, ...]:
        return (*self.moment.get(camera, ()), *self.lasting.get(camera, ()))

    def has(self, camera: str, note: Note) -> bool:
        return note in self.lasting.get(camera, ())


class Observer:
    """Feeds a rig's health in the order of windows, so that live and recorded frames are judged alike.

    `push` sees every frame the source delivers, `see` every window made of them; what pairing left out is shown to the
    camera's health before the frame that followed it. `tick` and `report` may be called from another thread.

    pictures: false where frames have none to look at.
    """

    def __init__(self, cameras: Sequence[Camera], *, pictures: bool = True) -> None:
        self._lock = threading.Lock()
        self._health = RigHealth(cameras, pictures=pictures)
        self._waiting: dict[str, deque[Frame]] = {camera.name: deque() for camera in cameras}
        self._arrived_ns: dict[str, int] = {}
        self._ended: set[str] = set()

    def push(self, frame: Frame) -> None:
        self._arrived_ns[frame.camera] = frame.arrived_ns
        waiting = self._waiting[frame.camera]
        waiting.append(frame)
        if len(waiting) > MOST_WAITING:
            with self._lock:
                self._health.see(waiting.popleft())

    def see(self, window: Window, ended: Collection[str] = ()) -> Observation:
        """Takes the next window. ended: the cameras of which a recording holds no more frames."""
        moment: dict[str, tuple[Note, ...]] = {}
        with self._lock:
            for camera, triple in window.cameras.items():
                if triple.current is not None:
                    moment[camera] = self._taken(camera, triple.current)
            lasting = self._health.lasting()
        self._ended = {
            camera
            for camera in ended
            if camera in self._waiting and (camera in self._ended or Note.MISSING not in lasting[camera])
        }
        return Observation(moment, self._without_ended(lasting))

    def tick(self, now_ns: int) -> Notes:
        """Takes the host's monotonic time, of which `arrived_ns` of live frames is; the conditions that last.

        A camera whose frames wait for those of another one is not silent.
        """
        with self._lock:
            return self._without_ended(self._health.tick(now_ns, self._arrived_ns))

    def report(self) -> Mapping[str, CameraReport]:
        with self._lock:
            return self._health.report()

    def _taken(self, camera: str, frame: Frame) -> tuple[Note, ...]:
        """The notes of the moment of a frame, and of those before it that did not get into a window."""
        notes: list[Note] = []
        waiting = self._waiting[camera]
        while any(one is frame for one in waiting):
            next_one = waiting.popleft()
            notes += self._health.take(next_one)
        return tuple(dict.fromkeys(notes))

    def _without_ended(self, lasting: Mapping[str, Sequence[Note]]) -> Notes:
        return {
            camera: tuple(note for note in notes if not (camera in self._ended and note in SILENCE))
            for camera, notes in lasting.items()
        }
