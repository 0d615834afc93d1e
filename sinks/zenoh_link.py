"""Opens a Zenoh session for a sink, keeps trying where nothing can be reached, and closes it in time."""

from __future__ import annotations

import logging
import threading
import time
from collections.abc import Callable
from pathlib import Path
from typing import Protocol

import zenoh

from pipeline.deadline import done_within, ended_within
from pipeline.errors import InputError, RunError
from pipeline.zenoh_network import RETRY_EVERY_S
from pipeline.zenoh_reach import NOBODY, Network, first_words
from sinks.zenoh_echo import Echo
from sinks.zenoh_settings import PublishingSettings

log = logging.getLogger("syncwatch.sinks.zenoh")

REQUIRED_WITHIN_S = 3.0
STOP_WITHIN_S = 1.5

LOST_AFTER_S = 2.0
"""How long a link may be away before that is worth a line: a router that restarts is back sooner."""


class Publication(Protocol):
    """What a sink has declared on a session; `close` closes the session as well."""

    def is_connected(self) -> bool: ...

    def close(self) -> None: ...


class ZenohLink:
    """One session, from `start` to `stop`.

    publish: declares on a fresh session, in the thread of `start` or later in one of its own, and returns what it
    declared; RunError from it is for good (`refused`). name: of the sink, for people. base: the folder that relative
    paths count from. echo: a key under which something is published once a second; the sink says so by `sent`.

    Raises InputError for certificates and passwords that are not there or no good.
    """

    def __init__(
        self,
        settings: PublishingSettings,
        publish: Callable[[zenoh.Session], Publication],
        *,
        name: str,
        base: Path = Path(),
        echo: str | None = None,
    ) -> None:
        self.refused: RunError | None = None
        self._settings = settings
        try:
            self._network = Network(settings, base)
        except InputError as error:
            raise InputError(f"{name}: {error}") from None
        self._publish = publish
        self._name = name
        self._echo = Echo(self._network, echo) if echo is not None and settings.mode == "client" else None
        self._lock = threading.Lock()
        self._publication: Publication | None = None
        self._said: set[str] = set()
        self._linked_s: float | None = None
        self._stopped = threading.Event()
        self._keeper = threading.Thread(target=self._keep, name=f"{name}-keep", daemon=True)

    def start(self) -> None:
        """Tries to open; where that fails it warns once for each reason and goes on trying.

        Raises RunError if nothing can be reached and that is `required`, or if publishing was refused.
        """
        deadline = time.monotonic() + REQUIRED_WITHIN_S
        error = self._try_to_open()
        while self._settings.required and self.refused is None and not self._is_reached():
            if time.monotonic() > deadline:
                self._close(STOP_WITHIN_S)
                raise RunError(f"{self._name}: cannot reach {self._settings.where}: {error or self._why_not()}")
            if self._publication is None:
                error = self._try_to_open()
            else:
                time.sleep(RETRY_EVERY_S)
        if self.refused is not None:
            raise self.refused
        if self._is_reached():
            self._linked_s = time.monotonic()
        else:
            self._complain("yet, trying on", error or self._why_not())
        if self._settings.connect or self._publication is None:
            self._keeper.start()

    def sent(self) -> None:
        """Something was published under the key `echo`."""
        if self._echo is not None:
            self._echo.sent()

    def stop(self) -> None:
        """Closes what is open, within STOP_WITHIN_S."""
        deadline = time.monotonic() + STOP_WITHIN_S
        with self._lock:
            self._stopped.set()
        if self._keeper.is_alive():
            ended_within(STOP_WITHIN_S, self._keeper)
        self._close(max(deadline - time.monotonic(), 0.0))

    def _is_reached(self) -> bool:
        """A peer opens its session whether or not anyone is at the endpoints it was given."""
        publication = self._publication
        return publication is not None and (not self._settings.connect or publication.is_connected())

    def _close(self, within_s: float) -> None:
        if self._publication is not None and not done_within(within_s, self._publication.close, f"{self._name}-close"):
            log.warning("%s: the session did not close in time", self._name)

    def _keep(self) -> None:
        """The keeping thread: opens, and says when the other side is lost, found, or passes nothing on."""
        try:
            while not self._stopped.wait(RETRY_EVERY_S) and self.refused is None:
                if self._publication is None:
                    error = self._try_to_open()
                    if error and self.refused is None:
                        self._complain("yet, trying on", error)
                elif self._is_reached():
                    self._note_linked()
                elif self._linked_s is not None and time.monotonic() - self._linked_s > LOST_AFTER_S:
                    self._linked_s = None
                    self._complain("any more, trying on", self._why_not())
        finally:
            if self._echo is not None:
                done_within(STOP_WITHIN_S / 2, self._echo.close, f"{self._name}-echo-close")

    def _note_linked(self) -> None:
        if self._linked_s is None:
            log.info("%s: connected to %s", self._name, self._settings.where)
            self._said.clear()
        self._linked_s = time.monotonic()
        came_back = None if self._echo is None else self._echo.look()
        if self._echo is None or came_back is None:
            return
        if not came_back:
            who = f"user '{self._settings.user}'" if self._settings.user else "this program"
            log.warning(
                "%s: %s is reached but passes nothing of ours on: its access control may refuse %s the name of this "
                "rig, or of this prefix",
                self._name,
                self._settings.where,
                who,
            )
        self._echo.close()
        self._echo = None

    def _complain(self, how_long: str, reason: str) -> None:
        if reason not in self._said:
            self._said.add(reason)
            log.warning("%s: cannot reach %s %s (%s)", self._name, self._settings.where, how_long, reason)

    def _why_not(self) -> str:
        return self._network.why_not() or NOBODY

    def _try_to_open(self) -> str:
        """Returns what went wrong, if anything."""
        try:
            session = self._network.open()
        except zenoh.ZError as error:
            return self._network.why_not() or first_words(error)
        except InputError as error:
            return str(error)
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
