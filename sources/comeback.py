"""What a live camera that fails and comes back is told of, and how long is waited before the next try."""

from __future__ import annotations

import logging
from collections.abc import Callable

from pipeline.frame import NS_PER_S

FIRST_RETRY_S, RETRY_FACTOR, LONGEST_RETRY_S = 0.2, 1.5, 2.0


class Comeback:
    """Says each trouble of one camera once, and its end. clock_ns: the host's monotonic time."""

    def __init__(self, camera: str, logger: logging.Logger, clock_ns: Callable[[], int]) -> None:
        self._camera = camera
        self._logger = logger
        self._clock_ns = clock_ns
        self._retry_s = FIRST_RETRY_S
        self._trouble: str | None = None
        self._down_since_ns = 0

    def fell(self, trouble: str) -> float:
        """Takes a failure, in words; the seconds to wait before the next try, longer each time."""
        if self._trouble is None:
            self._down_since_ns = self._clock_ns()
        if trouble != self._trouble:
            self._logger.warning("%s: %s; trying again until it works", self._camera, trouble)
        self._trouble = trouble
        wait_s = self._retry_s
        self._retry_s = min(self._retry_s * RETRY_FACTOR, LONGEST_RETRY_S)
        return wait_s

    def rose(self, where: str = "") -> None:
        """Takes a picture. where: in words that follow "pictures again"."""
        self._retry_s = FIRST_RETRY_S
        if self._trouble is not None:
            down_s = (self._clock_ns() - self._down_since_ns) / NS_PER_S
            self._logger.warning("%s: pictures again%s, after %.1f s", self._camera, where, down_s)
            self._trouble = None
