"""A dashboard in this process, on a free port, around a listener whose table the test fills."""

from __future__ import annotations

import asyncio
import http.client
import json
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import closing, contextmanager
from typing import Any

from pipeline.dashboard.serve import bind, serve_until
from pipeline.fleet.listener import FleetListener
from sinks.zenoh_settings import ZenohSettings


class Served:
    """What is served at `port`; `listener` never starts to listen, and is taken to be connected."""

    def __init__(self, token: str | None, host: str, monotonic_ns: Callable[[], int]) -> None:
        self.listener = FleetListener(ZenohSettings(), monotonic_ns=monotonic_ns)
        self.listener.problem = None
        self.fleet = self.listener.fleet
        self.fleet.connected = True
        self._bound = bind(host, 0)
        self._host = host
        self._token = token
        self.port = self._bound.getsockname()[1]
        self.ended_within_s: float | None = None
        self._loop = asyncio.new_event_loop()
        self._stopping = asyncio.Event()
        self._thread = threading.Thread(target=self._serve)
        self._thread.start()

    def _serve(self) -> None:
        serving = serve_until(self._stopping, self.listener, self._bound, host=self._host, token=self._token)
        self._loop.run_until_complete(serving)
        self._loop.close()

    def stop(self) -> None:
        began = time.monotonic()
        if self._thread.is_alive():
            self._loop.call_soon_threadsafe(self._stopping.set)
        self._thread.join(10)
        self.ended_within_s = time.monotonic() - began

    def get(self, path: str, **headers: str) -> http.client.HTTPResponse:
        """The answer, read; further headers by name with _ for -."""
        connection = http.client.HTTPConnection("127.0.0.1", self.port, timeout=10)
        connection.request("GET", path, headers={name.replace("_", "-"): value for name, value in headers.items()})
        answer = connection.getresponse()
        answer.text = (
            "" if "event-stream" in (answer.getheader("content-type") or "") else answer.read().decode("latin-1")
        )
        connection.close()
        return answer

    @contextmanager
    def stream(self, path: str = "/stream") -> Iterator[Iterator[tuple[str, dict[str, Any]]]]:
        """The events of a stream, by name, as they come."""
        connection = http.client.HTTPConnection("127.0.0.1", self.port, timeout=10)
        connection.request("GET", path)
        with closing(connection), connection.getresponse() as answer:
            assert answer.status == 200
            yield events_of(answer)


@contextmanager
def served(
    token: str | None = None, host: str = "127.0.0.1", *, monotonic_ns: Callable[[], int] = time.monotonic_ns
) -> Iterator[Served]:
    made = Served(token, host, monotonic_ns)
    try:
        yield made
    finally:
        made.stop()


def events_of(answer: http.client.HTTPResponse) -> Iterator[tuple[str, dict[str, Any]]]:
    """The events of a stream, by name."""
    name = ""
    for raw in answer:
        line = raw.decode().rstrip("\n")
        if line.startswith("event: "):
            name = line.removeprefix("event: ")
        elif line.startswith("data: "):
            yield name, json.loads(line.removeprefix("data: "))


def next_of(events: Iterator[tuple[str, dict[str, Any]]], name: str) -> dict[str, Any]:
    return next(message for other, message in events if other == name)
