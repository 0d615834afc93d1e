"""A real router and subscribers in other processes."""

from __future__ import annotations

import json
import signal
import socket
import subprocess
import sys
import threading
import time
import uuid
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

import zenoh

from tests.programs import ROOT

EXAMPLES = ROOT / "examples"


def wait_for(condition: Callable[[], Any], seconds: float = 60) -> Any:
    deadline = time.monotonic() + seconds
    while not (result := condition()):
        assert time.monotonic() < deadline, "waited in vain"
        time.sleep(0.05)
    return result


def free_endpoint() -> str:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return f"tcp/127.0.0.1:{probe.getsockname()[1]}"


class Subscriber:
    """examples/subscribe.py in another process, its output in a file."""

    def __init__(self, folder: Path, *arguments: str) -> None:
        self._file = folder / f"{uuid.uuid4().hex}.txt"
        with self._file.open("w") as out:
            command = [sys.executable, str(EXAMPLES / "subscribe.py"), *arguments]
            self.process = subprocess.Popen(command, stdout=out, stderr=subprocess.STDOUT)
        wait_for(lambda: "listening" in self.lines())

    def lines(self) -> list[str]:
        return self._file.read_text().splitlines()

    def messages(self, schema: str) -> list[dict[str, Any]]:
        parsed = [json.loads(line) for line in self.lines() if line.startswith("{")]
        return [message for message in parsed if message["schema"] == schema]

    def events(self) -> list[dict[str, Any]]:
        return self.messages("syncwatch.event.v1")

    def statuses(self) -> list[dict[str, Any]]:
        return self.messages("syncwatch.status.v1")


@contextmanager
def subscriber(folder: Path, *arguments: str) -> Iterator[Subscriber]:
    made = Subscriber(folder, *arguments)
    try:
        yield made
    finally:
        made.process.send_signal(signal.SIGINT)
        assert made.process.wait(60) == 0


@contextmanager
def router(endpoint: str) -> Iterator[subprocess.Popen[str]]:
    command = [sys.executable, str(EXAMPLES / "router.py"), "--listen", endpoint]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        assert process.stdout.readline() == f"router at {endpoint}\n"
        try:
            yield process
        finally:
            process.kill()


@contextmanager
def routing(endpoints: list[str], example: Path | None = None, **values: Any) -> Iterator[None]:
    """A router in this process: of a configuration file if one is given, with `values` of its own keys, __ for /."""
    config = zenoh.Config() if example is None else zenoh.Config.from_file(str(example))
    own = {"mode": "router", "listen/endpoints": endpoints, "scouting/multicast/enabled": False}
    for key, value in (own | {name.replace("__", "/"): value for name, value in values.items()}).items():
        config.insert_json5(key, json.dumps(value))
    with zenoh.open(config):
        yield


class Proxy:
    """A link that can be cut: connections to `endpoint` are passed on to another one.

    `cut` closes them and refuses new ones or, silently, passes nothing on; `mend` undoes it. It holds little, so that
    who does not read is noticed soon.
    """

    def __init__(self, to: str) -> None:
        self._to = _address(to)
        self._server = socket.socket()
        self._server.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 65536)
        self._server.bind(("127.0.0.1", 0))
        self._server.listen()
        self.endpoint = f"tcp/127.0.0.1:{self._server.getsockname()[1]}"
        self._links: list[socket.socket] = []
        self._open = True
        self._flowing = threading.Event()
        self._flowing.set()
        threading.Thread(target=self._accept, daemon=True).start()

    def cut(self, *, silently: bool) -> None:
        if silently:
            self._flowing.clear()
        else:
            self._open = False
            self._hang_up()

    def mend(self) -> None:
        self._open = True
        self._flowing.set()

    def close(self) -> None:
        self._server.close()
        self.mend()
        self._hang_up()

    def _hang_up(self) -> None:
        for link in self._links:
            with suppress(OSError):
                link.shutdown(socket.SHUT_RDWR)
            link.close()
        self._links.clear()

    def _accept(self) -> None:
        with suppress(OSError):
            while True:
                near, _ = self._server.accept()
                far = None
                if self._open:
                    with suppress(OSError):
                        far = self._reach()
                if far is None:
                    near.close()
                    continue
                self._links += [near, far]
                for source, sink in ((near, far), (far, near)):
                    threading.Thread(target=self._pump, args=(source, sink), daemon=True).start()

    def _reach(self) -> socket.socket:
        far = socket.socket()
        far.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 65536)
        try:
            far.connect(self._to)
        except OSError:
            far.close()
            raise
        return far

    def _pump(self, source: socket.socket, sink: socket.socket) -> None:
        with suppress(OSError):
            while data := source.recv(65536):
                self._flowing.wait()
                sink.sendall(data)
        for end in (source, sink):
            with suppress(OSError):
                end.shutdown(socket.SHUT_RDWR)
            end.close()


def _address(endpoint: str) -> tuple[str, int]:
    host, _, port = endpoint.removeprefix("tcp/").rpartition(":")
    return host, int(port)
