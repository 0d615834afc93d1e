"""A source of pictures that others publish over Zenoh."""

from __future__ import annotations

import logging
import re
import threading
import time
from collections import Counter
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TypeAlias

import zenoh

from pipeline.deadline import done_within, ended_within
from pipeline.errors import InputError
from pipeline.frame import NS_PER_S, Camera, Frame, StampOrigin
from pipeline.zenoh_network import RETRY_EVERY_S, is_linked
from pipeline.zenoh_reach import NOBODY, Network, first_words
from sources.live import ARRIVAL_CLOCK, Inbox, feed
from sources.replay.notices import Notices
from sources.replay.pictures import PictureMaker
from sources.zenoh.samples import Shown, read_sample
from sources.zenoh.settings import ZenohSourceSettings

log = logging.getLogger("syncwatch.sources.zenoh")

POLL_S = 0.002
"""How often samples are looked for: arrival is noted to this. Zenoh's own threads must not call Python: that can abort
the process when the interpreter ends meanwhile."""

HINT_AFTER_NS = 3 * NS_PER_S
"""How long nothing may come of a camera before the log says so."""

SWITCH_AFTER_NS = NS_PER_S
"""Silence after which another publisher may take the place of the one that was heard: it was restarted."""

STOP_WITHIN_S = 1.5
NUMBERS = re.compile(r"\d+")
MOST_KINDS = 100

Subscriber: TypeAlias = "zenoh.Subscriber[zenoh.handlers.Handler[zenoh.Sample]]"


@dataclass(frozen=True, slots=True)
class _Arrival:
    """A sample as it came."""

    camera: str
    arrived_ns: int
    key: str
    payload: bytes
    attachment: bytes | None


@dataclass(slots=True)
class _Heard:
    """Who publishes a camera's pictures: the key and, if known, the publisher; of which size; when it was heard last.

    said_epoch: as the publisher counts; epoch: rises with it, with a new publisher and a new size, and never falls.
    """

    key: str
    publisher: bytes | None
    size: str
    said_epoch: int
    at_ns: int
    epoch: int = 0


