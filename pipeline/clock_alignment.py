"""Brings the stamps of a rig's cameras onto one time line, whatever their clocks show and whenever they are heard."""

from __future__ import annotations

from collections import deque
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from heapq import merge
from itertools import pairwise
from statistics import median
from typing import NamedTuple

from pipeline.frame import NS_PER_S, Camera, Frame

LEARNING_FRAMES = 8
"""Frames a camera must show before its clock is compared with another's: enough for a median to ignore a bad stamp."""

SAME_EPOCH_NS = 2 * NS_PER_S
"""Stamps of one clock further apart than this cannot be of one epoch: arrival says how they relate."""

SAME_EPOCH_PERIODS = 6
"""The same for slow cameras: an offset of five frames is one that the judge is to find."""

STEP_PERIODS = 2
STEP_NS = NS_PER_S // 5
"""Beyond both, a jump of stamps may be a step of the clock: the order in which cameras are heard tells of delivery to a
period before and after, and it jitters by a tenth of a second. Smaller ones stay as stamps say."""

STEP_FRAMES = 3
"""Frames that must bear a step out: one or two bad stamps are none, and 3 frames at 10 fps are well within a second."""

MOST_SKIPPED, MOST_OVERTAKEN = 1000, 16
"""A counter that rises or falls by more has been set anew and tells of no frames lost."""

DRIFT = 1e-3
"""The most that two clocks drift apart, a thousand ppm: what crystals never reach."""

FOLLOWING = 1 / 64
"""Share of each difference by which the offset of another clock follows its drift: two seconds at 30 fps, so that
jitter averages out and even 1000 ppm stay far below half a period."""

REMEMBERED = 128
"""Keys of a camera that are remembered for comparison: two of the longest waits."""


class Placed(NamedTuple):
    """A frame and its place: its group, or ns on the time line. None: it has no group and the others have."""

    key: int | None
    frame: Frame


class Apart(NamedTuple):
    """How far a stamp is ahead of the newest one of any other camera, ns.

    in_order: by the order in which they are heard, which holds for recordings read at any speed. elapsed: allowing for
    the time between their arrivals, which holds where a live camera is silent.
    """

    in_order: float
    elapsed: float

    @property
    def least(self) -> float:
        """What both bear out."""
        if self.in_order * self.elapsed <= 0:
            return 0.0
        return min(self.in_order, self.elapsed, key=abs)


class _Held(NamedTuple):
    """A frame whose place is not decided. stamp: as it is, no offset taken off; rig_ns: the others' newest key."""

    frame: Frame
    stamp: int
    apart: Apart | None
    rig_ns: int


@dataclass(slots=True)
class _Last:
    """What a camera showed last."""

    stamp: int
    key: int
    sequence: int | None


@dataclass(slots=True)
class _Clock:
    """What is known of one camera's clock. newest: key and arrival of the frame heard last. usual: how it was apart."""

    name: str
    period_ns: int
    most_held: int
    known: bool = False
    by_arrival: bool = False
    followed: bool = False
    offset_ns: float = 0.0
    clock: str = ""
    last: _Last | None = None
    newest: tuple[int, int] | None = None
    keys: deque[int] = field(default_factory=lambda: deque(maxlen=REMEMBERED))
    usual: deque[Apart] = field(default_factory=lambda: deque(maxlen=LEARNING_FRAMES))
    held: list[_Held] = field(default_factory=list)

    @property
    def held_keys(self) -> list[int]:
        return [seen.stamp - round(self.offset_ns) for seen in self.held]

    @property
    def least_step_ns(self) -> int:
        return max(STEP_NS, STEP_PERIODS * self.period_ns)

    def jump_ns(self, stamp: int, sequence: int | None) -> int:
        """By how much more, or less, than the frames delivered explain the stamps have risen since the last frame."""
        if self.last is None:
            return 0
        return stamp - self.last.stamp - self.advance(sequence) * self.period_ns

    def advance(self, sequence: int | None) -> int:
        """Frames since the last one, by the counter if it can tell, else one."""
        if self.last is None or sequence is None or self.last.sequence is None:
            return 1
        skipped = sequence - self.last.sequence
        return skipped if -MOST_OVERTAKEN <= skipped <= MOST_SKIPPED else 1


