"""`syncwatch record`: frames and verdicts into an MCAP file."""

from __future__ import annotations

from pathlib import Path
from typing import Any, get_args

import click

from pipeline.answer import answer
from pipeline.cli.common import execute, seconds, set_option
from pipeline.cli.recording import RecordingOptions, duration_of_rig, plan_of, recording_options
from pipeline.mcap.frames import Pictures
from pipeline.tally import Tally


@click.command()
@click.argument("path", nargs=-1, required=True)
@click.option(
    "-o", "--output", required=True, metavar="FILE.mcap", help="The file to write; {rig} and {time} are filled in."
)
@click.option("--pictures", type=click.Choice(get_args(Pictures)), help="How pictures are stored (default: raw).")
@click.option("--around-events", metavar="TIME", help="Record only what is this close to an event, e.g. 5s.")
@click.option("--for", "duration", metavar="TIME", help="Record for this long, e.g. 60s (default: to the end).")
@click.option("--force", is_flag=True, help="Replace FILE.mcap if it is there.")
@recording_options
@set_option
def record(
    path: tuple[str, ...],
    output: str,
    pictures: str | None,
    around_events: str | None,
    duration: str | None,
    force: bool,
    options: RecordingOptions,
    overrides: tuple[str, ...],
) -> int:
    """Record the rig of a configuration, or another recording, at PATH into an MCAP file while judging it.

    Of the configuration's sinks only the recording is used; --set sinks.mcap.KEY=VALUE changes how it is made.
    """
    settings: dict[str, Any] = {"path": str(Path(output).expanduser().absolute()) if output != "-" else output}
    if pictures is not None:
        settings["pictures"] = pictures
    if around_events is not None:
        settings["around_events_s"] = seconds(around_events, "--around-events")
    if force:
        settings["overwrite"] = True
    stop_after_s = duration_of_rig(duration, path)
    tally = Tally()
    plan = plan_of(path, options, sinks={"console": {"style": "progress"}, "mcap": settings}, overrides=overrides)
    interrupted = execute(
        plan,
        on_report=tally.take,
        stop_after_s=stop_after_s,
    )
    click.echo(f"{plan.config.rig}: {answer(tally).text}")
    return interrupted
