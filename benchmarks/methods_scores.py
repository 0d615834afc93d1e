"""What the comparison of methods comes to: scores by method and clip, and confusions."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, TypeAlias

from pipeline.evaluate.measures import ratio
from pipeline.evaluate.score import Score
from pipeline.verdict import State

Confusion: TypeAlias = dict[str, dict[str, int]]
"""Frames by what was true, then by what was said."""

STILL = ("robot_static", "still", "still_unequal")
"""Recordings in which nothing moves: whatever is answered there is a guess."""

BASE = "spatial"
"""Costs are told as ratios to it."""

right = ratio(lambda item: item.whole_right, lambda item: item.decided)
right_of_all = ratio(lambda item: item.whole_right, lambda item: item.windows)
wrong_of_all = ratio(lambda item: item.decided - item.whole_right, lambda item: item.windows)
abstained = ratio(lambda item: item.windows - item.decided, lambda item: item.windows)


@dataclass(slots=True)
class Seen:
    """What a method made of a clip: as it is, had it always answered, and the CPU ms that windows took."""

    name: str
    said: Score = field(default_factory=lambda: Score("", "", 0))
    forced: Score = field(default_factory=lambda: Score("", "", 0))
    spent_ms: list[float] = field(default_factory=list)


@dataclass(frozen=True, slots=True)
class Method:
    """What a method made of all clips."""

    clips: Sequence[Seen]

    def moving(self, which: Callable[[Seen], Score] = lambda seen: seen.said) -> list[Score]:
        return [which(seen) for seen in self.clips if seen.said.recording not in STILL]

    def still(self) -> list[Score]:
        return [seen.said for seen in self.clips if seen.said.recording in STILL]

    def ratios_to(self, base: Method) -> list[float]:
        """CPU of a window beside the base method's on the same windows, a number a recording, ascending."""
        recordings = dict.fromkeys(seen.said.recording for seen in self.clips)
        return sorted(self._spent(name) / base._spent(name) for name in recordings)

    def _spent(self, recording: str) -> float:
        return sum(sum(seen.spent_ms) for seen in self.clips if seen.said.recording == recording)


@dataclass(slots=True)
class Measured:
    """Methods by name; confusions by experiment and name; with how many processes and in what time."""

    methods: dict[str, Method]
    experiments: dict[str, dict[str, Confusion]]
    jobs: int
    minutes: float = 0.0

    @classmethod
    def from_json(cls, told: Mapping[str, Any]) -> Measured:
        """Raises KeyError or TypeError for what was not kept by this version."""
        methods = {
            name: Method(
                [
                    Seen(one["name"], Score(**one["said"]), Score(**one["forced"]), one["spent_ms"])
                    for one in method["clips"]
                ]
            )
            for name, method in told["methods"].items()
        }
        return cls(methods, told["experiments"], told["jobs"], told["minutes"])


def count(confusion: Confusion, truth: State, said: State) -> int:
    return confusion.get(truth.value, {}).get(said.value, 0)


def right_frames(confusion: Confusion) -> int:
    return sum(count(confusion, state, state) for state in (State.SYNC, State.ASYNC))


def frames(confusion: Confusion) -> int:
    return sum(sum(of_truth.values()) for of_truth in confusion.values())