class Timeline:
    """Gives every frame its key. Frames of one camera come in order of capture, cameras in any interleaving.

    The key is the `group` if every camera has one; else `captured_ns` less a constant of the camera's clock; else, when
    stamps do not rise, `arrived_ns`. The constants:

    - Cameras of one clock keep their stamps, however far apart their frames arrive, less a constant of half a period
      at most, so that jitter cannot tear them between two partners. So recordings pair where they overlap.
    - Another clock, or stamps of one clock that cannot be of one epoch, are compared by arrival, then brought to the
      nearest stamps. That is learned from the first frames of a camera, whenever these come, and again after a silence
      in which clocks may have drifted apart. Other clocks are followed while they drift.
    - A clock that steps by more than two periods and 0.2 s while its frames keep arriving as before is moved back by
      that; one or two stamps off are replaced by what the frames before them say. A jump that lost frames, a pause of
      all or a backlog explain is no step. When all clocks are set back, `void` says that all is to be learned anew.

    A recording is read in order of its stamps: of a step within it nothing is known, and stamps are taken as they are.

    most_held: by camera, how many frames may be held until a place is decided. At most LEARNING_FRAMES are, and up to
    most_held after a jump while the other cameras are silent.
    """

    def __init__(self, cameras: Sequence[Camera], most_held: Mapping[str, int]) -> None:
        self._clocks = {one.name: _Clock(one.name, one.period_ns, most_held[one.name]) for one in cameras}
        self._period_ns = min(camera.period_ns for camera in cameras)
        self._same_epoch_ns = max(SAME_EPOCH_NS, SAME_EPOCH_PERIODS * max(camera.period_ns for camera in cameras))
        self._reference_clock: str | None = None
        self.grouped = False
        self.void = False
        """Whether what was learned holds no longer: call `restart`."""

    def learn(self, frames: Sequence[Frame]) -> Iterator[Placed]:
        """Takes the first frames of the rig, in order of arrival, and yields those that have got their place."""
        by_camera: dict[str, list[Frame]] = {}
        for frame in frames:
            by_camera.setdefault(frame.camera, []).append(frame)
        self.grouped = bool(frames) and all(frame.group is not None for frame in frames)
        if not self.grouped and frames:
            by_arrival = not all(_rising([one.captured_ns for one in own]) for own in by_camera.values())
            reference = next(by_camera[name] for name in self._clocks if name in by_camera)
            self._reference_clock = reference[0].clock
            for name, own in by_camera.items():
                clock = self._clocks[name]
                clock.known, clock.clock, clock.by_arrival = True, own[0].clock, by_arrival
                clock.followed = not by_arrival and own[0].clock != self._reference_clock
                if not by_arrival:
                    clock.offset_ns = self._first_offset_ns(reference, own)
        for frame in frames:
            yield from self.place(frame)

    def place(self, frame: Frame) -> list[Placed]:
        """Takes a frame; it and those before it whose places are decided now."""
        clock = self._clocks[frame.camera]
        if self.grouped:
            if frame.group is None and clock.last is None:
                return self._ask_again(clock, frame)
            clock.last = _Last(0, 0, frame.sequence)
            return [Placed(frame.group, frame)]
        seen = self._seen(clock, frame)
        if clock.held or not clock.known or self._suspicious(clock, seen) or self._drifted(clock, seen.stamp):
            clock.held.append(seen)
            if clock.known:
                clock.newest = (seen.stamp - round(clock.offset_ns), frame.arrived_ns)
            return self._settled(clock, final=False)
        return [self._admit(clock, seen)]

    def settle(self, camera: str) -> list[Placed]:
        """Decides the places of the frames of a camera by what is known of them: no more will come for now."""
        clock = self._clocks[camera]
        return self._settled(clock, final=True) if clock.held else []

    def follow(self, keys: Mapping[str, int]) -> None:
        """Takes the keys of frames that were paired: the offsets of other clocks follow them."""
        reference = next((key for name, key in keys.items() if not self._clocks[name].followed), None)
        if reference is None or self.grouped:
            return
        for name, key in keys.items():
            if self._clocks[name].followed:
                self._clocks[name].offset_ns += FOLLOWING * (key - reference)

    def restart(self) -> list[Frame]:
        """Forgets everything; the frames that have no place yet, in order of arrival."""
        held = [[seen.frame for seen in clock.held] for clock in self._clocks.values()]
        for name, clock in self._clocks.items():
            self._clocks[name] = _Clock(name, clock.period_ns, clock.most_held)
        self.grouped = self.void = False
        return list(merge(*held, key=lambda frame: frame.arrived_ns))

    def _ask_again(self, clock: _Clock, frame: Frame) -> list[Placed]:
        clock.held.append(_Held(frame, frame.captured_ns, None, 0))
        self.void = True
        return []

    def _seen(self, clock: _Clock, frame: Frame) -> _Held:
        stamp = frame.arrived_ns if clock.by_arrival else frame.captured_ns
        others = [one.newest for one in self._clocks.values() if one is not clock and one.newest is not None]
        if not others:
            return _Held(frame, stamp, None, 0)
        rig_ns = max(key for key, _ in others)
        now_ns = max(key + frame.arrived_ns - arrived for key, arrived in others)
        return _Held(frame, stamp, Apart(stamp - rig_ns, stamp - now_ns), rig_ns)

    def _admit(self, clock: _Clock, seen: _Held, key: int | None = None) -> Placed:
        frame, last = seen.frame, clock.last
        if key is None:
            key = seen.stamp - round(clock.offset_ns)
            renumbered = last is not None and None is not frame.sequence != last.sequence
            if last is not None and renumbered and seen.stamp == last.stamp and clock.advance(frame.sequence) > 0:
                key = last.key + clock.advance(frame.sequence) * clock.period_ns
            if seen.apart is not None:
                clock.usual.append(seen.apart)
            clock.last = _Last(seen.stamp, key, frame.sequence)
        clock.newest = (key, frame.arrived_ns)
        clock.keys.append(key)
        return Placed(key, frame)

    def _drifted(self, clock: _Clock, stamp: int) -> bool:
        """Whether another clock may have drifted too far while its camera was silent."""
        if not clock.followed or clock.last is None:
            return False
        if DRIFT * (stamp - clock.last.stamp) <= self._period_ns / 4:
            return False
        clock.known = False
        return True

    def _suspicious(self, clock: _Clock, seen: _Held) -> bool:
        jump_ns = clock.jump_ns(seen.stamp, seen.frame.sequence)
        if jump_ns < -clock.least_step_ns:
            return True
        return jump_ns > clock.least_step_ns and self._moved_ns(clock, [seen], jump_ns) > 0

    def _moved_ns(self, clock: _Clock, held: Sequence[_Held], jump_ns: int) -> float:
        """By how much frames are further from the others than usual, in the direction of a jump; 0: no step shows.

        What brings cameras closer together may be a backlog thrown away, unless a counter shows that nothing is lost.
        """
        aparts = [seen.apart for seen in held if seen.apart is not None]
        if not aparts or not clock.usual:
            return 0.0
        now, usual = _middle(aparts), _middle(clock.usual)
        moved = Apart(now.in_order - usual.in_order, now.elapsed - usual.elapsed).least
        if moved * jump_ns <= 0 or abs(moved) <= min(clock.least_step_ns, abs(jump_ns) / 2):
            return 0.0
        nearer = abs(now.elapsed - clock.offset_ns) < abs(usual.elapsed - clock.offset_ns)
        return 0.0 if nearer and jump_ns > 0 and held[0].frame.sequence is None else moved

    def _settled(self, clock: _Clock, *, final: bool) -> list[Placed]:
        if not clock.known:
            if len(clock.held) < min(LEARNING_FRAMES, clock.most_held) and not final:
                return []
            self._learn_late(clock)
            return self._admit_held(clock)
        first, latest = clock.held[0], clock.held[-1]
        jump_ns = clock.jump_ns(first.stamp, first.frame.sequence)
        if len(clock.held) > 1 and self._returned(clock, latest, jump_ns):
            return self._pass_over(clock)
        if len(clock.held) < STEP_FRAMES and not final:
            return []
        heard_ns = latest.rig_ns - first.rig_ns
        moved_ns = self._moved_ns(clock, clock.held, jump_ns)
        if 2 * heard_ns >= (len(clock.held) - 1) * clock.period_ns > 0:
            if moved_ns:
                self._step(clock, jump_ns, moved_ns)
                return self._admit_held(clock)
        elif len(clock.held) < clock.most_held and heard_ns >= 0 and not final:
            return []
        if jump_ns < 0 and not final:
            self.void = True
            return []
        return self._admit_held(clock)

    def _returned(self, clock: _Clock, latest: _Held, jump_ns: int) -> bool:
        """Whether stamps go on where they were before they jumped."""
        uncounted = len(clock.held) - 1 if latest.frame.sequence is None else 0
        left_ns = clock.jump_ns(latest.stamp, latest.frame.sequence) - uncounted * clock.period_ns
        return abs(left_ns) <= min(clock.least_step_ns, abs(jump_ns) / 2)

    def _pass_over(self, clock: _Clock) -> list[Placed]:
        """Frames with bad stamps get the places between the good ones."""
        *bad, good = clock.held
        clock.held = []
        assert clock.last is not None
        last_key = clock.last.key
        placed = []
        for place, seen in enumerate(bad, 1):
            advance = clock.advance(seen.frame.sequence) if seen.frame.sequence is not None else place
            placed.append(self._admit(clock, seen, last_key + max(advance, place) * clock.period_ns))
        return [*placed, self._admit(clock, good)]

    def _step(self, clock: _Clock, jump_ns: int, moved_ns: float) -> None:
        """Moves the clock back by its jump; where frames were lost at it, too, by what arrival says.

        The jump is as noisy as two stamps: that the camera goes on as far beside the others as it was tells more.
        """
        before_ns = self._beside_nearest_ns(clock, list(clock.keys)[-REMEMBERED // 2 :])
        counted = clock.held[0].frame.sequence is not None
        exact = abs(jump_ns - moved_ns) <= (self._same_epoch_ns if counted else clock.least_step_ns)
        size_ns = jump_ns if exact else moved_ns
        clock.offset_ns += size_ns
        away_ns = self._beside_nearest_ns(clock, clock.held_keys) - before_ns
        clock.offset_ns += away_ns - self._period_ns * round(away_ns / self._period_ns)
        usual = [Apart(one.in_order + size_ns, one.elapsed + size_ns) for one in clock.usual]
        clock.usual = deque(usual, maxlen=LEARNING_FRAMES)

    def _admit_held(self, clock: _Clock) -> list[Placed]:
        held, clock.held = clock.held, []
        return [self._admit(clock, seen) for seen in held]

    def _learn_late(self, clock: _Clock) -> None:
        """Relates a camera first heard after the others, or after a long silence, to them."""
        frames = [seen.frame for seen in clock.held]
        if not _rising([frame.captured_ns for frame in frames]):
            clock.by_arrival = True
            clock.held = [self._seen(clock, frame) for frame in frames]
        clock.known, clock.clock, clock.last = True, frames[0].clock, None
        clock.usual.clear()
        aparts = [seen.apart for seen in clock.held if seen.apart is not None]
        if not aparts:
            return
        now = _middle(aparts)
        alike = [
            one
            for one in self._clocks.values()
            if one is not clock and one.known and one.clock == clock.clock and not one.by_arrival | clock.by_arrival
        ]
        nearest = min(alike, key=lambda one: abs(now.elapsed - one.offset_ns), default=None)
        if nearest is not None and abs(Apart(*(each - nearest.offset_ns for each in now)).least) <= self._same_epoch_ns:
            clock.offset_ns, clock.followed = nearest.offset_ns, nearest.followed
        else:
            clock.offset_ns = now.elapsed
            clock.followed = clock.by_arrival or clock.clock != self._reference_clock
        clock.offset_ns += self._beside_nearest_ns(clock, clock.held_keys)

    def _beside_nearest_ns(self, clock: _Clock, keys: Sequence[int]) -> int:
        """By how much keys of a camera lie beside the nearest ones of the others; half a period at most."""
        others = [key for one in self._clocks.values() if one is not clock for key in one.keys]
        return _beside_ns(keys, others, self._period_ns) if others else 0

    def _first_offset_ns(self, reference: Sequence[Frame], frames: Sequence[Frame]) -> int:
        """The constant by which `frames` are stamped later than `reference`; half a period at most is left after it."""
        coarse = 0
        apart = abs(frames[0].captured_ns - reference[0].captured_ns)
        if frames[0].clock != reference[0].clock or apart > self._same_epoch_ns:
            coarse = _lead_over_arrival_ns(frames) - _lead_over_arrival_ns(reference)
        keys = [frame.captured_ns - coarse for frame in frames]
        return coarse + _beside_ns(keys, [frame.captured_ns for frame in reference], self._period_ns)


def _middle(aparts: Collection[Apart]) -> Apart:
    return Apart(median(one.in_order for one in aparts), median(one.elapsed for one in aparts))


def _rising(stamps: Sequence[int]) -> bool:
    """Whether stamps can order frames: a few may repeat or step back, but most must rise."""
    steps = [later - earlier for earlier, later in pairwise(stamps)]
    return not steps or sum(step > 0 for step in steps) * 2 > len(steps)


def _beside_ns(keys: Sequence[int], others: Sequence[int], period_ns: int) -> int:
    """The median distance of keys to the nearest of others, of those within half a period; 0 where there are none."""
    nearest = [min((key - other for other in others), key=abs) for key in keys]
    close = [distance for distance in nearest if 2 * abs(distance) <= period_ns]
    return round(median(close)) if close else 0


def _lead_over_arrival_ns(frames: Sequence[Frame]) -> int:
    """Stamp less arrival of the frames delivered fastest; of eight, the first may have a bad stamp."""
    leads = sorted(frame.captured_ns - frame.arrived_ns for frame in frames)
    return leads[3 * len(leads) // 4]
