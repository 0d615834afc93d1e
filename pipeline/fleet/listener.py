"""Hears all rigs under a prefix over Zenoh and keeps a table of them."""

from __future__ import annotations

import logging
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from types import TracebackType
from typing import Any

import zenoh
import zenoh.ext

from pipeline.deadline import ended_within
from pipeline.errors import InputError
from pipeline.fleet.messages import HeardEvent, HeardStatus, HeardVerdict, read
from pipeline.fleet.table import MAX_EVENTS, Fleet
from pipeline.frame import NS_PER_S
from pipeline.printable import printable
from pipeline.zenoh_network import RETRY_EVERY_S, is_linked
from pipeline.zenoh_reach import NOBODY, Network, first_words
from sinks.zenoh_settings import ZenohSettings

log = logging.getLogger("syncwatch.fleet")

POLL_S = 0.05
STOP_WITHIN_S = 1.5

WAITING = 4096
"""Messages of a kind that may wait between two polls. Of statuses, verdicts and pictures the oldest give way to more;
events and tokens hold Zenoh up for the moment until the next poll."""

VERDICTS_WAITING = 512
PICTURES_WAITING = 64
"""Of one rig."""

MAX_PICTURE_BYTES = 1 << 20
JPEG_START = b"\xff\xd8\xff"

MAX_COMPLAINTS = 100

ASK_WITHIN_S = 5.0
PAST = f"@adv/**?_max={2 * MAX_EVENTS}"
"""Where an advanced publisher keeps what it has said, below its key."""

LOOK_FIRST_S, LOOK_EVERY_S = 0.5, 2.0
"""When it is looked into why nobody is at the other end, and how often then."""

LOOKS_ON_NS = 60 * NS_PER_S
"""Verdicts and pictures of a rig come until nobody has looked at it for so long."""


class FleetListener:
    """Listens on a thread of its own from `start` to `stop`, and connects again whenever it is cut off.

    `fleet` is the table; `problem` says in words why nothing can be heard, None while something can. Every rig's
    status, events and token are heard, its verdicts and pictures only while somebody looks at it: hundreds of rigs say
    too much for one listener, and for the line to where they are. previews: hear the pictures at all. Nothing of it
    raises for the network's sake; certificates and passwords that are not there or no good are an InputError at once.
    Zenoh's handlers are polled: Python callbacks on its threads can keep the program from ending.
    """

    def __init__(
        self,
        settings: ZenohSettings,
        *,
        previews: bool = False,
        monotonic_ns: Callable[[], int] = time.monotonic_ns,
    ) -> None:
        self.fleet = Fleet(monotonic_ns)
        self.problem: str | None = f"connecting to {settings.where}"
        self.settings = settings
        self._network = Network(settings)
        self._monotonic_ns = monotonic_ns
        self._previews = previews
        self._looked_at_ns: dict[str, int] = {}
        self._why_unlinked: str | None = None
        self._look_at_s = 0.0
        self._stopping = threading.Event()
        self._complained: set[str] = set()
        self._thread = threading.Thread(target=self._listen, name="fleet", daemon=True)

    def start(self) -> None:
        self._thread.start()

    def stop(self) -> None:
        """Ends listening, within STOP_WITHIN_S even where a router hangs."""
        self._stopping.set()
        ended_within(STOP_WITHIN_S, self._thread)

    def look_at(self, name: str) -> None:
        """Somebody looks at a rig now, and wants to hear all of it. Any thread; again and again while it lasts."""
        if self.fleet.knows(name):
            self._looked_at_ns[name] = self._monotonic_ns()

    def __enter__(self) -> FleetListener:
        self.start()
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, at: TracebackType | None) -> None:
        self.stop()

    def _listen(self) -> None:
        while not self._stopping.is_set():
            try:
                with ExitStack() as opened:
                    self._hear(self._open(opened))
            except zenoh.ZError as error:
                reason = self._network.why_not() or first_words(error)
                self._cut_off(f"cannot reach {self.settings.where}: {reason}")
            except InputError as error:
                self._cut_off(str(error))
            self._stopping.wait(RETRY_EVERY_S)

    def _open(self, opened: ExitStack) -> _Ears:
        session = opened.enter_context(self._network.open())
        return _Ears(session, opened, self.settings.prefix, previews=self._previews)

    def _hear(self, ears: _Ears) -> None:
        while not self._stopping.wait(POLL_S) and not ears.session.is_closed():
            if self.settings.connect and not is_linked(ears.session):
                self._cut_off(self._unlinked())
            elif self.problem is not None:
                log.debug("connected to %s", self.settings.where)
                self.problem, self.fleet.connected = None, True
            ears.turn_to(self._looked_at())
            for suffix, samples in ears.each():
                self._take(suffix, samples, ears)
            for sample in ears.past():
                self._take_checked("event", sample)

    def _unlinked(self) -> str:
        """That nobody is at the other end, and why: looked into now and then, for that takes a while."""
        now_s = time.monotonic()
        if self._why_unlinked is None or self.fleet.connected:
            self._why_unlinked, self._look_at_s = NOBODY, now_s + LOOK_FIRST_S
        elif now_s > self._look_at_s:
            self._why_unlinked = self._network.why_not() or NOBODY
            self._look_at_s = time.monotonic() + LOOK_EVERY_S
        return f"cannot reach {self.settings.where}: {self._why_unlinked}"

    def _looked_at(self) -> set[str]:
        before_ns = self._monotonic_ns() - LOOKS_ON_NS
        for name, at_ns in list(self._looked_at_ns.items()):
            if at_ns < before_ns:
                del self._looked_at_ns[name]
                self.fleet.forget_previews(name)
        return set(self._looked_at_ns)

    def _cut_off(self, problem: str) -> None:
        if self.problem != problem:
            log.debug("%s", problem)
        self.problem, self.fleet.connected = problem, False

    def _take(self, suffix: str, samples: Any, ears: _Ears) -> None:
        for _ in range(WAITING):
            if self._stopping.is_set() or (sample := samples.try_recv()) is None:
                return
            self._take_checked(suffix, sample)
            if suffix == "alive" and sample.kind == zenoh.SampleKind.PUT:
                ears.ask(str(sample.key_expr).removesuffix("/alive"))

    def _take_checked(self, suffix: str, sample: zenoh.Sample) -> None:
        key = str(sample.key_expr)
        below = key.removeprefix(self.settings.prefix).strip("/")
        try:
            self._take_one(suffix, below, sample)
        except ValueError as error:
            self._complain(key, error)

    def _take_one(self, suffix: str, below: str, sample: zenoh.Sample) -> None:
        """Raises ValueError for a message that is not what its key promises."""
        if "*" in below:
            raise ValueError("published for many keys at once")
        if not below.isprintable():
            raise ValueError("a name with characters that cannot be seen")
        name, _, part = below.rpartition("/")
        if suffix in {"verdict", "preview"}:
            name = name.rpartition("/")[0]
        if not name:
            return
        if suffix == "alive":
            self.fleet.hear_alive(name, here=sample.kind == zenoh.SampleKind.PUT)
        elif sample.kind != zenoh.SampleKind.PUT:
            return
        elif suffix == "status":
            self.fleet.hear_status(name, read(sample.payload.to_bytes(), HeardStatus))
        elif suffix == "event":
            self.fleet.hear_event(name, read(sample.payload.to_bytes(), HeardEvent))
        elif suffix == "verdict":
            self.fleet.hear_verdict(name, part, read(sample.payload.to_bytes(), HeardVerdict))
        else:
            self.fleet.hear_preview(name, part, _picture(sample.payload.to_bytes()))

    def _complain(self, key: str, error: ValueError) -> None:
        """Once a key; what somebody else publishes there is not ours to fill a log with."""
        if key in self._complained or len(self._complained) >= MAX_COMPLAINTS:
            return
        self._complained.add(key)
        log.warning("%s: a message that cannot be read is left out: %s", printable(key), str(error).splitlines()[0])


