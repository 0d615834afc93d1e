"""`syncwatch repair`: a recording written anew, with the frames together that belong together."""

from __future__ import annotations

import logging
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Literal

import click

from pipeline.assemble import build_rig, version
from pipeline.cli.common import CANNOT_TELL, DONE, execute, open_source, said_once, set_option
from pipeline.cli.recording import RecordingOptions, recording_options, recording_plan
from pipeline.errors import InputError, RunError
from pipeline.frame import Rig, Source
from pipeline.plan import Plan
from pipeline.repair.measured import Measured
from pipeline.repair.rewrite import Rewrite

log = logging.getLogger("syncwatch.repair")


@click.command()
@click.argument("source", metavar="IN")
@click.argument("output", metavar="OUT.mcap")
@click.option("--restamp", is_flag=True, help="Correct the other cameras' stamps by what the pictures say.")
@click.option("--pictures", type=click.Choice(["raw", "png", "jpeg"]), default="raw", help="(default: raw)")
@click.option("--force", is_flag=True, help="Replace OUT.mcap if it is there.")
@recording_options
@set_option
def repair(
    source: str,
    output: str,
    restamp: bool,
    pictures: Literal["raw", "png", "jpeg"],
    force: bool,
    options: RecordingOptions,
    overrides: tuple[str, ...],
) -> int:
    """Write the recording IN to OUT.mcap with its frames paired anew by what the pictures say. IN is not touched.

    Exit status 0: done. 4: no offset could be measured, so that frames are paired as they were.
    """
    taken, made = Path(source).expanduser(), Path(output).expanduser().absolute()
    _check(taken, made, force=force)
    with said_once():
        console = {"console": {"style": "progress"}}
        plan = recording_plan([source], options, sinks=console, overrides=("align={}", *overrides))
        rig = _rig(plan)
        measured = Measured(rig)
        interrupted = execute(plan, on_report=measured.take)
        if interrupted:
            return interrupted
        log.info("writing %s", made)
        job = Rewrite(taken, rig, measured, plan.config.buffer, pictures=pictures, restamp=restamp, version=version())
        with _opened(plan) as opened, _replaced(made) as unfinished:
            told = job.write(opened, unfinished)
        click.echo("\n".join([f"{made}:", *told]))
        return DONE if measured.is_known else CANNOT_TELL


def _check(taken: Path, made: Path, *, force: bool) -> None:
    """Raises InputError for an output that would touch the input, or anything else that is there."""
    if not taken.exists():
        raise InputError(f"no such file or folder: {taken}")
    if made.is_dir():
        raise InputError(f"{made}: is a folder: name a file, e.g. {made / 'repaired.mcap'}")
    if not made.parent.is_dir():
        raise InputError(f"{made}: cannot be written: there is no folder {made.parent}")
    inside = taken.is_dir() and taken.resolve() in made.resolve().parents
    if inside or any(one.exists() and one.samefile(taken) for one in (made, _unfinished(made))):
        raise InputError(f"{made}: lies in the recording that is read, which is never changed: name another file")
    if made.exists() and not force:
        raise InputError(f"{made}: exists already: name another file, or give --force")


def _rig(plan: Plan) -> Rig:
    with _opened(plan) as source:
        rig = build_rig(plan, source)
    firsts = {pair.first for pair in rig.pairs}
    if len(firsts) > 1:
        named = ", ".join(pair.name for pair in rig.pairs)
        raise InputError(f"pairs: {named}: to be paired anew, all pairs need the same first camera")
    return rig


@contextmanager
def _opened(plan: Plan) -> Iterator[Source]:
    source = open_source(plan)
    try:
        yield source
    finally:
        source.close()


def _unfinished(made: Path) -> Path:
    return made.with_name(f"{made.name}.part")


@contextmanager
def _replaced(made: Path) -> Iterator[Path]:
    """A file that takes its name only when it is complete, and is removed otherwise."""
    unfinished = _unfinished(made)
    try:
        yield unfinished
        unfinished.replace(made)
    except OSError as error:
        raise RunError(f"{made}: cannot be written: {error.strerror or error}") from error
    finally:
        with suppress(OSError):
            unfinished.unlink(missing_ok=True)
