"""The listener, with real sessions, a real router and monitors that come, go and die."""

from __future__ import annotations

import json
import subprocess
import sys
import time
import uuid

import pytest
import zenoh

from pipeline.fleet.listener import FleetListener
from pipeline.fleet.table import Presence
from pipeline.verdict import Basis, Cause, Event, Level, State, Status, Verdict
from pipeline.zenoh_network import session_config
from sinks.zenoh import ZenohSettings, ZenohSink
from sinks.zenoh_preview import PreviewSettings
from tests.frames import frame
from tests.network import free_endpoint, router, wait_for
from tests.programs import ROOT


@pytest.fixture
def prefix() -> str:
    """Nobody else on this machine uses it."""
    return f"test/{uuid.uuid4().hex[:8]}"


def event(number: int, phase: str = "onset") -> Event:
    return Event("cart", f"x-{number}", "async", phase, "a-b", "b", Cause.SLIP, number, None, {}, f"event {number}")


def status(level: Level = Level.OK) -> Status:
    return Status("cart", 1, level, (), {}, {}, "0", 1.0, 0)


def verdict(offset_ns: int) -> Verdict:
    return Verdict("cart", "a-b", 1, State.SYNC, Basis.CONTENT, offset_ns=offset_ns)


def started(prefix, rig="cart", **settings) -> ZenohSink:
    sink = ZenohSink(ZenohSettings(prefix=prefix, **settings), rig=rig)
    sink.start()
    return sink


def presence(listener, rig="cart") -> Presence | None:
    seen = listener.fleet.rig(rig)
    return seen and seen.presence


def test_status_verdicts_events_and_tokens_are_heard_and_every_event_once_though_it_comes_late(prefix):
    sink = started(prefix)
    for number in range(50):
        sink.take(event(number))
    with FleetListener(ZenohSettings(prefix=prefix)) as listener:
        wait_for(lambda: presence(listener) is Presence.ALIVE)
        wait_for(lambda: sink.take(status(Level.WARN)) or listener.fleet.rig("cart").status)
        listener.look_at("cart")
        wait_for(lambda: sink.take(verdict(2_000_000)) or listener.fleet.offsets("cart"))
        sink.take(event(50))
        sink.take(event(50, "end"))
        wait_for(
            lambda: (
                len(listener.fleet.rig("cart").incidents) == 51 and not listener.fleet.rig("cart").incidents[-1].open
            )
        )
        seen = listener.fleet.rig("cart")
        assert [incident.since_ns for incident in seen.incidents] == list(range(51))
        assert seen.status.level is Level.WARN
        assert listener.fleet.offsets("cart")["a-b"][0].offset_ms == 2.0
        sink.stop()
        wait_for(lambda: presence(listener) is Presence.GONE)
    assert listener.problem is None


def test_verdicts_and_pictures_are_heard_only_while_somebody_looks(prefix, monkeypatch):
    monkeypatch.setattr("pipeline.fleet.listener.LOOKS_ON_NS", 10**8)
    sinks = [started(prefix, rig, preview=PreviewSettings(every_s=0.1)) for rig in ("cart", "drone")]

    def say_all() -> None:
        for sink in sinks:
            sink.take_frame(frame("left", 0))
            sink.take(verdict(1_000_000))
            sink.take(status())

    with FleetListener(ZenohSettings(prefix=prefix), previews=True) as listener:
        fleet = listener.fleet
        wait_for(lambda: say_all() or all(presence(listener, rig) is Presence.ALIVE for rig in ("cart", "drone")))
        wait_for(lambda: say_all() or all(rig.status for rig in fleet.rigs()))
        listener.look_at("nobody")
        wait_for(
            lambda: listener.look_at("cart") or say_all() or (fleet.offsets("cart") and fleet.rig("cart").previews)
        )
        assert not fleet.offsets("drone")
        assert not fleet.rig("drone").previews
        wait_for(lambda: say_all() or not fleet.rig("cart").previews)
    for sink in sinks:
        sink.stop()


def test_rigs_of_several_sites_are_heard_under_one_prefix(prefix):
    sinks = [started(f"{prefix}/hall{number}") for number in (1, 2)]
    with FleetListener(ZenohSettings(prefix=prefix)) as listener:
        wait_for(lambda: [rig.name for rig in listener.fleet.rigs()] == ["hall1/cart", "hall2/cart"])
    for sink in sinks:
        sink.stop()


