"""What is evaluated: a suite file of recordings, manipulations and seeds."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal

from pydantic import Field, ValidationError, model_validator

from pipeline.configtext.document import Document, Problem, load_file, nearest, problems_from
from pipeline.errors import InputError
from pipeline.evaluate.origin import ClipDocument, Origins
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
    that of an async event, by default the second. unknown: to say nothing at all is as good as the state.
    within_frames: how many frames after the onset it must be called out of sync at the latest.
    stamps_ppm, pictures_ppm: the drift that must be told at the end.
    """

    state: State
    cause: Cause | None = None
    event: Literal["dark", "saturated", "blurred", "swapped", "geometry_shift", "drop", "restarted"] | None = None
    camera: str = "right"
    notes: tuple[Note, ...] = ()
    unknown: bool = False
    within_frames: int | None = Field(default=None, ge=0)
    stamps_ppm: float | None = None
    pictures_ppm: float | None = None

    @model_validator(mode="after")
    def _cause_of_async(self) -> Expected:
        if self.state is not State.ASYNC and (self.cause is not None or self.within_frames is not None):
            raise ValueError("a cause belongs to the state async, and to it alone; so does within_frames")
        return self


class Scenario(Settings):
    """A recording, what goes wrong with it, and what must be said.

    row: of a catalogue of failures. about: what happens, in words.
    recording: the name of one. source: one of its own instead.
    truth: `unknown` where nobody knows how far a recording is really in sync; then no frame counts as true or false,
    and a cause need not be expected.
    buffer: as in a configuration. judge: what differs from the suite's.
    """

    row: str = ""
    about: str = ""
    recording: str | None = None
    source: dict[str, Any] | None = None
    truth: Literal["known", "unknown"] = "known"
    faults: tuple[Any, ...] = ()
    buffer: dict[str, Any] = Field(default={})
    judge: dict[str, Any] = Field(default={})
    expect: Expected

    @model_validator(mode="after")
    def _one_source(self) -> Scenario:
        if (self.recording is None) == (self.source is None):
            raise ValueError("either the name of a recording or a source of its own is required")
        return self

    @model_validator(mode="after")
    def _cause_of_async(self) -> Scenario:
        if self.expect.state is State.ASYNC and self.expect.cause is None and self.truth == "known":
            raise ValueError("expect.cause is required: why it is out of sync")
        return self


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
    recordings: dict[str, dict[str, Any]] = Field(default={})
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
        if self.manipulations and not self.recordings:
            raise ValueError("recordings are required: what the manipulations are done to")
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
    document: ClipDocument | None = field(default=None, repr=False, compare=False)

    @property
    def label(self) -> str:
        what = "manipulation" if self.scenario is None else "scenario"
        return f"recording '{self.recording}', {what} '{self.manipulation}'"

    @property
    def truth_known(self) -> bool:
        return self.scenario is None or self.scenario.truth == "known"

    def plan(self, kinds: Kinds) -> Plan:
        """Raises ConfigError that names the place in the suite."""
        assert self.document is not None, "made by load_suite"
        return make_plan(self.document, kinds, self.base)

    def check_cameras(self, names: Sequence[str]) -> None:
        """Raises ConfigError if something is expected of a camera that the recording does not have."""
        if self.scenario is None or self.document is None:
            return
        camera, state = self.scenario.expect.camera, self.scenario.expect
        if camera not in names and (state.event is not None or state.cause is not None):
            message = f"no camera '{camera}': this rig has {', '.join(names)}"
            raise self.document.error([Problem(("expect", "camera"), message)])


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
    if problems := [*_unknown_recordings(suite), *_names_twice(suite)]:
        raise document.error(problems)
    manipulated = [
        _manipulated(document, suite, base, recording, name, seed)
        for recording in suite.recordings
        for name, manipulation in suite.manipulations.items()
        if manipulation.recordings is None or recording in manipulation.recordings
        for seed in suite.seeds
    ]
    staged = [_staged(document, suite, base, name, seed) for name in suite.scenarios for seed in suite.seeds]
    return manipulated + staged


def _manipulated(document: Document, suite: SuiteSettings, base: Path, recording: str, name: str, seed: int) -> Clip:
    done = suite.manipulations[name]
    own = ("manipulations", name)
    config = _config(suite, seed, suite.recordings[recording], done.faults)
    origins: Origins = {("source",): ("recordings", recording), ("faults",): (*own, "faults")}
    return _clip(document, suite, base, recording, name, seed, config, origins, subsample=done.subsample)


def _staged(document: Document, suite: SuiteSettings, base: Path, name: str, seed: int) -> Clip:
    scenario = suite.scenarios[name]
    own = ("scenarios", name)
    source = scenario.source if scenario.recording is None else suite.recordings[scenario.recording]
    config = _config(suite, seed, source or {}, scenario.faults)
    config["judge"] = {**suite.judge, **scenario.judge}
    config["buffer"] = scenario.buffer
    origins: Origins = {
        ("source",): (*own, "source") if scenario.recording is None else ("recordings", scenario.recording),
        **{(part,): (*own, part) for part in ("faults", "buffer", "expect")},
        **{("judge", key): (*own, "judge", key) for key in scenario.judge},
    }
    return _clip(document, suite, base, scenario.recording or name, name, seed, config, origins, scenario=scenario)


def _config(suite: SuiteSettings, seed: int, source: Mapping[str, Any], faults: Iterable[Any]) -> dict[str, Any]:
    return {
        "rig": "evaluation",
        "seed": seed,
        "source": source,
        "faults": list(faults),
        "detectors": suite.detectors,
        "judge": suite.judge,
    }


def _clip(
    document: Document,
    suite: SuiteSettings,
    base: Path,
    recording: str,
    name: str,
    seed: int,
    config: dict[str, Any],
    origins: Origins,
    *,
    subsample: SubsampleSettings | None = None,
    scenario: Scenario | None = None,
) -> Clip:
    return Clip(
        recording=recording,
        manipulation=name,
        seed=seed,
        config=config,
        subsample=subsample,
        base=(base / suite.data).resolve(),
        warm_up_s=suite.warm_up_s,
        warm_up_frames=suite.warm_up_frames,
        scenario=scenario,
        document=ClipDocument(config, document, origins),
    )


def _names_twice(suite: SuiteSettings) -> list[Problem]:
    twice = [name for name in suite.scenarios if name in suite.manipulations]
    return [Problem(("scenarios", name), "a manipulation has this name, too", at="key") for name in twice]


def _unknown_recordings(suite: SuiteSettings) -> list[Problem]:
    known = list(suite.recordings)
    wanted = [
        *(
            (("manipulations", name, "recordings", index), recording)
            for name, manipulation in suite.manipulations.items()
            for index, recording in enumerate(manipulation.recordings or ())
        ),
        *(
            (("scenarios", name, "recording"), scenario.recording)
            for name, scenario in suite.scenarios.items()
            if scenario.recording is not None
        ),
    ]
    return [
        Problem(path, f"no recording '{recording}'{nearest(recording, known)}")
        for path, recording in wanted
        if recording not in known
    ]
