"""Tells a page what changes, as server-sent events."""

from __future__ import annotations

import asyncio
import time
from collections.abc import AsyncIterator, Callable
from contextlib import suppress
from typing import Any

from pipeline.dashboard.views import as_text, fleet_view, offsets_view, rig_view, summary_view
from pipeline.fleet.listener import FleetListener
from pipeline.fleet.offsets import KEPT_NS
from pipeline.frame import NS_PER_MS

TICK_S = 0.5
FRESH_NS = 400 * NS_PER_MS
"""For how long what is written down for all pages holds; less than a tick."""


class Board:
    """What all pages are told alike: written down once a tick, however many there are."""

    def __init__(self, listener: FleetListener, monotonic_ns: Callable[[], int] = time.monotonic_ns) -> None:
        self.listener = listener
        self._monotonic_ns = monotonic_ns
        self._written: dict[str, tuple[int, str]] = {}

    def fleet(self) -> str:
        return self._event("fleet", fleet_view)

    def summary(self) -> str:
        return self._event("summary", summary_view)

    def _event(self, name: str, view: Callable[[FleetListener], dict[str, Any]]) -> str:
        now_ns = self._monotonic_ns()
        written = self._written.get(name)
        if written is None or now_ns - written[0] >= FRESH_NS:
            written = self._written[name] = (now_ns, _event(name, view(self.listener)))
        return written[1]


class Stream:
    """What one page is told. Nothing is queued for it: a page that is slow is told less often, of how it stands then.

    rig: the one that the page shows; None for all of them.
    """

    def __init__(self, board: Board, rig: str | None, monotonic_ns: Callable[[], int] = time.monotonic_ns) -> None:
        self._board = board
        self._listener = board.listener
        self._rig = rig
        self._monotonic_ns = monotonic_ns
        self._told: dict[str, str] = {}
        self._told_until_ns = 0

    async def messages(self, stopping: asyncio.Event) -> AsyncIterator[str]:
        """Events as they go over the wire, until `stopping` is set. Every tick ends with one called `tick`."""
        while not stopping.is_set():
            yield "".join(self.tick())
            with suppress(asyncio.TimeoutError):
                await asyncio.wait_for(stopping.wait(), TICK_S)

    def tick(self) -> list[str]:
        """What is to be told now."""
        told = self._about_all() if self._rig is None else self._about_one(self._rig)
        return [*told, _event("tick", {"now_ms": self._monotonic_ns() // NS_PER_MS})]

    def _about_all(self) -> list[str]:
        return self._if_new("fleet", self._board.fleet())

    def _about_one(self, name: str) -> list[str]:
        self._listener.look_at(name)
        told = self._if_new("summary", self._board.summary())
        rig = self._listener.fleet.rig(name)
        told += self._if_changed("rig", {"name": name, "unheard_of": True} if rig is None else rig_view(rig))
        return told + self._offsets(name)

    def _offsets(self, name: str) -> list[str]:
        """The points that are new or may have changed since the last tick."""
        now_ns = self._monotonic_ns()
        offsets = self._listener.fleet.offsets(name, self._told_until_ns)
        last_ns = max((points[-1].at_ns for points in offsets.values() if points), default=self._told_until_ns)
        self._told_until_ns = max(last_ns, now_ns - KEPT_NS)
        return self._if_changed("offsets", offsets_view(offsets)) if any(offsets.values()) else []

    def _if_changed(self, name: str, message: dict[str, Any]) -> list[str]:
        return self._if_new(name, _event(name, message))

    def _if_new(self, name: str, text: str) -> list[str]:
        if self._told.get(name) == text:
            return []
        self._told[name] = text
        return [text]


def _event(name: str, message: dict[str, Any]) -> str:
    return f"event: {name}\ndata: {as_text(message)}\n\n"
