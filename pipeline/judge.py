"""Weighs the evidence on a pair and says in sync, out of sync and why, or that it cannot tell."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Annotated, Literal

from pydantic import Field

from pipeline.frame import NS_PER_MS, NS_PER_S, Frame, Pair, Rig, Window
from pipeline.settings import Settings
from pipeline.verdict import Basis, Cause, Evidence, PairTruth, Reason, State, Verdict

WHOLE_FRAME = 0.1
"""An offset this close to a whole number of frames, in frames, is called whole: timing jitter of real rigs is below."""


class JudgeSettings(Settings):
    """How evidence becomes a verdict.

    sync_tolerance_ms: the largest offset that is still in sync (auto: 5 ms, but 3 to 10 % of a period).
    combine: `evidence` lets pictures outrank stamps; `classic` is the report's rule: sync only if all detectors say so.
    unknown_is: the level of a rig that cannot be judged.
    """

    sync_tolerance_ms: Literal["auto"] | Annotated[float, Field(gt=0, le=1e9)] = "auto"
    combine: Literal["evidence", "classic"] = "evidence"
    unknown_is: Literal["ok", "warn"] = "ok"


class Judge:
    """One verdict a pair and frame of its first camera.

    trust_stamps: take synthesised stamps for evidence. Under `classic` they always are: the report's rule has no notion
    of where a stamp comes from.
    """

    def __init__(self, settings: JudgeSettings, rig: Rig, *, trust_stamps: bool = False) -> None:
        self._rig = rig
        self._classic = settings.combine == "classic"
        self._trust_stamps = trust_stamps or self._classic
        self._tolerance_ns = {pair.name: _tolerance_ns(settings, rig, pair) for pair in rig.pairs}

    def tolerance_ns(self, pair: Pair) -> int:
        return self._tolerance_ns[pair.name]

    def judge(self, window: Window, evidence: Sequence[Evidence]) -> list[Verdict]:
        """The verdicts of the window's pairs, in the rig's order; none for a pair whose first camera has a hole."""
        return [
            self._verdict(pair, window, [item for item in evidence if item.pair == pair.name])
            for pair in self._rig.pairs
            if window.cameras[pair.first].current is not None
        ]

    def _verdict(self, pair: Pair, window: Window, evidence: Sequence[Evidence]) -> Verdict:
        first, second = (window.cameras[name].current for name in (pair.first, pair.second))
        assert first is not None
        content = _best([item for item in evidence if item.basis is Basis.CONTENT])
        stamps = _best([item for item in evidence if item.basis is Basis.TIMESTAMPS and self._counts(item)])
        decisive: Evidence | None = None
        if second is None:
            reason: Reason | None = Reason.UNPAIRED
        else:
            decisive = _classic(evidence) if self._classic else self._outranking(pair, content, stamps)
            reason = None if decisive else Reason.NO_EVIDENCE
        state = decisive.state if decisive else State.UNKNOWN
        return Verdict(
            rig=self._rig.name,
            pair=pair.name,
            frame=window.cameras[pair.first].number,
            state=state,
            basis=decisive.basis if decisive else Basis.NONE,
            cause=self._cause(pair, decisive, stamps) if decisive and state is State.ASYNC else None,
            reason=reason,
            offset_ns=decisive.offset_ns if decisive else None,
            sigma_ns=decisive.sigma_ns if decisive else None,
            offset_frames=decisive.offset_frames if decisive else None,
            tolerance_ns=self._tolerance_ns[pair.name],
            content=content,
            evidence=tuple(evidence),
            sequence=_by_camera(pair, first.sequence, second.sequence if second else None),
            captured_ns=_by_camera(pair, first.captured_ns, second.captured_ns if second else None),
            notes=_notes(evidence),
            truth=self._truth(pair, first, second),
        )

    def _counts(self, item: Evidence) -> bool:
        return self._trust_stamps or not item.synthesised

    def _outranking(self, pair: Pair, content: Evidence | None, stamps: Evidence | None) -> Evidence | None:
        """Pictures decide where they can; else stamps, held to the tolerance of synchronization; else nothing."""
        if content is not None and content.state is not State.UNKNOWN:
            return content
        if stamps is None or stamps.offset_ns is None:
            return None
        within = abs(stamps.offset_ns - pair.expected_offset_ns) <= self._tolerance_ns[pair.name]
        return replace(stamps, state=State.SYNC if within else State.ASYNC)

    def _cause(self, pair: Pair, decisive: Evidence, stamps: Evidence | None) -> Cause:
        if decisive.basis is Basis.CONTENT and _disagree(self._rig, pair, decisive, stamps):
            return Cause.STAMPS_LIE
        expected = pair.expected_offset_ns / self._rig.camera(pair.first).period_ns
        frames = (decisive.offset_frames or 0.0) - expected
        whole = round(frames) != 0 and abs(frames - round(frames)) <= WHOLE_FRAME
        return Cause.SLIP if whole else Cause.PHASE

    def _truth(self, pair: Pair, first: Frame, second: Frame | None) -> PairTruth | None:
        if second is None or first.truth is None or second.truth is None:
            return None
        offset_ns = second.truth.shown_ns - first.truth.shown_ns
        off = abs(offset_ns - pair.expected_offset_ns) > self._tolerance_ns[pair.name]
        faults = dict.fromkeys((*first.truth.faults, *second.truth.faults))
        assumed = first.truth.assumed or second.truth.assumed
        return PairTruth(offset_ns, State.ASYNC if off else State.SYNC, tuple(faults), assumed)


def _tolerance_ns(settings: JudgeSettings, rig: Rig, pair: Pair) -> int:
    if settings.sync_tolerance_ms != "auto":
        return round(settings.sync_tolerance_ms * NS_PER_MS)
    period_ns = NS_PER_S / max(rig.camera(pair.first).fps, rig.camera(pair.second).fps)
    return round(min(max(5 * NS_PER_MS, 0.03 * period_ns), 0.10 * period_ns))


def _best(items: Sequence[Evidence]) -> Evidence | None:
    """The decided item with the smallest standard error; an undecided one only if there is no other."""

    def rank(item: Evidence) -> tuple[bool, float]:
        return item.state is State.UNKNOWN, float("inf") if item.sigma_frames is None else item.sigma_frames

    return min(items, key=rank, default=None)


def _classic(evidence: Sequence[Evidence]) -> Evidence | None:
    """The report's conjunction: the first that says async, else the last if all say sync, else nothing."""
    for item in evidence:
        if item.state is State.ASYNC:
            return item
    return evidence[-1] if evidence and all(item.state is State.SYNC for item in evidence) else None


def _disagree(rig: Rig, pair: Pair, content: Evidence, stamps: Evidence | None) -> bool:
    """Whether stamps that count tell of an offset more than half a period away from what the pictures show."""
    if stamps is None or stamps.offset_ns is None or content.offset_ns is None:
        return False
    return 2 * abs(stamps.offset_ns - content.offset_ns) > rig.camera(pair.first).period_ns


def _notes(evidence: Sequence[Evidence]) -> tuple[str, ...]:
    return tuple(dict.fromkeys(note for item in evidence for note in item.notes))


def _by_camera(pair: Pair, first: int | None, second: int | None) -> Mapping[str, int | None]:
    return {pair.first: first, pair.second: second}
