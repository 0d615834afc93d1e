"""`syncwatch validate`, `init` and `schema`: writing a configuration and finding what is wrong with it."""

from __future__ import annotations

import json
import sys
from pathlib import Path

import click

from pipeline.assemble import KINDS, assemble, build_rig
from pipeline.cli.common import CONFIG_NAME, open_source, read_plan, set_option, shipped_config
from pipeline.errors import InputError
from pipeline.faults.base import FaultSettings
from pipeline.frame import NS_PER_MS
from pipeline.judge import Judge
from pipeline.messages import SHAPES, message_schema
from pipeline.plan import Chosen, Plan
from pipeline.schema import config_schema

SCHEMA_NAME = "syncwatch.schema.json"


@click.command()
@click.argument("config", required=False)
@click.option("--no-environment", is_flag=True, help="Do not open files or cameras; check the text alone.")
@set_option
def validate(config: str | None, no_environment: bool, overrides: tuple[str, ...]) -> None:
    """Check CONFIG and print what it would run.

    First its fields and values, all errors at once, then that its files and cameras are there.
    """
    plan = read_plan(config, overrides)
    lines = _plan_lines(plan) if no_environment else _opened_lines(plan)
    click.echo(f"{plan.document.label}: valid")
    for name, text in lines:
        click.echo(f"  {name:<10} {text}")


@click.command()
@click.argument("path", default=CONFIG_NAME)
def init(path: str) -> None:
    """Write a starting configuration to PATH (default: config.yaml), and its schema for editors beside it."""
    file = Path(path)
    _write(file, shipped_config())
    schema_file = file.with_name(SCHEMA_NAME)
    if not schema_file.exists():
        _write(schema_file, _schema_text("config"))
    click.echo(f"{file}: written; run it with: syncwatch run {file}")


@click.command()
@click.argument("what", type=click.Choice(["config", *SHAPES]), default="config")
def schema(what: str) -> None:
    """Print the JSON schema of a configuration, for editors, or of a kind of message, for those who read them."""
    click.echo(_schema_text(what), nl=False)


def _schema_text(what: str) -> str:
    return json.dumps(config_schema(KINDS) if what == "config" else message_schema(what), indent=2) + "\n"


def _write(file: Path, text: str) -> None:
    try:
        with file.open("x", encoding="utf-8") as stream:
            stream.write(text)
    except FileExistsError:
        raise InputError(f"{file}: exists already; remove it or name another file") from None
    except OSError as error:
        raise InputError(f"{file}: cannot be written: {error.strerror}") from None


def _plan_lines(plan: Plan) -> list[tuple[str, str]]:
    return [
        ("rig", plan.config.rig),
        ("source", _kind(plan.source)),
        ("faults", ", ".join(_fault_line(fault) for fault in plan.faults) or "none"),
        ("detectors", ", ".join(plan.detectors)),
        ("judge", plan.config.judge.combine),
        *([] if plan.config.align is None else [("align", f"by up to {plan.config.align.max_frames} frames")]),
        ("sinks", ", ".join(plan.sinks) or "none"),
    ]


def _opened_lines(plan: Plan) -> list[tuple[str, str]]:
    """The plan with what only the open source can tell: its cameras and the pairs made of them."""
    source = open_source(plan)
    try:
        rig = build_rig(plan, source)
        assemble(plan, source, console=sys.stderr)
    finally:
        source.close()
    judge = Judge(plan.config.judge, rig)
    cameras = ", ".join(f"{camera.name} ({camera.fps:g} fps)" for camera in rig.cameras)
    pairs = ", ".join(
        f"{pair.name} (in sync within {judge.tolerance_ns(pair) / NS_PER_MS:.1f} ms)" for pair in rig.pairs
    )
    lines = _plan_lines(plan)
    return [*lines[:2], ("cameras", cameras), ("pairs", pairs), *lines[2:]]


def _kind(chosen: Chosen) -> str:
    return str(getattr(chosen.settings, "type", type(chosen.settings).__name__))


def _fault_line(chosen: Chosen) -> str:
    settings = chosen.settings
    assert isinstance(settings, FaultSettings)
    until = "the end" if settings.stop_s is None else f"{settings.stop_s:g} s"
    return f"{_kind(chosen)} ({settings.start_s:g} s to {until})"
