"""Runs the same footage again and again through the ordinary pipeline: as it is, and changed in known ways."""

from __future__ import annotations

import io
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import as_completed
from dataclasses import dataclass, field, replace
from itertools import pairwise
from math import nan
from typing import Literal, TypeAlias

from pipeline.assemble import KINDS, assemble, build_source
from pipeline.config import PairSettings
from pipeline.detectors.offset.settings import OffsetSettings
from pipeline.frame import NS_PER_MS, NS_PER_S, Camera, Frame, Pair, Rig, Source
from pipeline.plan import Chosen, Plan, adapted
from pipeline.run import Run
from pipeline.selftest.findings import Row
from pipeline.verdict import Report, State, Verdict
from pipeline.workers import workers

DETECTOR = "offset"

Progress: TypeAlias = Callable[[str, int, int | None], None]
"""Hears what is being run, and how much of how much of it is done."""

MakePlan: TypeAlias = Callable[[], Plan]
"""Reads the footage's plan afresh; it must be picklable, as it is called in other processes."""

Rows: TypeAlias = Mapping[str, Sequence[Row]]
"""What was said, by the name of the pair as the rig has it, whichever way round the trial looked at it."""


@dataclass(frozen=True, slots=True, eq=False)
class Trial:
    """One way to run the footage.

    pairs: what is compared; in a `swap`, each is looked at from its second camera; `alone`, the rig has no cameras but
    those of the one pair. moves: by how many of its frames each camera's pictures are moved, from `start_s` of the
    stream on.
    """

    kind: Literal["plain", "shift", "swap", "slip", "alone"]
    pairs: tuple[Pair, ...]
    moves: Mapping[str, int] = field(default_factory=dict)
    start_s: float = 0.0


def loops(rig: Rig) -> list[tuple[Pair, Pair, Pair]]:
    """a-b, b-c and a-c, for the first camera a and each two consecutive others."""
    a, *others = (camera.name for camera in rig.cameras)
    return [(Pair(a, b), Pair(b, c), Pair(a, c)) for b, c in pairwise(others)]


def moves(pairs: Sequence[Pair]) -> dict[str, int]:
    """A step for each camera, as small as can be, so that the two cameras of every pair are moved differently."""
    steps: dict[str, int] = {}
    for name in dict.fromkeys(name for pair in pairs for name in (pair.first, pair.second)):
        partners = [other for p in pairs if name in (p.first, p.second) for other in (p.first, p.second)]
        taken = {steps[other] for other in partners if other in steps}
        nearest = sorted(range(-len(taken), len(taken) + 1), key=lambda step: (abs(step), -step))
        steps[name] = next(step for step in nearest if step not in taken)
    return steps


class TwoCameras:
    """Implements Source: the two cameras of a pair out of another source."""

    def __init__(self, source: Source, pair: Pair) -> None:
        self._source = source
        self._names = (pair.first, pair.second)
        self.open, self.stop, self.close = source.open, source.stop, source.close

    @property
    def cameras(self) -> Sequence[Camera]:
        return [camera for camera in self._source.cameras if camera.name in self._names]

    @property
    def live(self) -> bool:
        return self._source.live

    @property
    def frame_count(self) -> int | None:
        return self._source.frame_count

    def frames(self) -> Iterator[Frame]:
        return (frame for frame in self._source.frames() if frame.camera in self._names)


def open_footage(plan: Plan) -> Source:
    """The plan's source, open, to be run once and at full speed. Raises InputError."""
    settings = adapted(plan.source.settings, {"speed": "max", "loop": False})
    source = build_source(replace(plan, source=replace(plan.source, settings=settings)), know_truth=True)
    source.open()
    return source


def run_all(
    make_plan: MakePlan, trials: Sequence[Trial], jobs: int, progress: Progress
) -> Iterator[tuple[Trial, Rows]]:
    """Each trial with what was said, in their order. Raises SyncwatchError."""
    what = "moved, swapped, slipping"
    progress(what, 0, len(trials))
    with workers(jobs) as pool:
        pending = [pool.submit(run_trial, make_plan, trial) for trial in trials]
        for done, future in enumerate(as_completed(pending), start=1):
            future.result()
            progress(what, done, len(trials))
        yield from zip(trials, (future.result() for future in pending), strict=True)


