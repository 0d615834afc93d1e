"""What is evaluated: a suite file of recordings, manipulations and seeds."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import yaml
from pydantic import Field, ValidationError, model_validator

from pipeline.configtext.document import Document, Problem, load_file, load_text, nearest, problems_from
from pipeline.errors import InputError
from pipeline.notes import Note
from pipeline.plan import Kinds, Plan, make_plan
from pipeline.settings import Settings
from pipeline.verdict import Cause, State

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


class Expected(Settings):
    """What must be said of a scenario while its fault lasts.

    cause: given exactly where the state is async. event: of another kind than `async`. camera: that it must name, and
    that of an async event, by default the second. drift_ppm: what must be told at the end, by stamps and by pictures.
    """

    state: State
    cause: Cause | None = None
    event: Literal["dark", "saturated", "blurred", "swapped", "geometry_shift"] | None = None
    camera: str = "right"
    notes: tuple[Note, ...] = ()
    stamps_ppm: float | None = None
    pictures_ppm: float | None = None

    @model_validator(mode="after")
    def _cause_of_async(self) -> Expected:
        if (self.state is State.ASYNC) != (self.cause is not None):
            raise ValueError("a cause belongs to the state async, and to it alone")
        return self


class Scenario(Settings):
    """A recording, what goes wrong with it, and what must be said.

    row: of a catalogue of failures. about: what happens, in words. recording: the name of one.
    """

    row: str = ""
    about: str = ""
    recording: str
    faults: tuple[Any, ...] = ()
    judge: dict[str, Any] = Field(default={})
    expect: Expected


class SuiteSettings(Settings):
    """A suite file.

    data: the folder that paths of recordings count from, itself relative to the suite file.
    recordings: by name, each a `source` as in a configuration.
    manipulations: by name, each done to all recordings. scenarios: by name, each with what must be said.
    seeds: every combination runs once with each.
    detectors, judge: as in a configuration.
    warm_up_s, warm_up_frames: verdicts at the start that do not count: the longer of both, at most a third of a clip.
    """

    data: str = "."
    recordings: dict[str, dict[str, Any]] = Field(min_length=1)
    manipulations: dict[str, Manipulation] = Field(default={})
    scenarios: dict[str, Scenario] = Field(default={})
    seeds: tuple[int, ...] = Field(default=(0,), min_length=1)
    detectors: dict[str, Any] = Field(min_length=1)
    judge: dict[str, Any] = Field(default={})
    warm_up_s: float = Field(default=2.0, ge=0)
    warm_up_frames: int = Field(default=20, ge=0)

    @model_validator(mode="after")
    def _something_to_do(self) -> SuiteSettings:
        if not self.manipulations and not self.scenarios:
            raise ValueError("manipulations or scenarios are required: what is done to the recordings")
        return self


@dataclass(frozen=True, slots=True)
class Clip:
    """One run of a suite: a recording, manipulated, with a seed. Plain data, so that it can go to another process.

    manipulation: its name, or the scenario's.
    """

    recording: str
    manipulation: str
    seed: int
    config: Mapping[str, Any]
    subsample: SubsampleSettings | None
    base: Path
    warm_up_s: float
    warm_up_frames: int
    scenario: Scenario | None = None

    @property
    def label(self) -> str:
        what = "manipulation" if self.scenario is None else "scenario"
        return f"recording '{self.recording}', {what} '{self.manipulation}'"

    def plan(self, kinds: Kinds) -> Plan:
        """Raises ConfigError that names the clip."""
        text = yaml.safe_dump(dict(self.config)).replace("${", "$${")
        return make_plan(load_text(text, self.label, {}, quoted=False), kinds, self.base)


def load_suite(path: Path, environment: Mapping[str, str], overrides: Sequence[str] = ()) -> Sequence[Clip]:
    """All clips of a suite file, in order, wherever the command was started. Raises InputError.

    A path in the file counts from the file's folder, one in the variable SYNCWATCH_DATA from the current one.
    """
    if not path.exists():
        raise InputError(f"{path}: there is no such suite file")
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
    manipulated = [
        _clip(suite, base, recording, name, seed, manipulation.faults, subsample=manipulation.subsample)
        for recording in suite.recordings
        for name, manipulation in suite.manipulations.items()
        if manipulation.recordings is None or recording in manipulation.recordings
        for seed in suite.seeds
    ]
    staged = [
        _clip(suite, base, scenario.recording, name, seed, scenario.faults, scenario=scenario)
        for name, scenario in suite.scenarios.items()
        for seed in suite.seeds
    ]
    return manipulated + staged


def _clip(
    suite: SuiteSettings,
    base: Path,
    recording: str,
    name: str,
    seed: int,
    faults: Sequence[Any],
    *,
    subsample: SubsampleSettings | None = None,
    scenario: Scenario | None = None,
) -> Clip:
    return Clip(
        recording=recording,
        manipulation=name,
        seed=seed,
        config={
            "rig": "evaluation",
            "seed": seed,
            "source": suite.recordings[recording],
            "faults": list(faults),
            "detectors": suite.detectors,
            "judge": {**suite.judge, **(scenario.judge if scenario else {})},
        },
        subsample=subsample,
        base=(base / suite.data).resolve(),
        warm_up_s=suite.warm_up_s,
        warm_up_frames=suite.warm_up_frames,
        scenario=scenario,
    )


def _unknown_recordings(suite: SuiteSettings) -> list[Problem]:
    known = list(suite.recordings)
    wanted = [
        *(
            (("manipulations", name, "recordings", index), recording)
            for name, manipulation in suite.manipulations.items()
            for index, recording in enumerate(manipulation.recordings or ())
        ),
        *((("scenarios", name, "recording"), scenario.recording) for name, scenario in suite.scenarios.items()),
    ]
    return [
        Problem(path, f"no recording '{recording}'{nearest(recording, known)}")
        for path, recording in wanted
        if recording not in known
    ]
