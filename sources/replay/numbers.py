"""Turns the numbers in file names into slots: equal numbers share one, neighbouring frames differ by 1."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Mapping, Sequence
from itertools import pairwise


def slots(numbers: Sequence[Sequence[int]]) -> Mapping[int, int]:
    """The slot of every number that a camera has, counted from 0.

    Numbers may rise by more than 1 (every tenth frame was kept): the most common step is one slot. Where that would
    put two numbers into one slot, the largest step that divides all of them is.
    """
    every = sorted({number for own in numbers for number in own})
    steps = Counter(after - before for own in numbers for before, after in pairwise(sorted(own)) if after > before)
    most = max(steps.values(), default=0)
    usual = min((step for step, times in steps.items() if times == most), default=1)
    found = {number: _rounded(number - every[0], usual) for number in every}
    if len(set(found.values())) == len(every):
        return found
    exact = math.gcd(*(number - every[0] for number in every))
    return {number: (number - every[0]) // exact for number in every}


def _rounded(number: int, step: int) -> int:
    # Not round(number / step): file names hold numbers that a float does not.
    return (2 * number + step) // (2 * step)
