"""How sources and sinks get onto a Zenoh network: the settings and the session configuration made from them."""

from __future__ import annotations

import json
import re
from typing import Annotated, Any, Literal

import zenoh
from pydantic import AfterValidator, model_validator

from pipeline.settings import Settings

RETRY = {"period_init_ms": 200, "period_max_ms": 2000, "period_increase_factor": 1.5}
"""Reconnecting starts quickly and stays gentle on a router that comes back to many rigs."""

RETRY_EVERY_S = 0.2
TRY_OPEN_MS = 1000

NOBODY = "nobody answers there"
SOURCE_PLACE = re.compile(r"\.? at /\S+\.rs:\d+\.?")

ENDPOINT = re.compile(r"(?:tcp|udp|tls|quic|ws)/(?:\[[0-9a-fA-F:.]+\]|[^\s/:\[\]?#]+):(\d{1,5})(?:[?#]\S*)?")
SOCKET_FILE = re.compile(r"unixsock-stream/\S+")


def _endpoint(value: str) -> str:
    found = ENDPOINT.fullmatch(value)
    if not (SOCKET_FILE.fullmatch(value) or (found and int(found[1]) <= 65535)):
        raise ValueError(f"'{value}' is not an endpoint: write it like tcp/192.168.1.5:7447")
    return value


Endpoint = Annotated[str, AfterValidator(_endpoint)]


class NetworkSettings(Settings):
    """How a session finds others.

    mode: `peer` talks to other peers, `client` through a router, `router` is one itself. A router does not pass
    messages from peer to peer, so those that share one are clients.
    connect, listen: endpoints, and then exactly these: nobody else is looked for. Without any, only programs on this
    machine are found.
    """

    mode: Literal["peer", "client", "router"] = "peer"
    connect: tuple[Endpoint, ...] = ()
    listen: tuple[Endpoint, ...] = ()

    @property
    def where(self) -> str:
        """Where others are looked for, for people."""
        return ", ".join(self.connect or self.listen) or "the local network"

    @model_validator(mode="after")
    def _client_has_a_router(self) -> NetworkSettings:
        if self.mode == "client" and not self.connect:
            raise ValueError("mode: client needs a router to connect to, e.g. connect: [tcp/127.0.0.1:7447]")
        return self


def session_config(settings: NetworkSettings) -> zenoh.Config:
    config: zenoh.Config = zenoh.Config()
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


def is_linked(session: zenoh.Session) -> bool:
    """Whether anybody is at the other end of the session."""
    return bool(session.info.routers_zid() or session.info.peers_zid())


def first_words(error: zenoh.ZError) -> str:
    """What went wrong, without the places in Zenoh's own source."""
    return SOURCE_PLACE.sub("", str(error).splitlines()[0])
