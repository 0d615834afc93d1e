"""`syncwatch dashboard` as a user starts and ends it."""

from __future__ import annotations

import http.client
import os
import signal
import subprocess
import sys
import uuid
from contextlib import closing
from urllib.parse import urlsplit

import pytest

from pipeline.cli.app import main


def started(folder, *arguments: str) -> tuple[subprocess.Popen[str], str]:
    """The program and the address that it printed."""
    command = [
        sys.executable,
        "-m",
        "syncwatch",
        "dashboard",
        f"test/{uuid.uuid4().hex[:8]}",
        "--port",
        "0",
        *arguments,
    ]
    env = {**os.environ, "PYTHONWARNINGS": "error"}
    pipes = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE}
    process = subprocess.Popen(command, cwd=folder, env=env, text=True, **pipes)
    assert process.stdout is not None
    return process, process.stdout.readline().strip()


@pytest.mark.parametrize(("number", "code"), [(signal.SIGINT, 130), (signal.SIGTERM, 143)])
def test_it_prints_its_address_and_ends_at_once_on_a_signal_though_a_page_is_open(tmp_path, number, code):
    process, address = started(tmp_path)
    where = urlsplit(address)
    assert (where.hostname, where.query) == ("127.0.0.1", "")
    connection = http.client.HTTPConnection("127.0.0.1", where.port, timeout=20)
    connection.request("GET", "/stream")
    with closing(connection), connection.getresponse() as answer:
        assert answer.readline() == b"event: fleet\n"
        process.send_signal(number)
        _, said = process.communicate(timeout=20)
    assert process.returncode == code
    assert [line for line in said.splitlines() if "Ctrl-C ends it" not in line] == []


def test_for_others_than_this_machine_it_makes_a_token_and_asks_for_it(tmp_path):
    process, address = started(tmp_path, "--host", "0.0.0.0")  # noqa: S104
    where = urlsplit(address)
    statuses = []
    for path in ("/", f"/?{where.query}"):
        connection = http.client.HTTPConnection("127.0.0.1", where.port, timeout=20)
        connection.request("GET", path)
        with closing(connection), connection.getresponse() as answer:
            statuses.append(answer.status)
    process.terminate()
    process.communicate(timeout=40)
    assert statuses == [401, 303]
    assert len(where.query) > len("token=") + 20


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["--host", "300.1.2.3"], "--host '300.1.2.3': no such address"),
        (["--port", "99999"], "99999 is not in the range"),
        (["--token", "short"], "--token: expected at least 12 plain characters"),
        (["--connect", "router"], "--connect: 'router' is not an endpoint: write it like tcp/"),
        (["--mode", "client"], "--mode client: needs a router"),
        (["a b"], "PREFIX: 'a b' is not a key"),
    ],
)
def test_what_cannot_work_is_one_line_and_status_2(monkeypatch, capsys, arguments, said):
    monkeypatch.setattr(sys, "argv", ["syncwatch", "dashboard", *arguments])
    assert main() == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert said in line
