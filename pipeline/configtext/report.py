"""Problems of a configuration, and how they are shown to people: place, sentence, source line, caret."""

from __future__ import annotations

import datetime as dt
import difflib
import re
import unicodedata
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Literal, TypeAlias

from pipeline.configtext.secrets import holds_secret, is_secret, without_secret, without_url_secrets, without_values
from pipeline.errors import InputError
from pipeline.printable import as_wide

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence

Path: TypeAlias = tuple[str | int, ...]

_LINE_BREAK = re.compile("\r\n|[\n\r\x85\u2028\u2029]")  # YAML's line breaks: str.splitlines knows others
_PLAIN_KEY = re.compile(r"[\w${}-]+")
_MAX_WIDTH = 110
_MAX_SHOWN = 60
_MAX_ALLOWED = 20


@dataclass(frozen=True, slots=True)
class Place:
    """A character of a configuration file or of a ``--set`` argument; line and column count from 1."""

    label: str
    line: int
    column: int


@dataclass(frozen=True, slots=True)
class Problem:
    """What is wrong with the value (or the key) at a path, in words, and what to do about it."""

    path: Path
    message: str
    hint: str | None = None
    at: Literal["key", "value"] = "value"


class ConfigError(InputError):
    """All that is wrong with a configuration: each problem stands rendered in `problems`."""

    def __init__(self, problems: Iterable[str]) -> None:
        self.problems = tuple(dict.fromkeys(problems))
        super().__init__(self.problems)

    def __str__(self) -> str:
        return "\n".join(self.problems)


@dataclass(frozen=True)
class Source:
    """A text with a name: a file, or one ``--set`` argument, whose name is its text."""

    label: str
    text: str
    is_argument: bool = False
    lines: list[str] = field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, "lines", _LINE_BREAK.split(self.text))

    def render(self, place: Place, problem: Problem) -> str:
        """``file:line:column: error: path: message - hint``, the line and a caret below.

        A line with a password on it, or below one, is not repeated.
        """
        where = dotted(problem.path)
        message = without_values(problem.message) if is_secret(problem.path) else problem.message
        sentence = ": ".join(part for part in ("error", where, message) if part)
        if problem.hint:
            sentence += f" - {problem.hint}"
        if not self.is_argument:
            header = f"{as_wide(self.label)}:{place.line}:{place.column}: {sentence}"
            shown = self.lines[place.line - 1] if place.line <= len(self.lines) else ""
            told = shown.strip() and not any(map(holds_secret, self.lines[max(place.line - 2, 0) : place.line]))
            return "\n".join([header, *_excerpt(shown, place.column)]) if told else header
        header = f"{self.label}: {sentence}"
        # The header begins with the argument itself: the caret can stand right below it.
        if self.label == self.text and len(self.label) <= _MAX_WIDTH:
            return f"{header}\n{_padding(self.label[: place.column - 1])}^"
        return header


def argument_source(argument: str) -> Source:
    """The source of ``--set argument``, with a label that stays on one line."""
    text = without_url_secrets(f"--set {argument}")
    label = as_wide(without_secret(text))
    return Source(label if len(label) <= _MAX_WIDTH else f"{label[:_MAX_WIDTH]}...", text, is_argument=True)


def report(located: Iterable[tuple[Place, Problem]], sources: Sequence[Source]) -> ConfigError:
    """The error that shows every problem, in the order of the sources and their lines."""
    order = {source.label: number for number, source in enumerate(sources)}
    ranked = sorted(located, key=lambda pair: (order[pair[0].label], pair[0].line, pair[0].column))
    return ConfigError(sources[order[place.label]].render(place, problem) for place, problem in ranked)


def dotted(path: Path) -> str:
    """``faults[0].camera``; a key that would not be readable so stands in brackets and quotes."""
    text = ""
    for part in path:
        if isinstance(part, int):
            text += f"[{part}]"
        elif _PLAIN_KEY.fullmatch(part):
            text += f".{part}" if text else part
        else:
            text += f"[{show(part)}]"
    return text


def show(value: object) -> str:
    """A value as a sentence can hold it: short, on one line, in YAML's words."""
    if value is None:
        return "nothing"
    value = without_url_secrets(value) if isinstance(value, str) else value
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, dict):
        return "a mapping"
    if isinstance(value, (list, tuple, set)):
        return "a list"
    if isinstance(value, (dt.date, dt.datetime)):
        return value.isoformat()
    if isinstance(value, int) and value.bit_length() > 4 * _MAX_SHOWN:
        return "a number of very many digits"  # repr refuses some of them
    if isinstance(value, str) and len(value) > _MAX_SHOWN:
        return repr(value[:_MAX_SHOWN])[:-1] + "...'"
    text = as_wide(repr(value))
    return text if len(text) <= 2 * _MAX_SHOWN else f"{text[:_MAX_SHOWN]}..."


def likely(word: str, allowed: Iterable[str]) -> str | None:
    """``did you mean 'x'?`` if one of the allowed words is near."""
    known = {name.lower(): name for name in allowed}
    near = difflib.get_close_matches(word.lower()[:100], known, n=1, cutoff=0.6)
    return f"did you mean {show(known[near[0]])}?" if near else None


def suggestion(word: str, allowed: Iterable[str]) -> str | None:
    """The nearest allowed word as a question, or all of them; None if nothing is allowed."""
    names = list(allowed)
    if not names:
        return None
    rest = ", ..." if len(names) > _MAX_ALLOWED else ""
    return likely(word, names) or f"allowed: {', '.join(names[:_MAX_ALLOWED])}{rest}"


def nearest(word: str, allowed: Iterable[str]) -> str:
    """The end of a sentence about a wrong word: `` - did you mean 'x'?`` or `` - allowed: a, b``."""
    text = suggestion(word, allowed)
    return f" - {text}" if text else ""


def _excerpt(line: str, column: int) -> list[str]:
    line, at = without_url_secrets(line), column - 1
    start = max(0, min(at - _MAX_WIDTH // 2, len(line) - _MAX_WIDTH)) if len(line) > _MAX_WIDTH else 0
    front = "..." if start else ""
    back = "..." if start + _MAX_WIDTH < len(line) else ""
    shown = front + as_wide(line[start : start + _MAX_WIDTH]) + back
    return [shown.rstrip(), _padding(front + line[start:at]) + "^"]


def _padding(text: str) -> str:
    """White space as wide as the text is in a terminal: a tab stays a tab."""
    return "".join("\t" if char == "\t" else " " * _cells(char) for char in text)


def _cells(char: str) -> int:
    if unicodedata.combining(char):
        return 0
    return 2 if unicodedata.east_asian_width(char) in "WF" else 1
