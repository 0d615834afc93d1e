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
    def shown(self) -> tuple[Finding, ...]:
        """The tests for which the footage decided enough."""
        return tuple(finding for finding in self.findings if finding.outcome is not Outcome.NOT_SHOWN)

    @property
    def failed(self) -> tuple[Finding, ...]:
        return tuple(finding for finding in self.findings if finding.outcome is Outcome.FAILED)

    @property
    def conclusion(self) -> Conclusion:
        """Of the worst pair, as in `check`: a contradiction anywhere, else a pair without proof, else proved."""
        if self.failed:
            return Conclusion.CONTRADICTED
        return Conclusion.NOT_PROVED if self.without_proof else Conclusion.PROVED

    @property
    def without_proof(self) -> tuple[str, ...]:
        """The pairs for which not even a shift and the swap could be shown."""
        shown = {(finding.subject, finding.test.split()[0]) for finding in self.shown}
        return tuple(item.pair for item in self.summaries if not {(item.pair, "shift"), (item.pair, "swap")} <= shown)

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
    if not worth_it:
        return Proof(rig.name, rig.cameras[0].period_ns / NS_PER_MS, summaries, ())
    alone = {pair: Trial("alone", (pair,)) for of_loop in loops(rig) for pair in of_loop}
    trials = further_trials(worth_it, plain)
    told = dict(run_all(make_plan, [*trials, *alone.values()], jobs, progress))
    findings = [finding for pair in worth_it for finding in _findings(pair, rig, plain, {t: told[t] for t in trials})]
    by_itself = {pair: told[trial][pair.name] for pair, trial in alone.items()}
    findings += [
        loop((ab.first, ab.second, ac.second), by_itself[ab], by_itself[bc], by_itself[ac]) for ab, bc, ac in loops(rig)
    ]
    return Proof(rig.name, rig.cameras[0].period_ns / NS_PER_MS, summaries, tuple(findings))


def _as_recorded(plan: Plan, progress: Progress) -> tuple[Rig, Rows]:
    source = open_footage(plan)
    try:
        rig = build_rig(plan, source)
    except BaseException:
        source.close()
        raise
    count, trial = source.frame_count, Trial("plain", rig.pairs)
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
