"""Publishes verdicts, events and status over Zenoh, whatever the network does."""

from __future__ import annotations

import json
import logging
import re
import threading
import time
from collections import deque
from collections.abc import Callable
from typing import Annotated, Any, Literal

import zenoh
import zenoh.ext
from pydantic import AfterValidator, model_validator

from pipeline.errors import InputError, RunError
from pipeline.settings import Settings
from pipeline.verdict import EVENT_SCHEMA, STATUS_SCHEMA, VERDICT_SCHEMA, Event, Message, Report, Status, Verdict

log = logging.getLogger("syncwatch.sinks.zenoh")

EVENT_CACHE = 1000
"""Events that a late or briefly cut subscriber can still get, and that wait for a network that is not there yet."""

HEARTBEAT_S = 0.5
"""How soon a subscriber notices that it missed the last event."""

FIND_OTHERS_S = 0.8
"""How long another monitor of the same rig is looked for: peers on one machine find each other in about half of it."""

ANSWER_EVERY_S = 0.02
QUERIES_WAITING = 256

TRY_OPEN_MS = 1000
REQUIRED_WITHIN_S = 3.0
STOP_WITHIN_S = 1.5
RETRY = {"period_init_ms": 200, "period_max_ms": 2000, "period_increase_factor": 1.5}
"""Reconnecting starts quickly and stays gentle on a router that comes back to many rigs."""

KEY_CHUNK = re.compile(r"[^/*$#?\s]+")
ENDPOINT = re.compile(r"(tcp|udp|tls|quic|ws|unixsock-stream)/\S+")


def _key_prefix(value: str) -> str:
    if not all(KEY_CHUNK.fullmatch(chunk) for chunk in value.split("/")):
        raise ValueError(f"'{value}' is not a key: chunks of letters, digits, - _ . joined by /, e.g. site/hall2")
    return value


def _endpoint(value: str) -> str:
    if not ENDPOINT.fullmatch(value):
        raise ValueError(f"'{value}' is not an endpoint: write it like tcp/192.168.1.5:7447")
    return value


Endpoint = Annotated[str, AfterValidator(_endpoint)]


class ZenohSettings(Settings):
    """Where and how the rig is published, under <prefix>/<rig>.

    mode: `peer` talks to other peers, `client` through a router, `router` is one itself.
    connect, listen: endpoints. Without any, only programs on this machine can hear.
    required: end the run when nothing can be reached at the start.
    verdicts: publish all of them, those that differ in state from the one before, or none.
    """

    type: Literal["zenoh"] = "zenoh"
    mode: Literal["peer", "client", "router"] = "peer"
    prefix: Annotated[str, AfterValidator(_key_prefix)] = "syncwatch"
    connect: tuple[Endpoint, ...] = ()
    listen: tuple[Endpoint, ...] = ()
    required: bool = False
    verdicts: Literal["all", "changes", "none"] = "all"

    @model_validator(mode="after")
    def _client_has_a_router(self) -> ZenohSettings:
        if self.mode == "client" and not self.connect:
            raise ValueError("mode: client needs a router to connect to, e.g. connect: [tcp/127.0.0.1:7447]")
        return self


