"""Checks a configuration against the kinds that exist and turns it into a plan: settings, each with its builder."""

from __future__ import annotations

import importlib
import sys
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
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


class Several(Settings):
    """The settings of several sources in one rig, in order."""

    sources: tuple[Settings, ...]

    @property
    def type(self) -> str:
        return ", ".join(str(getattr(one, "type", "?")) for one in self.sources)

    @property
    def trust_stamps(self) -> bool:
        """Whether all say so."""
        return all(getattr(one, "trust_stamps", False) for one in self.sources)


@dataclass(frozen=True, slots=True)
class Kinds:
    """All kinds there are, by section of the configuration and by the `type` that names them.

    own: how a class of the user's (`type: my_module:MyClass`) is built, for the sections that take such.
    several: how several sources become one: takes the builders of each, then as a builder does.
    """

    tables: Mapping[str, Mapping[str, Kind]]
    own: Mapping[str, Callable[[Any], Callable[..., Any]]]
    several: Callable[..., Any]


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


def name_taken(name: str, other: int) -> str:
    """What is wrong with the name of a camera that the source of another number has, too."""
    return f"source[{other}] has a camera '{name}', too: every camera of the rig needs a name of its own"


def adapted(settings: Settings, values: Mapping[str, Any]) -> Settings:
    """The settings of a source, or each of several, with other values of those that it has."""
    if isinstance(settings, Several):
        return Several(sources=tuple(adapted(one, values) for one in settings.sources))
    return settings.model_copy(
        update={name: one for name, one in values.items() if name in type(settings).model_fields}
    )


class _Checker:
    """Validates entries one by one and collects what is wrong with them."""

    def __init__(self, problems: list[Problem], kinds: Kinds, base: Path) -> None:
        self._problems = problems
        self._kinds = kinds
        self._base = base

    def source(self, entry: Any) -> Chosen | None:
        if isinstance(entry, list):
            return self._several(entry)
        return None if entry is None else self._chosen(("source",), entry)

    def _several(self, entries: Sequence[Any]) -> Chosen | None:
        if not entries:
            self._problem(("source",), "at least one source is required, but the list is empty")
        chosen = [self._chosen(("source", number), entry) for number, entry in enumerate(entries)]
        known = [one for one in chosen if one is not None]
        if len(known) < max(len(entries), 1):
            return None
        if len(known) == 1:
            return known[0]
        self._refuse_names([one.settings for one in known])
        settings = Several(sources=tuple(one.settings for one in known))
        return Chosen(settings, partial(self._kinds.several, [one.build for one in known]))

    def _refuse_names(self, sources: Sequence[Settings]) -> None:
        """Names of cameras that settings tell, given by two sources; the others show when they are opened."""
        first: dict[str, int] = {}
        for number, settings in enumerate(sources):
            cameras = getattr(settings, "cameras", None)
            for name in cameras if isinstance(cameras, dict) else getattr(settings, "camera_names", ()):
                if first.setdefault(name, number) != number:
                    self._problem(("source", number, "cameras", name), name_taken(name, first[name]))

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
