"""What a replay says about its input in the log: clear sentences, each of them once."""

from __future__ import annotations

import logging

LOGGER = logging.getLogger("syncwatch.sources.replay")


class Notices:
    """Says each sentence once, however often a recording loops."""

    def __init__(self) -> None:
        self._said: set[str] = set()

    def info(self, text: str) -> None:
        self._say(logging.INFO, text)

    def warning(self, text: str) -> None:
        self._say(logging.WARNING, text)

    def _say(self, level: int, text: str) -> None:
        if text not in self._said:
            self._said.add(text)
            LOGGER.log(level, text)
