"""`syncwatch replay`: judge every frame of a recording."""

from __future__ import annotations

import os
import re
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import click
import yaml

from pipeline.assemble import KINDS
from pipeline.cli.common import execute, set_option
from pipeline.configtext.document import load_text
from pipeline.errors import InputError
from pipeline.plan import Plan, make_plan

DEFAULT_DETECTORS = ("timestamp", "offset")


@click.command()
@click.argument("path", nargs=-1, required=True)
@click.option("--fps", type=float, help="Frame rate of a recording without timestamps (30 if unknown).")
@click.option(
    "--fault", "faults", multiple=True, metavar="KIND:KEY=VALUE,...", help="Inject a fault. May be given again."
)
@click.option("--detectors", metavar="A,B", help=f"Which detectors judge (default: {','.join(DEFAULT_DETECTORS)}).")
@click.option("--jsonl", metavar="FILE", help="Write every verdict as a line of JSON; - is standard output.")
@set_option
def replay(
    path: tuple[str, ...],
    fps: float | None,
    faults: tuple[str, ...],
    detectors: str | None,
    jsonl: str | None,
    overrides: tuple[str, ...],
) -> int:
    """Judge the recording at PATH at full speed, every frame.

    PATH is a folder in a known format (EuRoC, image folders, video files), or one image folder or video file a camera.
    """
    plan = recording_plan(path, fps=fps, faults=faults, detectors=detectors, sinks=_sinks(jsonl), overrides=overrides)
    return execute(plan)


def recording_plan(
    paths: Sequence[str],
    *,
    fps: float | None = None,
    faults: Sequence[str] = (),
    detectors: str | None = None,
    sinks: dict[str, Any] | None = None,
    overrides: Sequence[str] = (),
) -> Plan:
    """The plan of a recording, as the command line describes it. Raises InputError."""
    source: dict[str, Any] = {"type": "replay", "path": paths[0] if len(paths) == 1 else list(paths)}
    if fps is not None:
        source["fps"] = fps
    names = DEFAULT_DETECTORS if detectors is None else [name.strip() for name in detectors.split(",")]
    config = {
        "rig": rig_name(paths[0]),
        "source": source,
        "faults": [parse_fault(text) for text in faults],
        "detectors": {name: {} for name in names},
        "sinks": sinks or {},
    }
    text = yaml.safe_dump(config, sort_keys=False).replace("${", "$${")
    return make_plan(load_text(text, "command line", os.environ, overrides, quoted=False), KINDS, Path.cwd())


def rig_name(path: str) -> str:
    """A recording's name as a rig: what its folder or file is called."""
    return re.sub(r"[^A-Za-z0-9_.]+", "_", _name_of(Path(path).resolve())) or "recording"


def _name_of(path: Path) -> str:
    return path.stem if path.is_file() else path.name


def parse_fault(text: str) -> dict[str, Any]:
    """`slip:camera=right,frames=1` as a mapping. Raises InputError."""
    kind, _, rest = text.partition(":")
    fault: dict[str, Any] = {"type": kind}
    for part in filter(None, rest.split(",")):
        key, equals, value = part.partition("=")
        if not equals or not key.strip():
            raise InputError(f"--fault '{text}': '{part}' is not KEY=VALUE, e.g. --fault slip:camera=right,frames=1")
        if key.strip() in fault:
            raise InputError(f"--fault '{text}': '{key.strip()}' is given twice")
        try:
            fault[key.strip()] = yaml.safe_load(value)
        except yaml.YAMLError as error:
            raise InputError(f"--fault '{text}': cannot read the value of '{key.strip()}': {value}") from error
    return fault


def _sinks(jsonl: str | None) -> dict[str, Any]:
    sinks: dict[str, Any] = {"console": {}}
    if jsonl is not None:
        sinks["jsonl"] = {"path": jsonl}
    return sinks