class ZenohSink:
    """Keys <prefix>/<rig>/status, /verdict/<pair>, /event and /alive; `get()` on <prefix>/<rig>/** answers the latest.

    Events go through an advanced publisher: a subscriber of the same kind (zenoh.ext, with history and recovery) that
    comes late or loses its connection for a while gets every one of them, in order. What is reported before the network
    is there is kept: every event (up to EVENT_CACHE), else the latest.

    Raises InputError for a rig name that cannot be part of a key, RunError when another monitor publishes this rig or,
    if `required`, when nothing can be reached.
    """

    lossless = False

    def __init__(self, settings: ZenohSettings, *, rig: str) -> None:
        if not KEY_CHUNK.fullmatch(rig):
            raise InputError(
                f"rig: '{rig}' cannot be published over Zenoh: no spaces and none of / * $ # ? in a rig's name"
            )
        self._settings = settings
        self._rig = rig
        self._root = f"{settings.prefix}/{rig}"
        self._lock = threading.Lock()
        self._latest: dict[str, tuple[str, str]] = {}
        self._early_events: deque[Message] = deque(maxlen=EVENT_CACHE)
        self._lost_events = 0
        self._published: _Published | None = None
        self._refused: RunError | None = None
        self._stopped = threading.Event()
        self._last_states: dict[str, str] = {}
        self._opener = threading.Thread(target=self._open_until_stopped, name="zenoh-open", daemon=True)

    def start(self) -> None:
        error = self._try_to_open()
        if self._refused is not None:
            raise self._refused
        if self._published is not None:
            return
        deadline = time.monotonic() + REQUIRED_WITHIN_S
        while self._settings.required and self._published is None:
            if time.monotonic() > deadline:
                raise RunError(f"zenoh: cannot reach {self._where()}: {error}")
            error = self._try_to_open()
        if self._published is None:
            log.warning("zenoh: cannot reach %s yet, trying on (%s)", self._where(), error)
            self._opener.start()

    def take(self, report: Report) -> None:
        if self._refused is not None:
            raise self._refused
        message = report.to_message()
        if isinstance(report, Event):
            self._take_event(message)
        elif isinstance(report, Status):
            self._take_latest(f"{self._root}/status", message)
        else:
            self._take_latest(f"{self._root}/verdict/{report.pair}", message, publish=self._wanted(report))

    def stop(self) -> None:
        self._stopped.set()
        if self._opener.is_alive():
            self._opener.join(STOP_WITHIN_S)
        if self._published is not None:
            closer = threading.Thread(target=self._published.close, name="zenoh-close", daemon=True)
            closer.start()
            closer.join(STOP_WITHIN_S)
            if closer.is_alive():
                log.warning("zenoh: the session did not close within %.1f s", STOP_WITHIN_S)
        unheard = self._lost_events + len(self._early_events)
        if unheard:
            log.warning("zenoh: %d events were never published: nothing could be reached in time", unheard)

    def _wanted(self, verdict: Verdict) -> bool:
        before = self._last_states.get(verdict.pair)
        self._last_states[verdict.pair] = verdict.state.value
        kind = self._settings.verdicts
        return kind == "all" or (kind == "changes" and before != verdict.state.value)

    def _take_event(self, message: Message) -> None:
        with self._lock:
            self._latest[f"{self._root}/event"] = (json.dumps(message), EVENT_SCHEMA)
            if self._published is None:
                self._lost_events += len(self._early_events) == EVENT_CACHE
                self._early_events.append(message)
                return
        self._published.event(message)

    def _take_latest(self, key: str, message: Message, *, publish: bool = True) -> None:
        text = json.dumps(message)
        schema = str(message["schema"])
        with self._lock:
            self._latest[key] = (text, schema)
            published = self._published
        if published is not None and publish:
            published.put(key, text, schema)

    def _open_until_stopped(self) -> None:
        while not self._stopped.is_set() and self._published is None and self._refused is None:
            self._try_to_open()
            self._stopped.wait(RETRY["period_init_ms"] / 1000)
        if self._published is not None:
            log.info("zenoh: connected to %s", self._where())

    def _try_to_open(self) -> str:
        """Opens the session and publishes what has waited; returns what went wrong, if anything."""
        try:
            session = zenoh.open(_config(self._settings))
        except zenoh.ZError as error:
            return str(error).splitlines()[0]
        try:
            return self._publish_from(session)
        except zenoh.ZError as error:  # what was open may be gone again
            session.close()
            return str(error).splitlines()[0]

    def _publish_from(self, session: zenoh.Session) -> str:
        if _is_taken(session, f"{self._root}/alive"):
            session.close()
            self._refused = RunError(
                f"rig '{self._rig}' is already published under '{self._root}' by another monitor: "
                "choose another name with rig: in the configuration or --set rig=NAME"
            )
            return str(self._refused)
        published = _Published(session, self._root, self._answer)
        with self._lock:
            if self._stopped.is_set():
                published.close()
                return ""
            for message in self._early_events:
                published.event(message)
            self._early_events.clear()
            for key, (text, schema) in self._latest.items():
                if schema != EVENT_SCHEMA:
                    published.put(key, text, schema)
            self._published = published
        return ""

    def _answer(self, query: zenoh.Query) -> None:
        """Answers with the latest of everything that was asked for."""
        with self._lock:
            latest = dict(self._latest)
        with query:
            for key, (text, schema) in latest.items():
                if query.key_expr.intersects(zenoh.KeyExpr(key)):
                    query.reply(key, text, encoding=_encoding(schema))

    def _where(self) -> str:
        return ", ".join(self._settings.connect) or "the local network"


