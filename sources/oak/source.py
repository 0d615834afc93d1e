"""A source of the pictures of OAK cameras."""

from __future__ import annotations

import logging
import threading
import time
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from datetime import timedelta
from functools import partial
from typing import Any, TypeAlias

from pipeline.deadline import done_within
from pipeline.errors import InputError, SyncwatchError
from pipeline.frame import NS_PER_S, Camera, Frame, StampOrigin, StampReference
from sources.live import Inbox, feed
from sources.oak.device import Built, NotThereError, build_on_device
from sources.oak.library import load
from sources.oak.message import clock_name, read_message
from sources.oak.settings import OakDeviceSettings, OakSettings
from sources.replay.notices import Notices
from sources.replay.pictures import PictureMaker

log = logging.getLogger("syncwatch.sources.oak")

Build: TypeAlias = Callable[[Any, OakDeviceSettings, OakSettings], Built]
"""Finds the device and builds its pipeline; takes the module depthai first."""

QUEUE_FRAMES = 16
"""Frames of a camera that depthai may hold; beyond, it overwrites the oldest, which shows as a gap in sequences."""

WAIT = timedelta(milliseconds=100)
START_WITHIN_S = 10.0
"""How long cameras may take until their first frame: booting and exposure control take seconds."""

STOP_WITHIN_S = 5.0
AGAIN_AFTER_S, AGAIN_AT_MOST_S = 0.5, 10.0
"""The first wait before a lost device is looked for again, which doubles, and the longest."""

SAYS = {
    "device": "stamps are of the device's own clock",
    "host": "stamps are of this machine's clock, as depthai translates them",
    "ptp": "stamps are of the devices' system clocks, kept together by PTP",
}


@dataclass(slots=True)
class _Device:
    """One OAK: what was asked for, what is running, and how often it was opened anew."""

    settings: OakDeviceSettings
    built: Built | None = None
    name: str = ""
    epoch: int = 0
    sequences: dict[str, int] = field(default_factory=dict)
    restarts: dict[str, int] = field(default_factory=dict)


