"""Answers Prometheus: how a rig stands, at http://<listen>/metrics."""

from __future__ import annotations

import logging
import re
import socket
import threading
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from socketserver import TCPServer
from typing import Annotated, Literal

from prometheus_client import CollectorRegistry
from prometheus_client.exposition import choose_encoder
from pydantic import AfterValidator

from pipeline.errors import InputError
from pipeline.settings import Settings
from pipeline.verdict import Report
from sinks.prometheus_metrics import RigCollector

log = logging.getLogger("syncwatch.sinks.prometheus")

ADDRESS = re.compile(r"(\[[0-9a-fA-F:.]+\]|[^\s/:\[\]]+):(\d{1,5})")
LOOK_S = 0.05
"""How soon the server notices that it should end."""

REQUEST_S = 5.0
"""A client that sends nothing for so long is left alone."""


def _address(value: str) -> str:
    found = ADDRESS.fullmatch(value)
    if found is None or int(found[2]) > 65535:
        raise ValueError(f"'{value}' is not an address: write it like 127.0.0.1:9464, or 0.0.0.0:9464 for everyone")
    return value


class PrometheusSettings(Settings):
    """listen: where to answer, host:port; port 0 takes a free one and says which. Only this machine by default."""

    type: Literal["prometheus"] = "prometheus"
    listen: Annotated[str, AfterValidator(_address)] = "127.0.0.1:9464"


class PrometheusSink:
    """Metrics of one rig in a registry of their own, read from what was reported last. What is unknown is left out."""

    lossless = False

    def __init__(self, settings: PrometheusSettings, *, rig: str, version: str) -> None:
        self._settings = settings
        self._collector = RigCollector(rig, version)
        self._registry = CollectorRegistry(auto_describe=False)
        self._registry.register(self._collector)
        self._server: _Server | None = None
        self._thread: threading.Thread | None = None

    @property
    def url(self) -> str:
        """Where metrics are while the sink is started, with the port that was really taken."""
        assert self._server is not None
        return f"http://{self._settings.listen.rpartition(':')[0]}:{self._server.server_port}/metrics"

    def start(self) -> None:
        """Opens the port. Raises InputError where it cannot be had."""
        host, _, port = self._settings.listen.rpartition(":")
        try:
            self._server = _Server(host.strip("[]"), int(port), self._registry)
        except OSError as error:
            raise InputError(
                f"prometheus: cannot listen at {self._settings.listen}: {error.strerror or error}; "
                "choose another address with listen: HOST:PORT"
            ) from error
        self._thread = threading.Thread(
            target=self._server.serve_forever, args=(LOOK_S,), name="prometheus", daemon=True
        )
        self._thread.start()
        log.info("metrics at %s", self.url)

    def take(self, report: Report) -> None:
        self._collector.take(report)

    def stop(self) -> None:
        assert self._server is not None
        assert self._thread is not None
        self._server.shutdown()
        self._server.server_close()
        self._thread.join()


class _Server(ThreadingHTTPServer):
    """Answers each request on a thread that cannot keep the program from ending."""

    daemon_threads = True

    def __init__(self, host: str, port: int, registry: CollectorRegistry) -> None:
        self.registry = registry
        self.address_family = socket.getaddrinfo(host, port, type=socket.SOCK_STREAM)[0][0]
        super().__init__((host, port), _Handler)

    def server_bind(self) -> None:
        """Without the look-up of the host's name that may take seconds where there is no network."""
        TCPServer.server_bind(self)
        self.server_name, self.server_port = str(self.server_address[0]), int(self.server_address[1])

    def handle_error(self, request: object, client_address: object) -> None:  # noqa: ARG002
        log.debug("a request from %s failed", client_address)


class _Handler(BaseHTTPRequestHandler):
    timeout = REQUEST_S
    server: _Server

    def do_GET(self) -> None:
        if self.path.partition("?")[0] != "/metrics":
            self.send_error(404, explain="metrics are at /metrics")
            return
        encode, content_type = choose_encoder(self.headers.get("Accept", ""))
        body = encode(self.server.registry)
        self.send_response(200)
        self.send_header("Content-Type", content_type)
        self.send_header("Content-Length", str(len(body)))
        self.end_headers()
        self.wfile.write(body)

    def log_message(self, format: str, *arguments: object) -> None:  # noqa: A002
        log.debug(format, *arguments)
