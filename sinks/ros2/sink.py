"""Publishes a rig's status as ROS 2 diagnostics over Zenoh."""

from __future__ import annotations

import re
import threading
from contextlib import ExitStack
from pathlib import Path

import zenoh

from pipeline.verdict import Report, Status
from pipeline.zenoh_network import is_linked
from sinks.ros2 import wire
from sinks.ros2.diagnostics import diagnostics
from sinks.ros2.settings import Ros2Settings
from sinks.zenoh_link import ZenohLink

__all__ = ["Ros2Settings", "Ros2Sink"]


class Ros2Sink:
    """/diagnostics as rmw_zenoh's subscribers hear it, once a second and on every change.

    Only the latest status is kept for a network that is not there yet. Raises RunError if nothing can be reached and
    that is `required`.
    """

    lossless = False

    def __init__(self, settings: Ros2Settings, *, rig: str, base: Path = Path()) -> None:
        self._settings = settings
        self._node = settings.node or node_name(rig)
        self._lock = threading.Lock()
        self._early: Status | None = None
        self._published: _Published | None = None
        echo = wire.topic_key(settings.domain_id, humble=settings.humble)
        self._link = ZenohLink(settings, self._publish_from, name="ros2", base=base, echo=echo)

    def start(self) -> None:
        self._link.start()

    def take(self, report: Report) -> None:
        if not isinstance(report, Status):
            return
        with self._lock:
            if self._published is None:
                self._early = report
                return
        self._published.put(report)
        self._link.sent()

    def stop(self) -> None:
        self._link.stop()

    def _publish_from(self, session: zenoh.Session) -> _Published:
        published = _Published(session, self._settings, self._node)
        with self._lock:
            if self._early is not None:
                published.put(self._early)
            self._early = None
            self._published = published
        return published


def node_name(rig: str) -> str:
    """`syncwatch_<rig>` with what ROS allows in a node's name."""
    return f"syncwatch_{re.sub('[^A-Za-z0-9_]', '_', rig)}"[:255]


class _Published:
    """An open session with the publisher of a node and the tokens that make both appear in ROS's graph."""

    def __init__(self, session: zenoh.Session, settings: Ros2Settings, node: str) -> None:
        self._session = session
        self._open = ExitStack()
        self._open.enter_context(session)
        key = wire.topic_key(settings.domain_id, humble=settings.humble)
        self._publisher = self._open.enter_context(
            session.declare_publisher(key, congestion_control=zenoh.CongestionControl.DROP)
        )
        tokens = wire.tokens(settings.domain_id, str(session.zid()), node, humble=settings.humble)
        for token in tokens:
            self._open.enter_context(session.liveliness().declare_token(token))
        self._gid = wire.gid(tokens[1])
        self._sequence = 0

    def put(self, status: Status) -> None:
        self._sequence += 1
        attachment = wire.attachment(self._sequence, status.at_ns, self._gid)
        self._publisher.put(wire.payload(status.at_ns, diagnostics(status)), attachment=attachment)

    def is_connected(self) -> bool:
        return is_linked(self._session)

    def close(self) -> None:
        self._open.close()  # the tokens first, the session last
