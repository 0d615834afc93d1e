"""What commands about a recording share: the options that say how it is read, and the plan they make."""

from __future__ import annotations

import functools
import json
import os
import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import click
import yaml

from pipeline.assemble import KINDS
from pipeline.cli.common import read_plan, seconds
from pipeline.configtext.document import load_text
from pipeline.errors import InputError
from pipeline.plan import Plan, make_plan

DEFAULT_DETECTORS = ("timestamp", "offset")


@dataclass(frozen=True, slots=True)
class RecordingOptions:
    """How a recording is read, as the command line has it; None where it is not given."""

    fps: float | None = None
    topics: str | None = None
    from_s: float | None = None
    to_s: float | None = None
    layout: str | None = None

    @property
    def settings(self) -> dict[str, Any]:
        """The settings of the source that were given. Raises InputError."""
        given = {
            "fps": self.fps,
            "topics": None if self.topics is None else parse_topics(self.topics),
            "from_s": self.from_s,
            "to_s": self.to_s,
            "layout": self.layout,
        }
        return {key: value for key, value in given.items() if value is not None}

    @property
    def overrides(self) -> tuple[str, ...]:
        """The same as overrides of a configuration. Raises InputError."""
        return tuple(f"source.{key}={json.dumps(value)}" for key, value in self.settings.items())


AS_IT_IS = RecordingOptions()


def recording_options(command: Callable[..., Any]) -> Callable[..., Any]:
    """Adds the options that say how a recording is read; the command gets them as one, `options`."""

    @functools.wraps(command)
    def with_options(
        *args: Any,
        fps: float | None,
        topics: str | None,
        from_s: float | None,
        to_s: float | None,
        layout: str | None,
        **others: Any,
    ) -> Any:
        return command(*args, options=RecordingOptions(fps, topics, from_s, to_s, layout), **others)

    decorated: Callable[..., Any] = with_options
    for option in (
        click.option("--layout", metavar="LAYOUT", help="Of a video with both views: side_by_side or top_bottom."),
        click.option("--to", "to_s", type=float, metavar="S", help="Stop this many seconds into the recording."),
        click.option("--from", "from_s", type=float, metavar="S", help="Start this many seconds into the recording."),
        click.option("--topics", metavar="NAME=/TOPIC,...", help="Which topics of a bag or MCAP are the cameras."),
        click.option("--fps", type=float, help="Frame rate of a recording without timestamps (30 if unknown)."),
    ):
        decorated = option(decorated)
    return decorated


FOR_RECORDING = "--for is of a live rig: of a recording, --from and --to say which part is looked at"


def duration_of_rig(text: str | None, paths: Sequence[str]) -> float | None:
    """What --for says in seconds, None where it is not given. Raises InputError, also where PATH is a recording."""
    if text is None:
        return None
    if not is_config(paths):
        raise InputError(FOR_RECORDING)
    return seconds(text)


def is_config(paths: Sequence[str]) -> bool:
    return len(paths) == 1 and Path(paths[0]).suffix in {".yaml", ".yml"}


def plan_of(
    paths: Sequence[str],
    options: RecordingOptions = AS_IT_IS,
    *,
    sinks: dict[str, Any],
    overrides: Sequence[str] = (),
) -> Plan:
    """The plan of a configuration with other sinks, or of a recording. Raises InputError."""
    if is_config(paths):
        return read_plan(paths[0], (f"sinks={json.dumps(sinks, ensure_ascii=False)}", *options.overrides, *overrides))
    return recording_plan(paths, options, sinks=sinks, overrides=overrides)


def recording_plan(
    paths: Sequence[str],
    options: RecordingOptions = AS_IT_IS,
    *,
    faults: Sequence[str] = (),
    detectors: str | None = None,
    sinks: dict[str, Any] | None = None,
    overrides: Sequence[str] = (),
) -> Plan:
    """The plan of a recording, as the command line describes it. Raises InputError."""
    path = paths[0] if len(paths) == 1 else list(paths)
    names = DEFAULT_DETECTORS if detectors is None else [name.strip() for name in detectors.split(",")]
    config = {
        "rig": rig_name(paths[0]),
        "source": {"type": "replay", "path": path, **options.settings},
        "faults": [parse_fault(text) for text in faults],
        "detectors": {name: {} for name in names},
        "sinks": sinks or {},
    }
    text = yaml.safe_dump(config, sort_keys=False).replace("${", "$${")
    return make_plan(load_text(text, "command line", os.environ, overrides, quoted=False), KINDS, Path.cwd())


def rig_name(path: str) -> str:
    """A recording's name as a rig: what its folder or file is called."""
    return re.sub(r"[^A-Za-z0-9_.]+", "_", _name_of(Path(os.path.realpath(path)))) or "recording"


def _name_of(path: Path) -> str:
    return path.stem if path.is_file() else path.name


def parse_topics(text: str) -> dict[str, str] | list[str]:
    """`left=/cam0/image_raw,right=/cam1/image_raw` by names, `/cam0/image_raw,/cam1/image_raw` in order.

    Raises InputError.
    """
    parts = [part.strip() for part in text.split(",")]
    named = [part.partition("=") for part in parts]
    if all(equals and name.strip() and topic.strip() for name, equals, topic in named):
        topics = {name.strip(): topic.strip() for name, _, topic in named}
        if len(topics) == len(parts):
            return topics
        raise InputError(f"--topics '{text}': a camera is named twice")
    if len(parts) > 1 and all(parts) and not any(equals for _, equals, _ in named):
        return parts
    raise InputError(
        f"--topics '{text}': expected NAME=/TOPIC for each camera, e.g. left=/cam0/image_raw,right=/cam1/image_raw"
    )


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
