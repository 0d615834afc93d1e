"""A real router and subscribers in other processes."""

from __future__ import annotations

import json
import signal
import socket
import subprocess
import sys
import time
import uuid
from collections.abc import Callable, Iterator
from contextlib import contextmanager
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