class ZenohSource:
    """Implements Source. What cannot be decoded is counted and said once a kind; the rest goes on.

    One publisher a camera is heard, with pictures of one size. Others on a key that matches, too, and other sizes are
    left out and said once; they take its place when it has been silent for a second, and the epoch rises. A network
    that is not there is waited for; sessions reconnect by themselves.
    """

    live = True
    frame_count = None

    def __init__(
        self,
        settings: ZenohSourceSettings,
        *,
        base: Path = Path(),
        clock_ns: Callable[[], int] = time.monotonic_ns,
    ) -> None:
        self._settings = settings
        self._base = base
        self._network: Network | None = None
        self._clock_ns = clock_ns
        self._inbox: Inbox[_Arrival] = Inbox(settings.cameras, frames_ahead=settings.frames_ahead)
        self._notices = Notices(log)
        self._makers = {name: PictureMaker(name, self._notices) for name in settings.cameras}
        self._heard: dict[str, _Heard] = {}
        self._silent = set(settings.cameras)
        self._refused: Counter[str] = Counter()
        self._kinds: set[tuple[str, str]] = set()
        self._session: zenoh.Session | None = None
        self._subscribers: dict[str, Subscriber] = {}
        self._troubles: set[str] = set()
        self._stopped = threading.Event()
        self._receiver: threading.Thread | None = None

    @property
    def cameras(self) -> tuple[Camera, ...]:
        return tuple(Camera(name, camera.fps) for name, camera in self._settings.cameras.items())

    @property
    def dropped(self) -> Mapping[str, int]:
        return self._inbox.dropped

    @property
    def refused(self) -> Counter[str]:
        """Samples that could not be decoded, by camera."""
        return self._refused

    def open(self) -> None:
        """Starts to look for the network; it need not be there yet.

        Raises InputError for certificates and passwords that are not there or no good.
        """
        try:
            self._network = Network(self._settings, self._base)
        except InputError as error:
            raise InputError(f"zenoh: {error}") from None
        self._try_to_open()

    def frames(self) -> Iterator[Frame]:
        if not self._stopped.is_set():
            self._receiver = feed(self._inbox, self._receive, name="zenoh-receive")
        for arrival in self._inbox.read():
            frame = self._frame(arrival)
            if frame is not None:
                yield frame

    def stop(self) -> None:
        self._stopped.set()
        self._inbox.stop()

    def close(self) -> None:
        self.stop()
        if self._receiver is not None:
            ended_within(STOP_WITHIN_S, self._receiver)
        if self._session is not None and not done_within(STOP_WITHIN_S, self._session.close, "zenoh-close"):
            log.warning("zenoh: the session did not close in time")
        self._inbox.say_what_was_dropped()
        for camera, count in self._refused.items():
            log.warning("%s: %d samples could not be used", camera, count)

    def _receive(self) -> None:
        """The receiving thread: samples into the inbox."""
        hint_at_ns: int | None = self._clock_ns() + HINT_AFTER_NS
        while not self._stopped.is_set():
            if self._session is None or self._session.is_closed():
                self._try_to_open()
                if self._session is None:
                    self._stopped.wait(RETRY_EVERY_S)
                    continue
                log.info("zenoh: connected to %s", self._settings.where)
            try:
                self._take_what_came()
            except zenoh.ZError as error:
                log.debug("zenoh: %s", error)
            if hint_at_ns is not None and self._clock_ns() > hint_at_ns:
                self._hint()
                hint_at_ns = None
            self._stopped.wait(POLL_S)

    def _take_what_came(self) -> None:
        for camera, subscriber in self._subscribers.items():
            for _ in range(self._settings.frames_ahead):  # then it is the next camera's turn
                sample = subscriber.try_recv()
                if sample is None or self._stopped.is_set():
                    break
                if sample.kind is zenoh.SampleKind.DELETE:
                    continue
                attachment = None if sample.attachment is None else sample.attachment.to_bytes()
                self._silent.discard(camera)
                key, payload = str(sample.key_expr), sample.payload.to_bytes()
                self._inbox.put(_Arrival(camera, self._clock_ns(), key, payload, attachment))

    def _try_to_open(self) -> None:
        assert self._network is not None
        self._session = None
        try:
            session = self._network.open()
            ahead = zenoh.handlers.RingChannel(self._settings.frames_ahead)
            self._subscribers = {
                name: session.declare_subscriber(camera.key, ahead) for name, camera in self._settings.cameras.items()
            }
        except zenoh.ZError as error:
            self._complain(self._network.why_not() or first_words(error))
        except InputError as error:
            self._complain(str(error))
        else:
            self._session = session
            self._troubles.clear()

    def _complain(self, trouble: str) -> None:
        if trouble not in self._troubles:
            self._troubles.add(trouble)
            log.warning("zenoh: cannot reach %s yet, trying on (%s)", self._settings.where, trouble)

    def _hint(self) -> None:
        """Says of which cameras nothing has come at all."""
        assert self._session is not None
        assert self._network is not None
        nobody = "" if is_linked(self._session) else f" ({self._settings.where}: {self._network.why_not() or NOBODY})"
        for camera in self._settings.cameras:
            if camera in self._silent:
                log.warning("%s: nothing is published on %s yet%s", camera, self._settings.cameras[camera].key, nobody)

    def _frame(self, arrival: _Arrival) -> Frame | None:
        try:
            shown = read_sample(arrival.key, arrival.payload, arrival.attachment)
            if not self._is_heard(arrival, shown):
                return None
            image = self._makers[arrival.camera].make(shown.image, arrival.key)
        except InputError as error:
            self._refuse(arrival.camera, f"{arrival.camera}: {arrival.key}: {error}")
            return None
        return Frame(
            camera=arrival.camera,
            sequence=shown.sequence,
            captured_ns=arrival.arrived_ns if shown.captured_ns is None else shown.captured_ns,
            clock=ARRIVAL_CLOCK if shown.captured_ns is None else shown.clock,
            arrived_ns=arrival.arrived_ns,
            image=image,
            epoch=self._heard[arrival.camera].epoch,
            exposure_ns=shown.exposure_ns,
            stamp_origin=StampOrigin.ARRIVAL if shown.captured_ns is None else shown.stamp_origin,
        )

    def _is_heard(self, arrival: _Arrival, shown: Shown) -> bool:
        """Whether the picture is of the publisher that is heard for its camera."""
        camera, (height, width) = arrival.camera, shown.image.shape[:2]
        now = _Heard(arrival.key, shown.publisher, f"{width}x{height}", shown.epoch, arrival.arrived_ns)
        heard = self._heard.setdefault(camera, now)
        is_same = (heard.key, heard.publisher) == (now.key, now.publisher)
        is_restarted = is_same and now.said_epoch != heard.said_epoch
        goes_on = is_same and now.size == heard.size
        if not goes_on and not is_restarted and now.at_ns - heard.at_ns < SWITCH_AFTER_NS:
            if is_same:
                why = f"{now.size} pixels are left out, for pictures of {heard.size} are heard"
            else:
                why = f"is left out, for {heard.key} is heard: give the camera a key that only one publisher has"
            self._refuse(camera, f"{camera}: {arrival.key}: {why}")
            return False
        now.epoch = heard.epoch + (is_restarted or not goes_on)
        self._heard[camera] = now
        if now.size != heard.size:
            self._makers[camera] = PictureMaker(camera, self._notices)
        return True

    def _refuse(self, camera: str, sentence: str) -> None:
        """Counts what cannot be used and says each kind of it once."""
        self._refused[camera] += 1
        kind = (camera, NUMBERS.sub("", sentence))
        if kind not in self._kinds and len(self._kinds) < MOST_KINDS:
            self._kinds.add(kind)
            log.warning("%s", sentence)
