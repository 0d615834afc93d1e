"""What is evaluated: a suite file of recordings, manipulations and seeds."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import yaml
from pydantic import Field, ValidationError

from pipeline.configtext.document import Document, Problem, load_file, load_text, nearest, problems_from
from pipeline.plan import Kinds, Plan, make_plan
from pipeline.settings import Settings

DATA_VARIABLE = "SYNCWATCH_DATA"
"""Names the folder of recordings, in suites and tests."""


class SubsampleSettings(Settings):
    """Every n-th frame of the first camera against every n-th plus k of the others: an offset of k / n of a period."""

    every: int = Field(ge=1, le=100)
    plus: int = Field(default=0, ge=-100, le=100)


class Manipulation(Settings):
    """What is done to a recording: a sub-sampling first, then faults in order.

    recordings: the names of those it is done to; left out: to all.
    """

    subsample: SubsampleSettings | None = None
    faults: tuple[Any, ...] = ()
    recordings: tuple[str, ...] | None = None


class SuiteSettings(Settings):
    """A suite file.

    data: the folder that paths of recordings count from, itself relative to the suite file.
    recordings: by name, each a `source` as in a configuration.
    manipulations: by name.
    seeds: every combination runs once with each.
    detectors, judge: as in a configuration.
    warm_up_s, warm_up_frames: verdicts at the start that do not count: the longer of both, at most a third of a clip.
    """

    data: str = "."
    recordings: dict[str, dict[str, Any]] = Field(min_length=1)
    manipulations: dict[str, Manipulation] = Field(min_length=1)
    seeds: tuple[int, ...] = Field(default=(0,), min_length=1)
    detectors: dict[str, Any] = Field(min_length=1)
    judge: dict[str, Any] = Field(default={})
    warm_up_s: float = Field(default=2.0, ge=0)
    warm_up_frames: int = Field(default=20, ge=0)


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
    warm_up_frames: int

    @property
    def label(self) -> str:
        return f"recording '{self.recording}', manipulation '{self.manipulation}'"

    def plan(self, kinds: Kinds) -> Plan:
        """Raises ConfigError that names the clip."""
        text = yaml.safe_dump(dict(self.config)).replace("${", "$${")
        return make_plan(load_text(text, self.label, {}, quoted=False), kinds, self.base)


def load_suite(path: Path, environment: Mapping[str, str], overrides: Sequence[str] = ()) -> Sequence[Clip]:
    """All clips of a suite file, in order, wherever the command was started. Raises ConfigError.

    A path in the file counts from the file's folder, one in the variable SYNCWATCH_DATA from the current one.
    """
    given = dict(environment)
    if given.get(DATA_VARIABLE):
        given[DATA_VARIABLE] = str(Path(given[DATA_VARIABLE]).absolute())
    return read_suite(load_file(path, given, overrides), path.resolve().parent)


def read_suite(document: Document, base: Path) -> Sequence[Clip]:
    """All clips of a suite, in order. Raises ConfigError with all that is wrong with the suite itself."""
    try:
        suite = SuiteSettings.model_validate(document.data)
    except ValidationError as error:
        raise document.error(problems_from(error, (), SuiteSettings)) from None
    if problems := _unknown_recordings(suite):
        raise document.error(problems)
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
            base=(base / suite.data).resolve(),
            warm_up_s=suite.warm_up_s,
            warm_up_frames=suite.warm_up_frames,
        )
        for recording, source in suite.recordings.items()
        for name, manipulation in suite.manipulations.items()
        if manipulation.recordings is None or recording in manipulation.recordings
        for seed in suite.seeds
    ]


def _unknown_recordings(suite: SuiteSettings) -> list[Problem]:
    return [
        Problem(("manipulations", name, "recordings", index), f"no recording '{wanted}'{nearest(wanted, known)}")
        for known in [list(suite.recordings)]
        for name, manipulation in suite.manipulations.items()
        for index, wanted in enumerate(manipulation.recordings or ())
        if wanted not in known
    ]
