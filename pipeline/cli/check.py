"""`syncwatch check`: is this in sync?"""

from __future__ import annotations

import re

import click

from pipeline.answer import answer
from pipeline.cli.common import CANNOT_TELL, DONE, OUT_OF_SYNC, execute, set_option
from pipeline.cli.recording import RecordingOptions, plan_of, recording_options
from pipeline.errors import InputError
from pipeline.tally import Tally
from pipeline.verdict import State, Verdict

STATUS = {State.SYNC: DONE, State.ASYNC: OUT_OF_SYNC, State.UNKNOWN: CANNOT_TELL}
UNIT_S = {"ms": 0.001, "s": 1.0, "": 1.0, "m": 60.0, "h": 3600.0}


@click.command()
@click.argument("path", nargs=-1, required=True)
@click.option(
    "--for", "duration", metavar="TIME", help="Judge a live rig for this long, e.g. 10s (default: to the end)."
)
@recording_options
@set_option
def check(path: tuple[str, ...], duration: str | None, options: RecordingOptions, overrides: tuple[str, ...]) -> int:
    """Say whether the recording, or the rig of the configuration, at PATH is in sync.

    Exit status 0: in sync. 3: out of sync. 4: cannot tell.
    """
    tally = Tally()
    plan = plan_of(path, options, sinks={"console": {"style": "progress"}}, overrides=overrides)
    interrupted = execute(
        plan,
        on_report=lambda report: tally.add(report) if isinstance(report, Verdict) else None,
        stop_after_s=None if duration is None else seconds(duration),
    )
    result = answer(tally)
    click.echo(f"{plan.config.rig}: {result.text}")
    return interrupted or STATUS[result.state]


def seconds(text: str) -> float:
    """`10s`, `500ms`, `2m` or `10` as seconds. Raises InputError."""
    match = re.fullmatch(r"(\d+(?:\.\d+)?)(ms|s|m|h|)", text.strip())
    if match is None or float(match[1]) == 0:
        raise InputError(f"--for '{text}': expected a duration such as 10s, 500ms or 2m")
    return float(match[1]) * UNIT_S[match[2]]
