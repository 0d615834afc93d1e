"""`syncwatch cameras`: what cameras this machine has, and how to write them into a configuration."""

from __future__ import annotations

import json
from collections.abc import Sequence

import click
import yaml

from pipeline.assemble import FINDERS
from pipeline.cli.common import DONE
from pipeline.found import Finder, FoundCamera, Mode, names_of


@click.command()
@click.option("--json", "as_json", is_flag=True, help="Everything that is known, as JSON.")
def cameras(as_json: bool) -> int:
    """List the cameras of this machine, V4L2 and OAK, with a piece of configuration to paste."""
    by_finder = [(finder, finder.find()) for finder in FINDERS]
    found = [camera for _, own in by_finder for camera in own]
    if as_json:
        click.echo(json.dumps([camera.to_json() for camera in found], indent=2))
    elif not found:
        click.echo("no cameras here: plug one in; `ls /dev/video*` shows what the system sees", err=True)
    else:
        click.echo("\n".join([*_table(found), *_snippet(by_finder)]))
    return DONE


def _table(found: Sequence[FoundCamera]) -> list[str]:
    rows = [
        (camera.path, camera.name, camera.bus, f"serial {camera.serial}" if camera.serial else "") for camera in found
    ]
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    lines = []
    for camera, row in zip(found, rows, strict=True):
        lines.append("  ".join(text.ljust(width) for text, width in zip(row, widths, strict=True)).rstrip())
        lines += [f"    {link}" for link in camera.links]
        lines += [f"    cannot be used: {camera.problem}"] if camera.problem else _mode_lines(camera.modes)
    return lines


def _mode_lines(modes: Sequence[Mode]) -> list[str]:
    """A line for all formats that come in the same sizes and rates."""
    sizes: dict[str, list[str]] = {}
    for mode in modes:
        if mode.readable:
            sizes.setdefault(mode.format, []).append(_size_text(mode))
    formats: dict[str, list[str]] = {}
    for name, texts in sizes.items():
        formats.setdefault("; ".join(texts), []).append(name)
    lines = [f"    {', '.join(names)}: {text}" for text, names in formats.items()]
    others = sorted({mode.format for mode in modes if not mode.readable})
    return [*lines, f"    not read here: {', '.join(others)}"] if others else lines


def _size_text(mode: Mode) -> str:
    least = "" if mode.least is None else f"{mode.least[0]}x{mode.least[1]} to "
    rates = f" at {', '.join(f'{fps:.4g}' for fps in mode.fps)} fps" if mode.fps else ""
    return f"{least}{mode.size[0]}x{mode.size[1]}{rates}"


def _snippet(by_finder: Sequence[tuple[Finder, Sequence[FoundCamera]]]) -> list[str]:
    """The source, or the list of sources, for the cameras that can be used."""
    usable = [(finder, [camera for camera in own if not camera.problem]) for finder, own in by_finder]
    views = sum(camera.views for _, own in usable for camera in own)
    names = iter(names_of(views))
    sources = [dict(finder.source(own, names)) for finder, own in usable if own]
    if not sources:
        return []
    config = {"source": sources[0] if len(sources) == 1 else sources}
    text = yaml.safe_dump(config, default_flow_style=None, sort_keys=False, width=1000)
    return ["", *text.splitlines(), *(["# a rig needs two or more cameras"] if views == 1 else [])]
