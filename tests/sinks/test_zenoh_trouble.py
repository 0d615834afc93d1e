"""The Zenoh sink when routers and monitors die, hang, come late or not at all."""

from __future__ import annotations

import logging
import signal
import subprocess
import sys
import time
import uuid

import pytest
import zenoh

from pipeline.errors import RunError
from pipeline.verdict import Basis, Cause, Event, Level, State, Status, Verdict
from pipeline.zenoh_network import session_config
from sinks.zenoh import ZenohSettings, ZenohSink
from tests.network import free_endpoint, router, subscriber, wait_for
from tests.programs import ROOT

WORST = {"offset_ms": 1.0}


def event(number: int) -> Event:
    return Event(
        "cart", f"x-{number}", "async", "onset", "a-b", "b", Cause.SLIP, number, None, WORST, f"event {number}"
    )


def verdict(frame: int) -> Verdict:
    return Verdict("cart", "a-b", frame, State.SYNC, Basis.CONTENT)


def status(level: Level = Level.OK) -> Status:
    return Status("cart", 1, level, (), {}, {}, "0", 1.0, 0)


def numbers(events):
    return [int(message["id"][2:]) for message in events]


@pytest.fixture
def prefix() -> str:
    """Nobody else on this machine uses it."""
    return f"test/{uuid.uuid4().hex[:8]}"


def test_a_router_killed_and_restarted_loses_no_event(prefix, tmp_path):
    endpoint = free_endpoint()
    sink = ZenohSink(ZenohSettings(prefix=prefix, mode="client", connect=[endpoint]), rig="cart")
    with router(endpoint) as first, subscriber(tmp_path, "--connect", endpoint, "--prefix", prefix, "--json") as heard:
        sink.start()
        for number in range(10):
            sink.take(event(number))
        wait_for(lambda: len(heard.events()) == 10)
        first.send_signal(signal.SIGKILL)
        first.wait()
        for number in range(10, 30):
            began = time.monotonic()
            sink.take(event(number))
            assert time.monotonic() - began < 1
            time.sleep(0.05)
        with router(endpoint):
            for number in range(30, 40):
                sink.take(event(number))
                time.sleep(0.05)
            wait_for(lambda: len(heard.events()) >= 40, 30)
            sink.take(status(Level.WARN))
            wait_for(heard.statuses)
            sink.stop()
    assert numbers(heard.events()) == list(range(40))


def test_a_router_that_is_absent_at_the_start_is_waited_for_without_blocking(prefix, tmp_path, caplog):
    caplog.set_level(logging.INFO, "syncwatch.sinks.zenoh")
    endpoint = free_endpoint()
    sink = ZenohSink(ZenohSettings(prefix=prefix, mode="client", connect=[endpoint]), rig="cart")
    sink.start()
    for number in range(20):
        sink.take(event(number))
        sink.take(verdict(number))
    warnings = [record.getMessage() for record in caplog.records if record.levelname == "WARNING"]
    assert len(warnings) == 1
    assert f"cannot reach {endpoint} yet" in warnings[0]
    with router(endpoint), subscriber(tmp_path, "--connect", endpoint, "--prefix", prefix, "--json") as heard:
        wait_for(lambda: len(heard.events()) >= 20, 30)
        assert numbers(heard.events()) == list(range(20))
        wait_for(lambda: f"zenoh: connected to {endpoint}" in caplog.messages)
        sink.stop()


def test_stopping_is_prompt_without_a_router(prefix):
    sink = ZenohSink(ZenohSettings(prefix=prefix, mode="client", connect=[free_endpoint()]), rig="cart")
    sink.start()
    sink.take(event(1))
    began = time.monotonic()
    sink.stop()
    assert time.monotonic() - began < 2


def test_a_required_router_that_is_absent_is_an_error(prefix):
    endpoint = free_endpoint()
    settings = ZenohSettings(prefix=prefix, mode="client", connect=[endpoint], required=True)
    with pytest.raises(RunError, match=f"cannot reach {endpoint}"):
        ZenohSink(settings, rig="cart").start()


