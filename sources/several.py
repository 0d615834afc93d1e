"""Several sources as one: cameras of different kinds side by side in one rig, each on its own clock."""

from __future__ import annotations

import heapq
import logging
import threading
from collections import deque
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import replace
from functools import partial
from itertools import count
from typing import NamedTuple

import numpy as np

from pipeline.buffer import BufferSettings
from pipeline.configtext.document import ConfigError
from pipeline.deadline import ended_within
from pipeline.errors import InputError, RunError, SyncwatchError
from pipeline.faults.source import StreamClock, paired_slots
from pipeline.frame import NS_PER_S, Camera, Frame, Picture, Source
from pipeline.pairing import Pairer, Slot
from pipeline.plan import name_taken
from sources.live import Inbox, feed

log = logging.getLogger("syncwatch.sources")

COMMON_CLOCKS = frozenset({"monotonic", "realtime", "ptp"})
"""Clocks that are one and the same whichever live source tells of them: this machine's, and what PTP keeps together."""

OWN = "source"
"""With which sources begin that tell of their own settings."""

END_WITHIN_S = 5.0
NOTHING: Picture = np.zeros((1, 1), np.uint8)
NOTHING.flags.writeable = False


class _Moment(NamedTuple):
    """A slot of one source. at_ns: since the first one of that source; number: counts them."""

    at_ns: int
    source: int
    number: int
    slot: Slot

    @property
    def mark(self) -> Frame:
        """Stands for the whole slot where slots are paired."""
        return Frame(_mark(self.source), self.number, self.at_ns, _mark(self.source), self.at_ns, NOTHING)


class SeveralSources:
    """Implements Source over two or more others, all live or all recorded; names of their cameras must differ.

    What one source says is not compared with what another means by it: clocks are told apart by the source, but for
    those that are common to all; truth, which is known on a clock of its own, is left out. Live sources run on a thread
    each, and their frames pair by time: a camera's oldest gives way when too many wait. Recordings are taken to begin
    at the same moment and are merged in order of their time; their groups are numbered anew, so that what one holds
    together stays together.

    It ends when all have ended; one that fails ends it with its error. refuse: makes the error of what is wrong with
    the source of a number. pairing: as in the rig's own buffer.
    """

    def __init__(
        self, sources: Sequence[Source], *, refuse: Callable[[int, str], InputError], pairing: BufferSettings
    ) -> None:
        self.sources = tuple(sources)
        self._refuse = refuse
        self._pairing = pairing
        self._inbox: Inbox[Frame] | None = None
        self._opened: list[int] = []
        self._threads: dict[int, threading.Thread] = {}
        self._running = len(self.sources)
        self._over: set[str] = set()
        self._lock = threading.Lock()
        self._stopped = False

    @property
    def cameras(self) -> Sequence[Camera]:
        return [camera for source in self.sources for camera in source.cameras]

    @property
    def live(self) -> bool:
        return any(source.live for source in self.sources)

    @property
    def frame_count(self) -> int | None:
        return self.sources[0].frame_count

    @property
    def ended(self) -> Collection[str]:
        return self._over.union(*(getattr(source, "ended", ()) for source in self.sources))

    @property
    def dropped(self) -> Mapping[str, int]:
        """Frames that gave way in their own source, or on the way from it."""
        told = [getattr(source, "dropped", {}) for source in self.sources]
        if self._inbox is not None:
            told.append(self._inbox.dropped)
        return {camera.name: sum(one.get(camera.name, 0) for one in told) for camera in self.cameras}

    def open(self) -> None:
        """Opens them in order. Raises InputError for a recording beside live cameras and for a name given twice."""
        self._refuse_mixture()
        try:
            for number, source in enumerate(self.sources):
                with _told_of(number, "cannot be opened"):
                    source.open()
                self._opened.append(number)
                self._refuse_names(number)
        except BaseException:
            with _logged():
                self.close()
            raise
        self._inbox = Inbox([camera.name for camera in self.cameras])

    def frames(self) -> Iterator[Frame]:
        return self._live() if self.live else self._recorded()

    def stop(self) -> None:
        """Stops them all, whatever goes wrong with one. Raises what went wrong first."""
        self._stopped = True
        if self._inbox is not None:
            self._inbox.stop()
        _raise_first(self._each(self._opened, lambda source: source.stop(), "cannot be stopped"))

    def close(self) -> None:
        """Stops and closes them, the last first, whatever goes wrong with one. Raises what went wrong first."""
        failures: list[SyncwatchError] = []
        try:
            self.stop()
        except SyncwatchError as error:
            failures.append(error)
        stuck = [number for number, thread in self._threads.items() if not ended_within(END_WITHIN_S, thread)]
        failures += [RunError(f"{_name(number)} did not stop within {END_WITHIN_S:.0f} s") for number in stuck]
        closing = [number for number in self._opened[::-1] if number not in stuck]
        self._opened = []
        failures += self._each(closing, lambda source: source.close(), "cannot be closed")
        if self._inbox is not None:
            self._inbox.say_what_was_dropped()
        _raise_first(failures)

    def _each(self, numbers: Sequence[int], do: Callable[[Source], None], what: str) -> list[SyncwatchError]:
        failures = []
        for number in numbers:
            try:
                with _told_of(number, what):
                    do(self.sources[number])
            except SyncwatchError as error:
                failures.append(error)
        return failures

    def _refuse_mixture(self) -> None:
        live = [source.live for source in self.sources]
        if any(live) and not all(live):
            raise self._refuse(
                live.index(False),
                f"is a recording, and {_name(live.index(True))} is live: what was recorded then cannot be in sync with "
                "what happens now; record all of the rig, or play files as `type: video`",
            )

    def _refuse_names(self, number: int) -> None:
        for other in range(number):
            for name in {camera.name for camera in self.sources[other].cameras}:
                if any(camera.name == name for camera in self.sources[number].cameras):
                    raise self._refuse(number, name_taken(name, other))

    def _live(self) -> Iterator[Frame]:
        assert self._inbox is not None, "open comes first"
        for number in range(len(self.sources)):
            if not self._stopped:
                self._threads[number] = feed(self._inbox, partial(self._take, self._inbox, number), _name(number))
        yield from self._inbox.read()

    def _take(self, inbox: Inbox[Frame], number: int) -> None:
        """The thread of one live source."""
        with _told_of(number, "failed"):
            for frame in self.sources[number].frames():
                if not inbox.put(_own(frame, number, common=COMMON_CLOCKS)):
                    return
        with self._lock:
            self._running -= 1
            if self._running == 0:
                inbox.end()

    def _recorded(self) -> Iterator[Frame]:
        """Slots of all recordings, paired by the time since each began; groups are the numbers of these pairings."""
        rates = [max(camera.fps for camera in source.cameras) for source in self.sources]
        pairer = Pairer([Camera(_mark(number), fps) for number, fps in enumerate(rates)])
        held: list[deque[_Moment]] = [deque() for _ in self.sources]
        groups = count()
        streams = [self._moments(number) for number in range(len(self.sources))]
        for moment in heapq.merge(*streams, key=lambda one: (one.at_ns, one.source)):
            held[moment.source].append(moment)
            for slot in pairer.push(moment.mark):
                yield from _joined(slot, held, groups)
        for slot in pairer.flush():
            yield from _joined(slot, held, groups)

    def _moments(self, number: int) -> Iterator[_Moment]:
        source = self.sources[number]
        clock, at_ns, numbers = StreamClock(source.cameras), -NS_PER_S, count()
        with _told_of(number, "failed"):
            for slot in paired_slots(source, self._pairing):
                if any(frame is not None for frame in slot.values()):
                    at_ns = max(clock.tell(slot), at_ns + 1)
                    yield _Moment(at_ns, number, next(numbers), slot)
        self._over.update(camera.name for camera in source.cameras)


