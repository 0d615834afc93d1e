"""Decides which frames of a rig's cameras belong to the same slot; whether they were taken together is judged later."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from itertools import pairwise
from statistics import median
from typing import TypeAlias

from pipeline.frame import NS_PER_S, Camera, Frame

Slot: TypeAlias = dict[str, Frame | None]
"""One frame of every camera, None for a hole. A slot of holes only marks a gap in time."""

LEARNING_FRAMES = 8
"""Frames a camera must show before its clock is compared with another's: enough for a median to ignore a bad stamp."""

SAME_EPOCH_NS = 2 * NS_PER_S
"""Stamps of one clock further apart than this cannot be of one epoch: arrival says how they relate."""

FOLLOWING = 1 / 64
"""Share of each difference by which the offset of another clock follows its drift: two seconds at 30 fps, so that
jitter averages out and even 1000 ppm stay far below half a period."""


@dataclass(slots=True)
class Counters:
    """What pairing had to throw away or do without, by camera."""

    frames: dict[str, int] = field(default_factory=dict)
    late: dict[str, int] = field(default_factory=dict)
    duplicates: dict[str, int] = field(default_factory=dict)
    holes: dict[str, int] = field(default_factory=dict)


@dataclass(slots=True)
class _Lane:
    """One camera's frames that are not in a slot yet, in order of their key."""

    pending: deque[tuple[int, Frame]] = field(default_factory=deque)
    held: list[Frame] = field(default_factory=list)
    offset_ns: float = 0.0
    other_clock: bool = False
    floor: int | None = None
    last: tuple[int, int | None] | None = None
    epoch: int | None = None
    heard: bool = False
    absent: bool = False


