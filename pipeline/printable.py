"""Makes what others wrote safe to print."""

from __future__ import annotations


def printable(text: str) -> str:
    """The text with everything spelled out that is no letter to be seen.

    That is bytes that are no text, control characters, some of which a terminal obeys, and what turns the direction of
    writing.
    """
    shown = text.encode("utf-8", "backslashreplace").decode()
    return "".join(letter if letter.isprintable() else repr(letter)[1:-1] for letter in shown)


def as_wide(text: str) -> str:
    """As `printable`, with as many letters as before, so that a caret below still points where it should; tabs stay."""
    return "".join(letter if letter.isprintable() or letter == "\t" else "\N{REPLACEMENT CHARACTER}" for letter in text)
