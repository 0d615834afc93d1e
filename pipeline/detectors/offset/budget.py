"""Keeps a detector within its share of a core by leaving windows out."""

from __future__ import annotations

from collections.abc import Callable
from types import TracebackType


class Budget:
    """A share of a core, in windows: what one window used beyond its share is saved by the next ones.

    Windows are counted by their index, so those that were dropped before they came here count as saved.
    """

    def __init__(self, share: float, period_ns: int, cpu_ns: Callable[[], int]) -> None:
        self._a_window_ns = share * period_ns
        self._unlimited = share >= 1
        self._cpu_ns = cpu_ns
        self._owed_ns = 0.0
        self._last: int | None = None
        self._began_ns = 0

    def allows(self, index: int) -> bool:
        """Whether the window may be looked at."""
        if self._unlimited:
            return True
        passed = 0 if self._last is None else index - self._last
        self._last = index
        self._owed_ns = max(0.0, self._owed_ns - passed * self._a_window_ns)
        return self._owed_ns < self._a_window_ns

    def __enter__(self) -> None:
        self._began_ns = self._cpu_ns()

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._owed_ns += self._cpu_ns() - self._began_ns