class OakSource:
    """Implements Source. Each device has a thread; one that is lost, dies or falls silent is opened anew, for ever.

    `epoch` rises whenever a device was opened anew or its counters fell. build: what finds a device and builds its
    pipeline, called in `open` for each device, and again after it was lost.
    """

    live = True
    frame_count = None

    def __init__(
        self,
        settings: OakSettings,
        *,
        build: Build = build_on_device,
        clock_ns: Callable[[], int] = time.monotonic_ns,
        start_within_s: float = START_WITHIN_S,
    ) -> None:
        self._settings = settings
        self._build = build
        self._clock_ns = clock_ns
        self._start_within_s = start_within_s
        self._devices = [_Device(device, name=device.device or "(any)") for device in settings.devices]
        self._inbox: Inbox[Frame] = Inbox(settings.camera_names, frames_ahead=settings.frames_ahead)
        self._notices = Notices(log)
        self._makers = {name: PictureMaker(name, self._notices) for name in settings.camera_names}
        self._stopped = threading.Event()
        self._threads: list[threading.Thread] = []
        self._dai: Any = None

    @property
    def cameras(self) -> tuple[Camera, ...]:
        return tuple(Camera(name, self._settings.fps) for name in self._settings.camera_names)

    @property
    def dropped(self) -> Mapping[str, int]:
        return self._inbox.dropped

    def open(self) -> None:
        """Finds and opens every device; with `wait`, those that are there."""
        self._dai = load(telemetry=self._settings.telemetry)
        try:
            for device in self._devices:
                self._connect_or_wait(device)
        except SyncwatchError:
            self._give_back()
            raise
        log.info("oak: %s", SAYS[self._settings.stamps])

    def frames(self) -> Iterator[Frame]:
        for device in self._devices:
            if not self._stopped.is_set():
                self._threads.append(feed(self._inbox, partial(self._keep, device), f"oak-{device.name}"))
        yield from self._inbox.read()

    def stop(self) -> None:
        self._stopped.set()
        self._inbox.stop()

    def close(self) -> None:
        self.stop()
        for thread in self._threads:
            thread.join(2 * STOP_WITHIN_S)
        self._give_back()
        self._inbox.say_what_was_dropped()

    def _connect_or_wait(self, device: _Device) -> None:
        try:
            self._connect(device)
        except NotThereError as error:
            if not self._settings.wait:
                raise NotThereError(f"{error} (wait: true waits for it)") from error
            log.warning("%s; waiting for it", error)

    def _connect(self, device: _Device) -> None:
        device.built = self._build(self._dai, device.settings, self._settings)
        device.name = device.built.device

    def _keep(self, device: _Device) -> None:
        """The thread of a device: delivers its frames and opens it anew as often as it takes."""
        if device.built is None:
            self._connect_again(device)
        while not self._stopped.is_set():
            reason = self._deliver(device)
            if self._stopped.is_set():
                return
            log.warning("OAK %s: %s; opening it anew", device.name, reason)
            self._wind_up(device)
            device.epoch += 1
            device.sequences.clear()
            self._connect_again(device)

    def _connect_again(self, device: _Device) -> None:
        wait_s = AGAIN_AFTER_S
        while not self._stopped.wait(wait_s):
            try:
                self._connect(device)
            except SyncwatchError as error:
                self._notices.warning(f"OAK {device.name}: {error}; trying on")
                wait_s = min(2 * wait_s, AGAIN_AT_MOST_S)
            else:
                log.info("OAK %s: it is there", device.name)
                return

    def _deliver(self, device: _Device) -> str:
        """Runs the pipeline until it fails or `stop`; what went wrong."""
        assert device.built is not None
        pipeline, outputs = device.built.pipeline, device.built.outputs
        try:
            queues = {
                name: one.createOutputQueue(maxSize=QUEUE_FRAMES, blocking=False) for name, one in outputs.items()
            }
            pipeline.start()
            heard_ns, silence_s = self._clock_ns(), max(self._start_within_s, self._settings.stall_s)
            while not self._stopped.is_set():
                messages = self._dai.MessageQueue.getAny(queues, WAIT)
                arrived_ns = self._clock_ns()
                for camera, message in messages.items():
                    self._take(device, camera, message, arrived_ns)
                if messages:
                    heard_ns, silence_s = arrived_ns, self._settings.stall_s
                elif not pipeline.isRunning() or any(queue.isClosed() for queue in queues.values()):
                    return "its pipeline has ended"
                elif arrived_ns - heard_ns > silence_s * NS_PER_S:
                    return f"no frames for {silence_s:g} s"
        except (RuntimeError, self._dai.MessageQueue.QueueException) as error:
            return " ".join(str(error).split())
        return "stopped"

    def _take(self, device: _Device, camera: str, message: Any, arrived_ns: int) -> None:
        clock = self._settings.stamps
        try:
            said = read_message(message, clock)
            image = self._makers[camera].make(said.image, f"OAK {device.name}")
        except InputError as error:
            self._inbox.end(InputError(f"{camera}: {error}"))
            return
        if said.sequence < device.sequences.get(camera, 0):
            device.restarts[camera] = device.restarts.get(camera, 0) + 1
        device.sequences[camera] = said.sequence
        self._inbox.put(
            Frame(
                camera=camera,
                sequence=said.sequence,
                captured_ns=said.captured_ns,
                clock=clock_name(clock, f"oak-{device.name}"),
                arrived_ns=arrived_ns,
                image=image,
                epoch=device.epoch + device.restarts.get(camera, 0),
                exposure_ns=said.exposure_ns,
                stamp_reference=StampReference.END,
                stamp_origin=StampOrigin.DEVICE,
            )
        )

    def _give_back(self) -> None:
        for device in self._devices:
            self._wind_up(device)

    def _wind_up(self, device: _Device) -> None:
        """Ends the pipeline and closes the device, on a thread that is given up when the device does not answer."""
        built, device.built = device.built, None
        if built is None:
            return

        def end() -> None:
            built.pipeline.stop()
            built.pipeline.wait()
            built.close()

        if not done_within(STOP_WITHIN_S, end, f"oak-end-{device.name}"):
            log.warning("OAK %s: its pipeline did not end within %.0f s", device.name, STOP_WITHIN_S)
