"""Renders a rig with a known offset and known faults: frames for a pipeline, and a recording of them."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import yaml

from pipeline.assemble import KINDS, build_rig, build_source, version
from pipeline.cli.recording import DEFAULT_DETECTORS, parse_fault
from pipeline.configtext.document import load_text
from pipeline.frame import Frame, Rig
from pipeline.plan import Plan, make_plan
from sinks.mcap.settings import McapSettings
from sinks.mcap.sink import McapSink


@dataclass(frozen=True, slots=True)
class RenderedRig:
    """A rendered rig. `path` is the recording of it (MCAP), which every command of syncwatch reads, and Foxglove."""

    path: Path
    rig: Rig
    _make_frames: Callable[[], Iterator[Frame]]

    def frames(self) -> Iterator[Frame]:
        """The frames in the order in which the rig delivers them, from the start, with faults, truth noted on each."""
        return self._make_frames()


def render_rig(
    path: Path,
    *,
    offset_ms: float = 0.0,
    faults: Sequence[str] = (),
    seconds: float = 4.0,
    fps: float = 30.0,
    width: int = 320,
    height: int = 240,
    seed: int = 0,
    **scene: Any,
) -> RenderedRig:
    """Renders two cameras, `left` and `right`, into the recording `path`, which is written anew.

    offset_ms: the second camera is triggered so much later, and its stamps say so. faults: as `--fault` takes them,
    e.g. "content_shift:camera=right,frames=1". scene: other settings of the source `synthetic`.

    Raises InputError for what cannot be rendered.
    """
    source = {
        "type": "synthetic", "speed": "max", "duration_s": seconds, "fps": fps, "width": width, "height": height,
        "cameras": [{"name": "left"}, {"name": "right", "offset_ms": offset_ms}], **scene,
    }  # fmt: skip
    text = yaml.safe_dump(
        {
            "rig": "rendered",
            "seed": seed,
            "source": source,
            "faults": [parse_fault(fault) for fault in faults],
            "detectors": {name: {} for name in DEFAULT_DETECTORS},
            "sinks": {},
        }
    )
    plan = make_plan(load_text(text, "render_rig", os.environ, quoted=False), KINDS, Path.cwd())
    rig = _record(plan, path)
    return RenderedRig(path, rig, lambda: _frames(plan))


def _frames(plan: Plan) -> Iterator[Frame]:
    source = build_source(plan, know_truth=True)
    source.open()
    try:
        yield from source.frames()
    finally:
        source.close()


def _record(plan: Plan, path: Path) -> Rig:
    source = build_source(plan)
    source.open()
    rig = build_rig(plan, source)
    settings = McapSettings(path=str(path.resolve()), overwrite=True)
    sink = McapSink(settings, base=Path.cwd(), rig=rig, detectors=(), version=version(), live=False)
    sink.start()
    try:
        for frame in source.frames():
            sink.take_frame(frame)
    finally:
        sink.stop()
        source.close()
    return rig