def _name(number: int) -> str:
    return f"source[{number}]"


def _mark(number: int) -> str:
    """A source's name where its slots are paired as if they were frames of a camera."""
    return f"source_{number}"


def _joined(slot: Slot, held: Sequence[deque[_Moment]], groups: Iterator[int]) -> Iterator[Frame]:
    """The frames of the moments that were paired, in a group of their own; moments that were left out are given up."""
    marks = [slot[_mark(number)] for number in range(len(held))]
    if not any(mark is not None for mark in marks):
        return
    group = next(groups)
    for waiting, mark in zip(held, marks, strict=True):
        while mark is not None:
            moment = waiting.popleft()
            if moment.number == mark.sequence:
                frames = (frame for frame in moment.slot.values() if frame is not None)
                yield from (_own(frame, moment.source, group=group) for frame in frames)
                break


def _own(frame: Frame, number: int, *, common: Collection[str] = (), group: int | None = None) -> Frame:
    """The frame with nothing in it that holds within its source alone."""
    clock = frame.clock if frame.clock in common else f"{frame.clock}@{number}"
    return replace(frame, clock=clock, group=group, truth=None)


def _raise_first(failures: Sequence[SyncwatchError]) -> None:
    for other in failures[1:]:
        log.error("%s", other)
    if failures:
        raise failures[0]


@contextmanager
def _logged() -> Iterator[None]:
    """For what goes wrong after something else has."""
    try:
        yield
    except SyncwatchError as error:
        log.error("%s", error)  # noqa: TRY400 - one line, no traceback


@contextmanager
def _told_of(number: int, what: str) -> Iterator[None]:
    """Errors say of which source they are; those of the configuration say so by themselves."""
    try:
        yield
    except ConfigError:
        raise
    except SyncwatchError as error:
        text = str(error)
        place = f"{_name(number)}{text.removeprefix(OWN)}" if text.startswith(f"{OWN}.") else f"{_name(number)}: {text}"
        raise type(error)(place) from error
    except Exception as error:  # a user's own source may raise anything
        log.debug("%s %s", _name(number), what, exc_info=error)
        raise RunError(f"{_name(number)} {what}: {type(error).__name__}: {error}") from error
