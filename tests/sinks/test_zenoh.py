"""The Zenoh sink, with real sessions, a real router and subscribers in other processes."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
import uuid
from collections.abc import Iterator
from typing import Any

import pytest
import zenoh
from pydantic import ValidationError

from pipeline.errors import InputError, RunError
from pipeline.verdict import Basis, Cause, Event, Level, State, Status, Verdict
from sinks.zenoh import ZenohSettings, ZenohSink
from tests.network import free_endpoint, router, subscriber, wait_for
from tests.programs import ROOT


def event(number: int, rig: str = "cart") -> Event:
    return Event(rig, f"x-{number}", "async", "onset", "a-b", "b", Cause.SLIP, number, None, 1000, f"event {number}")


def verdict(frame: int, state: State = State.SYNC) -> Verdict:
    return Verdict("cart", "a-b", frame, state, Basis.CONTENT)


def status(level: Level = Level.OK) -> Status:
    return Status("cart", 1, level, (), {}, {}, "0", 1.0, 0)


@pytest.fixture
def prefix() -> str:
    """Nobody else on this machine uses it."""
    return f"test/{uuid.uuid4().hex[:8]}"


@pytest.fixture
def sink(prefix) -> Iterator[ZenohSink]:
    made = ZenohSink(ZenohSettings(prefix=prefix), rig="cart")
    made.start()
    yield made
    made.stop()


class Heard:
    """What a subscriber has received so far; polled for, so that no Python runs on zenoh's threads."""

    def __init__(self, subscriber: Any) -> None:
        self._subscriber = subscriber
        self._samples: list[Any] = []

    def samples(self) -> list[Any]:
        while (sample := self._subscriber.try_recv()) is not None:
            self._samples.append(sample)
        return self._samples

    def clear(self) -> None:
        self.samples().clear()


def numbers(events: list[dict[str, Any]]) -> list[int]:
    return [int(message["id"][2:]) for message in events]


def test_another_process_hears_status_and_events(sink, prefix, tmp_path):
    with subscriber(tmp_path, "--prefix", prefix) as heard:
        wait_for(lambda: any("here" in line for line in heard.lines()))
        sink.take(status(Level.ERROR))
        sink.take(event(1))
        wait_for(lambda: len(heard.lines()) >= 4)
        assert set(heard.lines()[2:]) == {"cart: error", "cart: onset: event 1"}


def test_a_late_subscriber_gets_every_event_in_order(sink, prefix, tmp_path):
    for number in range(50):
        sink.take(event(number))
    with subscriber(tmp_path, "--prefix", prefix, "--json") as heard:
        wait_for(lambda: len(heard.events()) >= 50)
        sink.take(event(50))
        wait_for(lambda: len(heard.events()) >= 51)
        assert numbers(heard.events()) == list(range(51))


def test_keys_and_encodings_are_as_promised(sink, prefix):
    with zenoh.open(local()) as session:
        heard = Heard(session.declare_subscriber(f"{prefix}/**"))
        wait_for(lambda: sink.take(status()) or heard.samples())
        heard.clear()
        for report in (status(), verdict(3), event(1)):
            sink.take(report)
        samples = wait_for(lambda: len(heard.samples()) >= 3 and heard.samples())
        got = {str(sample.key_expr): str(sample.encoding) for sample in samples}
        assert got == {
            f"{prefix}/cart/status": "application/json;syncwatch.status.v1",
            f"{prefix}/cart/verdict/a-b": "application/json;syncwatch.verdict.v1",
            f"{prefix}/cart/event": "application/json;syncwatch.event.v1",
        }


def test_get_answers_the_latest_of_each(sink, prefix):
    for report in (status(), verdict(1), verdict(2), event(1), event(2), status(Level.WARN)):
        sink.take(report)
    with zenoh.open(local()) as session:
        answers = wait_for(lambda: ask(session, f"{prefix}/cart/**"))
    assert answers[f"{prefix}/cart/status"]["level"] == "warn"
    assert answers[f"{prefix}/cart/verdict/a-b"]["frame"] == 2
    assert answers[f"{prefix}/cart/event"]["id"] == "x-2"
    assert len(answers) == 3


def test_get_answers_the_latest_verdict_even_if_it_was_not_published(prefix):
    sink = ZenohSink(ZenohSettings(prefix=prefix, verdicts="none"), rig="cart")
    sink.start()
    for frame in range(5):
        sink.take(verdict(frame))
    with zenoh.open(local()) as session:
        answers = wait_for(lambda: ask(session, f"{prefix}/cart/**"))
    sink.stop()
    assert answers[f"{prefix}/cart/verdict/a-b"]["frame"] == 4


def test_get_can_ask_for_one_thing(sink, prefix):
    sink.take(status())
    sink.take(verdict(1))
    with zenoh.open(local()) as session:
        assert list(wait_for(lambda: ask(session, f"{prefix}/*/status"))) == [f"{prefix}/cart/status"]


