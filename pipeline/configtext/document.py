"""Configuration text becomes plain data that knows where each value stands, and problems become lines for people."""

from __future__ import annotations

from pathlib import Path as FilePath
from typing import TYPE_CHECKING, Any

from pipeline.configtext.build import Builder, Places
from pipeline.configtext.compose import compose
from pipeline.configtext.overrides import Override, apply_override, override_path, parse_override
from pipeline.configtext.report import ConfigError, Path, Place, Problem, Source, nearest, report, show
from pipeline.configtext.validation import problems_from
from pipeline.errors import InputError

if TYPE_CHECKING:
    import os
    from collections.abc import Iterable, Mapping, Sequence

__all__ = [
    "ConfigError",
    "Document",
    "Path",
    "Place",
    "Problem",
    "load_file",
    "load_text",
    "nearest",
    "problems_from",
]

_MAX_BYTES = 1_000_000
_START = "`syncwatch init` writes a starting one"


class Document:
    """A loaded configuration: plain data, and the places its keys and values came from."""

    def __init__(self, data: dict[str, Any], places: Places, sources: Sequence[Source]) -> None:
        self.data = data
        self._places = places
        self._sources = tuple(sources)
        self.label = self._sources[0].label

    def place(self, path: Path) -> tuple[Place, Place]:
        """The places of the key and of the value at the path, or of what stands nearest above it."""
        while path not in self._places:
            path = path[:-1]
        return self._places[path]

    def error(self, problems: Iterable[Problem]) -> ConfigError:
        """The error that shows each problem at its place."""
        return report([(self._place_of(problem), problem) for problem in problems], self._sources)

    def _place_of(self, problem: Problem) -> Place:
        key, value = self.place(problem.path)
        is_missing = problem.path not in self._places
        # A block begins with its first key, which is not what is wrong: its own key names it better.
        is_block = (key.label, key.line) != (value.label, value.line) and self._is_container(problem.path)
        return key if is_missing or problem.at == "key" or is_block else value

    def _is_container(self, path: Path) -> bool:
        at: Any = self.data
        for part in path:
            # A key that was refused has a place but no value.
            at = at.get(part) if isinstance(at, dict) else at[part]
        return isinstance(at, (dict, list))


def load_file(path: str | os.PathLike[str], environ: Mapping[str, str], overrides: Sequence[str] = ()) -> Document:
    """The configuration in the file, with variables replaced and overrides applied.

    Raises:
        InputError: if the file cannot be read or holds no usable configuration; all problems at once.
    """
    return load_text(_read(path), str(path), environ, overrides)


def load_text(
    text: str, label: str, environ: Mapping[str, str], overrides: Sequence[str] = (), *, quoted: bool = True
) -> Document:
    """The configuration in the text; `label` names it in messages, which quote the line unless told otherwise.

    Raises:
        ConfigError: with all problems of the text and the overrides at once.
    """
    source = Source(label, text.removeprefix("\ufeff"), is_argument=not quoted)
    complaints: list[str] = []
    parsed: list[Override] = []
    for argument in overrides:
        try:
            parsed.append(parse_override(argument))
        except ConfigError as error:
            complaints += error.problems
    try:
        document = _build(source, environ, parsed)
    except ConfigError as error:
        raise ConfigError([*error.problems, *complaints]) from None
    if complaints:
        raise ConfigError(complaints)
    return document


def _build(source: Source, environ: Mapping[str, str], overrides: Sequence[Override]) -> Document:
    node, tagged = compose(source, source.text)
    builder = Builder(source, tagged, environ)
    sources = [source, *{override.source.label: override.source for override in overrides}.values()]
    data = builder.build(node, ()) if node is not None else None
    if not isinstance(data, dict):
        if data is None and not builder.problems:
            located = (Place(source.label, 1, 1), Problem((), "the configuration is empty", _START))
        else:
            message = f"the top level must be a mapping of keys and values, not {show(data)}"
            located = (builder.places[()][1], Problem((), message))
        raise report(builder.problems or [located], sources)
    replaced = [override_path(override, data) for override in overrides]
    # A value that is overridden anyway may well hold a variable that is not set here.
    problems = [
        (place, problem)
        for place, problem in builder.problems
        if problem.at == "key" or not any(problem.path[: len(path)] == path for path in replaced)
    ]
    for override in overrides:
        problems += apply_override(override, data, builder.places)
    if problems:
        raise report(problems, sources)
    return Document(data, builder.places, sources)


def _read(path: str | os.PathLike[str]) -> str:
    try:
        with FilePath(path).open("rb") as file:
            raw = file.read(_MAX_BYTES + 1)
    except FileNotFoundError:
        raise InputError(f"configuration {show(str(path))} does not exist - {_START}") from None
    except IsADirectoryError:
        raise InputError(f"configuration {show(str(path))} is a directory, not a file") from None
    except (OSError, ValueError) as error:
        reason = getattr(error, "strerror", None) or error
        raise InputError(f"configuration {show(str(path))} cannot be read: {reason}") from None
    if len(raw) > _MAX_BYTES:
        raise InputError(f"configuration {show(str(path))} is larger than {_MAX_BYTES // 1000} kB")
    try:
        return raw.decode("utf-8")
    except UnicodeDecodeError as error:
        line = raw.count(b"\n", 0, error.start) + 1
        found = f"byte 0x{raw[error.start]:02x} in line {line}"
        raise InputError(f"configuration {show(str(path))} is not UTF-8 text ({found}) - save it as UTF-8") from None
