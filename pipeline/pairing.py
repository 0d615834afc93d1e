"""Decides which frames of a rig's cameras belong to the same slot; whether they were taken together is judged later."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from typing import TypeAlias

from pipeline.clock_alignment import LEARNING_FRAMES, SAME_EPOCH_NS, Placed, Timeline
from pipeline.frame import NS_PER_S, Camera, Frame

__all__ = ["SAME_EPOCH_NS", "Counters", "Pairer", "Slot"]

Identity: TypeAlias = tuple[int | None, int, int, int | None]
"""Group, epoch, stamp and counter of a frame."""

Slot: TypeAlias = dict[str, Frame | None]
"""One frame of every camera, None for a hole. A slot of holes only marks a gap in time."""

PATIENCE_NS = NS_PER_S // 2
PATIENCE_PERIODS = 3
"""How long a camera is waited for, and periods of the slowest beside it: hosts and buses pause for tenths of a second,
and a camera that is silent for longer is missing."""

LEAST_PENDING, MOST_PENDING = 4, 64
"""Bounds of the frames of one camera that wait: a few where there is a frame a second, half a second at 120 fps."""


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

    most: int
    pending: deque[tuple[int, Frame]] = field(default_factory=deque)
    learning: int = 0
    floor: int | None = None
    last: Identity | None = None
    epoch: int | None = None
    heard: bool = False
    absent: bool = False


class Pairer:
    """Turns frames of N cameras, in any interleaving, into slots: one to one, in order, with bounded memory.

    Frames are compared by their place on the rig's `Timeline`: their `group` if every camera has one; else
    `captured_ns` less a constant of the clock; else arrival. Cameras of one clock pair by the nearest stamps as they
    are: one that stamps two frames ahead is paired with the frames two later, and recordings that overlap partly pair
    where they overlap. Whether these were taken together is for the judge to say.

    The earliest frame that is waiting opens a slot; every other camera adds its earliest one if that lies within the
    tolerance, unless it lies in the outer half of it and the opening camera's next frame is nearer. A camera that
    delivers nothing while another piles up `max_pending` frames is waited for until the next frame only, until it is
    heard again. Slots are as frequent as the fastest camera's frames; a slower one has holes between its own.

    tolerance_ns: None means half the shortest period of the cameras, and more than a period is too much.
    max_pending: None means as many frames of each camera as come in half a second and three periods of the slowest,
    4 to 64. As many more are held while the place of a camera's frames is being learned.
    """

    def __init__(
        self, cameras: Sequence[Camera], *, tolerance_ns: int | None = None, max_pending: int | None = None
    ) -> None:
        self._cameras = tuple(camera.name for camera in cameras)
        self._period_ns = min(camera.period_ns for camera in cameras)
        self._tolerance_ns = self._period_ns // 2 if tolerance_ns is None else tolerance_ns
        slowest_ns = max(camera.period_ns for camera in cameras)
        most = {camera.name: max_pending or _most_pending(camera, slowest_ns) for camera in cameras}
        self._lanes = {name: _Lane(most[name]) for name in self._cameras}
        self._timeline = Timeline(cameras, most)
        self._first: list[Frame] | None = []
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
        yield from self._take(frame)

    def flush(self) -> Iterator[Slot]:
        """Yields what is left: no more frames will come (or none that compare with these)."""
        self._learn()
        for name in self._cameras:
            self._enqueue(self._timeline.settle(name))
        yield from self._decided(final=True)

    def _restart(self) -> list[Frame]:
        """Forgets what was learned; cameras that restart together do so once. The frames that had no place yet."""
        for lane in self._lanes.values():
            lane.floor = lane.last = None
            lane.heard = False
            lane.learning = 0
        self._first = []
        if self._last_key is not None:
            self._last_key = None
            self._gap_due = True
        return self._timeline.restart()

    def _take(self, frame: Frame) -> Iterator[Slot]:
        if self._first is not None:
            self._first.append(frame)
            self._lanes[frame.camera].learning += 1
            if not self._learned_enough(self._first):
                return
            self._learn()
        else:
            self._enqueue(self._timeline.place(frame))
        if self._timeline.void:
            yield from self._decided(final=True)
            for left in self._restart():
                self._lanes[left.camera].heard = True
                yield from self._take(left)
            return
        yield from self._decided(final=False)

    def _learned_enough(self, first: Sequence[Frame]) -> bool:
        lanes = self._lanes.values()
        if any(lane.learning >= lane.most for lane in lanes):
            return True
        if all(lane.learning for lane in lanes) and all(frame.group is not None for frame in first):
            return True
        return all(lane.learning >= LEARNING_FRAMES for lane in lanes)

    def _learn(self) -> None:
        """Learns by the frames held so far and lets them in."""
        if self._first is not None:
            first, self._first = self._first, None
            self._enqueue(self._timeline.learn(first))

    @property
    def _tolerance(self) -> int:
        return 0 if self._timeline.grouped else self._tolerance_ns

    def _enqueue(self, placed: Iterable[Placed]) -> None:
        for key, frame in placed:
            lane = self._lanes[frame.camera]
            known = [_identity(other) for _, other in lane.pending]
            if _identity(frame) in (lane.last, *known) or any(key == other for other, _ in lane.pending):
                self.counters.duplicates[frame.camera] += 1
            elif key is None or (lane.floor is not None and key <= lane.floor):
                self.counters.late[frame.camera] += 1
            else:
                lane.pending.append((key, frame))
                if len(lane.pending) > 1 and lane.pending[-2][0] > key:
                    lane.pending = deque(sorted(lane.pending, key=lambda item: item[0]))

    def _decided(self, *, final: bool) -> Iterator[Slot]:
        while True:
            waiting = [name for name in self._cameras if self._lanes[name].pending]
            if not waiting:
                return
            forced = final or any(self._overflows(name) for name in self._cameras)
            silent = [name for name in self._cameras if not self._lanes[name].pending and not self._lanes[name].absent]
            if silent and not forced:
                return
            if silent and not final:
                for name in silent:
                    self._lanes[name].absent = True
                    self._enqueue(self._timeline.settle(name))
                continue
            opener = min(waiting, key=lambda name: self._lanes[name].pending[0][0])
            if not forced and self._may_come(self._lanes[opener].pending[0][0]):
                return
            partners = self._partners(opener, forced=forced)
            if partners is None:
                return
            yield from self._emit(opener, partners)

    def _may_come(self, start: int) -> bool:
        """Whether a camera that is not waited for may come back yet with a frame for a slot: nothing later is there."""
        lanes = self._lanes.values()
        latest = max(lane.pending[-1][0] for lane in lanes if lane.pending)
        return any(lane.absent for lane in lanes) and latest <= start + self._tolerance

    def _overflows(self, name: str) -> bool:
        lane = self._lanes[name]
        return len(lane.pending) > lane.most

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
        step = 1 if self._timeline.grouped else self._period_ns
        skipped = self._last_key is not None and start - self._last_key > 1.5 * step
        if skipped or self._gap_due:
            self._gap_due = False
            yield dict.fromkeys(self._cameras)
        slot: Slot = {}
        keys: dict[str, int] = {}
        for name in self._cameras:
            lane = self._lanes[name]
            if name == opener or name in partners:
                key, frame = lane.pending.popleft()
                lane.last, lane.floor = _identity(frame), key
                slot[name] = frame
                keys[name] = key
            else:
                slot[name] = None
                self.counters.holes[name] += 1
                if not lane.pending:
                    lane.floor = max(start + self._tolerance, lane.floor or start)
        self._last_key = start
        self._timeline.follow(keys)
        yield slot


def _identity(frame: Frame) -> Identity:
    """What a frame that is delivered twice has in common with itself: its key may move with the clock it follows."""
    return frame.group, frame.epoch, frame.captured_ns, frame.sequence


def _most_pending(camera: Camera, slowest_ns: int) -> int:
    frames = round((PATIENCE_NS + PATIENCE_PERIODS * slowest_ns) / camera.period_ns)
    return min(max(frames, LEAST_PENDING), MOST_PENDING)
