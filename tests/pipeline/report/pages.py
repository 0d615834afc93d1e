"""Reads a page as a browser does: what it would fetch, and what it shows."""

from __future__ import annotations

import re
from html.parser import HTMLParser
from typing import Any

FETCHES = {"src", "href", "srcset", "data", "action", "poster", "xlink:href"}
ACTIVE = {"script", "link", "iframe", "object", "embed", "base", "form"}
VOID = {"meta", "img", "br", "hr", "link", "base", "input"}


class Page(HTMLParser):
    """fetched: every address. tags: names of all tags. text: what is shown. unclosed: tags that are left open."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.fetched: list[str] = re.findall(r"url\(([^)]*)\)", text) + re.findall(r"@import\S*", text)
        self.tags: list[str] = []
        self.ids: list[str] = []
        self.handlers: list[str] = []
        self.unclosed: list[str] = []
        self._text: list[str] = []
        self.feed(text)
        self.close()

    @property
    def text(self) -> str:
        return " ".join("".join(self._text).split())

    def handle_starttag(self, tag: str, attrs: list[tuple[str, Any]]) -> None:
        self._see(tag, attrs)
        if tag not in VOID:
            self.unclosed.append(tag)

    def handle_startendtag(self, tag: str, attrs: list[tuple[str, Any]]) -> None:
        self._see(tag, attrs)

    def handle_endtag(self, tag: str) -> None:
        assert self.unclosed, f"</{tag}> closes nothing"
        assert self.unclosed[-1] == tag, f"</{tag}> closes <{self.unclosed[-1]}>"
        self.unclosed.pop()
        self._text.append(" ")

    def handle_data(self, data: str) -> None:
        if "style" not in self.unclosed:
            self._text.append(data)

    def _see(self, tag: str, attrs: list[tuple[str, Any]]) -> None:
        self.tags.append(tag)
        self.fetched += [value for name, value in attrs if name in FETCHES]
        self.ids += [value for name, value in attrs if name == "id"]
        self.handlers += [name for name, _ in attrs if name.startswith("on")]

    @property
    def needs(self) -> list[str]:
        """What it would take from elsewhere."""
        return [address for address in self.fetched if not address.startswith(("#", "data:image/jpeg;base64,"))]
