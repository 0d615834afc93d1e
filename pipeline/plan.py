"""Checks a configuration against the kinds that exist and turns it into a plan: settings, each with its builder."""

from __future__ import annotations

import importlib
import sys
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeAlias

from pydantic import ValidationError

from pipeline.config import Config
from pipeline.configtext.document import Document, Problem, nearest, problems_from
from pipeline.settings import Settings

DataPath: TypeAlias = tuple[str | int, ...]


@dataclass(frozen=True, slots=True)
class Kind:
    """A kind of source, fault, detector or sink: what may be set, and how it is built from that."""

    settings: type[Settings]
    build: Callable[..., Any]


@dataclass(frozen=True, slots=True)
class Kinds:
    """All kinds there are, by section of the configuration and by the `type` that names them.

    own: how a class of the user's (`type: my_module:MyClass`) is built, for the sections that take such.
    """

    tables: Mapping[str, Mapping[str, Kind]]
    own: Mapping[str, Callable[[Any], Callable[..., Any]]]


@dataclass(frozen=True, slots=True)
class Chosen:
    """One entry of the configuration: its settings and their builder."""

    settings: Settings
    build: Callable[..., Any]


@dataclass(frozen=True, slots=True)
class Plan:
    """A configuration in which every entry has been checked."""

    config: Config
    source: Chosen
    faults: tuple[Chosen, ...]
    detectors: Mapping[str, Chosen]
    sinks: Mapping[str, Chosen]
    document: Document
    base: Path


def make_plan(document: Document, kinds: Kinds, base: Path) -> Plan:
    """Checks everything that can be checked without touching a camera, a file or the network.

    base: the folder that relative paths, and modules of the user's own, count from.
    Raises ConfigError with all problems at once.
    """
    problems: list[Problem] = []
    config: Config | None = None
    try:
        config = Config.model_validate(document.data)
    except ValidationError as error:
        problems += problems_from(error, (), Config)
    check = _Checker(problems, kinds, base)
    data = document.data
    source = check.source(data.get("source"))
    faults = check.listed("faults", data.get("faults"))
    detectors = check.named("detectors", data.get("detectors"))
    sinks = check.named("sinks", data.get("sinks"))
    if problems or config is None or source is None:
        raise document.error(problems)
    return Plan(config, source, tuple(faults), detectors, sinks, document, base)


class _Checker:
    """Validates entries one by one and collects what is wrong with them."""

    def __init__(self, problems: list[Problem], kinds: Kinds, base: Path) -> None:
        self._problems = problems
        self._kinds = kinds
        self._base = base

    def source(self, entry: Any) -> Chosen | None:
        if isinstance(entry, list):
            if len(entry) != 1:
                self._problem(("source",), f"exactly one source is supported so far, not {len(entry)}")
                return None
            return self._chosen(("source", 0), entry[0])
        return None if entry is None else self._chosen(("source",), entry)

    def listed(self, section: str, entries: Any) -> list[Chosen]:
        if not isinstance(entries, list):
            return []
        chosen = [self._chosen((section, index), entry) for index, entry in enumerate(entries)]
        return [item for item in chosen if item is not None]

    def named(self, section: str, entries: Any) -> dict[str, Chosen]:
        if not isinstance(entries, dict):
            return {}
        chosen = {name: self._chosen((section, name), entry, name) for name, entry in entries.items()}
        return {name: item for name, item in chosen.items() if item is not None}

    def _chosen(self, path: DataPath, entry: Any, name: str | None = None) -> Chosen | None:
        entry = {} if entry is None and name is not None else entry
        if not isinstance(entry, dict):
            self._problem(path, f"expected a mapping with a 'type', not {entry!r}")
            return None
        wanted = entry.get("type", name)
        if wanted is None:
            self._problem(path, f"'type' is required{nearest('', list(self._table(path)))}")
            return None
        kind = self._kind(path, str(wanted), given="type" in entry)
        if kind is None:
            return None
        try:
            return Chosen(kind.settings.model_validate({**entry, "type": wanted}), kind.build)
        except ValidationError as error:
            self._problems += problems_from(error, path, kind.settings)
            return None

    def _table(self, path: DataPath) -> Mapping[str, Kind]:
        return self._kinds.tables[str(path[0])]

    def _kind(self, path: DataPath, wanted: str, *, given: bool) -> Kind | None:
        table = self._table(path)
        if wanted in table:
            return table[wanted]
        place = (*path, "type") if given else path
        own = self._kinds.own.get(str(path[0]))
        if ":" not in wanted or own is None:
            self._problem(place, f"unknown type '{wanted}'{nearest(wanted, list(table))}")
            return None
        try:
            return self._imported(wanted, own)
        except Exception as error:  # a user's own module may raise anything while it is imported
            self._problem(place, f"cannot use '{wanted}': {type(error).__name__}: {error}")
            return None

    def _imported(self, dotted: str, own: Callable[[Any], Callable[..., Any]]) -> Kind:
        if str(self._base) not in sys.path:
            sys.path.append(str(self._base))
        module, _, attribute = dotted.partition(":")
        made = getattr(importlib.import_module(module), attribute)
        settings = getattr(made, "Settings", None)
        if not (isinstance(settings, type) and issubclass(settings, Settings) and "type" in settings.model_fields):
            raise TypeError(
                f"{attribute} needs an attribute Settings: a class derived from syncwatch.Settings with a field 'type'"
            )
        return Kind(settings, own(made))

    def _problem(self, path: Sequence[str | int], message: str) -> None:
        self._problems.append(Problem(tuple(path), message))
