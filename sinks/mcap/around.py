"""Keeps the last seconds in memory and lets through what is near an event."""

from __future__ import annotations

import logging
from collections import deque

from pipeline.frame import NS_PER_S
from pipeline.mcap.writer import Item
from pipeline.verdict import Event

log = logging.getLogger("syncwatch.sinks.mcap")

AT_ONCE = 8
"""Messages let through for one that comes in: what has waited is written soon, but not in one go that stalls frames."""


class Around:
    """A queue of messages, those not near an event being given up once they are too old, or too much.

    Time is the messages' own: their log time.
    """

    def __init__(self, reach_s: float, most_bytes: int) -> None:
        self._reach_ns = round(reach_s * NS_PER_S)
        self._most_bytes = most_bytes
        self._items: deque[Item] = deque()
        self._bytes = 0
        self._open: set[str] = set()
        self._due_until_ns: int | None = None
        self._told = False

    def put(self, item: Item) -> list[Item]:
        """Takes a message; those to be written now."""
        self._items.append(item)
        self._bytes += item.size
        due = self._due(AT_ONCE)
        while self._items and self._items[0].log_time_ns < item.log_time_ns - self._reach_ns and not self._is_due():
            self._pop()
        while self._bytes > self._most_bytes:
            if self._is_due():
                due.append(self._pop())
            else:
                self._say_too_much(item.log_time_ns - self._pop().log_time_ns)
        return due

    def take(self, event: Event, at_ns: int) -> None:
        """Takes note of an event that begins or ends."""
        if event.phase == "onset":
            self._open.add(event.id)
        else:
            self._open.discard(event.id)
        self._due_until_ns = at_ns + self._reach_ns

    def finish(self) -> list[Item]:
        """What is still to be written."""
        return self._due(len(self._items))

    def _due(self, most: int) -> list[Item]:
        due: list[Item] = []
        while len(due) < most and self._is_due():
            due.append(self._pop())
        return due

    def _is_due(self) -> bool:
        """Whether the oldest message lies near an event."""
        if not self._items:
            return False
        return bool(self._open) or (self._due_until_ns is not None and self._items[0].log_time_ns <= self._due_until_ns)

    def _pop(self) -> Item:
        item = self._items.popleft()
        self._bytes -= item.size
        return item

    def _say_too_much(self, kept_ns: int) -> None:
        if not self._told:
            self._told = True
            log.warning(
                "only the last %.1f s before an event fit into ring_bytes (%d): raise it, or record pictures as jpeg",
                kept_ns / NS_PER_S,
                self._most_bytes,
            )
