"""The Zenoh sink, with real sessions, a real router and subscribers in other processes."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import time
import uuid
from collections.abc import Iterator
from typing import Any

import cv2
import numpy as np
import pytest
import zenoh
from pydantic import ValidationError

from pipeline.errors import InputError, RunError
from pipeline.frame import Frame
from pipeline.verdict import Basis, Cause, Event, Level, State, Status, Verdict
from sinks.zenoh import ZenohSettings, ZenohSink
from sinks.zenoh_preview import Previews, PreviewSettings
from tests.network import free_endpoint, subscriber, wait_for
from tests.programs import ROOT

WORST = {"offset_ms": 1.0}


def event(number: int, rig: str = "cart") -> Event:
    return Event(rig, f"x-{number}", "async", "onset", "a-b", "b", Cause.SLIP, number, None, WORST, f"event {number}")


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
        for report in (status(), verdict(3), event(1)):
            sink.take(report)
        wait_for(lambda: len({str(sample.key_expr) for sample in heard.samples()}) == 3)
        got = {str(sample.key_expr): str(sample.encoding) for sample in heard.samples()}
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


def test_small_pictures_are_published_where_they_are_wanted_and_answered_to_get(prefix):
    sink = ZenohSink(ZenohSettings(prefix=prefix, preview={"every_s": 0.1, "width": 64}), rig="cart")
    assert sink.wants_frames
    sink.start()
    image = np.random.default_rng(1).integers(0, 255, (240, 320, 3), np.uint8)
    with zenoh.open(local()) as session:
        heard = Heard(session.declare_subscriber(f"{prefix}/cart/preview/*"))
        wait_for(lambda: sink.take_frame(Frame("left", 1, 0, "rig", 0, image)) or heard.samples())
        sample = heard.samples()[0]
        assert (str(sample.key_expr), str(sample.encoding)) == (f"{prefix}/cart/preview/left", "image/jpeg")
        picture = cv2.imdecode(np.frombuffer(sample.payload.to_bytes(), np.uint8), cv2.IMREAD_UNCHANGED)
        assert picture.shape == (48, 64, 3)
        (answer,) = session.get(f"{prefix}/cart/**", timeout=1.0)
        assert answer.ok.payload.to_bytes()[:3] == b"\xff\xd8\xff"
    sink.stop()


def test_pictures_come_no_more_often_than_asked_for_and_are_never_enlarged():
    previews = Previews(PreviewSettings(every_s=1))
    frames = {side: Frame(side, 1, 0, "rig", 0, np.zeros((10, 20), np.uint8)) for side in ("left", "right")}
    made = [previews.take(frames["left"], at_ns) for at_ns in range(0, 3_000_000_000, 100_000_000)]
    assert [n for n, jpeg in enumerate(made) if jpeg] == [0, 10, 20]
    assert previews.take(frames["right"], 50_000_000)
    assert cv2.imdecode(np.frombuffer(made[0], np.uint8), cv2.IMREAD_UNCHANGED).shape == (10, 20)


def test_frames_are_not_asked_for_without_previews():
    assert not ZenohSink(ZenohSettings(), rig="cart").wants_frames


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


def test_what_is_reported_last_is_still_delivered_before_the_session_closes(prefix, tmp_path):
    sink = ZenohSink(ZenohSettings(prefix=prefix), rig="cart")
    with subscriber(tmp_path, "--prefix", prefix, "--json") as heard:
        sink.start()
        wait_for(lambda: sink.take(status()) or heard.statuses())
        for number in range(20):
            sink.take(event(number))
        sink.stop()
        wait_for(lambda: len(heard.events()) == 20)


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
        ({"connect": ["tcp/router"]}, "'tcp/router' is not an endpoint: write it like tcp/"),
        ({"listen": ["tcp/0.0.0.0:70000"]}, "not an endpoint"),
        ({"prefix": "/a"}, "not a key"),
        ({"prefix": "a/*"}, "not a key"),
        ({"mode": "pear"}, "'peer', 'client' or 'router'"),
    ],
)
def test_settings_that_cannot_work_are_refused(settings, said):
    with pytest.raises(ValidationError, match=said):
        ZenohSettings.model_validate(settings)


@pytest.mark.parametrize("endpoint", ["tcp/[::1]:7447", "tls/router.example:7447", "udp/10.0.0.1:7447#iface=eth0"])
def test_endpoints_of_every_kind_are_accepted(endpoint):
    assert ZenohSettings(connect=[endpoint]).connect == (endpoint,)


@pytest.mark.parametrize("name", ["a b", "a/b", "a*", "", "a#b", "@a"])
def test_a_rig_name_that_is_no_key_is_refused(name):
    with pytest.raises(InputError, match="cannot be published"):
        ZenohSink(ZenohSettings(), rig=name)


@pytest.mark.parametrize("settings", ["", "mode='client', connect=['ENDPOINT']"], ids=["peer", "client"])
def test_nothing_of_zenoh_reaches_stdout(prefix, settings):
    given = settings.replace("ENDPOINT", free_endpoint())
    code = (
        "from sinks.zenoh import ZenohSettings, ZenohSink\n"
        f"s = ZenohSink(ZenohSettings(prefix='{prefix}', {given}), rig='cart')\n"
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
