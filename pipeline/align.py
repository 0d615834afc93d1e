"""Pairs anew what a rig delivers whole frames apart: the report's future work, "synchronize the async frame"."""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass, field

from pydantic import Field

from pipeline.frame import Frame, Pair, Rig, Window
from pipeline.settings import Settings
from pipeline.verdict import AlignedPair, State, Verdict

BEYOND = 0.6
"""Frames that must be left before another frame fits better: a tenth more than half, so that a camera half a frame off
is not paired now with the one, now with the other."""

CONFIRM = 3
"""Verdicts in a row that must ask for another shift."""

NEARLY_WHOLE = 0.02
"""How far a ratio of frame rates may be off a whole number: 29.97 is 30, and a cheap camera's 30 is 29.6."""


class AlignSettings(Settings):
    """max_frames: by how many frames at most, of the faster camera of a pair, the second one's are moved."""

    max_frames: int = Field(default=5, ge=1, le=30)


@dataclass(frozen=True, slots=True)
class _Slot:
    """One window of one pair. away_frames, sigma_ns: what was judged of it, off what is expected; None: nothing."""

    index: int
    first: Frame | None
    second: Frame | None
    numbers: tuple[int | None, int | None]
    away_frames: float | None
    sigma_ns: int | None


@dataclass(slots=True)
class _Lane:
    """One pair. shift: the first camera's frame of slot t belongs to the second's of slot t - shift * step.

    period_ns: of the faster camera of the pair. step: slots from one of its frames to the next, more than one where
    another camera of the rig is faster still. most: frames that may be moved.
    """

    pair: Pair
    period_ns: int
    step: int
    most: int
    shift: int = 0
    asked: int = 0
    asking: int = 0
    slots: deque[_Slot] = field(default_factory=deque)
    waiting: deque[_Slot] = field(default_factory=deque)
    used: int = -1

    def partner_of(self, slot: _Slot) -> int:
        """The index of the slot whose second frame belongs to this one's first."""
        return slot.index - self.shift * self.step


class Aligner:
    """Emits pairs of frames that belong together, in order, one to one, with what is left between them.

    Whole frames follow the judged offset, with hysteresis; while it is unknown, the last shift holds. A slip is known
    only when the judge has found it: the pairs of those few frames are still the rig's own. Holes yield nothing, nor do
    frames whose partner lies beyond a gap in time or beyond dropped windows: how many frames were lost there is not
    known. Frames that wait for a partner when the stream ends have none. Where the rig's fastest frame rate is no whole
    multiple of both cameras', slots do not count frames: pairs stay as they are, and what is left is told.
    """

    def __init__(self, settings: AlignSettings, rig: Rig) -> None:
        self._rig = rig.name
        self._lanes = {pair.name: _lane(pair, rig, settings.max_frames) for pair in rig.pairs}
        self._newest = -1

    def take(self, window: Window, verdicts: Sequence[Verdict]) -> list[AlignedPair]:
        """Takes a window and what was judged of it; the pairs that are complete now."""
        said = {verdict.pair: verdict for verdict in verdicts}
        if window.index != self._newest + 1 or all(triple.previous is None for triple in window.cameras.values()):
            for lane in self._lanes.values():
                lane.slots.clear()
                lane.waiting.clear()
        self._newest = window.index
        return [made for lane in self._lanes.values() for made in self._step(lane, window, said.get(lane.pair.name))]

    def _step(self, lane: _Lane, window: Window, verdict: Verdict | None) -> list[AlignedPair]:
        first, second = window.cameras[lane.pair.first], window.cameras[lane.pair.second]
        away = _away(lane, verdict)
        sigma_ns = None if verdict is None else verdict.sigma_ns
        slot = _Slot(window.index, first.current, second.current, (first.number, second.number), away, sigma_ns)
        lane.slots.append(slot)
        while lane.slots[0].index < window.index - 2 * lane.most * lane.step:
            lane.slots.popleft()
        lane.waiting.append(slot)
        if away is not None:
            self._follow(lane, away)
        return list(self._complete(lane, window.index))

    def _follow(self, lane: _Lane, away: float) -> None:
        wanted = max(-lane.most, min(lane.most, round(away)))
        if abs(away - lane.shift) <= BEYOND or wanted == lane.shift:
            lane.asking = 0
            return
        lane.asking = lane.asking + 1 if wanted == lane.asked else 1
        lane.asked = wanted
        if lane.asking >= CONFIRM:
            lane.shift, lane.asking = wanted, 0

    def _complete(self, lane: _Lane, newest: int) -> list[AlignedPair]:
        made = []
        while lane.waiting and newest >= lane.partner_of(lane.waiting[0]):
            slot = lane.waiting.popleft()
            partner = next((one for one in lane.slots if one.index == lane.partner_of(slot)), None)
            if slot.first is None or partner is None or partner.second is None or partner.index <= lane.used:
                continue
            lane.used = partner.index
            made.append(self._pair(lane, slot, partner))
        return made

    def _pair(self, lane: _Lane, slot: _Slot, partner: _Slot) -> AlignedPair:
        assert slot.first is not None
        assert partner.second is not None
        told = slot if partner.away_frames is None else partner
        left = None if told.away_frames is None else round((told.away_frames - lane.shift) * lane.period_ns)
        return AlignedPair(
            rig=self._rig,
            pair=lane.pair.name,
            first=slot.numbers[0],
            second=partner.numbers[1],
            shift_frames=lane.shift,
            residual_ns=left,
            sigma_ns=told.sigma_ns if left is not None else None,
            frames=(slot.first, partner.second),
        )


def slots_per_frame(pair: Pair, rig: Rig) -> int:
    """Slots of the rig from one frame of the pair's faster camera to the next."""
    slot_ns = min(camera.period_ns for camera in rig.cameras)
    return round(min(rig.camera(name).period_ns for name in (pair.first, pair.second)) / slot_ns)


def _lane(pair: Pair, rig: Rig, most: int) -> _Lane:
    slot_ns = min(camera.period_ns for camera in rig.cameras)
    periods_ns = [rig.camera(name).period_ns for name in (pair.first, pair.second)]
    whole = all(abs(ns / slot_ns / round(ns / slot_ns) - 1) <= NEARLY_WHOLE for ns in periods_ns)
    return _Lane(pair, min(periods_ns), slots_per_frame(pair, rig), most if whole else 0)


def _away(lane: _Lane, verdict: Verdict | None) -> float | None:
    """The offset off what is expected, in frames of the pair's faster camera, where it was judged."""
    if verdict is None or verdict.state is State.UNKNOWN or verdict.offset_ns is None:
        return None
    return (verdict.offset_ns - lane.pair.expected_offset_ns) / lane.period_ns
