"""Puts the trials and the findings together: is the detector proved right on this footage, wrong, or neither?"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from enum import Enum
from typing import Any

from pipeline.assemble import build_rig
from pipeline.frame import NS_PER_MS, Pair, Rig
from pipeline.plan import Plan
from pipeline.selftest.findings import Finding, Outcome, halves, loop, shifted, slip, swapped
from pipeline.selftest.summary import Summary, summary
from pipeline.selftest.trials import (
    MakePlan,
    Progress,
    Rows,
    Trial,
    changed,
    loops,
    middle_s,
    moves,
    open_footage,
    plain_trial,
    run,
    run_all,
)

SCHEMA = "syncwatch.selftest.v1"

SHIFTS = (1, -2)
"""Frames by which pictures are moved: to either side, once within the reach of tracking and once past it."""

HALVES = (("odd", "even", True), ("up", "down", False), ("slow", "fast", False), ("near", "far", False))


class Conclusion(str, Enum):
    """What the selftest comes to."""

    PROVED = "proved"
    CONTRADICTED = "contradicted"
    NOT_PROVED = "not proved"


@dataclass(frozen=True, slots=True)
class Proof:
    """Everything that was found about the footage of one rig; period_ms is that of its first camera."""

    rig: str
    period_ms: float
    summaries: tuple[Summary, ...]
    findings: tuple[Finding, ...]

    @property
    def conclusion(self) -> Conclusion:
        """Of the worst pair, as in `check`: a contradiction anywhere, else a pair without proof, else proved."""
        if any(finding.outcome is Outcome.FAILED for finding in self.findings):
            return Conclusion.CONTRADICTED
        return Conclusion.PROVED if all(self.is_proved(item.pair) for item in self.summaries) else Conclusion.NOT_PROVED

    def is_proved(self, pair: str) -> bool:
        """Whether at least a shift and the swap could be shown, and nothing that could be contradicts them."""
        of_pair = [finding for finding in self.findings if finding.subject == pair]
        passed = {finding.test.split()[0] for finding in of_pair if finding.outcome is Outcome.PASSED}
        return {"shift", "swap"} <= passed and not any(finding.outcome is Outcome.FAILED for finding in of_pair)

    def to_json(self) -> dict[str, Any]:
        return {
            "schema": SCHEMA,
            "rig": self.rig,
            "conclusion": self.conclusion.value,
            "period_ms": self.period_ms,
            "pairs": [item.to_json(self.period_ms) for item in self.summaries],
            "tests": [finding.to_json() for finding in self.findings],
        }


def prove(make_plan: MakePlan, jobs: int, progress: Progress) -> Proof:
    """Runs the footage as it is and, where that decides anything, changed in known ways, on `jobs` processes.

    Raises SyncwatchError.
    """
    rig, plain = _as_recorded(make_plan(), progress)
    summaries = tuple(summary(pair.name, plain[pair.name]) for pair in rig.pairs)
    worth_it = tuple(pair for pair, found in zip(rig.pairs, summaries, strict=True) if found.can_prove)
    told = dict(run_all(make_plan, further_trials(worth_it, plain), jobs, progress)) if worth_it else {}
    findings = [finding for pair in worth_it for finding in _findings(pair, rig, plain, told)]
    closed = [
        loop((ab.first, ab.second, ac.second), plain[ab.name], plain[bc.name], plain[ac.name])
        for ab, bc, ac in loops(rig)
    ]
    return Proof(rig.name, rig.cameras[0].period_ns / NS_PER_MS, summaries, (*findings, *closed))


def _as_recorded(plan: Plan, progress: Progress) -> tuple[Rig, Rows]:
    source = open_footage(plan)
    try:
        rig = build_rig(plan, source.cameras)
    except BaseException:
        source.close()
        raise
    count, trial = source.frame_count, plain_trial(rig)
    return rig, run(changed(plan, trial), source, trial, lambda frame: progress("as recorded", frame + 1, count))


def further_trials(pairs: tuple[Pair, ...], plain: Rows) -> list[Trial]:
    """The footage moved, swapped, and slipping by a frame amid what could be decided of the first of the pairs."""
    steps = moves(pairs)
    begin_s = middle_s(plain[pairs[0].name])
    return [
        *(Trial("shift", pairs, {name: frames * step for name, step in steps.items()}) for frames in SHIFTS),
        Trial("swap", pairs),
        Trial("slip", pairs, steps, begin_s),
    ]


def _findings(pair: Pair, rig: Rig, plain: Rows, told: Mapping[Trial, Rows]) -> Iterator[Finding]:
    name, rows = pair.name, plain[pair.name]
    period_ns = rig.cameras[0].period_ns
    for trial, of_trial in told.items():
        if trial.kind == "swap":
            yield swapped(name, rows, of_trial[name])
        elif trial.kind == "slip":
            yield slip(name, rows, of_trial[name], period_ns / NS_PER_MS)
        else:
            moved = [trial.moves.get(camera, 0) * rig.camera(camera).period_ns for camera in (pair.second, pair.first)]
            yield shifted(name, rows, of_trial[name], (moved[0] - moved[1]) / period_ns)
    for one, other, alike in HALVES:
        yield halves(name, rows, one, other, alike=alike)
