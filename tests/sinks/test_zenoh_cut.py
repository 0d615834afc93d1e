"""Subscribers that come late, are cut off, see the router restart or never read: real sessions, real cuts."""

from __future__ import annotations

import time
import uuid
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from typing import Any

import numpy as np
import zenoh

from pipeline.frame import Frame
from pipeline.verdict import Cause, Event, Level, State, Status, Verdict
from pipeline.zenoh_network import NetworkSettings, session_config
from sinks.zenoh import ZenohSettings, ZenohSink
from syncwatch.testing import ListSink
from tests.frames import PERIOD_NS, frame
from tests.network import Proxy, Subscriber, free_endpoint, router, subscriber, wait_for
from tests.pipeline.test_run import run_of

CUT_S = 5.0


def event(number: int) -> Event:
    return Event("cart", f"x-{number}", "async", "onset", "a-b", "b", Cause.SLIP, number, None, {}, f"event {number}")


class Rig:
    """Publishes an event and a status at a time, numbered alike."""

    def __init__(self, sink: ZenohSink) -> None:
        self.sink = sink
        self.said = 0

    def speak(self) -> None:
        self.sink.take(event(self.said))
        self.sink.take(Status("cart", self.said, Level.OK, (), {}, {}, "0", 1.0, 0))
        self.said += 1
        time.sleep(0.05)

    def speak_for(self, seconds: float) -> None:
        until = time.monotonic() + seconds
        while time.monotonic() < until:
            self.speak()


def numbers(subscriber: Subscriber) -> list[int]:
    return [message["since_ns"] for message in subscriber.events()]


def catch_up(rig: Rig, *subscribers: Subscriber) -> None:
    """All of them hear the statuses of now while the rig goes on, and have every event once and in order."""
    since = rig.said
    wait_for(
        lambda: rig.speak() or all(one.statuses()[-1:] and one.statuses()[-1]["at_ns"] > since for one in subscribers)
    )
    for one in subscribers:
        wait_for(lambda one=one: len(one.events()) >= rig.said)
        assert numbers(one) == list(range(rig.said))


def test_late_cut_off_for_5_s_and_router_restarted_every_event_comes_once_and_in_order(tmp_path):
    endpoint, prefix = free_endpoint(), f"test/{uuid.uuid4().hex[:8]}"
    closed, silent = Proxy(endpoint), Proxy(endpoint)
    sink = ZenohSink(ZenohSettings(prefix=prefix, mode="client", connect=[endpoint]), rig="cart")
    rig = Rig(sink)
    with ExitStack() as opened:
        first = opened.enter_context(router(endpoint))
        sink.start()
        rig.speak_for(0.5)
        late = [
            opened.enter_context(subscriber(tmp_path, "--connect", one.endpoint, "--prefix", prefix, "--json"))
            for one in (closed, silent)
        ]
        catch_up(rig, *late)
        closed.cut(silently=False)
        silent.cut(silently=True)
        before = rig.said
        rig.speak_for(CUT_S)
        assert all(len(one.events()) == before for one in late)
        closed.mend()
        silent.mend()
        catch_up(rig, *late)
        first.kill()
        first.wait()
        rig.speak_for(0.5)
        opened.enter_context(router(endpoint))
        catch_up(rig, *late)
        sink.stop()
    closed.close()
    silent.close()


MOMENTS = 150


def judged(*sinks: ZenohSink, listening: Callable[[], object] = lambda: None) -> tuple[list[Any], Status]:
    """What a live rig says of MOMENTS, each handed over when the one before has been judged."""
    heard = ListSink()
    noise = np.random.default_rng(1).integers(0, 255, (4, 480, 640), np.uint8)

    def handed_over() -> Iterator[Frame]:
        listening()
        for number in range(MOMENTS):
            late_ns = PERIOD_NS * (60 < number < 90)
            yield frame("left", number * PERIOD_NS, number, group=number, image=noise[number % 4])
            yield frame("right", number * PERIOD_NS + late_ns, number, group=number, image=noise[number % 4])
            deadline = time.monotonic() + 10
            while len(framed(heard)) < number and time.monotonic() < deadline:
                time.sleep(0.005)

    run_of(handed_over(), heard, *sinks, live=True).execute()
    return [(one.frame, one.state, one.cause, one.offset_ns) for one in framed(heard)], heard.statuses[-1]


def framed(heard: ListSink) -> list[Verdict]:
    """Without what is said of silences: this machine may be slow."""
    return [one for one in heard.verdicts if one.frame is not None]


def test_a_subscriber_that_never_reads_costs_detection_nothing():
    endpoint, prefix = free_endpoint(), f"test/{uuid.uuid4().hex[:8]}"
    proxy = Proxy(endpoint)
    settings = ZenohSettings(listen=[endpoint], prefix=prefix, preview={"every_s": 0.1, "width": 640})
    heard: list[Any] = []
    with ExitStack() as opened:

        def listen() -> None:
            peer = zenoh.open(session_config(NetworkSettings(mode="client", connect=[proxy.endpoint])))
            heard.append(opened.enter_context(peer).declare_subscriber(f"{prefix}/**"))
            proxy.cut(silently=True)

        undisturbed, _ = judged()
        disturbed, status = judged(ZenohSink(settings, rig="cart"), listening=listen)
        assert heard[0].try_recv() is None, "it has read"
        proxy.close()
    assert disturbed == undisturbed
    assert len(undisturbed) == MOMENTS
    assert {state for _, state, _, _ in undisturbed} == {State.SYNC, State.ASYNC}
    assert status.dropped_windows == 0
