"""`syncwatch watch`, against monitors that publish."""

from __future__ import annotations

import fcntl
import json
import os
import pty
import re
import signal
import struct
import subprocess
import sys
import termios
import threading
import uuid
from collections.abc import Iterator
from contextlib import contextmanager

import pytest
from click import ClickException
from click.testing import CliRunner, Result

from pipeline.cli.app import app
from pipeline.errors import InputError
from pipeline.verdict import Cause, Event, Level, PairStatus, State, Status
from sinks.zenoh import ZenohSettings, ZenohSink
from tests.network import free_endpoint, router
from tests.programs import ROOT, syncwatch
from tests.schemas import check

PAIR = PairStatus(State.SYNC, None, 5, 100_000, 200_000, 0.9)
LATE = Event("cart", "x-1", "async", "onset", "a-b", "b", Cause.SLIP, 5, None, {}, "b is late")
SHORT = ("--once", "--for", "2.5s")


@pytest.fixture
def prefix() -> str:
    """Nobody else on this machine uses it."""
    return f"test/{uuid.uuid4().hex[:8]}"


class Rig:
    """A monitor that says the same status again and again until it ends, or falls silent."""

    def __init__(self, prefix: str, name: str, level: Level = Level.OK, **settings) -> None:
        self.sink = ZenohSink(ZenohSettings(prefix=prefix, **settings), rig=name)
        self.sink.start()
        self._status = Status(name, 10**10, level, (), {"a-b": PAIR}, {}, "0", 1.0, 0)
        self._silent = threading.Event()
        self._thread = threading.Thread(target=self._tell)
        self._thread.start()

    def _tell(self) -> None:
        while not self._silent.wait(0.1):
            self.sink.take(self._status)

    def end(self) -> None:
        self._silent.set()
        self._thread.join()
        self.sink.stop()


@contextmanager
def rigs(*made: Rig) -> Iterator[None]:
    try:
        yield
    finally:
        for rig in made:
            rig.end()


def watch(*arguments: str) -> Result:
    return CliRunner().invoke(app, ["watch", *arguments], standalone_mode=False)


def test_all_rigs_that_are_well_are_status_0(prefix):
    with rigs(Rig(prefix, "cart"), Rig(prefix, "drone")):
        result = watch(prefix, *SHORT, "--json")
    told = json.loads(result.stdout)
    check(told, "fleet")
    assert (result.return_value, told["ok"], list(told["rigs"])) == (0, True, ["cart", "drone"])
    assert told["rigs"]["cart"]["pairs"]["a-b"]["offset_ms"] == 0.1


def test_one_that_is_not_is_status_3_and_its_event_is_open(prefix):
    cart = Rig(prefix, "cart", Level.ERROR)
    cart.sink.take(LATE)
    with rigs(cart, Rig(prefix, "drone")):
        result = watch(prefix, *SHORT, "--json")
    told = json.loads(result.stdout)
    assert (result.return_value, told["ok"]) == (3, False)
    assert [told["rigs"][name]["ok"] for name in ("cart", "drone")] == [False, True]
    assert [event["text"] for event in told["rigs"]["cart"]["open"]] == ["b is late"]


def test_people_get_a_table(prefix):
    with rigs(Rig(prefix, "cart")):
        result = watch(prefix, *SHORT)
    lines = [" ".join(line.split()) for line in result.stdout.splitlines()]
    assert lines[1].startswith("cart In sync a-b sync +0.1 ± 0.2 ms")
    assert lines[3:] == ["1 rig: 1 in sync", f"under '{prefix}' at this machine"]
    assert result.return_value == 0


def test_no_rig_is_status_3(prefix):
    result = watch(prefix, "--once", "--for", "300ms")
    assert result.return_value == 3
    assert f"no rig is heard under '{prefix}'" in result.stdout


def test_a_monitor_that_ends_meanwhile_is_gone(prefix):
    leaving = Rig(prefix, "leaving")
    threading.Timer(1.5, leaving.end).start()
    with rigs(Rig(prefix, "staying")):
        result = watch(prefix, "--once", "--for", "4s", "--json")
    told = json.loads(result.stdout)["rigs"]
    assert (told["leaving"]["presence"], told["staying"]["presence"]) == ("gone", "alive")
    assert result.return_value == 3


