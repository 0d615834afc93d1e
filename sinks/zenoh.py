"""Publishes verdicts, events and status over Zenoh, whatever the network does."""

from __future__ import annotations

import json
import logging
import threading
import time
from collections import deque
from collections.abc import Sequence
from pathlib import Path

import zenoh

from pipeline.errors import InputError, RunError
from pipeline.frame import Frame
from pipeline.verdict import EVENT_SCHEMA, AlignedPair, Event, Message, Report, Status, Verdict
from sinks.zenoh_link import ZenohLink
from sinks.zenoh_preview import Previews
from sinks.zenoh_session import EVENT_CACHE, JPEG, Published, encoding
from sinks.zenoh_settings import ZenohSettings, is_key_chunk

__all__ = ["ZenohSettings", "ZenohSink"]

log = logging.getLogger("syncwatch.sinks.zenoh")

FIND_OTHERS_S = 0.8
"""How long another monitor of the same rig is looked for: peers on one machine find each other in about half of it."""


class ZenohSink:
    """Publishes status, verdict/<pair>, event and alive under <prefix>/<rig>, and preview/<camera> where it is wanted.

    `get()` on <prefix>/<rig>/** answers the latest of each. Previews are small JPEGs, everything else is JSON.

    Events go through an advanced publisher: a subscriber of the same kind (zenoh.ext, with history, late publishers and
    heartbeat recovery) that comes late or is cut off gets every one of them, once and in order, whether it was the
    router or the subscriber that went away, as long as fewer than EVENT_CACHE are published meanwhile. Of more, the
    oldest are lost. A plain subscriber misses what happens while it is cut off. What is reported before the network is
    there is kept: every event (up to EVENT_CACHE), else the latest.
    history: events of former runs, for subscribers of the same kind that come late. One that has been there gets them
    again, each with the id and phase it had.

    Raises InputError for a rig name that cannot be part of a key and for certificates or passwords that are no good,
    RunError when another monitor publishes this rig or, if `required`, when nothing can be reached.
    """

    lossless = False

    def __init__(
        self, settings: ZenohSettings, *, rig: str, history: Sequence[Message] = (), base: Path = Path()
    ) -> None:
        if not is_key_chunk(rig):
            raise InputError(
                f"rig: '{rig}' cannot be published over Zenoh: no spaces, none of / * $ # ? and no @ first"
            )
        self._settings = settings
        self._rig = rig
        self._root = f"{settings.prefix}/{rig}"
        self._lock = threading.Lock()
        self._latest: dict[str, tuple[str | bytes, str]] = {}
        self._history = tuple(history)[-EVENT_CACHE:]
        if self._history:
            self._latest[f"{self._root}/event"] = (json.dumps(self._history[-1]), EVENT_SCHEMA)
        self._early_events: deque[Message] = deque(maxlen=EVENT_CACHE)
        self._lost_events = 0
        self._published: Published | None = None
        self._last_states: dict[str, str] = {}
        self._previews = settings.preview and Previews(settings.preview)
        self._link = ZenohLink(settings, self._publish_from, name="zenoh", base=base, echo=f"{self._root}/status")

    def start(self) -> None:
        self._link.start()

    def take(self, report: Report) -> None:
        if self._link.refused is not None:
            raise self._link.refused
        message = report.to_message()
        if isinstance(report, Event):
            self._take_event(message)
        elif isinstance(report, Status):
            self._take_latest(f"{self._root}/status", message)
            self._link.sent()
        elif isinstance(report, AlignedPair):
            self._take_latest(f"{self._root}/aligned/{report.pair}", message)
        else:
            self._take_latest(f"{self._root}/verdict/{report.pair}", message, publish=self._wanted(report))

    @property
    def dropped(self) -> int:
        """Events that had to give way to newer ones before the network was there."""
        return self._lost_events

    @property
    def wants_frames(self) -> bool:
        return self._previews is not None

    def take_frame(self, frame: Frame) -> None:
        jpeg = self._previews and self._previews.take(frame, time.monotonic_ns())
        if jpeg:
            self._put_latest(f"{self._root}/preview/{frame.camera}", jpeg, JPEG)

    def stop(self) -> None:
        self._link.stop()
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
        self._put_latest(key, json.dumps(message), str(message["schema"]), publish=publish)

    def _put_latest(self, key: str, payload: str | bytes, schema: str, *, publish: bool = True) -> None:
        with self._lock:
            self._latest[key] = (payload, schema)
            published = self._published
        if published is not None and publish:
            published.put(key, payload, schema)

    def _publish_from(self, session: zenoh.Session) -> Published:
        """Publishes what has waited for the session. Raises RunError where another monitor has the rig."""
        if _is_taken(session, f"{self._root}/alive"):
            raise RunError(
                f"rig '{self._rig}' is already published under '{self._root}' by another monitor: "
                "choose another name with rig: in the configuration or --set rig=NAME"
            )
        published = Published(session, self._root, self._answer, self._history)
        with self._lock:
            for message in self._early_events:
                published.event(message)
            self._early_events.clear()
            for key, (payload, schema) in self._latest.items():
                if schema != EVENT_SCHEMA:
                    published.put(key, payload, schema)
            self._published = published
        return published

    def _answer(self, query: zenoh.Query) -> None:
        """Answers with the latest of everything that was asked for."""
        with self._lock:
            latest = dict(self._latest)
        with query:
            for key, (payload, schema) in latest.items():
                if query.key_expr.intersects(zenoh.KeyExpr(key)):
                    query.reply(key, payload, encoding=encoding(schema))


def _is_taken(session: zenoh.Session, key: str) -> bool:
    """Whether somebody else holds the token; asked again until peers have had time to find each other."""
    deadline = time.monotonic() + FIND_OTHERS_S
    while True:
        if any(reply.ok for reply in session.liveliness().get(key, timeout=0.2)):
            return True
        if time.monotonic() > deadline:
            return False
        time.sleep(0.1)