def ask(session: zenoh.Session, key: str) -> dict[str, Any]:
    replies = list(session.get(key, timeout=1.0))
    return {str(reply.ok.key_expr): json.loads(reply.ok.payload.to_string()) for reply in replies if reply.ok}


def test_the_alive_token_is_there_while_the_sink_is(prefix):
    sink = ZenohSink(ZenohSettings(prefix=prefix), rig="cart")
    with zenoh.open(local()) as session:
        heard = Heard(session.liveliness().declare_subscriber(f"{prefix}/*/alive", history=True))
        sink.start()
        (here,) = wait_for(heard.samples)
        assert (str(here.key_expr), here.kind) == (f"{prefix}/cart/alive", zenoh.SampleKind.PUT)
        sink.stop()
        wait_for(lambda: [sample.kind for sample in heard.samples()[1:]] == [zenoh.SampleKind.DELETE])


def test_a_second_rig_of_the_same_name_is_refused(sink, prefix):
    with pytest.raises(RunError, match=f"rig 'cart' is already published under '{prefix}/cart'"):
        ZenohSink(ZenohSettings(prefix=prefix), rig="cart").start()


def test_two_rigs_in_one_process_do_not_disturb_each_other(sink, prefix):
    other = ZenohSink(ZenohSettings(prefix=prefix), rig="drone")
    other.start()
    other.take(status())
    other.stop()
    sink.take(status())


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
        sink.stop()


def test_stopping_is_prompt_without_a_router(prefix):
    sink = ZenohSink(ZenohSettings(prefix=prefix, mode="client", connect=[free_endpoint()]), rig="cart")
    sink.start()
    sink.take(event(1))
    began = time.monotonic()
    sink.stop()
    assert time.monotonic() - began < 4


def test_what_is_reported_last_is_still_delivered_before_the_session_closes(prefix, tmp_path):
    sink = ZenohSink(ZenohSettings(prefix=prefix), rig="cart")
    with subscriber(tmp_path, "--prefix", prefix, "--json") as heard:
        sink.start()
        wait_for(lambda: sink.take(status()) or heard.statuses())
        for number in range(20):
            sink.take(event(number))
        sink.stop()
        wait_for(lambda: len(heard.events()) == 20)


def test_a_required_router_that_is_absent_is_an_error(prefix):
    endpoint = free_endpoint()
    settings = ZenohSettings(prefix=prefix, mode="client", connect=[endpoint], required=True)
    with pytest.raises(RunError, match=f"cannot reach {endpoint}"):
        ZenohSink(settings, rig="cart").start()


def test_verdicts_can_be_thinned_to_changes(prefix):
    sink = ZenohSink(ZenohSettings(prefix=prefix, verdicts="changes"), rig="cart")
    sink.start()
    with zenoh.open(local()) as session:
        statuses = Heard(session.declare_subscriber(f"{prefix}/cart/status"))
        verdicts = Heard(session.declare_subscriber(f"{prefix}/cart/verdict/*"))
        wait_for(lambda: sink.take(status()) or statuses.samples())
        time.sleep(0.5)
        states = [State.SYNC, State.SYNC, State.ASYNC, State.ASYNC, State.SYNC]
        for frame, state in enumerate(states):
            sink.take(verdict(frame, state))
        wait_for(lambda: len(verdicts.samples()) >= 3)
        assert [json.loads(sample.payload.to_string())["frame"] for sample in verdicts.samples()] == [0, 2, 4]
    sink.stop()


@pytest.mark.parametrize(
    ("settings", "said"),
    [
        ({"mode": "client"}, "needs a router"),
        ({"connect": ["127.0.0.1:7447"]}, "not an endpoint"),
        ({"prefix": "/a"}, "not a key"),
        ({"prefix": "a/*"}, "not a key"),
        ({"mode": "pear"}, "'peer', 'client' or 'router'"),
    ],
)
def test_settings_that_cannot_work_are_refused(settings, said):
    with pytest.raises(ValidationError, match=said):
        ZenohSettings.model_validate(settings)


@pytest.mark.parametrize("name", ["a b", "a/b", "a*", "", "a#b"])
def test_a_rig_name_that_is_no_key_is_refused(name):
    with pytest.raises(InputError, match="cannot be published"):
        ZenohSink(ZenohSettings(), rig=name)


def test_nothing_of_zenoh_reaches_stdout(prefix):
    code = (
        "from sinks.zenoh import *\n"
        f"s = ZenohSink(ZenohSettings(mode='client', connect=['{free_endpoint()}'], prefix='{prefix}'), rig='cart')\n"
        "s.start(); s.stop()\n"
    )
    env = {**os.environ, "RUST_LOG": "debug"}
    done = subprocess.run([sys.executable, "-c", code], cwd=ROOT, env=env, capture_output=True, timeout=30, check=True)
    assert done.stdout == b""


def local() -> zenoh.Config:
    config = zenoh.Config()
    config.insert_json5("listen/endpoints", '["tcp/127.0.0.1:0"]')
    config.insert_json5("scouting/multicast/interface", '"lo"')
    return config