class _Ears:
    """Everything that is declared on a session to hear rigs."""

    def __init__(self, session: zenoh.Session, opened: ExitStack, prefix: str, *, previews: bool) -> None:
        self.session = session
        self._asked: list[Any] = []
        self._handlers: dict[str, Any] = {}
        hear = opened.enter_context
        self._handlers["alive"] = hear(
            session.liveliness().declare_subscriber(
                f"{prefix}/**/alive", zenoh.handlers.FifoChannel(WAITING), history=True
            )
        )
        self._handlers["event"] = zenoh.ext.declare_advanced_subscriber(
            session,
            f"{prefix}/**/event",
            zenoh.handlers.FifoChannel(WAITING),
            history=zenoh.ext.HistoryConfig(detect_late_publishers=True, max_samples=2 * MAX_EVENTS),
            recovery=zenoh.ext.RecoveryConfig(heartbeat=True, periodic_queries=None),
        )
        self._handlers["status"] = hear(
            session.declare_subscriber(f"{prefix}/**/status", zenoh.handlers.RingChannel(WAITING))
        )
        self._prefix = prefix
        self._of_a_rig = {"verdict": VERDICTS_WAITING} | ({"preview": PICTURES_WAITING} if previews else {})
        self._turned_to: dict[str, list[tuple[str, Any]]] = {}

    def turn_to(self, names: set[str]) -> None:
        """Hears all of these rigs, and of the others no more than what is heard of every one."""
        for name in self._turned_to.keys() - names:
            for _, subscriber in self._turned_to.pop(name):
                subscriber.undeclare()
        for name in names - self._turned_to.keys():
            self._turned_to[name] = [
                (suffix, self._declared(f"{self._prefix}/{name}/{suffix}/*", waiting))
                for suffix, waiting in self._of_a_rig.items()
            ]

    def _declared(self, keys: str, waiting: int) -> Any:
        return self.session.declare_subscriber(keys, zenoh.handlers.RingChannel(waiting))

    def ask(self, root: str) -> None:
        """Asks the rig that has appeared for its past events.

        The advanced subscriber does so as well. But of a publisher that it learns of by its token while events come it
        passes over all before these (Zenoh 1.10: one time in three through a router).
        """
        answers = self.session.get(
            f"{root}/event/{PAST}",
            zenoh.handlers.FifoChannel(WAITING),
            target=zenoh.QueryTarget.ALL,
            consolidation=zenoh.ConsolidationMode.NONE,
            accept_replies=zenoh.ReplyKeyExpr.ANY,
            timeout=ASK_WITHIN_S,
        )
        self._asked.append(answers)

    def past(self) -> Iterator[zenoh.Sample]:
        """The past events that have been told by now."""
        for answers in list(self._asked):
            try:
                while (reply := answers.try_recv()) is not None:
                    if reply.ok is not None:
                        yield reply.ok
            except zenoh.ZError:  # that was all
                self._asked.remove(answers)

    def each(self) -> list[tuple[str, Any]]:
        """What ends the keys of each kind, and where its messages wait; tokens first."""
        return [*self._handlers.items(), *(heard for rig in self._turned_to.values() for heard in rig)]


def _picture(payload: bytes) -> bytes:
    """Raises ValueError."""
    if len(payload) > MAX_PICTURE_BYTES or not payload.startswith(JPEG_START):
        raise ValueError(f"{len(payload)} bytes that are no small JPEG")
    return payload
