"""`syncwatch replay`: judge every frame of a recording."""

from __future__ import annotations

from typing import Any

import click

from pipeline.cli.common import execute, set_option
from pipeline.cli.fleet import network_option, read_network
from pipeline.cli.recording import DEFAULT_DETECTORS, RecordingOptions, recording_options, recording_plan
from pipeline.errors import InputError


@click.command()
@click.argument("path", nargs=-1, required=True)
@recording_options
@click.option(
    "--fault", "faults", multiple=True, metavar="KIND:KEY=VALUE,...", help="Inject a fault. May be given again."
)
@click.option("--detectors", metavar="A,B", help=f"Which detectors judge (default: {','.join(DEFAULT_DETECTORS)}).")
@click.option("--jsonl", metavar="FILE", help="Write every verdict as a line of JSON; - is standard output.")
@click.option("--publish", is_flag=True, help="At real speed, with every picture and the status on Zenoh.")
@click.option(
    "--connect", multiple=True, metavar="ENDPOINT", help="With --publish: the router, e.g. tcp/192.168.1.5:7447."
)
@network_option
@set_option
def replay(
    path: tuple[str, ...],
    options: RecordingOptions,
    faults: tuple[str, ...],
    detectors: str | None,
    jsonl: str | None,
    publish: bool,
    connect: tuple[str, ...],
    network: str | None,
    overrides: tuple[str, ...],
) -> int:
    """Judge the recording at PATH, every frame, at full speed, or with --publish at its own.

    PATH is an MCAP file, a ROS 1 or ROS 2 bag, a folder in a known format (EuRoC, TUM-VI, KITTI, caliscope, depthai,
    image folders, video files), a video with both views, or one image folder or video file a camera.
    """
    if not publish and (connect or network):
        raise InputError(f"{'--connect' if connect else '--network'} is of --publish: without it nothing is sent")
    sinks: dict[str, Any] = {"console": {}}
    if jsonl is not None:
        sinks["jsonl"] = {"path": jsonl}
    if publish:
        access = read_network(network) if network else {}
        prefix = {"prefix": access.pop("prefix")} if "prefix" in access else {}
        if connect:
            access |= {"mode": "client", "connect": list(connect)}
        sinks |= {"zenoh": access | prefix, "pictures": access}
        overrides = ("source.speed=1.0", *overrides)
    plan = recording_plan(path, options, faults=faults, detectors=detectors, sinks=sinks, overrides=overrides)
    return execute(plan)
