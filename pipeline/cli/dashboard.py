"""`syncwatch dashboard`: all rigs on the network, in a browser."""

from __future__ import annotations

import logging
import secrets

import click

from pipeline.cli.fleet import fleet_options, fleet_settings
from pipeline.dashboard.serve import address_of, bind, is_loopback, serve
from pipeline.errors import InputError
from pipeline.fleet.listener import FleetListener

log = logging.getLogger("syncwatch.cli")

SHORTEST_TOKEN = 12


@click.command()
@fleet_options
@click.option("--host", default="127.0.0.1", show_default=True, help="Address to serve on; 0.0.0.0 for everybody.")
@click.option("--port", type=click.IntRange(0, 65535), default=8080, show_default=True, help="0 takes a free one.")
@click.option(
    "--token",
    envvar="SYNCWATCH_TOKEN",
    show_envvar=True,
    help="Who opens the page must know it (default: none on this machine, elsewhere a new one is made and printed).",
)
def dashboard(
    prefix: str | None,
    connect: tuple[str, ...],
    listen: tuple[str, ...],
    mode: str | None,
    network: str | None,
    host: str,
    port: int,
    token: str | None,
) -> int:
    """Show all rigs under PREFIX (default: syncwatch) on a web page that keeps itself up to date.

    Ends with Ctrl-C.
    """
    settings = fleet_settings(prefix, connect, listen, mode, network)
    if token is not None and (len(token) < SHORTEST_TOKEN or not token.isascii() or not token.isprintable()):
        raise InputError(
            f"--token: expected at least {SHORTEST_TOKEN} plain characters; without it, one is made for you"
        )
    with bind(host, port) as bound, FleetListener(settings, previews=True) as listener:
        address = address_of(bound, host)
        if token is None and not is_loopback(bound):
            token = secrets.token_urlsafe(18)
            address += f"?token={token}"
        click.echo(address)
        log.info("showing rigs under '%s', listening at %s; Ctrl-C ends it", settings.prefix, settings.where)
        return 128 + serve(listener, bound, host=host, token=token)
