"""Keeps passwords out of messages: what stands behind a key that sounds like one, and in URLs, is not repeated."""

from __future__ import annotations

import re
from collections.abc import Sequence

HIDDEN = "***"

_WORD = r"(?:pass(?:word|wd|phrase|wort)?|pwd|secret|token|private_key_base64)(?![\w-]*[_-](?:file|env))"
_KEY = re.compile(_WORD, re.IGNORECASE)
_GIVEN = re.compile(rf"{_WORD}[\w-]*[\"']?\s*[:=]", re.IGNORECASE)
_LOGIN = re.compile(r"(?<=://)(?:[^/:\s'\"]*:[^\s'\"]+|[^/\s'\"]+)(?=@)")
_QUERY = re.compile(r"(://[^\s'\"?]*\?)([^\s'\"]+)")
_QUOTED = re.compile(r"'[^']*(?:'|$)|\"[^\"]*(?:\"|$)")


def is_secret(path: Sequence[str | int]) -> bool:
    """Whether the value at the path, or one around it, is a password."""
    return any(isinstance(part, str) and _KEY.search(part) for part in path)


def holds_secret(text: str) -> bool:
    return _GIVEN.search(text) is not None


def without_secret(text: str) -> str:
    """The text up to the first password, what follows hidden."""
    found = _GIVEN.search(text)
    return text if found is None else text[: found.end()] + HIDDEN


def without_url_secrets(text: str) -> str:
    """The text without what may be secret in URLs, login and query; as many characters as before."""
    text = _LOGIN.sub(lambda found: "*" * len(found.group()), text)
    return _QUERY.sub(lambda found: found[1] + "*" * len(found[2]), text)


def without_values(sentence: str) -> str:
    """A sentence without the values that it quotes."""
    return _QUOTED.sub(HIDDEN, sentence)
