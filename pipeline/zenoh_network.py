"""How sources and sinks get onto a Zenoh network: the settings and the session configuration made from them."""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Annotated, Any, Literal

import zenoh
from pydantic import AfterValidator, BeforeValidator, Field, SecretStr, model_validator

from pipeline.settings import Settings
from pipeline.zenoh_secrets import TlsFiles, existing, password_of

RETRY = {"period_init_ms": 200, "period_max_ms": 2000, "period_increase_factor": 1.5}
"""Reconnecting starts quickly and stays gentle on a router that comes back to many rigs."""

RETRY_EVERY_S = 0.2
TRY_OPEN_MS = 1000

ENDPOINT = re.compile(r"(?:tcp|udp|tls|quic|ws)/(?:\[[0-9a-fA-F:.]+\]|[^\s/:\[\]?#]+):(\d{1,5})(?:[?#]\S*)?")
SOCKET_FILE = re.compile(r"unixsock-stream/\S+")
ENCRYPTED = ("tls/", "quic/")


def _endpoint(value: str) -> str:
    found = ENDPOINT.fullmatch(value)
    if not (SOCKET_FILE.fullmatch(value) or (found and int(found[1]) <= 65535)):
        raise ValueError(f"'{_shown(value)}' is not an endpoint: write it like tcp/192.168.1.5:7447")
    return value


def _shown(endpoint: str) -> str:
    """The endpoint without its options, among which there may be a key."""
    return re.split("[?#]", endpoint, maxsplit=1)[0]


def _text(value: Any) -> Any:
    """YAML takes a password of digits for a number, 0123 for 83: said without repeating it."""
    if not isinstance(value, (str, SecretStr)):
        raise ValueError('a password is a text: put it in quotes, e.g. password: "${PASSWORD}"')  # noqa: TRY004
    return value


Endpoint = Annotated[str, AfterValidator(_endpoint)]
Password = Annotated[SecretStr, BeforeValidator(_text)]


class TlsSettings(Settings):
    """Certificates and keys, PEM files.

    root_ca: whose certificates are believed (default: the authorities that browsers believe).
    certificate, private_key: our own, shown to routers that ask for one and to those who connect to `listen`.
    mutual: both sides show a certificate; off, only the one that listens (default: on with a certificate of our own).
    verify_name: the host in `connect` must be named in its certificate.
    """

    root_ca: str | None = None
    certificate: str | None = None
    private_key: str | None = None
    mutual: bool | None = None
    verify_name: bool = True

    @model_validator(mode="after")
    def _key_and_certificate(self) -> TlsSettings:
        if (self.certificate is None) != (self.private_key is None):
            raise ValueError("certificate and private_key belong together: give both or neither")
        if self.mutual and self.certificate is None:
            raise ValueError("mutual: needs a certificate and a private_key of our own")
        return self


class NetworkSettings(Settings):
    """How a session finds others, and how it and they are known to each other.

    mode: `peer` talks to other peers, `client` through a router, `router` is one itself. A router does not pass
    messages from peer to peer, so those that share one are clients.
    connect, listen: endpoints, and then exactly these: nobody else is looked for. Without any, only programs on this
    machine are found.
    tls: for endpoints that begin with tls/ or quic/.
    user, and password or password_file: who we are for the router. users_file: who may connect to `listen`, a line
    `user:password` each.
    """

    mode: Literal["peer", "client", "router"] = "peer"
    connect: tuple[Endpoint, ...] = ()
    listen: tuple[Endpoint, ...] = ()
    tls: TlsSettings | None = None
    user: Annotated[str, Field(min_length=1)] | None = None
    password: Password | None = None
    password_file: str | None = None
    users_file: str | None = None

    @property
    def where(self) -> str:
        """Where others are looked for, for people."""
        return ", ".join(_shown(one) for one in self.connect or self.listen) or "this machine"

    @model_validator(mode="after")
    def _client_has_a_router(self) -> NetworkSettings:
        if self.mode == "client" and not self.connect:
            raise ValueError("mode: client needs a router to connect to, e.g. connect: [tcp/127.0.0.1:7447]")
        return self

    @model_validator(mode="after")
    def _tls_is_of_use(self) -> NetworkSettings:
        if self.tls is not None and not any(one.startswith(ENCRYPTED) for one in (*self.connect, *self.listen)):
            raise ValueError("tls: no endpoint of connect or listen begins with tls/ or quic/: nothing is encrypted")
        if any(one.startswith(ENCRYPTED) for one in self.listen) and not (self.tls and self.tls.certificate):
            raise ValueError("listen: tls/ and quic/ need tls with a certificate and its private_key")
        return self

    @model_validator(mode="after")
    def _password_has_a_user(self) -> NetworkSettings:
        given = [name for name in ("password", "password_file") if getattr(self, name) is not None]
        if len(given) != (self.user is not None):
            raise ValueError("user: needs a password or a password_file, one of them, and these need a user")
        if self.user is not None and not self.connect:
            raise ValueError("user: is for the router or rig to connect to, but connect is empty")
        if self.user is not None and self.listen and self.users_file is None:
            raise ValueError("user: with listen, users_file has to say who may connect; without it nobody could")
        if self.users_file is not None and not self.listen:
            raise ValueError("users_file: says who may connect to listen, which is empty")
        return self


def session_config(settings: NetworkSettings, base: Path = Path()) -> zenoh.Config:
    """base: the folder that relative paths count from. Raises InputError for a file that is missing or no good."""
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
    return made_config(values | access_values(settings, base))


def access_values(settings: NetworkSettings, base: Path) -> dict[str, Any]:
    """What Zenoh has to know about keys and passwords. Raises InputError as `session_config`."""
    values: dict[str, Any] = {}
    if settings.tls is not None:
        tls = settings.tls
        files = TlsFiles.found(base, root_ca=tls.root_ca, certificate=tls.certificate, private_key=tls.private_key)
        mutual = tls.certificate is not None if tls.mutual is None else tls.mutual
        values |= {f"transport/link/tls/{key}": value for key, value in files.values().items()}
        values |= {
            "transport/link/tls/enable_mtls": mutual,
            "transport/link/tls/verify_name_on_connect": tls.verify_name,
        }
    if settings.user is not None:
        given = None if settings.password is None else settings.password.get_secret_value()
        values["transport/auth/usrpwd/user"] = settings.user
        values["transport/auth/usrpwd/password"] = password_of(base, given, settings.password_file)
    if settings.users_file is not None:
        values["transport/auth/usrpwd/dictionary_file"] = str(existing(base, settings.users_file, "users_file"))
    return values


def made_config(values: dict[str, Any]) -> zenoh.Config:
    config: zenoh.Config = zenoh.Config()
    for key, value in values.items():
        config.insert_json5(key, json.dumps(value))
    return config


def is_linked(session: zenoh.Session) -> bool:
    """Whether anybody is at the other end of the session."""
    return bool(session.info.routers_zid() or session.info.peers_zid())
