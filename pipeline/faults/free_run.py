"""A camera that runs free on a clock of another rate than the rig's."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable, Iterator
from dataclasses import replace
from typing import Literal

from pydantic import Field

from pipeline.errors import InputError
from pipeline.faults.base import Fault, FaultSettings, TimedSlot
from pipeline.faults.moment import RetakableFrame, retaken, with_picture_of
from pipeline.faults.shift import MAX_FRAMES
from pipeline.frame import NS_PER_S, Camera, Frame


class FreeRunSettings(FaultSettings):
    """ppm: how fast the camera runs; positive = fast, so that each frame comes earlier. renumber: ids stay equal."""

    type: Literal["free_run"] = "free_run"
    ppm: float = Field(default=417, ge=-100_000, le=100_000)
    renumber: bool = False


class FreeRun(Fault):
    """The moment of slot n drifts away from that of the other cameras, by -ppm / (1 + ppm) of the time since the onset.

    Signature: stamps and pictures ramp; ids ramp with them, a step for every whole frame gained or lost, or stay equal
    with `renumber`. Seen in: luxonis/depthai#390 (1 frame in 80 s at 30 fps = 417 ppm), luxonis/depthai-core#960; after
    a lost trigger in realsenseai/librealsense#13881 and #11669; with equal ids in luxonis/depthai-core#440 and #559.

    Rendered pictures are those of the drifting moment. Of a recording, the picture is that of the nearest frame, as a
    free-running camera delivers it: now and then one is shown twice (fast) or left out (slow). Stamps ramp all the
    same, and so lie up to half a frame off the picture; the truth follows the picture. The slot is empty where the
    recording has no frame within a period of the drifting moment.
    Raises InputError while running when the drift grows past the frames that are kept of a recording.
    """

    def __init__(self, settings: FreeRunSettings, cameras: tuple[Camera, ...], seed: int) -> None:
        super().__init__(settings.type, settings, cameras, seed)
        self._ppm = settings.ppm
        self._renumber = settings.renumber

    def apply(self, slots: Iterable[TimedSlot]) -> Iterator[TimedSlot]:
        waiting: deque[TimedSlot] = deque()
        kept: deque[tuple[int, Frame]] = deque()
        for slot in slots:
            frame = slot.frames[self.camera.name]
            waiting.append(slot)
            if frame is not None and not isinstance(frame, RetakableFrame):
                kept.append((slot.stream_ns, frame))
            while waiting and self._moment_ns(waiting[0]) <= slot.stream_ns:
                yield self._drifted(waiting.popleft(), kept)
            self._forget(waiting[0] if waiting else slot, kept)
            self._check(slot, max(len(waiting), len(kept)))
        for slot in waiting:
            yield self._drifted(slot, kept)

    def _drift_ns(self, slot: TimedSlot) -> int:
        if not self.active(slot):
            return 0
        return round((self._start_ns - slot.stream_ns) * self._ppm / (1e6 + self._ppm))

    def _moment_ns(self, slot: TimedSlot) -> int:
        """Stream time at which the picture is taken; of a rendered one, there is no need to wait for it."""
        rendered = isinstance(slot.frames[self.camera.name], RetakableFrame)
        return slot.stream_ns + (0 if rendered else self._drift_ns(slot))

    def _drifted(self, slot: TimedSlot, kept: Iterable[tuple[int, Frame]]) -> TimedSlot:
        frame = slot.frames[self.camera.name]
        if frame is None or not self.active(slot):
            return slot
        drift_ns = self._drift_ns(slot)
        if isinstance(frame, RetakableFrame):
            shown: Frame | None = retaken(frame, drift_ns)
        else:
            donor = self._nearest(slot.stream_ns + drift_ns, kept)
            shown = None if donor is None else with_picture_of(frame, donor)
        if shown is None:
            return self.with_frame(slot, None)
        gained = 0 if self._renumber else round(drift_ns / self.camera.period_ns)
        sequence = None if frame.sequence is None else frame.sequence + gained
        return self.with_frame(slot, replace(shown, captured_ns=frame.captured_ns + drift_ns, sequence=sequence))

    def _nearest(self, moment_ns: int, kept: Iterable[tuple[int, Frame]]) -> Frame | None:
        distance_ns, frame = min(
            ((abs(stream_ns - moment_ns), frame) for stream_ns, frame in kept),
            key=lambda item: item[0],
            default=(0, None),
        )
        return frame if distance_ns <= self.camera.period_ns else None

    def _forget(self, oldest: TimedSlot, kept: deque[tuple[int, Frame]]) -> None:
        """Moments never go back, so that frames more than a period before this one will not be asked for."""
        needed_ns = oldest.stream_ns + self._drift_ns(oldest) - self.camera.period_ns
        while kept and kept[0][0] < needed_ns:
            kept.popleft()

    def _check(self, slot: TimedSlot, held: int) -> None:
        if held > MAX_FRAMES:
            raise InputError(
                f"fault free_run: ppm: {self._ppm:g} has drifted past {MAX_FRAMES} frames after "
                f"{slot.stream_ns / NS_PER_S:.0f} s, more than are kept of a recording: lower it, or set stop_s"
            )
