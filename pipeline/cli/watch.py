"""`syncwatch watch`: all rigs on the network, in the terminal."""

from __future__ import annotations

import json
import logging
import math
import signal
import sys
import threading
import time
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from types import FrameType

import click
from rich.console import Console, Group
from rich.live import Live
from rich.text import Text

from pipeline.cli.common import DONE, OUT_OF_SYNC, seconds
from pipeline.cli.fleet import fleet_options, fleet_settings
from pipeline.fleet.headline import headline
from pipeline.fleet.listener import FleetListener
from pipeline.fleet.overview import all_well, counted, fleet_message, fleet_table

log = logging.getLogger("syncwatch.cli")

ONCE = "3s"
"""How long is listened before answering once: a status comes every second."""

LOOK_S = 0.25
TELL_EVERY_S = 1.0


@click.command()
@fleet_options
@click.option("--for", "duration", metavar="TIME", help=f"End after this long, e.g. 10s (with --once: {ONCE}).")
@click.option("--once", is_flag=True, help="Listen for a while, say how all rigs stand, and end.")
@click.option("--json", "as_json", is_flag=True, help="A JSON object (syncwatch.fleet.v1) a second, or just one.")
def watch(
    prefix: str | None,
    connect: tuple[str, ...],
    listen: tuple[str, ...],
    mode: str | None,
    network: str | None,
    duration: str | None,
    once: bool,
    as_json: bool,
) -> int:
    """Show all rigs under PREFIX (default: syncwatch) until Ctrl-C: how they stand, since when, and who is gone.

    Exit status after --once or --for: 0 all rigs are well, 3 one is not, or none is heard.
    """
    settings = fleet_settings(prefix, connect, listen, mode, network)
    for_s = seconds(duration or ONCE) if duration or once else math.inf
    with _until_signals() as stop, FleetListener(settings) as heard:
        if once:
            for _ in _ticks(stop, LOOK_S, for_s):
                pass
            _show_once(heard, as_json=as_json)
        elif as_json:
            for _ in _ticks(stop, TELL_EVERY_S, for_s):
                _print_json(heard)
        elif sys.stdout.isatty():
            _show_live(heard, _ticks(stop, LOOK_S, for_s))
        else:
            _print_changes(heard, _ticks(stop, LOOK_S, for_s))
        if heard.problem is not None and (as_json or not once):  # else it has been said
            log.warning("%s", heard.problem)
        if stop.number:
            return 128 + stop.number
        return DONE if all_well(heard.fleet.rigs()) else OUT_OF_SYNC


class _Stop:
    """Set by a signal, whose number it keeps."""

    def __init__(self) -> None:
        self.event = threading.Event()
        self.number = 0

    def handle(self, number: int, _: FrameType | None) -> None:
        self.number = number
        self.event.set()


@contextmanager
def _until_signals() -> Iterator[_Stop]:
    stop = _Stop()
    before = {number: signal.signal(number, stop.handle) for number in (signal.SIGINT, signal.SIGTERM)}
    try:
        yield stop
    finally:
        for number, action in before.items():
            signal.signal(number, action)


def _ticks(stop: _Stop, every_s: float, for_s: float) -> Iterator[None]:
    """Yields again and again until the time is up or a signal has come."""
    until_s = time.monotonic() + for_s
    while (left_s := until_s - time.monotonic()) > 0:
        if stop.event.wait(min(every_s, left_s)):
            return
        yield


def _show_once(heard: FleetListener, *, as_json: bool) -> None:
    if as_json:
        _print_json(heard)
    else:
        console = Console(file=sys.stdout)
        console.print(_page(heard, None, console.width))


def _show_live(heard: FleetListener, ticks: Iterable[None]) -> None:
    console = Console(file=sys.stdout)
    with Live(console=console, screen=True, auto_refresh=False) as live:
        for _ in ticks:
            live.update(_page(heard, console.height, console.width), refresh=True)


def _print_changes(heard: FleetListener, ticks: Iterable[None]) -> None:
    """One line whenever a rig stands otherwise than before: for files and journals."""
    told: dict[str, tuple[str, tuple[str, ...]]] = {}
    problem = heard.problem
    for _ in ticks:
        if problem != heard.problem:
            problem = heard.problem
            log.warning("%s", problem or "rigs can be heard now")
        for rig in heard.fleet.rigs():
            said = headline(rig)
            reasons = () if rig.status is None else rig.status.reasons
            if told.get(rig.name) != (said.word, reasons):
                told[rig.name] = (said.word, reasons)
                click.echo(f"{rig.name}: {said.word}" + (f": {said.detail}" if said.detail else ""))


def _print_json(heard: FleetListener) -> None:
    fleet = heard.fleet
    message = fleet_message(
        heard.settings.prefix,
        fleet.rigs(),
        at_ns=time.time_ns(),
        problem=heard.problem,
        left_out=fleet.left_out,
    )
    click.echo(json.dumps(message, allow_nan=False))


def _page(heard: FleetListener, lines: int | None, width: int) -> Group:
    """lines: how many there are, None for any number; what says how all stand is always among them."""
    rigs = heard.fleet.rigs()
    where = f"under '{heard.settings.prefix}' at {heard.settings.where}"
    foot = [_line(f"no rig is heard {where}", "dim")]
    if rigs:
        count = Text(f"{len(rigs)} {'rig' if len(rigs) == 1 else 'rigs'}: ").append_text(counted(rigs))
        foot = [count, _line(where, "dim")]
    if heard.problem is not None:
        foot.append(_line(heard.problem, "yellow"))
    if not rigs:
        return Group(*foot)
    table, left = fleet_table(rigs, lines=lines and lines - len(foot) - 2, width=width)
    more = [Text(f"and {len(left)} more: ", "dim").append_text(counted(left))] if left else []
    return Group(table, *more, Text(), *foot)


def _line(text: str, style: str) -> Text:
    return Text(text, style, no_wrap=True, overflow="ellipsis")
