"""`syncwatch events`: what has happened, from a file or from the rigs on the network."""

from __future__ import annotations

import json
import logging
import time
from collections.abc import Iterator
from datetime import datetime, timezone
from pathlib import Path
from typing import TypeAlias

import click
from pydantic import ValidationError

from pipeline.cli.common import DONE, OUT_OF_SYNC, seconds
from pipeline.cli.fleet import PREFIX, fleet_options, fleet_settings
from pipeline.errors import InputError
from pipeline.event_log import older, read_events
from pipeline.fleet.listener import FleetListener
from pipeline.fleet.messages import HeardEvent
from pipeline.fleet.table import Incident, merged
from pipeline.frame import NS_PER_S
from pipeline.terms import INCIDENT_SCHEMA, Message

log = logging.getLogger("syncwatch.cli")

LISTEN = "3s"
"""How long rigs have to tell what has happened: they are found within half a second, and tell at once."""

MOST = 100_000
"""Events of a file that are looked at."""

Told: TypeAlias = tuple[str, Incident]
"""A rig and what happened to it."""


@click.command()
@fleet_options
@click.option(
    "--for", "duration", metavar="TIME", default=LISTEN, show_default=True, help="How long to listen to rigs."
)
@click.option("--last", type=click.IntRange(min=1), default=100, show_default=True, help="How many to list at most.")
@click.option("--json", "as_json", is_flag=True, help="A JSON object a line (syncwatch.incident.v1).")
def events(
    prefix: str | None,
    connect: tuple[str, ...],
    listen: tuple[str, ...],
    mode: str | None,
    network: str | None,
    duration: str,
    last: int,
    as_json: bool,
) -> int:
    """List the last events, oldest first.

    PREFIX is a file that the sink `events` (or `jsonl`) wrote, or else where rigs publish (default: syncwatch).
    Exit status 3: no rig is heard.
    """
    file = Path(prefix or PREFIX)
    if file.suffix == ".jsonl" or file.is_file():
        if connect or listen or mode or network:
            raise InputError(f"{file}: is a file: --connect, --listen, --mode and --network are for rigs")
        told, status = _of_file(file), DONE
        if not told:
            log.warning("%s: no event is in it", file)
    else:
        settings = fleet_settings(prefix, connect, listen, mode, network)
        with FleetListener(settings) as heard:
            time.sleep(seconds(duration))
            rigs, problem = heard.fleet.rigs(), heard.problem
        if problem is not None or not rigs:
            log.warning("%s", problem or f"no rig is heard under '{settings.prefix}'")
        told = [(rig.name, incident) for rig in rigs for incident in rig.incidents]
        status = DONE if rigs else OUT_OF_SYNC
    for rig, incident in sorted(told, key=lambda one: one[1].since_ns)[-last:]:
        click.echo(json.dumps(_json(rig, incident)) if as_json else _line(rig, incident))
    return status


def _of_file(file: Path) -> list[Told]:
    """Raises InputError."""
    if not file.exists() and not older(file).exists():
        raise InputError(f"{file}: there is no such file")
    return list(_incidents(read_events(file, MOST)))


def _incidents(messages: list[Message]) -> Iterator[Told]:
    found: dict[tuple[str, str], Incident] = {}
    for message in messages:
        try:
            event = HeardEvent.model_validate(message)
        except ValidationError:
            continue
        key = (str(message.get("rig", "")), event.id)
        found[key] = merged(found.get(key), event)
    for (rig, _), incident in found.items():
        yield rig, incident


def _json(rig: str, incident: Incident) -> Message:
    return {
        "schema": INCIDENT_SCHEMA,
        "rig": rig,
        "id": incident.id,
        "kind": incident.kind,
        "pair": incident.pair,
        "camera": incident.camera,
        "cause": incident.cause,
        "since_ns": incident.since_ns,
        "until_ns": incident.until_ns,
        "worst": dict(incident.worst),
        "text": incident.text,
    }


def _line(rig: str, incident: Incident) -> str:
    """When, whose, what, how long, and the sentence; by the clock of this machine."""
    since = datetime.fromtimestamp(incident.since_ns / NS_PER_S, tz=timezone.utc).astimezone()
    what = f"{incident.kind} {incident.cause}" if incident.cause else incident.kind
    lasted = "no end"
    if incident.until_ns is not None:
        lasted = f"{(incident.until_ns - incident.since_ns) / NS_PER_S:.1f} s"
    where = incident.pair or incident.camera or ""
    return f"{since:%Y-%m-%d %H:%M:%S}  {rig}  {where}  {what:<16}  {lasted:>8}  {incident.text}"
