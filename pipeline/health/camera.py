"""One camera's health: what is remarkable about each frame, and how things stand."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

from pipeline.frame import NS_PER_S, Camera, Frame, StampOrigin
from pipeline.health.cadence import Cadence
from pipeline.health.counter import FrameCounter
from pipeline.health.sight import Sight, reduced
from pipeline.notes import Note

OVERDUE_PERIODS = 3
"""Silence after which frames are overdue (stalled): two lost in a row are drops."""

MISSING_NS = NS_PER_S // 2
"""Silence beyond that after which a camera is missing: hosts and buses pause for tenths of a second, not for half."""

JITTER_PERIODS = 0.1
"""Scatter of intervals, in periods, from which stamps are called noisy: the widest tolerance of synchronization, which
two stamps of such noise would miss every third time."""

OUT_OF_ORDER_FRAMES = 16
"""A frame that is older by id and stamp alike, but not by more, was overtaken; else the device has started anew."""

SURE_SIGMAS = 4
"""Standard errors of noise allowed for where a gap in ids is compared with a gap in time."""


@dataclass(frozen=True, slots=True)
class CameraReport:
    """How one camera has done so far.

    fps: one over the period, which lost frames do not change; None before 16 frames or where stamps are synthesised.
    drops_by_sequence, drops_by_time: frames lost with and without a gap in ids. duplicates: frames delivered twice.
    out_of_order: frames older than the one before. counter_resets: wraps and sets. restarts: of device or clock.
    jitter_p50_ns, jitter_p99_ns: how far intervals are off the period, over the last thousand.
    sharpness_ratio: against what is usual for the camera. stalls: silences of more than three periods. clock, epoch:
    of the last frame. notes: the lasting conditions that hold now.
    """

    camera: str
    fps: float | None
    expected_fps: float
    frames: int
    drops_by_sequence: int
    drops_by_time: int
    duplicates: int
    duplicate_timestamps: int
    backward_timestamps: int
    out_of_order: int
    counter_resets: int
    restarts: int
    jitter_p50_ns: int | None
    jitter_p99_ns: int | None
    sharpness_ratio: float | None
    stalls: int
    clock: str | None
    epoch: int | None
    notes: tuple[Note, ...]

    @property
    def drops(self) -> int:
        return self.drops_by_sequence + self.drops_by_time

    @property
    def rate_error(self) -> float | None:
        """Relative difference of the frame rate to what is expected: -0.5 is half of it."""
        return None if self.fps is None else self.fps / self.expected_fps - 1


class Taken(NamedTuple):
    """new: neither a frame delivered twice nor one out of order. notes: those of the moment."""

    new: bool
    notes: tuple[Note, ...]


@dataclass(slots=True)
class _Counts:
    frames: int = 0
    drops_by_sequence: int = 0
    drops_by_time: int = 0
    duplicates: int = 0
    duplicate_timestamps: int = 0
    backward_timestamps: int = 0
    out_of_order: int = 0
    counter_resets: int = 0
    restarts: int = 0
    stalls: int = 0


class CameraHealth:
    """Follows one camera in constant memory. No clock and no thread of its own.

    Whether the camera is frozen takes the other cameras: `RigHealth` sets `frozen`, and `scene_changed` where a fall of
    sharpness is shared by them.
    """

    def __init__(self, camera: Camera, *, pictures: bool = True) -> None:
        self._camera = camera
        self._pictures = pictures
        self._counts = _Counts()
        self._counter = FrameCounter()
        self._cadence = Cadence()
        self._last: Frame | None = None
        self._heard_ns: int | None = None
        self._silence: Note | None = None
        self._stamps_count = True
        self.sight = Sight(camera.period_ns)
        self.frozen = False
        self.scene_changed = False

    @property
    def period_ns(self) -> float:
        """As measured, else nominal."""
        return self._cadence.period_ns or self._camera.period_ns

    def see(self, frame: Frame) -> Sequence[Note]:
        """Takes the next frame in order of arrival; the notes of this frame, then the lasting ones that hold.

        Frames lost without a gap in ids are noted one to eight frames late, once jitter is ruled out.
        """
        return (*self.take(frame).notes, *self.lasting())

    def take(self, frame: Frame) -> Taken:
        """The same without the lasting notes."""
        self._counts.frames += 1
        self._heard_ns, self._silence = frame.arrived_ns, None
        self._stamps_count = frame.stamp_origin is not StampOrigin.SYNTHESISED
        notes: list[Note] = []
        new = self._admit(frame, notes)
        return Taken(new, tuple(notes))

    def tick(self, now_ns: int, arrived_ns: int | None = None) -> Sequence[Note]:
        """Takes the host's monotonic time, of which `arrived_ns` is; the lasting notes that hold.

        Silence counts from the last frame, before the first one from the first tick. arrived_ns: when the latest frame
        came, if it has not been taken yet.
        """
        if self._heard_ns is None:
            self._heard_ns = now_ns
        if arrived_ns is not None and arrived_ns > self._heard_ns:
            self._heard_ns, self._silence = arrived_ns, None
        self.silent_for(now_ns - self._heard_ns)
        return self.lasting()

    def silent_for(self, silence_ns: int) -> None:
        """Says how long the camera has been silent on any clock; only frames end a silence.

        A period of it is no fault: missing is told before three periods and half a second are over for the next frame.
        """
        overdue_ns = round(OVERDUE_PERIODS * self.period_ns)
        self._counts.stalls += self._silence is None and silence_ns > overdue_ns
        if silence_ns > overdue_ns + MISSING_NS - round(self.period_ns):
            self._silence = Note.MISSING
        elif silence_ns > overdue_ns and self._silence is None:
            self._silence = Note.STALLED

    def lasting(self) -> tuple[Note, ...]:
        """The conditions that hold now."""
        if self._silence is Note.MISSING:
            return (Note.MISSING,)
        holds = {
            Note.JITTER: self._stamps_count and self._noisy(),
            Note.FROZEN: self.frozen,
            Note.DARK: self.sight.dark,
            Note.SATURATED: self.sight.saturated,
            Note.BLURRED: self.sight.blurred and not self.scene_changed,
            Note.STALLED: self._silence is Note.STALLED,
        }
        return tuple(note for note, held in holds.items() if held)

    def report(self) -> CameraReport:
        counts, period_ns = self._counts, self._cadence.period_ns
        return CameraReport(
            camera=self._camera.name,
            fps=NS_PER_S / period_ns if period_ns else None,
            expected_fps=self._camera.fps,
            frames=counts.frames,
            drops_by_sequence=counts.drops_by_sequence,
            drops_by_time=counts.drops_by_time,
            duplicates=counts.duplicates,
            duplicate_timestamps=counts.duplicate_timestamps,
            backward_timestamps=counts.backward_timestamps,
            out_of_order=counts.out_of_order,
            counter_resets=counts.counter_resets,
            restarts=counts.restarts,
            jitter_p50_ns=self._cadence.jitter_ns(50),
            jitter_p99_ns=self._cadence.jitter_ns(99),
            sharpness_ratio=self.sight.sharpness_ratio,
            stalls=counts.stalls,
            clock=self._last.clock if self._last else None,
            epoch=self._last.epoch if self._last else None,
            notes=self.lasting(),
        )

    def _admit(self, frame: Frame, notes: list[Note]) -> bool:
        """Whether the frame is a new one; adds to the notes of the moment."""
        small = reduced(frame.image) if self._pictures else None
        last = self._last
        if last is not None and frame.epoch < last.epoch:
            self._counts.out_of_order += 1
            return False
        if last is not None and frame.epoch > last.epoch:
            self._counts.restarts += 1
            notes.append(Note.RESTARTED)
            self._counter.restart()
            self._cadence.restart()
            last = None
        if last is not None:
            if self._repeats(last, frame) and (small is None or self.sight.same_as_last(small)):
                self._counts.duplicates += 1
                notes.append(Note.DUPLICATE_FRAME)
                return False
            if self._overtaken(last, frame):
                self._counts.out_of_order += 1
                self._counts.backward_timestamps += 1
                notes.append(Note.BACKWARD_TIMESTAMP)
                return False
        self._follow(last, frame, notes)
        if small is not None:
            self.sight.see(small)
        self._last = frame
        return True

    def _repeats(self, last: Frame, frame: Frame) -> bool:
        """Whether id and stamp allow the frame to be the last one again, perhaps under a new stamp."""
        if frame.sequence != last.sequence:
            return False
        return frame.captured_ns == last.captured_ns or (frame.sequence is not None and self._counter.moves)

    def _overtaken(self, last: Frame, frame: Frame) -> bool:
        step, interval_ns = self._counter.step(frame.sequence), frame.captured_ns - last.captured_ns
        if step is None or step >= 0 or interval_ns >= 0 or not self._stamps_count:
            return False
        return -step <= OUT_OF_ORDER_FRAMES and -interval_ns <= (OUT_OF_ORDER_FRAMES + 1) * self.period_ns

    def _follow(self, last: Frame | None, frame: Frame, notes: list[Note]) -> None:
        """Counter and stamps of a new frame."""
        interval_ns = frame.captured_ns - last.captured_ns if last is not None and self._stamps_count else None
        period_ns = self._cadence.period_ns
        advance = self._counter.advance(
            frame.sequence,
            nominal_periods=None if interval_ns is None else interval_ns / self._camera.period_ns,
            periods=None if interval_ns is None or not period_ns else interval_ns / period_ns,
            slack=SURE_SIGMAS * math.sqrt(2) * self._cadence.sigma_ns / period_ns if period_ns else 0.5,
        )
        lost_by_time = 0
        if interval_ns is None and self._stamps_count:
            self._cadence.see(frame.captured_ns, 1)
        elif interval_ns is not None:
            lost_by_time = self._cadence.see(frame.captured_ns, advance.frames)
            if interval_ns <= 0:
                again = interval_ns == 0
                notes.append(Note.DUPLICATE_TIMESTAMP if again else Note.BACKWARD_TIMESTAMP)
                self._counts.duplicate_timestamps += again
                self._counts.backward_timestamps += not again
        if advance.reset:
            self._counts.counter_resets += 1
            notes.append(Note.COUNTER_RESET)
        self._counts.drops_by_sequence += advance.frames - 1
        self._counts.drops_by_time += lost_by_time
        if advance.frames > 1 or lost_by_time:
            notes.append(Note.DROP)

    def _noisy(self) -> bool:
        period_ns = self._cadence.period_ns
        return period_ns is not None and math.sqrt(2) * self._cadence.sigma_ns > JITTER_PERIODS * period_ns
