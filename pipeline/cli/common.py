"""What commands share: finding the configuration, running it under signals, and saying what went wrong."""

from __future__ import annotations

import logging
import os
import re
import signal
import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from importlib import resources
from pathlib import Path
from types import FrameType
from typing import TextIO

import click

from pipeline.assemble import KINDS, assemble, build_rig, build_source
from pipeline.configtext.document import ConfigError, Document, load_file, load_text
from pipeline.errors import InputError, RunError, SyncwatchError
from pipeline.frame import Rig, Source
from pipeline.plan import Plan, make_plan
from pipeline.run import Parts, Run
from pipeline.verdict import Report, Sink

log = logging.getLogger("syncwatch.cli")

DONE, FAILED, BAD_INPUT, OUT_OF_SYNC, CANNOT_TELL = 0, 1, 2, 3, 4
CONFIG_NAME = "config.yaml"
UNIT_S = {"ms": 0.001, "s": 1.0, "": 1.0, "m": 60.0, "h": 3600.0}

WATCH = "the command's own"
"""The name of the sink that a command adds to those of the plan."""

AT_ONCE = 3
"""Signals after which a run is abandoned: people press Ctrl-C twice without meaning more than once."""

GIVE_UP_S = 15
"""Seconds from a signal until what the main thread is stuck in, a user's own detector say, is interrupted."""

set_option = click.option(
    "--set",
    "overrides",
    multiple=True,
    metavar="KEY=VALUE",
    help="Set a value of the configuration, e.g. --set source.fps=10. May be given again.",
)


def shipped_config() -> str:
    """The text of the default configuration."""
    return resources.files("syncwatch").joinpath(CONFIG_NAME).read_text(encoding="utf-8")


def read_config(path: str | None, overrides: Sequence[str]) -> tuple[Document, Path]:
    """The configuration that was named, else the one in this folder, else the shipped one; and its folder.

    Raises InputError.
    """
    if path is None and not Path(CONFIG_NAME).exists():
        return load_text(shipped_config(), f"{CONFIG_NAME} (shipped)", os.environ, overrides), Path.cwd()
    file = Path(path or CONFIG_NAME)
    return load_file(file, os.environ, overrides), file.resolve().parent


def read_plan(path: str | None, overrides: Sequence[str]) -> Plan:
    document, base = read_config(path, overrides)
    return make_plan(document, KINDS, base)


def console_of(plan: Plan) -> TextIO:
    """Where sinks that talk to people print: standard error once another sink has taken standard output."""
    taken = any(getattr(chosen.settings, "path", None) == "-" for chosen in plan.sinks.values())
    return sys.stderr if taken else sys.stdout


def open_source(plan: Plan) -> Source:
    """The plan's source, open. Raises SyncwatchError, also where a source of the user's own raises something else."""
    try:
        source = build_source(plan)
        source.open()
    except SyncwatchError:
        raise
    except Exception as error:  # a user's own source may raise anything
        log.debug("the source cannot be opened", exc_info=error)
        raise RunError(f"the source cannot be opened: {type(error).__name__}: {error}") from error
    return source


def execute(
    plan: Plan,
    *,
    on_report: Callable[[Report], None] = lambda _: None,
    watch: Callable[[Rig], Sink] | None = None,
    stop_after_s: float | None = None,
    until: Callable[[], bool] = lambda: False,
) -> int:
    """Runs the plan to its end, or until that is true after a report. Returns and raises as `carry_out`.

    watch: makes a sink of the command's own, beside those of the plan.
    """
    source = open_source(plan)
    try:
        parts = assemble(plan, source, console=console_of(plan), on_report=on_report)
        if watch is not None:
            parts.sinks = {**parts.sinks, WATCH: watch(build_rig(plan, source))}
    except BaseException:
        source.close()
        raise
    return carry_out(parts, stop_after_s=stop_after_s, until=until)


def carry_out(parts: Parts, *, stop_after_s: float | None = None, until: Callable[[], bool] = lambda: False) -> int:
    """Runs what is assembled. Returns 0, or 130 / 143 after SIGINT / SIGTERM. Raises SyncwatchError."""
    told = parts.on_report

    def on_report(report: Report) -> None:
        told(report)
        if until():
            run.stop()

    parts.on_report = on_report
    run = Run(parts, stop_after_s=stop_after_s)
    with _stopped_by_signals(run) as received:
        run.execute()
    return 128 + received[0] if received else DONE


@contextmanager
def _stopped_by_signals(run: Run) -> Iterator[list[int]]:
    """The first SIGINT or SIGTERM ends the run in order, the third at once; so does a part that blocks for too long."""
    received: list[int] = []

    def handle(number: int, _: FrameType | None) -> None:
        received.append(number)
        run.stop()
        signal.alarm(GIVE_UP_S)
        if len(received) >= AT_ONCE:
            raise KeyboardInterrupt

    def give_up(_: int, __: FrameType | None) -> None:
        signal.alarm(GIVE_UP_S)
        raise RunError(f"a part of the pipeline did not end within {GIVE_UP_S} s of the signal")

    before = {number: signal.signal(number, handle) for number in (signal.SIGINT, signal.SIGTERM)}
    before[signal.SIGALRM] = signal.signal(signal.SIGALRM, give_up)
    try:
        yield received
    finally:
        signal.alarm(0)
        for number, action in before.items():
            signal.signal(number, action)


@contextmanager
def said_once() -> Iterator[None]:
    """What is said of a recording that is opened again and again is logged once."""
    said: set[str] = set()

    def is_new(record: logging.LogRecord) -> bool:
        text = record.getMessage()
        return text not in said and not said.add(text)  # type: ignore[func-returns-value]

    handlers = logging.getLogger("syncwatch").handlers
    for handler in handlers:
        handler.addFilter(is_new)
    try:
        yield
    finally:
        for handler in handlers:
            handler.removeFilter(is_new)


def set_up_logging(*, verbose: bool) -> None:
    """Everything that is not a result goes to stderr, one line each."""
    handler = logging.StreamHandler(sys.stderr)
    handler.setFormatter(_OneLine())
    root = logging.getLogger("syncwatch")
    root.handlers = [handler]
    root.setLevel(logging.DEBUG if verbose else logging.INFO)
    root.propagate = False


class _OneLine(logging.Formatter):
    def format(self, record: logging.LogRecord) -> str:
        level = "" if record.levelno == logging.INFO else f"{record.levelname.lower()}: "
        text = f"syncwatch: {level}{record.getMessage()}"
        return text + ("\n" + self.formatException(record.exc_info) if record.exc_info else "")


def seconds(text: str, option: str = "--for") -> float:
    """`10s`, `500ms`, `2m` or `10` as seconds. Raises InputError."""
    match = re.fullmatch(r"(\d+(?:\.\d+)?)(ms|s|m|h|)", text.strip())
    if match is None or float(match[1]) == 0:
        raise InputError(f"{option} '{text}': expected a duration such as 10s, 500ms or 2m")
    return float(match[1]) * UNIT_S[match[2]]


def report(error: SyncwatchError) -> int:
    """Prints the error for people; returns the exit status."""
    click.echo(str(error) if isinstance(error, ConfigError) else f"syncwatch: error: {error}", err=True)
    return BAD_INPUT if isinstance(error, InputError) else FAILED