def test_events_of_an_outage_arrive_though_nothing_is_published_after_it(prefix, tmp_path):
    endpoint = free_endpoint()
    sink = ZenohSink(ZenohSettings(prefix=prefix, mode="client", connect=[endpoint]), rig="cart")
    with router(endpoint) as first, subscriber(tmp_path, "--connect", endpoint, "--prefix", prefix, "--json") as heard:
        sink.start()
        sink.take(event(0))
        wait_for(heard.events)
        first.kill()
        first.wait()
        for number in range(1, 6):
            sink.take(event(number))
        with router(endpoint):
            wait_for(lambda: len(heard.events()) >= 6, 30)
            assert numbers(heard.events()) == list(range(6))
            sink.stop()


def test_a_subscriber_that_was_frozen_gets_every_event(prefix, tmp_path):
    sink = ZenohSink(ZenohSettings(prefix=prefix), rig="cart")
    sink.start()
    with subscriber(tmp_path, "--prefix", prefix, "--json") as heard:
        sink.take(event(0))
        wait_for(heard.events)
        heard.process.send_signal(signal.SIGSTOP)
        for number in range(1, 200):
            sink.take(event(number))
        heard.process.send_signal(signal.SIGCONT)
        wait_for(lambda: len(heard.events()) >= 200)
        assert numbers(heard.events()) == list(range(200))
    sink.stop()


def test_a_monitor_that_crashed_does_not_keep_its_name(prefix):
    code = (
        "import sys\n"
        "from sinks.zenoh import ZenohSettings, ZenohSink\n"
        f"ZenohSink(ZenohSettings(prefix='{prefix}'), rig='cart').start()\n"
        "print('up', flush=True); sys.stdin.read()\n"
    )
    pipes = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE}
    with subprocess.Popen([sys.executable, "-c", code], cwd=ROOT, **pipes) as crashing:
        assert crashing.stdout.readline() == b"up\n"
        with pytest.raises(RunError, match="already published"):
            ZenohSink(ZenohSettings(prefix=prefix), rig="cart").start()
        crashing.kill()
    again = ZenohSink(ZenohSettings(prefix=prefix), rig="cart")
    again.start()
    again.stop()


def test_a_second_rig_is_refused_though_its_router_came_late(prefix):
    """The first is at another router all the time, so that only the late one's link is new."""
    early, late = free_endpoint(), free_endpoint()
    first = ZenohSink(ZenohSettings(prefix=prefix, mode="client", connect=[early]), rig="cart")
    second = ZenohSink(ZenohSettings(prefix=prefix, mode="client", connect=[late]), rig="cart")
    with router(early):
        first.start()
        second.start()
        with zenoh.open(linked_router(late, early)), pytest.raises(RunError, match="already published"):
            wait_for(lambda: second.take(status()))
        second.stop()
        first.stop()


def linked_router(listen: str, connect: str) -> zenoh.Config:
    settings = ZenohSettings(mode="router", listen=[listen], connect=[connect])
    return session_config(settings)


def test_a_router_that_hangs_delays_neither_reports_nor_the_end(prefix):
    endpoint = free_endpoint()
    with router(endpoint) as hanging:
        sink = ZenohSink(ZenohSettings(prefix=prefix, mode="client", connect=[endpoint]), rig="cart")
        sink.start()
        hanging.send_signal(signal.SIGSTOP)
        slowest_s = 0.0
        for number in range(500):
            for report in (event(number), verdict(number), status()):
                began = time.monotonic()
                sink.take(report)
                slowest_s = max(slowest_s, time.monotonic() - began)
        assert slowest_s < 0.5
        began = time.monotonic()
        sink.stop()
        assert time.monotonic() - began < 2
        hanging.send_signal(signal.SIGCONT)


def test_a_peer_says_that_nobody_is_at_its_endpoint(prefix, caplog):
    endpoint = free_endpoint()
    sink = ZenohSink(ZenohSettings(prefix=prefix, connect=[endpoint]), rig="cart")
    sink.start()
    sink.stop()
    assert caplog.messages == [f"zenoh: cannot reach {endpoint} yet, trying on (nobody answers there)"]


def test_a_required_peer_that_is_absent_is_an_error(prefix):
    endpoint = free_endpoint()
    with pytest.raises(RunError, match=f"cannot reach {endpoint}: nobody answers there"):
        ZenohSink(ZenohSettings(prefix=prefix, connect=[endpoint], required=True), rig="cart").start()
