"""Prints the status and the events of every rig on this machine.

    python examples/subscribe.py

    --connect tcp/host:7447   hear the rigs of a router instead
    --rig NAME                only this rig
    --json                    raw messages, one a line

Events are heard with an advanced subscriber: one that comes late, or loses its connection for a while, gets them all.
Those that a monitor has kept of its former runs may come more than once; they are printed once.
"""

from __future__ import annotations

import argparse
import json
import math
import signal
import sys
import threading
import time
from collections import deque
from collections.abc import Callable
from typing import Any

import zenoh
import zenoh.ext


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--connect", help="endpoint of a router, e.g. tcp/127.0.0.1:7447")
    parser.add_argument("--prefix", default="syncwatch")
    parser.add_argument("--rig", default="*")
    parser.add_argument("--for", dest="seconds", type=float, default=math.inf, help="stop after so many seconds")
    parser.add_argument("--json", action="store_true")
    given = parser.parse_args()
    root = f"{given.prefix}/{given.rig}"
    printer = Printer(raw=given.json)
    stop = threading.Event()
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda *_: stop.set())
    with zenoh.open(config(given.connect)) as session:
        status = session.declare_subscriber(f"{root}/status")
        alive = session.liveliness().declare_subscriber(f"{root}/alive", history=True)
        events = zenoh.ext.declare_advanced_subscriber(
            session,
            f"{root}/event",
            history=zenoh.ext.HistoryConfig(detect_late_publishers=True),
            recovery=zenoh.ext.RecoveryConfig(heartbeat=True, periodic_queries=None),
        )
        print("listening", flush=True)
        deadline = time.monotonic() + given.seconds
        while not stop.wait(0.02) and time.monotonic() < deadline:
            show(alive, lambda sample: greet(session, printer, sample))
            show(events, printer.event)
            show(status, printer.status)


def show(subscriber: Any, printed: Callable[[zenoh.Sample], None]) -> None:
    """Prints what has arrived. Polling keeps Python off zenoh's own threads, so that the program ends cleanly."""
    while (sample := subscriber.try_recv()) is not None:
        printed(sample)


def greet(session: zenoh.Session, printer: Printer, token: zenoh.Sample) -> None:
    """Asks a rig that appears for its past events, as the advanced subscriber may miss those while new ones come."""
    printer.alive(token)
    if token.kind == zenoh.SampleKind.PUT:
        replies = session.get(
            f"{str(token.key_expr).removesuffix('/alive')}/event/@adv/**",
            target=zenoh.QueryTarget.ALL,
            consolidation=zenoh.ConsolidationMode.NONE,
            accept_replies=zenoh.ReplyKeyExpr.ANY,
            timeout=5.0,
        )
        for reply in replies:
            if reply.ok is not None:
                printer.event(reply.ok)


def config(router: str | None) -> zenoh.Config:
    """Through a router, or else peers on this machine only."""
    made: zenoh.Config = zenoh.Config()
    made.insert_json5("mode", '"client"' if router else '"peer"')
    made.insert_json5("scouting/multicast/enabled", "false" if router else "true")
    if router:
        made.insert_json5("connect/endpoints", json.dumps([router]))
        made.insert_json5("connect/retry", "{period_init_ms: 200, period_max_ms: 2000, period_increase_factor: 1.5}")
    else:
        made.insert_json5("scouting/multicast/interface", '"lo"')
        made.insert_json5("listen/endpoints", '["tcp/127.0.0.1:0"]')
    return made


class Printer:
    """One line a message; a status only when its level or reasons have changed."""

    def __init__(self, *, raw: bool) -> None:
        self._raw = raw
        self._shown: dict[str, object] = {}
        self._told: deque[tuple[str, str]] = deque(maxlen=10_000)

    def status(self, sample: zenoh.Sample) -> None:
        text = sample.payload.to_string()
        message = json.loads(text)
        state = (message["level"], message["reasons"])
        if self._raw:
            print(text, flush=True)
        elif self._shown.get(message["rig"]) != state:
            self._shown[message["rig"]] = state
            print(f"{message['rig']}: {message['level']} {'; '.join(message['reasons'])}".rstrip(), flush=True)

    def event(self, sample: zenoh.Sample) -> None:
        text = sample.payload.to_string()
        message = json.loads(text)
        key = (message["id"], message["phase"])
        if key in self._told:
            return
        self._told.append(key)
        print(text if self._raw else f"{message['rig']}: {message['phase']}: {message['text']}", flush=True)

    def alive(self, sample: zenoh.Sample) -> None:
        here = sample.kind == zenoh.SampleKind.PUT
        if not self._raw:
            print(f"{sample.key_expr}: {'here' if here else 'gone'}", flush=True)


if __name__ == "__main__":
    try:
        main()
    except zenoh.ZError as error:
        sys.exit(f"cannot open a Zenoh session: {error}")
