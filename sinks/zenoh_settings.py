"""Where and how a rig is published over Zenoh: the settings and the session configuration made from them."""

from __future__ import annotations

import json
import re
from typing import Annotated, Any, Literal

import zenoh
from pydantic import AfterValidator, model_validator

from pipeline.settings import Settings
from sinks.zenoh_preview import PreviewSettings

RETRY = {"period_init_ms": 200, "period_max_ms": 2000, "period_increase_factor": 1.5}
"""Reconnecting starts quickly and stays gentle on a router that comes back to many rigs."""

RETRY_EVERY_S = 0.2
TRY_OPEN_MS = 1000

KEY_CHUNK = re.compile(r"(?!@)[^/*$#?\s]+")
"""A chunk that begins with @ would be hidden from a subscriber's wildcards."""

ENDPOINT = re.compile(r"(?:tcp|udp|tls|quic|ws)/(?:\[[0-9a-fA-F:.]+\]|[^\s/:\[\]?#]+):(\d{1,5})(?:[?#]\S*)?")
SOCKET_FILE = re.compile(r"unixsock-stream/\S+")


def is_key_chunk(text: str) -> bool:
    return KEY_CHUNK.fullmatch(text) is not None


def _key_prefix(value: str) -> str:
    if not all(is_key_chunk(chunk) for chunk in value.split("/")):
        raise ValueError(f"'{value}' is not a key: chunks of letters, digits, - _ . joined by /, e.g. site/hall2")
    return value


def _endpoint(value: str) -> str:
    found = ENDPOINT.fullmatch(value)
    if not (SOCKET_FILE.fullmatch(value) or (found and int(found[1]) <= 65535)):
        raise ValueError(f"'{value}' is not an endpoint: write it like tcp/192.168.1.5:7447")
    return value


Endpoint = Annotated[str, AfterValidator(_endpoint)]


class NetworkSettings(Settings):
    """How a sink takes part in Zenoh's network.

    mode: `peer` talks to other peers, `client` through a router, `router` is one itself. A router does not pass
    messages from peer to peer, so rigs and subscribers that share one are clients.
    connect, listen: endpoints, and then exactly these: nobody else is looked for. Without any, only programs on this
    machine can hear.
    required: end the run when nothing can be reached at the start.
    """

    mode: Literal["peer", "client", "router"] = "peer"
    connect: tuple[Endpoint, ...] = ()
    listen: tuple[Endpoint, ...] = ()
    required: bool = False

    @property
    def where(self) -> str:
        """Where others are looked for, for people."""
        return ", ".join(self.connect or self.listen) or "the local network"

    @model_validator(mode="after")
    def _client_has_a_router(self) -> NetworkSettings:
        if self.mode == "client" and not self.connect:
            raise ValueError("mode: client needs a router to connect to, e.g. connect: [tcp/127.0.0.1:7447]")
        return self


class ZenohSettings(NetworkSettings):
    """Where and how the rig is published, under <prefix>/<rig>.

    verdicts: publish all of them, those that differ in state from the one before, or none.
    preview: publish small pictures of the cameras, too.
    """

    type: Literal["zenoh"] = "zenoh"
    prefix: Annotated[str, AfterValidator(_key_prefix)] = "syncwatch"
    verdicts: Literal["all", "changes", "none"] = "all"
    preview: PreviewSettings | None = None


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
