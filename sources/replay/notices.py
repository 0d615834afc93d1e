"""What a replay says about its input in the log: clear sentences, each of them once."""

from __future__ import annotations

import logging

LOGGER = logging.getLogger("syncwatch.sources.replay")


class Notices:
    """Says each sentence once, however often a recording loops."""

    def __init__(self, logger: logging.Logger = LOGGER) -> None:
        self._logger = logger
        self._said: set[str] = set()

    def info(self, text: str) -> None:
        self._say(logging.INFO, text)

    def warning(self, text: str) -> None:
        self._say(logging.WARNING, text)

    def _say(self, level: int, text: str) -> None:
        if text not in self._said:
            self._said.add(text)
            self._logger.log(level, text)