def test_rigs_are_heard_through_a_router(prefix):
    endpoint = free_endpoint()
    with router(endpoint), rigs(Rig(prefix, "cart", mode="client", connect=[endpoint])):
        result = watch(prefix, "--connect", endpoint, *SHORT, "--json")
    assert (result.return_value, json.loads(result.stdout)["problem"]) == (0, None)


def test_a_router_that_does_not_answer_is_said(prefix):
    endpoint = free_endpoint()
    result = watch(prefix, "--connect", endpoint, *SHORT, "--json")
    told = json.loads(result.stdout)
    check(told, "fleet")
    assert result.return_value == 3
    assert endpoint in told["problem"]


def test_where_nobody_looks_changes_are_lines_and_json_comes_once_a_second(prefix):
    with rigs(Rig(prefix, "cart", Level.WARN)):
        assert watch(prefix, "--for", "2.5s").stdout.splitlines()[-1:] == ["cart: Warning"]
        lines = watch(prefix, "--for", "2.5s", "--json").stdout.splitlines()
    assert 1 <= len(lines) <= 3
    assert json.loads(lines[-1])["rigs"]["cart"]["level"] == "warn"


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (("--mode", "client"), "--mode client: needs a router"),
        (("--connect", "router"), "--connect: 'router' is not an endpoint"),
        (("a//b",), "PREFIX: 'a//b' is not a key"),
        (("--for", "soon"), "--for 'soon': expected a duration"),
        (("--mode", "pear"), "'pear' is not one of"),
    ],
)
def test_bad_arguments_are_refused_with_their_place(arguments, said):
    error = watch(*arguments).exception
    assert isinstance(error, (InputError, ClickException))
    assert said in (error.format_message() if isinstance(error, ClickException) else str(error))


def test_bad_arguments_are_one_line_and_status_2(tmp_path):
    done = syncwatch("watch", "--mode", "client", cwd=tmp_path)
    assert (done.returncode, len(done.stderr.splitlines())) == (2, 1), done.stderr


def test_a_signal_ends_it_at_once_and_nothing_but_results_is_printed(prefix):
    with rigs(Rig(prefix, "cart")):
        process = subprocess.Popen(
            [sys.executable, "-m", "syncwatch", "watch", prefix, "--json"],
            cwd=ROOT,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
        )
        assert process.stdout is not None
        check(json.loads(process.stdout.readline()), "fleet")
        process.send_signal(signal.SIGTERM)
        out, errors = process.communicate(timeout=40)
    assert (process.returncode, errors) == (143, "")
    assert all(line.startswith("{") for line in out.splitlines())


def test_in_a_terminal_the_page_is_live_and_ctrl_c_ends_it(prefix):
    ours, theirs = pty.openpty()
    fcntl.ioctl(theirs, termios.TIOCSWINSZ, struct.pack("HHHH", 24, 80, 0, 0))
    command = [sys.executable, "-m", "syncwatch", "watch", prefix]
    environment = {**os.environ, "TERM": "xterm"}
    shown = ""
    with rigs(Rig(prefix, "cart")):
        process = subprocess.Popen(
            command, cwd=ROOT, stdin=theirs, stdout=theirs, stderr=subprocess.PIPE, env=environment
        )
        os.close(theirs)
        while "1 rig: 1 in sync" not in re.sub(r"\x1b\[[0-9;?]*[a-zA-Z]", "", shown):
            shown += os.read(ours, 65536).decode()
        process.send_signal(signal.SIGINT)
        while chunk := _rest(ours):
            shown += chunk
        errors = process.communicate(timeout=10)[1]
    os.close(ours)
    assert (process.returncode, errors) == (130, b"")
    assert shown.rstrip().endswith(("\x1b[?25h", "\x1b[?1049l"))  # the cursor and what was there before are back


def _rest(terminal: int) -> str:
    try:
        return os.read(terminal, 65536).decode()
    except OSError:  # nobody is at its other end any more
        return ""
