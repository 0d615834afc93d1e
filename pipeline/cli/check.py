"""`syncwatch check`: is this in sync?"""

from __future__ import annotations

import re
from pathlib import Path

import click

from pipeline.answer import answer
from pipeline.cli.common import CANNOT_TELL, DONE, OUT_OF_SYNC, execute, read_plan, set_option
from pipeline.cli.replay import recording_plan
from pipeline.errors import InputError
from pipeline.plan import Plan
from pipeline.tally import Tally
from pipeline.verdict import State, Verdict

STATUS = {State.SYNC: DONE, State.ASYNC: OUT_OF_SYNC, State.UNKNOWN: CANNOT_TELL}
UNIT_S = {"ms": 0.001, "s": 1.0, "": 1.0, "m": 60.0, "h": 3600.0}


@click.command()
@click.argument("path", nargs=-1, required=True)
@click.option(
    "--for", "duration", metavar="TIME", help="Judge a live rig for this long, e.g. 10s (default: to the end)."
)
@click.option("--fps", type=float, help="Frame rate of a recording without timestamps (30 if unknown).")
@set_option
def check(path: tuple[str, ...], duration: str | None, fps: float | None, overrides: tuple[str, ...]) -> int:
    """Say whether the recording, or the rig of the configuration, at PATH is in sync.

    Exit status 0: in sync. 3: out of sync. 4: cannot tell.
    """
    tally = Tally()
    plan = _plan(path, fps, overrides)
    interrupted = execute(
        plan,
        on_report=lambda report: tally.add(report) if isinstance(report, Verdict) else None,
        stop_after_s=None if duration is None else seconds(duration),
    )
    result = answer(tally)
    click.echo(f"{plan.config.rig}: {result.text}")
    return interrupted or STATUS[result.state]


def _plan(path: tuple[str, ...], fps: float | None, overrides: tuple[str, ...]) -> Plan:
    if len(path) == 1 and Path(path[0]).suffix in {".yaml", ".yml"}:
        if fps is not None:
            overrides = (*overrides, f"source.fps={fps}")
        return read_plan(path[0], (*overrides, "sinks={console: {style: progress}}"))
    return recording_plan(path, fps=fps, sinks={"console": {"style": "progress"}}, overrides=overrides)


def seconds(text: str) -> float:
    """`10s`, `500ms`, `2m` or `10` as seconds. Raises InputError."""
    match = re.fullmatch(r"(\d+(?:\.\d+)?)(ms|s|m|h|)", text.strip())
    if match is None or float(match[1]) == 0:
        raise InputError(f"--for '{text}': expected a duration such as 10s, 500ms or 2m")
    return float(match[1]) * UNIT_S[match[2]]
