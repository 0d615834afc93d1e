"""The table a failure: how many runs of each scenario were right, how soon, and what was said falsely."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from statistics import median
from typing import TypeAlias

from pipeline.evaluate.columns import EMPTY, percent
from pipeline.evaluate.outcome import Outcome
from pipeline.evaluate.score import quantile

Cell: TypeAlias = Callable[[Sequence[Outcome]], str]

TAIL = 0.05
"""What is left above a 95 % upper bound."""


def upper_bound(events: int, hours: float) -> float | None:
    """The 95 % upper bound of a rate, events an hour, when so many were seen in so many hours.

    Exact for a Poisson process (Garwood 1936): the rate at which as few events or fewer are seen in one case in twenty.
    None where there was no time.
    """
    if hours <= 0:
        return None
    low, high = 0.0, 10.0 + 3.0 * events
    for _ in range(100):
        middle = (low + high) / 2
        chance = sum(math.exp(-middle + k * math.log(middle) - math.lgamma(k + 1)) for k in range(events + 1))
        low, high = (middle, high) if chance > TAIL else (low, middle)
    return high / hours


def _rightly(value: Callable[[Outcome], bool | None]) -> Cell:
    def cell(runs: Sequence[Outcome]) -> str:
        told = [right for run in runs if (right := value(run)) is not None]
        return f"{sum(told)}/{len(told)}" if told else EMPTY

    return cell


def _delay(value: Callable[[Outcome], float | None], digits: int) -> Cell:
    """Median and 95th percentile; what was not found is later than anything."""

    def cell(runs: Sequence[Outcome]) -> str:
        delays = sorted(math.inf if (late := value(run)) is None else late for run in runs if run.has_onset)
        if not delays:
            return EMPTY
        two = (quantile(delays, 0.5), quantile(delays, 0.95))
        return " / ".join("never" if math.isinf(late) else f"{late:.{digits}f}" for late in two)

    return cell


def _alarms(runs: Sequence[Outcome]) -> str:
    """Rate of false alarms, and its upper bound."""
    hours, count = sum(run.hours_in_sync for run in runs), sum(run.false_alarms for run in runs)
    bound = upper_bound(count, hours)
    return EMPTY if bound is None else f"{count / hours:.2g} (< {bound:.2g})"


def _coverage(runs: Sequence[Outcome]) -> str:
    frames = sum(run.frames for run in runs)
    return f"{percent(sum(run.decided for run in runs) / frames)} %" if frames else EMPTY


def _offset_error(runs: Sequence[Outcome]) -> str:
    errors = [error for run in runs for error in run.offset_errors_ms]
    return f"{median(errors):.2f}" if errors else EMPTY


def _drift_error(runs: Sequence[Outcome]) -> str:
    errors = [run.drift_error for run in runs if run.drift_error is not None]
    return f"{percent(max(errors))} %" if errors else EMPTY


FAILURE_COLUMNS: Mapping[str, Cell] = {
    "right": _rightly(lambda run: run.right if run.state is not None else None),
    "state": _rightly(lambda run: run.state),
    "cause": _rightly(lambda run: run.cause),
    "event": _rightly(lambda run: run.event),
    "notes": _rightly(lambda run: run.notes),
    "frames p50 / p95": _delay(lambda run: run.delay_frames, 0),
    "seconds p50 / p95": _delay(lambda run: run.delay_s, 2),
    "false async": lambda runs: str(sum(run.false_async for run in runs)),
    "false alarms/h": _alarms,
    "decided": _coverage,
    "offset error ms": _offset_error,
    "drift error": _drift_error,
}


def by_scenario(outcomes: Sequence[Outcome]) -> dict[tuple[str, str], list[Outcome]]:
    """Runs by row and name, seeds together, in order."""
    groups: dict[tuple[str, str], list[Outcome]] = {}
    for run in outcomes:
        groups.setdefault((run.row, run.scenario), []).append(run)
    return groups


def failure_cells(runs: Sequence[Outcome]) -> list[str]:
    return [cell(runs) for cell in FAILURE_COLUMNS.values()]


def confusion(runs: Sequence[Outcome]) -> dict[str, dict[str, int]]:
    """Frames by truth (sync, async) and by what was said (sync, async, unknown), summed."""
    total: dict[str, dict[str, int]] = {}
    for run in runs:
        for true, said in run.confusion.items():
            row = total.setdefault(true, {})
            for state, count in said.items():
                row[state] = row.get(state, 0) + count
    return total


def confusions(runs: Sequence[Outcome]) -> dict[str, dict[str, dict[str, int]]]:
    """The same by recording, for those of which the truth is known."""
    names = dict.fromkeys(run.recording for run in runs if run.confusion)
    return {name: confusion([run for run in runs if run.recording == name]) for name in names}
