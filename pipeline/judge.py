"""Weighs the evidence on the pairs of a rig: in sync, out of sync and why, or unknown."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Annotated, Literal

from pydantic import Field

from pipeline.frame import NS_PER_MS, NS_PER_S, Pair, Rig, Window
from pipeline.health.observer import Observation
from pipeline.range_error import RangeCase, RangeSettings
from pipeline.rulings import ClassicPair, PairJudge, WeighedPair
from pipeline.settings import Settings
from pipeline.verdict import Evidence, Verdict


class JudgeSettings(Settings):
    """How evidence becomes a verdict.

    sync_tolerance_ms: the largest offset that is still in sync (auto: 5 ms, but 3 to 10 % of a period).
    combine: `evidence` lets pictures outrank stamps; `classic` is the report's rule: sync only if all detectors say so.
    unknown_is: the level of a rig that cannot be judged.
    range: states with every verdict what the offset does to a range measured by stereo.
    """

    sync_tolerance_ms: Literal["auto"] | Annotated[float, Field(gt=0, le=1e9)] = "auto"
    combine: Literal["evidence", "classic"] = "evidence"
    unknown_is: Literal["ok", "warn"] = "ok"
    range: RangeSettings | None = None


class Judge:
    """One verdict a pair and frame of its first camera; while that camera is missing, one a second.

    That the second one is missing is told at once as well, where frames of the first are held back for it.

    trust_stamps: take synthesised stamps for evidence. Under `classic` they always are: the report's rule has no notion
    of where a stamp comes from. ranges: by pair, what to say of the offset's effect on a range.
    """

    def __init__(
        self,
        settings: JudgeSettings,
        rig: Rig,
        *,
        trust_stamps: bool = False,
        ranges: Mapping[str, RangeCase] | None = None,
    ) -> None:
        cases = ranges or {}
        self._tolerance_ns = {pair.name: _tolerance_ns(settings, rig, pair) for pair in rig.pairs}
        self._pairs: list[PairJudge] = [
            ClassicPair(rig, pair, self.tolerance_ns(pair), cases.get(pair.name))
            if settings.combine == "classic"
            else WeighedPair(rig, pair, self.tolerance_ns(pair), cases.get(pair.name), trust_stamps=trust_stamps)
            for pair in rig.pairs
        ]

    def tolerance_ns(self, pair: Pair) -> int:
        return self._tolerance_ns[pair.name]

    def judge(
        self, window: Window, evidence: Sequence[Evidence], observation: Observation | None = None
    ) -> list[Verdict]:
        """The verdicts of the window's pairs, in the rig's order; none for a pair whose first camera has a hole.

        observation: what is known of the health of the cameras.
        """
        seen = observation or Observation()
        said = (one.judge(window, [item for item in evidence if item.pair == one.name], seen) for one in self._pairs)
        return [verdict for verdict in said if verdict is not None]

    def silence(self, observation: Observation) -> list[Verdict]:
        """The verdicts of pairs of which a camera is missing, while no window comes at all: call it once a second."""
        said = (one.silence(observation) for one in self._pairs)
        return [verdict for verdict in said if verdict is not None]


def _tolerance_ns(settings: JudgeSettings, rig: Rig, pair: Pair) -> int:
    if settings.sync_tolerance_ms != "auto":
        return round(settings.sync_tolerance_ms * NS_PER_MS)
    period_ns = NS_PER_S / max(rig.camera(pair.first).fps, rig.camera(pair.second).fps)
    return round(min(max(5 * NS_PER_MS, 0.03 * period_ns), 0.10 * period_ns))
