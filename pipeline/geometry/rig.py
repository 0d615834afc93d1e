"""Watches the geometry of all pairs of a rig and says when a condition begins and ends."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Literal

from pipeline.frame import Pair, Rig, Window
from pipeline.geometry.look import look_at
from pipeline.geometry.shift import Shift, ShiftWatch
from pipeline.geometry.swap import SwapWatch

LOOKS_A_SECOND = 2


@dataclass(frozen=True, slots=True)
class Finding:
    """The onset or end of a condition of a pair; worst: what was measured, by name with the unit in it."""

    kind: Literal["swapped", "geometry_shift"]
    pair: str
    phase: Literal["onset", "end"]
    text: str
    worst: Mapping[str, float | None] = field(default_factory=dict)


@dataclass(slots=True)
class _Watched:
    pair: Pair
    every: int
    shift: ShiftWatch = field(default_factory=ShiftWatch)
    swap: SwapWatch = field(default_factory=SwapWatch)
    windows: int = 0
    shifted: bool = False
    swapped: bool = False


class RigGeometry:
    """Looks at every pair twice a second. No clock and no thread of its own; memory is constant."""

    def __init__(self, rig: Rig) -> None:
        self._watched = [
            _Watched(pair, max(1, round(rig.camera(pair.first).fps / LOOKS_A_SECOND))) for pair in rig.pairs
        ]

    def see(self, window: Window, apart: Collection[str] = ()) -> Sequence[Finding]:
        """Takes the next window. apart: the pairs whose frames were not taken together, which tell nothing."""
        return [finding for one in self._watched if one.pair.name not in apart for finding in self._look(one, window)]

    @staticmethod
    def _look(one: _Watched, window: Window) -> list[Finding]:
        first, second = window.cameras[one.pair.first], window.cameras[one.pair.second]
        if first.current is None or second.current is None:
            return []
        one.windows += 1
        if one.windows % one.every:
            return []
        look = look_at(first.current, second.current, first.previous)
        if look is None:
            return []
        one.swap.see(look)
        if not one.swap.swapped:
            one.shift.see(look)
        return _changes(one)


def _changes(one: _Watched) -> list[Finding]:
    made = []
    if one.swap.swapped != one.swapped:
        one.swapped = one.swap.swapped
        text = f"{one.pair.first} and {one.pair.second} are exchanged"
        made.append(Finding("swapped", one.pair.name, _phase(one.swapped), text))
    shift = one.shift.shifted
    if (shift is not None) != one.shifted:
        one.shifted = shift is not None
        made.append(_shifted(one.pair, shift))
    return made


def _shifted(pair: Pair, shift: Shift | None) -> Finding:
    if shift is None:
        return Finding("geometry_shift", pair.name, "end", f"{pair.second} looks where it did at first again")
    return Finding(
        "geometry_shift",
        pair.name,
        "onset",
        f"{pair.second} was knocked or creeps: its picture is off {pair.first}'s by up to {shift.shift_px:.1f} px "
        f"more than it was, turned by {shift.roll_deg:+.2f} deg",
        {"shift_px": shift.shift_px, "roll_deg": shift.roll_deg},
    )


def _phase(begins: bool) -> Literal["onset", "end"]:
    return "onset" if begins else "end"
