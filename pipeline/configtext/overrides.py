"""``--set a.b[0].c=value``: sets one value of a built configuration, and nothing else."""

from __future__ import annotations

import re
from dataclasses import dataclass
from itertools import pairwise
from typing import TYPE_CHECKING, Any

from pipeline.configtext.build import Builder, Places
from pipeline.configtext.compose import compose
from pipeline.configtext.report import ConfigError, Path, Place, Problem, Source, argument_source, dotted, show
from pipeline.configtext.secrets import without_secret

if TYPE_CHECKING:
    import yaml

_STEP = re.compile(r"(?:^|\.)([^.\[\]=\s]+)|\[(\d{1,9})\]")
_INDEX = re.compile(r"[0-9]{1,9}")
_PREFIX = len("--set ")


@dataclass(frozen=True, slots=True)
class Step:
    """One part of an override's key; an index in brackets fits lists only."""

    name: str
    is_index: bool
    place: Place


@dataclass(frozen=True, slots=True)
class Override:
    """A parsed ``--set`` argument, not yet applied; `node` is None where no value is given."""

    source: Source
    steps: tuple[Step, ...]
    node: yaml.Node | None
    tagged: frozenset[int]
    value: Place


class _RefusedError(Exception):
    def __init__(self, place: Place, path: Path, message: str) -> None:
        self.located = (place, Problem(path, message))
        super().__init__(message)


def parse_override(argument: str) -> Override:
    """The parts of the argument.

    Raises:
        ConfigError: if it is not KEY=VALUE, or its value is not YAML.
    """
    key, equals, value = argument.partition("=")
    source = argument_source(argument)
    steps = _parse_key(key, source)
    if not equals or not steps:
        raise ConfigError([f"--set {show(without_secret(argument))}: expected KEY=VALUE, e.g. --set source.fps=10"])
    column = _PREFIX + len(key) + 1
    # Blanks stand for the key, so that the marks are columns of the argument; lines of a block must not move.
    node, tagged = compose(source, value if "\n" in value else " " * column + value)
    if node is None and value.strip():
        hint = "put it in quotes"
        raise ConfigError(
            [f"--set {show(without_secret(argument))}: the value is a YAML comment or empty document - {hint}"]
        )
    return Override(source, steps, node, frozenset(tagged), Place(source.label, 1, column + 1))


def apply_override(override: Override, data: dict[str, Any], places: Places) -> list[tuple[Place, Problem]]:
    """Sets the value in the data, with its places; returns what stands in the way."""
    try:
        container, path = _descend(override.steps, data, places)
        last = override.steps[-1]
        slot = _slot(container, last, path)
    except _RefusedError as refused:
        return [refused.located]
    path = (*path, slot)
    for stale in [known for known in places if known[: len(path)] == path]:
        del places[stale]
    if override.node is None:
        places[path] = (last.place, override.value)
        container[slot] = None
        return []
    builder = Builder(override.source, set(override.tagged), environ=None)
    try:
        container[slot] = builder.build(override.node, path, last.place)
    finally:
        places.update(builder.places)
    return builder.problems


def override_path(override: Override, data: dict[str, Any]) -> Path:
    """The path that the override sets in this data, as far as it can be told before applying it."""
    path: Path = ()
    at: Any = data
    for step in override.steps:
        slot: str | int = int(step.name) if isinstance(at, list) and _INDEX.fullmatch(step.name) else step.name
        path = (*path, slot)
        try:
            at = at[slot]
        except (LookupError, TypeError):
            at = None
    return path


def _parse_key(key: str, source: Source) -> tuple[Step, ...]:
    steps: list[Step] = []
    at = 0
    if key.startswith("."):
        return ()
    while at < len(key):
        match = _STEP.match(key, at)
        if match is None or (match.group(2) and not steps):
            return ()
        group = 1 if match.group(1) else 2
        column = _PREFIX + match.start(group) + 1
        steps.append(Step(match.group(group), group == 2, Place(source.label, 1, column)))
        at = match.end()
    return tuple(steps)


def _descend(steps: tuple[Step, ...], data: dict[str, Any], places: Places) -> tuple[Any, Path]:
    """The container that the last step names a part of; missing mappings are made on the way."""
    at: Any = data
    path: Path = ()
    for step, following in pairwise(steps):
        slot = _slot(at, step, path)
        path = (*path, slot)
        known = at.get(slot) if isinstance(at, dict) else at[slot]
        if known is None and not following.is_index:
            known = at[slot] = {}
            places[path] = (step.place, step.place)
        at = known
    return at, path


def _slot(container: Any, step: Step, path: Path) -> str | int:
    """The key or index that the step means in this container."""
    if isinstance(container, list):
        if not _INDEX.fullmatch(step.name):
            raise _RefusedError(
                step.place, path, f"is a list, whose parts are numbered from 0, not named {show(step.name)}"
            )
        index = int(step.name)
        if index >= len(container):
            size = f"{len(container)} {'entry' if len(container) == 1 else 'entries'}"
            raise _RefusedError(step.place, (*path, index), f"index beyond the end: the list has {size}")
        return index
    if step.is_index:
        given = "missing" if container is None else show(container)
        raise _RefusedError(step.place, (*path, int(step.name)), f"{dotted(path)} is {given}, not a list")
    if not isinstance(container, dict):
        raise _RefusedError(step.place, (*path, step.name), f"{dotted(path)} is {show(container)}, not a mapping")
    return step.name
