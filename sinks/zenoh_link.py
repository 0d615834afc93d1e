"""Opens a Zenoh session for a sink, keeps trying where nothing can be reached, and closes it in time."""

from __future__ import annotations

import logging
import threading
import time
from collections.abc import Callable
from typing import Protocol

import zenoh

from pipeline.deadline import done_within
from pipeline.errors import RunError
from pipeline.zenoh_network import NOBODY, RETRY_EVERY_S, first_words, session_config
from sinks.zenoh_settings import PublishingSettings

log = logging.getLogger("syncwatch.sinks.zenoh")

REQUIRED_WITHIN_S = 3.0
STOP_WITHIN_S = 1.5


class Publication(Protocol):
    """What a sink has declared on a session; `close` closes the session as well."""

    def is_connected(self) -> bool: ...

    def close(self) -> None: ...


class ZenohLink:
    """One session, from `start` to `stop`.

    publish: declares on a fresh session, in the thread of `start` or later in one of its own, and returns what it
    declared; RunError from it is for good (`refused`). name: of the sink, for people.
    """

    def __init__(
        self, settings: PublishingSettings, publish: Callable[[zenoh.Session], Publication], *, name: str
    ) -> None:
        self.refused: RunError | None = None
        self._settings = settings
        self._publish = publish
        self._name = name
        self._lock = threading.Lock()
        self._publication: Publication | None = None
        self._stopped = threading.Event()
        self._opener = threading.Thread(target=self._open_until_stopped, name=f"{name}-open", daemon=True)

    def start(self) -> None:
        """Tries to open; where that fails it warns once and goes on trying.

        Raises RunError if nothing can be reached and that is `required`, or if publishing was refused.
        """
        deadline = time.monotonic() + REQUIRED_WITHIN_S
        error = self._try_to_open()
        while self._settings.required and self.refused is None and not self._is_reached():
            if time.monotonic() > deadline:
                self._close(STOP_WITHIN_S)
                raise RunError(f"{self._name}: cannot reach {self._settings.where}: {error or NOBODY}")
            if self._publication is None:
                error = self._try_to_open()
            else:
                time.sleep(RETRY_EVERY_S)
        if self.refused is not None:
            raise self.refused
        if not self._is_reached():
            log.warning("%s: cannot reach %s yet, trying on (%s)", self._name, self._settings.where, error or NOBODY)
        if self._publication is None:
            self._opener.start()

    def stop(self) -> None:
        """Closes what is open, within STOP_WITHIN_S."""
        deadline = time.monotonic() + STOP_WITHIN_S
        with self._lock:
            self._stopped.set()
        if self._opener.is_alive():
            self._opener.join(STOP_WITHIN_S)
        self._close(max(deadline - time.monotonic(), 0.0))

    def _is_reached(self) -> bool:
        """A peer opens its session whether or not anyone is at the endpoints it was given."""
        publication = self._publication
        return publication is not None and (not self._settings.connect or publication.is_connected())

    def _close(self, within_s: float) -> None:
        if self._publication is not None and not done_within(within_s, self._publication.close, f"{self._name}-close"):
            log.warning("%s: the session did not close in time", self._name)

    def _open_until_stopped(self) -> None:
        while not self._stopped.is_set() and self._publication is None and self.refused is None:
            self._try_to_open()
            self._stopped.wait(RETRY_EVERY_S)
        if self._publication is not None:
            log.info("%s: connected to %s", self._name, self._settings.where)

    def _try_to_open(self) -> str:
        """Returns what went wrong, if anything."""
        try:
            session = zenoh.open(session_config(self._settings))
        except zenoh.ZError as error:
            return first_words(error)
        try:
            publication = self._publish(session)
        except zenoh.ZError as error:  # what was open may be gone again
            session.close()
            return first_words(error)
        except RunError as error:
            session.close()
            self.refused = error
            return str(error)
        with self._lock:
            if not self._stopped.is_set():
                self._publication = publication
                return ""
        publication.close()
        return ""