class _Published:
    """An open session with everything that is declared on it.

    Queries are polled for: a Python callback that zenoh runs on a thread of its own can abort the process when the
    interpreter ends meanwhile.
    """

    def __init__(self, session: zenoh.Session, root: str, answer: Callable[[zenoh.Query], None]) -> None:
        self._session = session
        self._answer = answer
        self._closing = threading.Event()
        self._publishers: dict[str, zenoh.Publisher] = {}
        self._events = zenoh.ext.declare_advanced_publisher(
            session,
            f"{root}/event",
            encoding=_encoding(EVENT_SCHEMA),
            congestion_control=zenoh.CongestionControl.BLOCK,
            cache=zenoh.ext.CacheConfig(max_samples=EVENT_CACHE),
            sample_miss_detection=zenoh.ext.MissDetectionConfig(heartbeat=HEARTBEAT_S, sporadic_heartbeat=None),
            publisher_detection=True,
        )
        self._queryable = session.declare_queryable(f"{root}/**", zenoh.handlers.FifoChannel(QUERIES_WAITING))
        self._token = session.liveliness().declare_token(f"{root}/alive")
        self._answerer = threading.Thread(target=self._answer_queries, name="zenoh-answer", daemon=True)
        self._answerer.start()

    def event(self, message: Message) -> None:
        self._events.put(json.dumps(message))

    def put(self, key: str, text: str, schema: str) -> None:
        publisher = self._publishers.get(key)
        if publisher is None:
            control = CONGESTION[schema]
            publisher = self._session.declare_publisher(key, encoding=_encoding(schema), congestion_control=control)
            self._publishers[key] = publisher
        publisher.put(text)

    def close(self) -> None:
        self._closing.set()
        self._answerer.join()
        self._token.undeclare()
        self._queryable.undeclare()
        self._session.close()

    def _answer_queries(self) -> None:
        while not self._closing.wait(ANSWER_EVERY_S):
            try:
                while (query := self._queryable.try_recv()) is not None:
                    self._answer(query)
            except zenoh.ZError as error:  # one that asked and left must not end the answers to others
                log.debug("zenoh: a query could not be answered: %s", error)


CONGESTION = {STATUS_SCHEMA: zenoh.CongestionControl.BLOCK, VERDICT_SCHEMA: zenoh.CongestionControl.DROP}


def _encoding(schema: str) -> zenoh.Encoding:
    return zenoh.Encoding.APPLICATION_JSON.with_schema(schema)


def _is_taken(session: zenoh.Session, key: str) -> bool:
    """Whether somebody else holds the token; asked again until peers have had time to find each other."""
    deadline = time.monotonic() + FIND_OTHERS_S
    while True:
        if any(reply.ok for reply in session.liveliness().get(key, timeout=0.2)):
            return True
        if time.monotonic() > deadline:
            return False
        time.sleep(0.1)


def _config(settings: ZenohSettings) -> zenoh.Config:
    config = zenoh.Config()
    local = not settings.connect and not settings.listen
    values: dict[str, Any] = {
        "mode": settings.mode,
        "connect/endpoints": list(settings.connect),
        "connect/retry": RETRY,
        "listen/endpoints": ["tcp/127.0.0.1:0"] if local else list(settings.listen),
        "scouting/multicast/enabled": local,
        "timestamping/enabled": True,
    }
    if settings.mode == "client":
        values["connect/timeout_ms"] = TRY_OPEN_MS
    if local:
        values["scouting/multicast/interface"] = "lo"
    for key, value in values.items():
        config.insert_json5(key, json.dumps(value))
    return config
