"""A bounded queue that says what it does when full, and closes even when one side has died."""

from __future__ import annotations

import math
import threading
import time
from collections import deque
from collections.abc import Callable
from typing import Generic, TypeVar

Item = TypeVar("Item")

LOOK_S = 0.1
"""How often a waiting putter looks whether it is to hurry."""


class QueueClosedError(Exception):
    """The queue is closed and, when getting, empty."""


class BoundedQueue(Generic[Item]):
    """Many putters, one getter.

    `put` waits for room when `wait` is set; otherwise, or when the time that `hurry` allowed is over, the oldest item
    for which `expendable` is true gives way (any oldest item if none is), counted in `dropped`.
    `close` lets the getter have what is left and refuses more.
    """

    def __init__(self, size: int, *, wait: bool, expendable: Callable[[Item], bool] = lambda _: True) -> None:
        self._size = size
        self._wait = wait
        self._expendable = expendable
        self._items: deque[Item] = deque()
        self._changed = threading.Condition()
        self._closed = False
        self._wait_until_s = math.inf
        self.dropped = 0

    def put(self, item: Item) -> None:
        """Adds an item. Raises QueueClosedError after `close`."""
        with self._changed:
            while self._must_wait():
                self._changed.wait(LOOK_S)
            if self._closed:
                raise QueueClosedError
            if len(self._items) >= self._size:
                self._drop_one()
            self._items.append(item)
            self._changed.notify_all()

    def get(self, timeout_s: float | None = None) -> Item:
        """Takes the oldest item. Raises QueueClosedError when none will come, TimeoutError when none came in time."""
        deadline = None if timeout_s is None else time.monotonic() + timeout_s
        with self._changed:
            while not self._items:
                if self._closed:
                    raise QueueClosedError
                left = None if deadline is None else deadline - time.monotonic()
                if left is not None and left <= 0:
                    raise TimeoutError
                self._changed.wait(left)
            item = self._items.popleft()
            self._changed.notify_all()
            return item

    def hurry(self, within_s: float) -> None:
        """After this time nobody waits for room any more. Takes no lock: signal handlers may call it."""
        self._wait_until_s = time.monotonic() + within_s

    def close(self) -> None:
        with self._changed:
            self._closed = True
            self._changed.notify_all()

    def __len__(self) -> int:
        return len(self._items)

    def _must_wait(self) -> bool:
        full = len(self._items) >= self._size
        return full and self._wait and not self._closed and time.monotonic() < self._wait_until_s

    def _drop_one(self) -> None:
        self.dropped += 1
        for index, item in enumerate(self._items):
            if self._expendable(item):
                del self._items[index]
                return
        self._items.popleft()