class Pairer:
    """Turns frames of N cameras, in any interleaving, into slots: one to one, in order, with bounded memory.

    Frames are compared by a key: their `group` if every camera has one; else `captured_ns` less the camera's clock
    offset; else, when stamps do not rise, `arrived_ns`. The offset is learned from the first frames: for cameras that
    share a clock it is then kept, so that one that runs away shows; for another clock it follows the drift.
    The earliest frame that is waiting opens a slot; every other camera adds its earliest one if that lies within the
    tolerance, unless it lies in the outer half of it and the opening camera's next frame is nearer. A camera that
    delivers nothing while another piles up `max_pending` frames is not waited for until it is heard again.

    tolerance_ns: None means half the shortest period of the cameras.
    """

    def __init__(self, cameras: Sequence[Camera], *, tolerance_ns: int | None = None, max_pending: int = 16) -> None:
        self._cameras = tuple(camera.name for camera in cameras)
        self._period_ns = min(camera.period_ns for camera in cameras)
        self._tolerance_ns = self._period_ns // 2 if tolerance_ns is None else tolerance_ns
        self._max_pending = max_pending
        self._lanes = {name: _Lane() for name in self._cameras}
        self._key: Callable[[Frame], int] | None = None
        self._tolerance = 0
        self._step = 1.0
        self._last_key: int | None = None
        self._gap_due = False
        zero = dict.fromkeys(self._cameras, 0)
        self.counters = Counters(dict(zero), dict(zero), dict(zero), dict(zero))

    def push(self, frame: Frame) -> Iterator[Slot]:
        """Takes one frame and yields the slots that are decided by it."""
        lane = self._lanes[frame.camera]
        self.counters.frames[frame.camera] += 1
        if lane.epoch is not None and frame.epoch < lane.epoch:
            self.counters.late[frame.camera] += 1
            return
        if lane.epoch is not None and frame.epoch > lane.epoch and lane.heard:
            yield from self.flush()
            self._restart()
        lane.epoch, lane.heard, lane.absent = frame.epoch, True, False
        if self._key is None:
            lane.held.append(frame)
            if not self._learned_enough():
                return
            self._learn()
        else:
            self._enqueue(frame)
        yield from self._decided(final=False)

    def flush(self) -> Iterator[Slot]:
        """Yields what is left: no more frames will come (or none that compare with these)."""
        if self._key is None:
            self._learn()
        yield from self._decided(final=True)

    def _restart(self) -> None:
        """Forgets what was learned; cameras that restart together do so once."""
        for lane in self._lanes.values():
            lane.floor = lane.last = None
            lane.heard = False
        self._key = None
        if self._last_key is not None:
            self._last_key = None
            self._gap_due = True

    def _learned_enough(self) -> bool:
        lanes = self._lanes.values()
        if any(len(lane.held) >= self._max_pending for lane in lanes):
            return True
        if all(lane.held for lane in lanes) and self._grouped():
            return True
        return all(len(lane.held) >= LEARNING_FRAMES for lane in lanes)

    def _grouped(self) -> bool:
        return all(frame.group is not None for lane in self._lanes.values() for frame in lane.held)

    def _learn(self) -> None:
        """Chooses the key by the frames held so far and lets them in."""
        held = {name: lane.held for name, lane in self._lanes.items() if lane.held}
        if self._grouped():
            self._key = _group
            self._tolerance, self._step = 0, 1.0
        else:
            self._tolerance, self._step = self._tolerance_ns, self._period_ns
            if all(_rising([frame.captured_ns for frame in frames]) for frames in held.values()):
                self._key = self._aligned_stamp
                reference = next(iter(held.values()), [])
                for name, frames in held.items():
                    self._lanes[name].other_clock = frames[0].clock != reference[0].clock
                    self._lanes[name].offset_ns = _clock_offset_ns(reference, frames, self._period_ns)
            else:
                self._key = _arrival
        for frames in held.values():
            for frame in frames:
                self._enqueue(frame)
            frames.clear()

    def _aligned_stamp(self, frame: Frame) -> int:
        return frame.captured_ns - round(self._lanes[frame.camera].offset_ns)

    def _enqueue(self, frame: Frame) -> None:
        assert self._key is not None
        lane = self._lanes[frame.camera]
        key = self._key(frame) if self._key is not _group or frame.group is not None else None
        identity = (key, frame.sequence)
        if key is None or (lane.floor is not None and key <= lane.floor):
            repeated = identity == lane.last
            (self.counters.duplicates if repeated else self.counters.late)[frame.camera] += 1
            return
        if any(
            key == other and (self._tolerance == 0 or frame.sequence == seen.sequence) for other, seen in lane.pending
        ):
            self.counters.duplicates[frame.camera] += 1
            return
        lane.pending.append((key, frame))
        if len(lane.pending) > 1 and lane.pending[-2][0] > key:
            lane.pending = deque(sorted(lane.pending, key=lambda item: item[0]))

    def _decided(self, *, final: bool) -> Iterator[Slot]:
        while True:
            waiting = [name for name in self._cameras if self._lanes[name].pending]
            if not waiting:
                return
            opener = min(waiting, key=lambda name: self._lanes[name].pending[0][0])
            forced = final or any(len(self._lanes[name].pending) > self._max_pending for name in waiting)
            silent = [name for name in self._cameras if not self._lanes[name].pending and not self._lanes[name].absent]
            if silent and not forced:
                return
            if silent and not final:
                for name in silent:
                    self._lanes[name].absent = True
            partners = self._partners(opener, forced=forced)
            if partners is None:
                return
            yield from self._emit(opener, partners)

    def _partners(self, opener: str, *, forced: bool) -> list[str] | None:
        """The cameras whose earliest frame joins the opener's; None while only a later frame can tell."""
        pending = self._lanes[opener].pending
        start = pending[0][0]
        partners = []
        for name in self._cameras:
            lane = self._lanes[name]
            if name == opener or not lane.pending:
                continue
            distance = lane.pending[0][0] - start
            if distance > self._tolerance:
                continue
            if 2 * distance > self._tolerance:
                if len(pending) < 2 and not forced:
                    return None
                if len(pending) >= 2 and abs(pending[1][0] - lane.pending[0][0]) < distance:
                    continue
            partners.append(name)
        return partners

    def _emit(self, opener: str, partners: list[str]) -> Iterator[Slot]:
        start = self._lanes[opener].pending[0][0]
        skipped = self._last_key is not None and start - self._last_key > 1.5 * self._step
        if skipped or self._gap_due:
            self._gap_due = False
            yield dict.fromkeys(self._cameras)
        slot: Slot = {}
        keys: dict[str, int] = {}
        for name in self._cameras:
            lane = self._lanes[name]
            if name == opener or name in partners:
                key, frame = lane.pending.popleft()
                lane.last, lane.floor = (key, frame.sequence), key
                if self._tolerance and lane.pending and lane.pending[0][0] == key:
                    lane.floor = key - 1
                slot[name] = frame
                keys[name] = key
            else:
                slot[name] = None
                self.counters.holes[name] += 1
                if not lane.pending:
                    lane.floor = max(start + self._tolerance, lane.floor or start)
        self._last_key = start
        self._follow_clocks(keys)
        yield slot

    def _follow_clocks(self, keys: dict[str, int]) -> None:
        """Lets the offsets of other clocks follow what was just paired."""
        reference = next((key for name, key in keys.items() if not self._lanes[name].other_clock), None)
        if reference is None or not self._tolerance:
            return
        for name, key in keys.items():
            if self._lanes[name].other_clock:
                self._lanes[name].offset_ns += FOLLOWING * (key - reference)


def _group(frame: Frame) -> int:
    assert frame.group is not None
    return frame.group


def _arrival(frame: Frame) -> int:
    return frame.arrived_ns


def _rising(stamps: Sequence[int]) -> bool:
    """Whether stamps can order frames: a few may repeat or step back, but most must rise."""
    steps = [later - earlier for earlier, later in pairwise(stamps)]
    return not steps or sum(step > 0 for step in steps) * 2 > len(steps)


def _clock_offset_ns(reference: Sequence[Frame], frames: Sequence[Frame], period_ns: int) -> int:
    """The constant by which `frames` are stamped later than `reference`; half a period at most is left after it."""
    coarse = 0
    apart = abs(frames[0].captured_ns - reference[0].captured_ns)
    if frames[0].clock != reference[0].clock or apart > SAME_EPOCH_NS:
        coarse = _lead_over_arrival_ns(frames) - _lead_over_arrival_ns(reference)
    nearest = [
        min((frame.captured_ns - coarse - other.captured_ns for other in reference), key=abs) for frame in frames
    ]
    paired = [difference for difference in nearest if 2 * abs(difference) <= period_ns]
    return coarse + (round(median(paired)) if paired else 0)


def _lead_over_arrival_ns(frames: Sequence[Frame]) -> int:
    return round(median(frame.captured_ns - frame.arrived_ns for frame in frames))
