"""`syncwatch replay`: judge every frame of a recording."""

from __future__ import annotations

from typing import Any

import click

from pipeline.cli.common import execute, set_option
from pipeline.cli.recording import DEFAULT_DETECTORS, RecordingOptions, recording_options, recording_plan


@click.command()
@click.argument("path", nargs=-1, required=True)
@recording_options
@click.option(
    "--fault", "faults", multiple=True, metavar="KIND:KEY=VALUE,...", help="Inject a fault. May be given again."
)
@click.option("--detectors", metavar="A,B", help=f"Which detectors judge (default: {','.join(DEFAULT_DETECTORS)}).")
@click.option("--jsonl", metavar="FILE", help="Write every verdict as a line of JSON; - is standard output.")
@set_option
def replay(
    path: tuple[str, ...],
    options: RecordingOptions,
    faults: tuple[str, ...],
    detectors: str | None,
    jsonl: str | None,
    overrides: tuple[str, ...],
) -> int:
    """Judge the recording at PATH at full speed, every frame.

    PATH is an MCAP file, a ROS 1 or ROS 2 bag, a folder in a known format (EuRoC, TUM-VI, KITTI, caliscope, depthai,
    image folders, video files), a video with both views, or one image folder or video file a camera.
    """
    plan = recording_plan(path, options, faults=faults, detectors=detectors, sinks=_sinks(jsonl), overrides=overrides)
    return execute(plan)


def _sinks(jsonl: str | None) -> dict[str, Any]:
    sinks: dict[str, Any] = {"console": {}}
    if jsonl is not None:
        sinks["jsonl"] = {"path": jsonl}
    return sinks
