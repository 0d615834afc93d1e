"""The health of all cameras of a rig, and what only several cameras together can tell of one."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

from pipeline.frame import NS_PER_S, Camera, Frame
from pipeline.health.camera import CameraHealth, CameraReport
from pipeline.notes import Note

MOTION_HELD_NS = NS_PER_S // 2
"""What moved half a second ago counts as moving: cameras differ in rate, and things stop for a moment."""

FROZEN_NS = NS_PER_S
FROZEN_FRAMES = 5
"""Least time and frames without any change, while another camera shows motion, before a camera is called frozen:
an encoder that skips what has not changed delivers equal pictures for shorter times."""

HABIT = 2
"""How many times longer than ever before a camera must stand still: one that often does is not frozen for it."""


@dataclass(slots=True)
class _Place:
    """One camera.

    elapsed_ns: its frames so far, in its periods. moved_ns: the same when it last showed motion. marks: the same of
    every camera when this one was last heard. still_ns, still_frames: for how long it has not changed while another
    moved; longest_ns: the longest that ended before it was called frozen.
    """

    health: CameraHealth
    elapsed_ns: float = 0.0
    moved_ns: float | None = None
    marks: dict[str, float] = field(default_factory=dict)
    still_ns: float = 0.0
    still_frames: int = 0
    longest_ns: float = 0.0


class RigHealth:
    """Follows all cameras of a rig in constant memory. No clock and no thread of its own.

    Time is counted in the frames of the cameras, so that recordings read at any speed are judged like live ones: a
    camera is silent while another goes on. For live cameras the host's clock, given to `tick`, tells of silence, too.
    """

    def __init__(self, cameras: Sequence[Camera], *, pictures: bool = True) -> None:
        self._pictures = pictures
        self._places = {camera.name: _Place(CameraHealth(camera, pictures=pictures)) for camera in cameras}

    def see(self, frame: Frame) -> Sequence[Note]:
        """Takes a frame of any camera, in order of arrival; its notes, as `CameraHealth.see` gives them.

        Raises KeyError for a camera that the rig does not have.
        """
        return (*self.take(frame), *self._places[frame.camera].health.lasting())

    def take(self, frame: Frame) -> Sequence[Note]:
        """The same without the lasting notes."""
        place = self._places[frame.camera]
        taken = place.health.take(frame)
        if taken.new:
            place.elapsed_ns += place.health.period_ns
            self._listen(frame.camera)
            if self._pictures:
                self._judge_pictures(place)
        return taken.notes

    def tick(self, now_ns: int, arrived_ns: Mapping[str, int] | None = None) -> Mapping[str, Sequence[Note]]:
        """Takes the host's monotonic time; the lasting notes of every camera. For live cameras only.

        arrived_ns: by camera, when its latest frame came, which may not have been taken yet.
        """
        heard = arrived_ns or {}
        return {name: place.health.tick(now_ns, heard.get(name)) for name, place in self._places.items()}

    def lasting(self) -> Mapping[str, Sequence[Note]]:
        """The conditions of every camera that hold now."""
        return {name: place.health.lasting() for name, place in self._places.items()}

    def report(self) -> Mapping[str, CameraReport]:
        return {name: place.health.report() for name, place in self._places.items()}

    def _listen(self, heard: str) -> None:
        """Every other camera has been silent for as many periods as this one has completed since it was heard."""
        speaker = self._places[heard]
        for name, place in self._places.items():
            if name == heard:
                place.marks = {other: self._places[other].elapsed_ns for other in self._places}
            else:
                since_ns = speaker.elapsed_ns - place.marks.get(heard, 0.0)
                place.health.silent_for(round(since_ns - speaker.health.period_ns))

    def _judge_pictures(self, place: _Place) -> None:
        others = [other for other in self._places.values() if other is not place]
        fallen = [other.health.sight.blurred for other in others]
        place.health.scene_changed = bool(fallen) and all(fallen)
        sight = place.health.sight
        if sight.moving:
            place.moved_ns = place.elapsed_ns
        if not sight.still:
            self._end_stillness(place)
        elif any(_moves(other) for other in others) and not sight.dark:
            place.still_ns += place.health.period_ns
            place.still_frames += 1
            long = place.still_ns >= max(FROZEN_NS, HABIT * place.longest_ns)
            place.health.frozen |= long and place.still_frames >= FROZEN_FRAMES

    @staticmethod
    def _end_stillness(place: _Place) -> None:
        if not place.health.frozen:
            place.longest_ns = max(place.longest_ns, place.still_ns)
        place.still_ns, place.still_frames, place.health.frozen = 0.0, 0, False


def _moves(place: _Place) -> bool:
    """Whether a camera has shown motion of late."""
    held_ns = max(MOTION_HELD_NS, 2 * place.health.period_ns)
    return place.moved_ns is not None and place.elapsed_ns - place.moved_ns <= held_ns