def test_a_monitor_that_is_killed_is_gone(prefix):
    code = (
        "import sys\n"
        "from sinks.zenoh import ZenohSettings, ZenohSink\n"
        f"ZenohSink(ZenohSettings(prefix='{prefix}'), rig='cart').start()\n"
        "print('up', flush=True); sys.stdin.read()\n"
    )
    pipes = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE}
    with (
        FleetListener(ZenohSettings(prefix=prefix)) as listener,
        subprocess.Popen([sys.executable, "-c", code], cwd=ROOT, **pipes) as monitor,
    ):
        wait_for(lambda: presence(listener) is Presence.ALIVE)
        monitor.kill()
        wait_for(lambda: presence(listener) is Presence.GONE)


def test_a_router_that_dies_is_said_and_nobody_is_called_gone_for_it(prefix):
    endpoint = free_endpoint()
    client = {"mode": "client", "connect": [endpoint]}
    listener = FleetListener(ZenohSettings(prefix=prefix, **client))
    with listener:
        wait_for(lambda: listener.problem.startswith(f"cannot reach {endpoint}"))
        with router(endpoint) as first:
            sink = started(prefix, **client)
            sink.take(event(0))
            wait_for(lambda: presence(listener) is Presence.ALIVE and listener.fleet.rig("cart").incidents)
            first.kill()
            first.wait()
            seen = set()
            wait_for(lambda: seen.add(presence(listener)) or presence(listener) is Presence.UNHEARD)
            assert listener.problem == f"cannot reach {endpoint}: nobody answers there"
            sink.take(event(1))
        with router(endpoint):
            wait_for(lambda: seen.add(presence(listener)) or len(listener.fleet.rig("cart").incidents) == 2, 30)
            wait_for(lambda: seen.add(presence(listener)) or presence(listener) is Presence.ALIVE)
            assert listener.problem is None
            sink.stop()
    assert Presence.GONE not in seen


def test_a_rig_that_listens_is_heard_without_a_router(prefix):
    endpoint = free_endpoint()
    sink = started(prefix, listen=[endpoint])
    with FleetListener(ZenohSettings(prefix=prefix, mode="client", connect=[endpoint])) as listener:
        wait_for(lambda: sink.take(status()) or presence(listener) is Presence.ALIVE)
        sink.take(event(1))
        wait_for(lambda: listener.fleet.rig("cart").status and listener.fleet.rig("cart").incidents)
        sink.stop()
        wait_for(lambda: presence(listener) is not Presence.ALIVE)


def test_stopping_is_prompt_whether_or_not_anybody_is_there(prefix):
    for settings in ({}, {"mode": "client", "connect": [free_endpoint()]}):
        listener = FleetListener(ZenohSettings(prefix=prefix, **settings))
        listener.start()
        time.sleep(0.3)
        began = time.monotonic()
        listener.stop()
        assert time.monotonic() - began < 2


def test_what_cannot_be_read_is_left_out_with_one_line_a_key(prefix, caplog):
    sink = started(prefix)
    with FleetListener(ZenohSettings(prefix=prefix), previews=True) as listener:
        wait_for(lambda: presence(listener) is Presence.ALIVE)
        said = [f"{prefix}/cart/{key}" for key in ("event", "preview/left", "status", "verdict/a-b")]
        with zenoh.open(session_config(ZenohSettings())) as session:

            def shout() -> None:
                listener.look_at("cart")
                for key in said:
                    session.put(key, b"\xff{")
                session.put(f"{prefix}/status", b"{}")
                for name in ("*", "\x1b[2J"):
                    session.put(f"{prefix}/{name}/status", json.dumps(status().to_message()))

            wait_for(lambda: shout() or len(caplog.messages) >= 6)
            wait_for(lambda: sink.take(status()) or listener.fleet.rig("cart").status)
        assert [rig.name for rig in listener.fleet.rigs()] == ["cart"]
    sink.stop()
    assert sorted(message.partition(":")[0] for message in caplog.messages) == [
        f"{prefix}/*/status",
        rf"{prefix}/\x1b[2J/status",
        *said,
    ]
