"""YAML text becomes nodes with marks, or one error that shows what was found and where."""

from __future__ import annotations

import re
from typing import Any, NoReturn

import yaml
from yaml.composer import ComposerError
from yaml.reader import ReaderError

from pipeline.configtext.report import Place, Problem, Source, report

MAX_DEPTH = 100

_TOKENS = {  # PyYAML's names of what it met, in words
    "<block end>": "the end of the block",
    "'<block mapping start>'": "a key",
    "'<block sequence start>'": "a list",
    "'<block end>'": "the end of the block",
    "'<stream end>'": "the end of the text",
    "'<scalar>'": "a text",
    "found '?'": "found a key",
}
_HINTS = (
    (r"character '\\t' that cannot", "indent with spaces, not tabs"),
    (r"character '[@`%]' that cannot", "put the value in quotes"),
    (
        r"mapping values are not allowed",
        "a value that holds ': ' needs quotes; keys of one level start in the same column",
    ),
    (r"sequence entries are not allowed", "a list starts in a line of its own, or is written [a, b]"),
    (r"could not find expected ':'", "a key is followed by ': '"),
    (r"end of the block, but found a", "lines of one level start in the same column"),
    (r"expected the end of the block", "nothing but a comment follows a closing quote or bracket"),
    (r"expected '[^']+' or '.'|end of (stream|the text)", "a bracket or a quote is not closed"),
    (r"unknown escape character", "in single quotes a backslash is an ordinary character"),
)


class NodeLoader(yaml.SafeLoader):
    """PyYAML's own loader, which also remembers explicit tags and stops at a depth no configuration needs."""

    def __init__(self, text: str) -> None:
        super().__init__(text)
        self.tagged: set[int] = set()
        self._depth = 0

    def compose_node(self, parent: yaml.Node | None, index: int) -> yaml.Node | None:
        parser: Any = self  # its methods carry no types
        event = parser.peek_event()
        self._depth += 1
        if self._depth > MAX_DEPTH:
            raise ComposerError(None, None, f"nested more than {MAX_DEPTH} levels deep", event.start_mark)
        node = super().compose_node(parent, index)
        self._depth -= 1
        if getattr(event, "tag", None):
            self.tagged.add(id(node))
        return node


def compose(source: Source, text: str) -> tuple[yaml.Node | None, set[int]]:
    """The root node of the text, None if it holds none, and the identities of nodes with an explicit tag.

    The marks of the nodes are places in the source.

    Raises:
        ConfigError: if the text is not YAML or holds several documents.
    """
    try:
        loader = NodeLoader(text)
    except ReaderError as error:
        before = Source("", text[: error.position]).lines
        message = f"the character U+{int(error.character):04X} is not allowed in YAML"
        _refuse(source, len(before), len(before[-1]) + 1, message)
    try:
        return loader.get_single_node(), loader.tagged
    except yaml.MarkedYAMLError as error:
        mark = error.problem_mark or error.context_mark or loader.get_mark()
        _refuse(source, mark.line + 1, mark.column + 1, *_explain(error, source, mark))
    except (ValueError, OverflowError):  # PyYAML lets Python's own errors through for some escapes
        mark = loader.get_mark()
        _refuse(source, mark.line + 1, mark.column + 1, "not valid YAML: a number or an escape here is out of range")
    finally:
        loader.dispose()


def _refuse(source: Source, line: int, column: int, message: str, hint: str | None = None) -> NoReturn:
    raise report([(Place(source.label, line, column), Problem((), message, hint))], [source])


def _explain(error: yaml.MarkedYAMLError, source: Source, mark: yaml.Mark) -> tuple[str, str | None]:
    if error.problem == "but found another document":
        return "a second document starts here: one file holds one configuration", None
    problem = error.problem or "cannot be read"
    begin = error.context_mark
    if problem == "second occurrence" and begin:
        return f"this anchor is given twice, first in line {begin.line + 1}", None
    if problem.startswith("nested"):
        return problem, None
    for token, words in _TOKENS.items():
        problem = problem.replace(token, words)
    message = f"not valid YAML: {problem}"
    if error.context and begin and begin.line != mark.line:
        message += f" ({error.context} that starts in line {begin.line + 1})"
    return message, _hint(problem, source, mark)


def _hint(problem: str, source: Source, mark: yaml.Mark) -> str | None:
    line = source.lines[mark.line] if mark.line < len(source.lines) else ""
    if line[max(0, mark.column - 1) : mark.column + 1] == "${":
        return 'inside [ ] and { } write "${NAME}" in quotes'
    if "mapping values" in problem and "${" in line[: mark.column]:
        return "put the value with ${...} in quotes"
    return next((hint for pattern, hint in _HINTS if re.search(pattern, problem)), None)