def run_trial(make_plan: MakePlan, trial: Trial) -> Rows:
    """Opens the footage and runs it. Raises SyncwatchError."""
    plan = changed(make_plan(), trial)
    return run(plan, open_footage(plan), trial)


def run(plan: Plan, source: Source, trial: Trial, on_frame: Callable[[int], None] = lambda _: None) -> Rows:
    """Runs the footage as `changed` has it; its source is open, and closed afterwards. Raises SyncwatchError."""
    rows: dict[str, list[Row]] = {pair.name: [] for pair in trial.pairs}
    asked = {_name(pair, trial): pair for pair in trial.pairs}
    period_ns = {camera.name: camera.period_ns for camera in source.cameras}
    unit_ns = source.cameras[0].period_ns
    if trial.kind == "alone":
        source = TwoCameras(source, trial.pairs[0])

    def collect(verdict: Report) -> None:
        if not isinstance(verdict, Verdict):
            return
        pair = asked[verdict.pair]
        stamp = verdict.captured_ns[pair.first]
        if verdict.frame is not None and stamp is not None:
            second = pair.first if trial.kind == "swap" else pair.second
            row = row_of(verdict, unit_ns, period_ns[second] / unit_ns)
            rows[pair.name].append(replace(row, at_ns=stamp, partner_ns=verdict.captured_ns[pair.second]))
            on_frame(verdict.frame)

    try:
        parts = assemble(plan, source, console=io.StringIO(), on_report=collect)
    except BaseException:
        source.close()
        raise
    Run(parts).execute()
    return rows


def row_of(verdict: Verdict, unit_ns: int, scale: float) -> Row:
    """A verdict as a row, in frames of `unit_ns`; `scale` turns the detector's, the second camera's, into those."""
    row = Row(
        at_ns=0,
        frame=verdict.frame or 0,
        state=State.UNKNOWN,
        truth=0.0 if verdict.truth is None else verdict.truth.offset_ns / unit_ns,
    )
    said = next((item for item in verdict.evidence if item.detector == DETECTOR), None)
    if said is None:
        return row
    return replace(
        row,
        state=said.state,
        offset=nan if said.offset_frames is None else float(said.offset_frames) * scale,
        sigma=nan if said.sigma_frames is None else float(said.sigma_frames) * scale,
        reason=said.reason,
        numbers={
            name: float(value) * (scale if name.endswith("_frames") else 1.0) for name, value in said.numbers.items()
        },
    )


def _name(pair: Pair, trial: Trial) -> str:
    return f"{pair.second}-{pair.first}" if trial.kind == "swap" else pair.name


def changed(plan: Plan, trial: Trial) -> Plan:
    """The plan of a trial: its pairs and moves, the offset detector alone, no sinks."""
    sign = -1 if trial.kind == "swap" else 1
    pairs = tuple(
        PairSettings(pair=_name(pair, trial), expected_offset_ms=sign * pair.expected_offset_ns / NS_PER_MS)
        for pair in trial.pairs
    )
    shift = KINDS.tables["faults"]["content_shift"]
    faults = [
        Chosen(
            shift.settings.model_validate({"camera": camera, "frames": frames, "start_s": trial.start_s}), shift.build
        )
        for camera, frames in trial.moves.items()
        if frames
    ]
    return replace(
        plan,
        config=plan.config.model_copy(update={"pairs": pairs}),
        faults=(*plan.faults, *faults),
        detectors={DETECTOR: _detector(plan)},
        sinks={},
    )


def _detector(plan: Plan) -> Chosen:
    """The plan's own offset detector, else one with the default settings.

    It measures halves of the points, too, has all the time it takes, so that every trial looks at the same windows, and
    neither reads nor keeps what other runs learned of the rig.
    """
    own = next((c.settings for c in plan.detectors.values() if isinstance(c.settings, OffsetSettings)), None)
    settings = (own or OffsetSettings()).model_copy(update={"halves": True, "cpu_percent": 100.0, "rig": None})
    return Chosen(settings, KINDS.tables["detectors"][DETECTOR].build)


def middle_s(rows: Sequence[Row]) -> float:
    """Stream time, in seconds, amid what could be decided; half a period before a frame, so that it begins with it."""
    decided = [row for row in rows if row.decided]
    begin, there = rows[0], decided[len(decided) // 2]
    period_ns = (there.at_ns - begin.at_ns) / max(there.frame - begin.frame, 1)
    return max(there.at_ns - begin.at_ns - period_ns / 2, 0) / NS_PER_S
