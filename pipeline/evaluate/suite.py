"""What is evaluated: a suite file of recordings, manipulations and seeds."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import yaml
from pydantic import Field, ValidationError

from pipeline.configtext.document import Document, load_text, problems_from
from pipeline.plan import Kinds, Plan, make_plan
from pipeline.settings import Settings


class SubsampleSettings(Settings):
    """Every n-th frame of the first camera against every n-th plus k of the others: an offset of k / n of a period."""

    every: int = Field(ge=1, le=100)
    plus: int = Field(default=0, ge=-100, le=100)


class Manipulation(Settings):
    """What is done to a recording: a sub-sampling first, then faults in order."""

    subsample: SubsampleSettings | None = None
    faults: tuple[Any, ...] = ()


class SuiteSettings(Settings):
    """A suite file.

    data: the folder that paths of recordings count from, itself relative to the suite file.
    recordings: by name, each a `source` as in a configuration.
    manipulations: by name.
    seeds: every combination runs once with each.
    detectors, judge: as in a configuration.
    warm_up_s: verdicts at the start that do not count: so many seconds, at least 20 frames, at most a third of a clip.
    """

    data: str = "."
    recordings: dict[str, dict[str, Any]] = Field(min_length=1)
    manipulations: dict[str, Manipulation] = Field(min_length=1)
    seeds: tuple[int, ...] = Field(default=(0,), min_length=1)
    detectors: dict[str, Any] = Field(min_length=1)
    judge: dict[str, Any] = Field(default={})
    warm_up_s: float = Field(default=2.0, ge=0)


@dataclass(frozen=True, slots=True)
class Clip:
    """One run of a suite: a recording, manipulated, with a seed. Plain data, so that it can go to another process."""

    recording: str
    manipulation: str
    seed: int
    config: Mapping[str, Any]
    subsample: SubsampleSettings | None
    base: Path
    warm_up_s: float

    def plan(self, kinds: Kinds) -> Plan:
        """Raises ConfigError that names the clip."""
        label = f"recording '{self.recording}', manipulation '{self.manipulation}'"
        text = yaml.safe_dump(dict(self.config)).replace("${", "$${")
        return make_plan(load_text(text, label, {}, quoted=False), kinds, self.base)


def read_suite(document: Document, base: Path) -> Sequence[Clip]:
    """All clips of a suite, in order. Raises ConfigError with all that is wrong with the suite itself."""
    try:
        suite = SuiteSettings.model_validate(document.data)
    except ValidationError as error:
        raise document.error(problems_from(error, (), SuiteSettings)) from None
    return [
        Clip(
            recording=recording,
            manipulation=name,
            seed=seed,
            config={
                "rig": "evaluation",
                "seed": seed,
                "source": source,
                "faults": list(manipulation.faults),
                "detectors": suite.detectors,
                "judge": suite.judge,
            },
            subsample=manipulation.subsample,
            base=base / suite.data,
            warm_up_s=suite.warm_up_s,
        )
        for recording, source in suite.recordings.items()
        for name, manipulation in suite.manipulations.items()
        for seed in suite.seeds
    ]
