"""`syncwatch check`: is this in sync?"""

from __future__ import annotations

import logging
from dataclasses import dataclass, replace
from typing import Any

import click

from pipeline.answer import OF_PART, Answer, answer
from pipeline.check.sampled import Look, sample
from pipeline.check.stretches import STRETCH_FRAMES, Stretch, is_short, stretches
from pipeline.check.survey import Headed, Survey, by_headers, by_length
from pipeline.cli.common import (
    CANNOT_TELL,
    DONE,
    OUT_OF_SYNC,
    carry_out,
    console_of,
    execute,
    open_source,
    said_once,
    set_option,
)
from pipeline.cli.recording import RecordingOptions, duration_of_rig, is_config, plan_of, recording_options
from pipeline.errors import InputError
from pipeline.frame import StampOrigin
from pipeline.plan import Plan
from pipeline.tally import Tally
from pipeline.verdict import State

log = logging.getLogger("syncwatch.check")

STATUS = {State.SYNC: DONE, State.ASYNC: OUT_OF_SYNC, State.UNKNOWN: CANNOT_TELL}
SINKS: dict[str, Any] = {"console": {"style": "progress"}}


@click.command()
@click.argument("path", nargs=-1, required=True)
@click.option("--all", "everything", is_flag=True, help="Look at every frame of a long recording, not at parts of it.")
@click.option(
    "--for", "duration", metavar="TIME", help="Judge a live rig for this long, e.g. 10s (default: to the end)."
)
@recording_options
@set_option
def check(
    path: tuple[str, ...],
    everything: bool,
    duration: str | None,
    options: RecordingOptions,
    overrides: tuple[str, ...],
) -> int:
    """Say whether the recording, or the rig of the configuration, at PATH is in sync.

    Of a long recording the headers are read first, then the pictures of parts of it, those where timestamps are suspect
    and others spread over all of it, until the answer is sure.

    Exit status 0: in sync. 3: out of sync. 4: cannot tell.
    """
    asked = _Asked(path, options, overrides)
    plan = asked.plan()
    stop_after_s = duration_of_rig(duration, path)
    whole = everything or is_config(path) or stop_after_s is not None
    with said_once():
        try:
            status = None if whole else _check_parts(asked, plan)
        except InputError as error:
            log.debug("all of it is looked at, as far as it can be read", exc_info=error)
            status = None
        return _check_all(plan, stop_after_s) if status is None else status


def _check_all(plan: Plan, stop_after_s: float | None) -> int:
    tally = Tally()
    try:
        interrupted = execute(plan, on_report=tally.take, stop_after_s=stop_after_s)
    except InputError:
        if tally.pairs:
            _say(plan, answer(tally), OF_PART)
        raise
    status = _say(plan, answer(tally))
    return interrupted or status


@dataclass(frozen=True, slots=True)
class _Asked:
    """What was given on the command line."""

    path: tuple[str, ...]
    options: RecordingOptions
    overrides: tuple[str, ...]

    def plan(self, part: Stretch | None = None) -> Plan:
        """The plan of all of it, or of a part. Raises InputError."""
        options = self.options
        if part is not None:
            start_s = options.from_s or 0.0
            ends_s = start_s + part.to_s if options.to_s is None else min(start_s + part.to_s, options.to_s)
            options = replace(options, from_s=start_s + part.from_s, to_s=ends_s)
        return plan_of(self.path, options, sinks=SINKS, overrides=self.overrides)


def _say(plan: Plan, result: Answer, more: str = "") -> int:
    click.echo(f"{plan.config.rig}: {result.text}{more}")
    return STATUS[result.state]


def _check_parts(asked: _Asked, plan: Plan) -> int | None:
    """The exit status after looking at parts; None for a recording that is short, or shows too little in them."""
    survey, interrupted = _surveyed(plan)
    if survey is None or interrupted:
        return interrupted or None
    planned = stretches(survey.duration_s, survey.fps, survey.suspects_s)

    statuses: list[int] = []

    def look(stretch: Stretch, one: Look) -> bool:
        statuses.append(execute(asked.plan(stretch), on_report=one.add, until=one.shows_nothing))
        return statuses[-1] == DONE

    result = sample(survey, planned, look)
    if statuses[-1] != DONE:
        return statuses[-1]
    if not result.sure:
        log.info("%d parts of it show too little: all of it is looked at", result.looked)
        return None
    parts = f"{result.looked} part{'s' * (result.looked > 1)} of {STRETCH_FRAMES} frames"
    looked = f"Of {survey.frames} frames, {parts} were looked at; --all looks at every one."
    return _say(plan, result.answer, "".join(f" {said}" for said in (survey.told, looked) if said))


def _surveyed(plan: Plan) -> tuple[Survey | None, int]:
    """What the headers say, None for a recording too short to be worth it; and the status of an interruption."""
    source = open_source(plan)
    first, count = source.cameras[0], source.frame_count
    if not isinstance(source, Headed) or plan.faults or count is None or is_short(count):
        source.close()
        return None, DONE
    if source.stamp_origin is StampOrigin.SYNTHESISED:
        source.close()
        return by_length(first, count), DONE
    survey, parts = by_headers(plan, source, source, console_of(plan))
    return survey, carry_out(parts)
