"""An open Zenoh session with everything that is declared on it for one rig."""

from __future__ import annotations

import json
import logging
import threading
from collections.abc import Callable, Sequence
from contextlib import ExitStack

import zenoh
import zenoh.ext

from pipeline.verdict import ALIGNED_SCHEMA, EVENT_SCHEMA, STATUS_SCHEMA, VERDICT_SCHEMA, Message
from pipeline.zenoh_network import is_linked

log = logging.getLogger("syncwatch.sinks.zenoh")

EVENT_CACHE = 1000
"""Events that a late or briefly cut subscriber can still get, and that wait for a network that is not there yet."""

HEARTBEAT_S = 0.5
"""How soon a subscriber notices that it missed the last event."""

ANSWER_EVERY_S = 0.02
QUERIES_WAITING = 256

JPEG = "image/jpeg"
"""Stands where other messages have the name of their schema."""

CONGESTION = {
    STATUS_SCHEMA: zenoh.CongestionControl.BLOCK,
    VERDICT_SCHEMA: zenoh.CongestionControl.DROP,
    ALIGNED_SCHEMA: zenoh.CongestionControl.DROP,
    JPEG: zenoh.CongestionControl.DROP,
}


def encoding(schema: str) -> zenoh.Encoding:
    json_encoding = zenoh.Encoding.APPLICATION_JSON
    made: zenoh.Encoding = zenoh.Encoding.IMAGE_JPEG if schema == JPEG else json_encoding.with_schema(schema)
    return made


def _past_events(session: zenoh.Session, key: str, events: Sequence[Message]) -> zenoh.ext.AdvancedPublisher:
    """Fills a cache of its own, which subscribers with history ask when they notice this publisher; puts reach nobody.

    They notice it whenever they are linked to it anew, as a link that comes late and a monitor that comes late cannot
    be told apart: who has heard the former run as well gets its events again.
    """
    publisher = zenoh.ext.declare_advanced_publisher(
        session,
        key,
        encoding=encoding(EVENT_SCHEMA),
        allowed_destination=zenoh.Locality.SESSION_LOCAL,
        cache=zenoh.ext.CacheConfig(max_samples=EVENT_CACHE),
        publisher_detection=True,
    )
    for event in events:
        publisher.put(json.dumps(event))
    return publisher


class Published:
    """An open session with everything that is declared on it.

    Queries are polled for: a Python callback that zenoh runs on a thread of its own can abort the process when the
    interpreter ends meanwhile.
    """

    def __init__(
        self,
        session: zenoh.Session,
        root: str,
        answer: Callable[[zenoh.Query], None],
        history: Sequence[Message] = (),
    ) -> None:
        self._session = session
        self._open = ExitStack()
        self._open.enter_context(session)
        self._answer = answer
        self._closing = threading.Event()
        self._publishers: dict[str, zenoh.Publisher] = {}
        self._past = _past_events(session, f"{root}/event", history) if history else None
        self._events = zenoh.ext.declare_advanced_publisher(
            session,
            f"{root}/event",
            encoding=encoding(EVENT_SCHEMA),
            congestion_control=zenoh.CongestionControl.BLOCK,
            cache=zenoh.ext.CacheConfig(max_samples=EVENT_CACHE),
            sample_miss_detection=zenoh.ext.MissDetectionConfig(heartbeat=HEARTBEAT_S, sporadic_heartbeat=None),
            publisher_detection=True,
        )
        queryable = session.declare_queryable(f"{root}/**", zenoh.handlers.FifoChannel(QUERIES_WAITING))
        self._queryable = self._open.enter_context(queryable)
        self._open.enter_context(session.liveliness().declare_token(f"{root}/alive"))
        self._answerer = threading.Thread(target=self._answer_queries, name="zenoh-answer", daemon=True)
        self._answerer.start()

    def is_connected(self) -> bool:
        return is_linked(self._session)

    def event(self, message: Message) -> None:
        self._events.put(json.dumps(message))

    def put(self, key: str, payload: str | bytes, schema: str) -> None:
        """Publishes; pictures behind everything else, so that they hold nothing up."""
        publisher = self._publishers.get(key)
        if publisher is None:
            publisher = self._session.declare_publisher(
                key,
                encoding=encoding(schema),
                congestion_control=CONGESTION[schema],
                priority=zenoh.Priority.DATA_LOW if schema == JPEG else zenoh.Priority.DEFAULT,
            )
            self._publishers[key] = publisher
        publisher.put(payload)

    def close(self) -> None:
        self._closing.set()
        self._answerer.join()
        self._open.close()  # the token first, the session last

    def _answer_queries(self) -> None:
        while not self._closing.wait(ANSWER_EVERY_S) and not self._session.is_closed():
            try:
                while (query := self._queryable.try_recv()) is not None:
                    self._answer(query)
            except zenoh.ZError as error:  # one that asked and left must not end the answers to others
                log.debug("zenoh: a query could not be answered: %s", error)
