"""Footage for the selftest: what the command line names, or a recording of a live rig, which can be had only once."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

from pipeline.assemble import KINDS, build_source
from pipeline.cli.common import execute, read_plan
from pipeline.cli.recording import RecordingOptions, is_config, recording_plan
from pipeline.errors import InputError
from pipeline.frame import NS_PER_S
from pipeline.plan import Chosen, Plan
from pipeline.selftest.trials import DETECTOR
from pipeline.verdict import Report, Status, Verdict

FIRST_WITHIN_NS = 15 * NS_PER_S
"""How long a live rig may take until its first frame."""


@dataclass(frozen=True, slots=True)
class Footage:
    """What was given on the command line: one configuration, or a recording. taken: a recording of its live rig."""

    paths: tuple[str, ...]
    options: RecordingOptions
    overrides: tuple[str, ...]
    taken: Path | None = None

    def plan(self) -> Plan:
        """Raises InputError."""
        if not is_config(self.paths):
            return recording_plan(self.paths, self.options, detectors=DETECTOR, overrides=self.overrides)
        plan = read_plan(self.paths[0], (*self.overrides, *self.options.overrides))
        return plan if self.taken is None else replace(plan, source=_chosen("source", "replay", self.taken))


def is_live(plan: Plan) -> bool:
    """Whether its source can be had only once."""
    return build_source(plan).live


def take(
    plan: Plan,
    file: Path,
    duration_s: float,
    begin: Callable[[], None],
    clock_ns: Callable[[], int] = time.monotonic_ns,
) -> int:
    """Records a live rig into `file` for so long from its first frame on, when `begin` is called.

    Returns 0, or 130 / 143 after SIGINT / SIGTERM. Raises SyncwatchError, also where nothing comes of a camera.
    """
    asked_ns, ends_ns = clock_ns(), clock_ns() + FIRST_WITHIN_NS
    counts: dict[str, int] = {}
    began = False

    def see(report: Report) -> None:
        nonlocal began, ends_ns
        if isinstance(report, Status):
            counts.update({name: camera.frames for name, camera in report.cameras.items()})
        elif isinstance(report, Verdict) and report.frame is not None and not began:
            began, ends_ns = True, clock_ns() + round(duration_s * NS_PER_S)
            begin()

    recorded = replace(plan, faults=(), detectors={}, sinks={"recording": _chosen("sinks", "mcap", file)})
    status = execute(recorded, on_report=see, until=lambda: clock_ns() >= ends_ns)
    silent = [name for name, count in counts.items() if not count]
    if silent and not status:
        waited_s = (clock_ns() - asked_ns) / NS_PER_S
        raise InputError(f"nothing came of {' and '.join(silent)} within {waited_s:.0f} s: there is nothing to test")
    return status


def _chosen(section: str, name: str, path: Path) -> Chosen:
    kind = KINDS.tables[section][name]
    return Chosen(kind.settings.model_validate({"type": name, "path": str(path)}), kind.build)
