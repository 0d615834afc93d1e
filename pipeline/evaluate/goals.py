"""Goals of an evaluation, and whether they are met: over all rows that count, and row by row."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from enum import Enum

from pipeline.evaluate.measures import Measure, Scores, decided
from pipeline.evaluate.score import Score

LEAST_DECIDED = 0.5
"""An accuracy that is told only of the easier half of the windows says little about the other half."""

LEAST_WINDOWS = 10
"""Of fewer windows a share moves by more than a tenth with each."""


class Outcome(str, Enum):
    """What became of a goal."""

    MET = "met"
    NOT_MET = "not met"
    NOT_COUNTED = "does not count"


@dataclass(frozen=True, slots=True)
class Goal:
    """What is wanted of a group of clips.

    name, limit: what is measured, and the bound, for people. short: the name where there is little room.
    columns: which columns of a table show it.
    holds: whether the bound is kept by clips.
    accuracy: it is told of decided windows only, so that a row counts only if enough are.
    """

    name: str
    short: str
    limit: str
    columns: tuple[str, ...]
    holds: Callable[[Scores], bool]
    accuracy: bool = True

    def counts(self, row: Scores) -> bool:
        """Whether a row, the clips of a recording and manipulation, can say anything about this goal."""
        if not row or sum(item.windows for item in row) < LEAST_WINDOWS:
            return False
        return not self.accuracy or (decided(row) or 0.0) >= LEAST_DECIDED

    def of_row(self, row: Scores) -> Outcome:
        if not self.counts(row):
            return Outcome.NOT_COUNTED
        return Outcome.MET if self.holds(row) else Outcome.NOT_MET


@dataclass(frozen=True, slots=True)
class Result:
    """A goal after the measurement: the clips of all rows that count, and what became of every row."""

    goal: Goal
    counted: list[Score]
    rows: Mapping[tuple[str, ...], Outcome]

    @property
    def outcome(self) -> Outcome:
        if not self.counted:
            return Outcome.NOT_COUNTED
        return Outcome.MET if self.goal.holds(self.counted) else Outcome.NOT_MET

    def how_many(self, outcome: Outcome) -> int:
        return sum(1 for item in self.rows.values() if item is outcome)


def judge(goal: Goal, rows: Mapping[tuple[str, ...], Scores]) -> Result:
    """Holds a goal against rows, by any key."""
    counted = [item for row in rows.values() if goal.counts(row) for item in row]
    return Result(goal, counted, {key: goal.of_row(row) for key, row in rows.items()})


def at_least(measure: Measure, bound: float) -> Callable[[Scores], bool]:
    def holds(scores: Scores) -> bool:
        value = measure(scores)
        return value is not None and value >= bound

    return holds


def at_most(measure: Measure, bound: float) -> Callable[[Scores], bool]:
    def holds(scores: Scores) -> bool:
        value = measure(scores)
        return value is not None and value <= bound

    return holds


def both(one: Callable[[Scores], bool], other: Callable[[Scores], bool]) -> Callable[[Scores], bool]:
    return lambda scores: one(scores) and other(scores)
