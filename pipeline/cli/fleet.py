"""What commands share that look at all rigs on the network: where to listen."""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, TypeVar

import click
from pydantic import ValidationError

from pipeline.configtext.document import load_file
from pipeline.configtext.validation import problems_from
from pipeline.errors import InputError
from pipeline.zenoh_network import NetworkSettings
from sinks.zenoh_settings import Prefix, ZenohSettings

Command = TypeVar("Command", bound=Callable[..., Any])

PREFIX = "syncwatch"
FILES = ("password_file", "users_file", "root_ca", "certificate", "private_key")


class NetworkFile(NetworkSettings):
    """How to get onto the network, as the sinks say it, and the prefix under which rigs publish."""

    prefix: Prefix = PREFIX


network_option = click.option(
    "--network",
    metavar="FILE",
    help="A YAML file that says how to get onto the network, by the keys of the sink zenoh: mode, connect, tls, user, "
    "password_file, prefix ...",
)


def fleet_options(command: Command) -> Command:
    """Adds the argument `prefix` and the options `connect`, `listen`, `mode` and `network` (see `fleet_settings`)."""
    for decorate in (
        network_option,
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
        click.argument("prefix", required=False),
    ):
        command = decorate(command)
    return command


def fleet_settings(
    prefix: str | None, connect: Sequence[str], listen: Sequence[str], mode: str | None, network: str | None
) -> ZenohSettings:
    """Where to listen: as the command line says it, else as the file `network` does. Raises InputError."""
    given = {"prefix": prefix, "connect": tuple(connect), "listen": tuple(listen), "mode": mode}
    values = (read_network(network) if network else {}) | {key: value for key, value in given.items() if value}
    if mode == "client" and not values.get("connect"):
        raise InputError("--mode client: needs a router to connect to, e.g. --connect tcp/127.0.0.1:7447")
    values.setdefault("mode", "client" if values.get("connect") else "peer")
    try:
        return ZenohSettings.model_validate(values)
    except ValidationError as error:
        problem = error.errors(include_input=False)[0]
        said = str(problem.get("ctx", {}).get("error", problem["msg"]))
        name = str(problem["loc"][0]) if problem["loc"] else "network"
        raise InputError(f"{'PREFIX' if name == 'prefix' else f'--{name}'}: {said}") from None


def read_network(path: str) -> dict[str, Any]:
    """What the file says, with paths made absolute, which count from its folder, and the mode, which follows `connect`.

    Raises InputError.
    """
    if not Path(path).exists():
        raise InputError(f"--network {path}: there is no such file")
    document = load_file(Path(path), os.environ)
    try:
        NetworkFile.model_validate(document.data)
    except ValidationError as error:
        raise document.error(problems_from(error, (), NetworkFile)) from None
    base = Path(path).absolute().parent
    values = _absolute(document.data, base)
    if values.get("tls"):
        values["tls"] = _absolute(values["tls"], base)
    if values.get("connect"):
        values.setdefault("mode", "client")
    return values


def _absolute(values: dict[str, Any], base: Path) -> dict[str, Any]:
    return {key: str(base / value) if key in FILES and value else value for key, value in values.items()}
