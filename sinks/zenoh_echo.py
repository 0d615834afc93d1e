"""Finds out whether a router passes on what is published, as one that refuses it does so in silence."""

from __future__ import annotations

import time

import zenoh

from pipeline.errors import InputError
from pipeline.zenoh_reach import Network

ENOUGH = 3
"""So many messages, one a second, of which none has come back are no accident."""

SETTLE_S = 1.0
"""How long it takes until a new subscriber is known to everybody."""


class Echo:
    """Listens for our own messages with a second session, until one comes back or enough have not.

    Only a router is asked: peers pass nothing on. `sent` is called for every message under the key, `look` now and
    again from one thread.
    """

    def __init__(self, network: Network, key: str) -> None:
        self._network = network
        self._key = key
        self._session: zenoh.Session | None = None
        self._subscriber: zenoh.Subscriber[zenoh.handlers.Handler[zenoh.Sample]] | None = None
        self._sent = 0
        self._before = 0
        self._listening_since_s = 0.0

    def sent(self) -> None:
        self._sent += 1

    def look(self) -> bool | None:
        """True: it came back, or no router is there to refuse it. False: it did not. None: too early to say."""
        try:
            if self._subscriber is None:
                self._listen()
            return self._heard()
        except (zenoh.ZError, InputError):  # the router is gone again, or a file that a session needs
            self.close()
            return None

    def close(self) -> None:
        session, self._session, self._subscriber = self._session, None, None
        if session is not None:
            session.close()

    def _listen(self) -> None:
        self._session = self._network.open()
        self._subscriber = self._session.declare_subscriber(self._key, zenoh.handlers.RingChannel(1))
        self._listening_since_s, self._before = time.monotonic(), self._sent

    def _heard(self) -> bool | None:
        assert self._session is not None
        assert self._subscriber is not None
        if self._subscriber.try_recv() is not None:
            return True
        if not self._session.info.routers_zid():
            return True if self._session.info.peers_zid() else None
        if time.monotonic() - self._listening_since_s < SETTLE_S:
            self._before = self._sent
        return False if self._sent - self._before >= ENOUGH else None
