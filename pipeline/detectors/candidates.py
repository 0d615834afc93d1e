"""What all methods share that ask which frame of the second camera belongs to the first's t: that of t-1, t or t+1?"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import ClassVar, TypeAlias

import numpy as np
import numpy.typing as npt

from pipeline.detectors.offset.silence import Silence, reason_of
from pipeline.frame import Frame, Pair, Rig, Window
from pipeline.settings import Settings
from pipeline.verdict import Basis, Evidence, Reason, State

BETWEEN_FRAMES = 0.25
"""An expected offset further than this from a whole number of frames cannot be judged in whole frames."""

SURE = 3.0
"""Standard errors by which the best candidate must beat the second: with three to choose from, chance does so in fewer
than one window of a hundred, as far as parts err independently."""

LEAST_PARTS = 8
"""Of fewer parts no scatter can be told."""

MOMENT = {0: "t", 1: "t-1", -1: "t+1"}
"""By the offset each candidate would prove: if t-1 matches, the second camera is a frame ahead."""

Floats: TypeAlias = npt.NDArray[np.float32]
Parts: TypeAlias = npt.NDArray[np.float64]
Candidates: TypeAlias = Mapping[int, Frame]


class CandidateSettings(Settings):
    """always_answer: choose even where the choice is chance, as the report does."""

    always_answer: bool = False

    def least(self, few: int) -> int:
        """Of what must be seen at least: `few`, but one is enough for who always answers."""
        return 1 if self.always_answer else few


@dataclass(frozen=True, slots=True)
class Scores:
    """How well each candidate fits, by the offset it would prove; more is better.

    parts: n numbers a candidate, of the same n parts of the picture, whose differences between two candidates tell how
    far chance moves the difference of their scores. Left out where nobody asks.
    errors: the standard error of each score beyond what its parts show.
    """

    values: Mapping[int, float]
    parts: Mapping[int, Parts] = field(default_factory=dict)
    errors: Mapping[int, float] = field(default_factory=dict)

    @classmethod
    def of_parts(cls, parts: Mapping[int, Parts], errors: Mapping[int, float] | None = None) -> Scores:
        """Each candidate's score is the mean of its parts."""
        means = {offset: float(of_one.mean()) for offset, of_one in parts.items()}
        return cls(means, parts, errors or {})


class CandidateDetector(ABC):
    """Sync if the second camera's frame t fits the first camera's frame t best.

    For a staggered pair, the frame that it is expected to match takes the place of t. Of equals t wins.

    It abstains when it cannot compare (a frame of t is missing, sizes differ, nothing to see) and, unless it is set to
    answer always, when it cannot choose: there is little to see, a neighbour of t is missing, or the best candidate
    beats the second by no more than chance does. Set to answer always, it chooses among the candidates that exist, by
    whatever is to be seen.
    """

    measure: ClassVar[str]
    """What its scores are called."""

    def __init__(self, settings: CandidateSettings, *, name: str, rig: Rig) -> None:
        self._always = settings.always_answer
        self._name = name
        self._rig = rig

    @abstractmethod
    def enter(self, window: Window) -> None:
        """Prepares for the pairs of a window: what was kept of frames that have left it can be forgotten."""

    @abstractmethod
    def compare(self, pair: Pair, first: Frame, candidates: Candidates) -> Scores | Silence:
        """How well the candidates, one to three of the same size as `first`, fit; or why that cannot be told."""

    def observe(self, window: Window) -> Sequence[Evidence]:
        self.enter(window)
        return [self._judge(pair, window) for pair in self._rig.pairs]

    def _judge(self, pair: Pair, window: Window) -> Evidence:
        first, triple = window.cameras[pair.first].current, window.cameras[pair.second]
        if first is None or triple.current is None:
            missing = pair.first if first is None else pair.second
            return self._abstain(pair, Silence(f"no frame of {missing}", Reason.UNPAIRED))
        period_ns = self._rig.camera(pair.second).period_ns
        expected = pair.expected_offset_ns / period_ns
        if abs(expected - round(expected)) > BETWEEN_FRAMES:
            why = f"an expected offset of {expected:.2f} frames lies between whole frames"
            return self._abstain(pair, Silence(why, Reason.NO_EVIDENCE))
        of_second = {0: triple.current, 1: triple.previous, -1: triple.following}
        candidates = {offset: frame for offset, frame in of_second.items() if frame is not None}
        other = next((item for item in candidates.values() if item.image.shape[:2] != first.image.shape[:2]), None)
        if other is not None:
            why = f"picture sizes differ: {_size(first)}, {_size(other)}"
            return self._abstain(pair, Silence(why, Reason.NO_EVIDENCE))
        scores = self.compare(pair, first, candidates)
        if isinstance(scores, Silence):
            return self._abstain(pair, scores)
        return self._choose(pair, scores, round(expected), period_ns)

    def _choose(self, pair: Pair, scores: Scores, expected: int, period_ns: int) -> Evidence:
        values = scores.values
        ranked = sorted(values, key=lambda offset: (values[offset], offset == 0), reverse=True)
        winner, second = ranked[0], ranked[1] if len(ranked) > 1 else None
        numbers = {f"{self.measure}_{MOMENT[offset]}": value for offset, value in values.items()}
        if not self._always:
            absent = [name for offset, name in MOMENT.items() if offset not in values]
            if absent or second is None:
                why = f"no frame of {pair.second} at {absent[0]}, which may be the one"
                return self._abstain(pair, Silence(why, Reason.UNPAIRED), numbers)
            better, chance = values[winner] - values[second], SURE * _error(scores, winner, second)
            if not better > chance:
                why = f"{pair.second} {MOMENT[winner]} and {MOMENT[second]} match alike: {better:.4f} apart"
                return self._abstain(pair, Silence(f"{why}, chance {chance:.4f}", Reason.NO_MOTION), numbers)
        margin = "" if second is None else f", next best {values[second]:.4f}"
        return Evidence(
            pair=pair.name,
            detector=self._name,
            basis=Basis.CONTENT,
            state=State.SYNC if winner == expected else State.ASYNC,
            reason=f"{pair.second} {MOMENT[winner]} matches best: {values[winner]:.4f}{margin}",
            offset_ns=winner * period_ns,
            offset_frames=float(winner),
            numbers=numbers,
        )

    def _abstain(self, pair: Pair, why: Silence, numbers: Mapping[str, float] | None = None) -> Evidence:
        return Evidence(
            pair=pair.name,
            detector=self._name,
            basis=Basis.CONTENT,
            state=State.UNKNOWN,
            reason=str(why),
            numbers=numbers or {},
            silence=reason_of(why),
        )


def _error(scores: Scores, winner: int, second: int) -> float:
    """The standard error of the difference of two scores, from its scatter over the parts."""
    difference = scores.parts[winner] - scores.parts[second]
    if len(difference) < LEAST_PARTS:
        return float("inf")
    by_parts = float(difference.std()) / len(difference) ** 0.5
    return math.hypot(by_parts, scores.errors.get(winner, 0.0), scores.errors.get(second, 0.0))


def _size(frame: Frame) -> str:
    height, width = frame.image.shape[:2]
    return f"{frame.camera} {width}x{height}"
