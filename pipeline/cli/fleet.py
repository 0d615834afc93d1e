"""What commands share that look at all rigs on the network: where to listen."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TypeVar

import click
from pydantic import ValidationError

from pipeline.errors import InputError
from sinks.zenoh_settings import ZenohSettings

Command = TypeVar("Command", bound=Callable[..., int])


def fleet_options(command: Command) -> Command:
    """Adds the argument `prefix` and the options `connect`, `listen` and `mode` (see `fleet_settings`)."""
    for decorate in (
        click.option(
            "--mode",
            type=click.Choice(["peer", "client", "router"]),
            help="How to take part in Zenoh's network (default: client with --connect, else peer).",
        ),
        click.option("--listen", multiple=True, metavar="ENDPOINT", help="Where rigs may connect to. May be repeated."),
        click.option(
            "--connect",
            multiple=True,
            metavar="ENDPOINT",
            help="The router to hear rigs through, or a rig that listens, e.g. tcp/192.168.1.5:7447. May be repeated; "
            "without it, rigs on this machine are heard.",
        ),
        click.argument("prefix", default="syncwatch"),
    ):
        command = decorate(command)
    return command


def fleet_settings(prefix: str, connect: Sequence[str], listen: Sequence[str], mode: str | None) -> ZenohSettings:
    """Where to listen, as the command line says it. Raises InputError."""
    if mode == "client" and not connect:
        raise InputError("--mode client: needs a router to connect to, e.g. --connect tcp/127.0.0.1:7447")
    values = {
        "prefix": prefix,
        "connect": tuple(connect),
        "listen": tuple(listen),
        "mode": mode or ("client" if connect else "peer"),
    }
    try:
        return ZenohSettings.model_validate(values)
    except ValidationError as error:
        problem = error.errors()[0]
        said = str(problem.get("ctx", {}).get("error", problem["msg"]))
        name = str(problem["loc"][0])
        raise InputError(f"{'PREFIX' if name == 'prefix' else f'--{name}'}: {said}") from None
