"""A scripted stand-in for the kernel: cameras that answer as V4L2 drivers do, and fail when they are told to."""

from __future__ import annotations

import errno
import os
import threading
from collections import defaultdict, deque
from collections.abc import Callable, Iterable
from ctypes import Structure, c_int32
from dataclasses import dataclass, field
from pathlib import Path

from pipeline.frame import NS_PER_S
from sources.v4l2 import abi
from sources.v4l2.camera import LiveCamera
from sources.v4l2.device import ERROR, READABLE, Host
from sources.v4l2.settings import V4l2CameraSettings

MONOTONIC = abi.FLAG_TIMESTAMP_MONOTONIC
WIDTH, HEIGHT = 32, 16


def failure(number: int) -> OSError:
    return OSError(number, os.strerror(number))


@dataclass
class Shot:
    """A picture of one grey level; stamps follow the camera's rate from where the machine's clock is."""

    sequence: int | None = None
    flags: int = MONOTONIC
    level: int = 128
    bytesused: int | None = None
    captured_ns: int | None = None


@dataclass
class Silence:
    """Nothing comes for so long."""

    seconds: float


POLL_ERROR = object()
"""The driver reports an error without saying which."""

UNPLUG = object()
"""The camera goes away, and every open handle with it."""


@dataclass
class ControlSpec:
    id: int
    title: str
    type: int = abi.CTRL_INTEGER
    minimum: int = 0
    maximum: int = 100
    value: int = 0
    flags: int = 0
    menu: tuple[str, ...] = ()


class FakeCamera:
    """One camera. `steps` are what it does while it streams, over all its openings; `fail` gives errors by ioctl."""

    def __init__(
        self,
        steps: Iterable[object] = (),
        *,
        card: str = "Fake Camera",
        bus: str = "usb-1",
        formats: tuple[str, ...] = ("YUYV", "GREY"),
        sizes: tuple[tuple[int, int], ...] = ((WIDTH, HEIGHT),),
        fps: float | None = 10,
        controls: tuple[ControlSpec, ...] = (),
        most_buffers: int = 32,
        capabilities: int = abi.CAP_VIDEO_CAPTURE | abi.CAP_STREAMING,
    ) -> None:
        self.steps = deque(steps)
        self.card, self.bus = card, bus
        self.codes = [abi.fourcc(text.ljust(4)) for text in formats]
        self.sizes = sizes
        self.fps = fps
        self.controls = {spec.id: spec for spec in controls}
        self.most_buffers = most_buffers
        self.capabilities = capabilities
        self.fail: dict[int, deque[OSError | None]] = defaultdict(deque)
        self.handles: list[FakeHandle] = []
        self.sequence = 0
        self.set_to: list[tuple[int, int]] = []

    @property
    def is_open(self) -> bool:
        return any(not handle.closed for handle in self.handles)


@dataclass
class Machine:
    """Cameras by the names of their nodes, one clock that waiting moves on, and what happens when a script is over."""

    folder: Path
    now_ns: int = 1000 * NS_PER_S
    on_end: Callable[[], None] = lambda: None
    cameras: dict[str, FakeCamera] = field(default_factory=dict)
    waits: list[float] = field(default_factory=list)
    stopped: threading.Event = field(default_factory=threading.Event)

    def __post_init__(self) -> None:
        (self.folder / "dev/v4l/by-id").mkdir(parents=True, exist_ok=True)
        (self.folder / "dev/v4l/by-path").mkdir(parents=True, exist_ok=True)
        (self.folder / "sys/class/video4linux").mkdir(parents=True, exist_ok=True)

    def plug(self, name: str, camera: FakeCamera, *, serial: str | None = None, by_id: str | None = None) -> FakeCamera:
        self.cameras[name] = camera
        (self.dev / name).touch()
        place = self.folder / "sys/class/video4linux" / name
        place.mkdir(exist_ok=True)
        device = self.folder / f"sys/{camera.bus}/1-1:1.0"
        device.mkdir(parents=True, exist_ok=True)
        (place / "device").unlink(missing_ok=True)
        (place / "device").symlink_to(device)
        (place / "index").write_text("0\n")
        if serial is not None:
            (device.parent / "serial").write_text(f"{serial}\n")
        if by_id is not None:
            link = self.dev / "v4l/by-id" / by_id
            link.unlink(missing_ok=True)
            link.symlink_to(self.dev / name)
        return camera

    def unplug(self, name: str) -> FakeCamera:
        (self.dev / name).unlink()
        return self.cameras.pop(name)

    @property
    def dev(self) -> Path:
        return self.folder / "dev"

    @property
    def host(self) -> Host:
        return Host(
            dev=self.dev,
            sys=self.folder / "sys",
            open=self.open,
            monotonic_ns=lambda: self.now_ns,
            realtime_ns=lambda: self.now_ns + 10**18,
        )

    def open(self, path: Path) -> FakeHandle:
        camera = self.cameras.get(path.name)
        if camera is None:
            raise failure(errno.ENOENT)
        if camera.fail[-1]:
            error = camera.fail[-1].popleft()
            if error is not None:
                raise error
        handle = FakeHandle(self, camera)
        camera.handles.append(handle)
        return handle

    def wait(self, seconds: float) -> bool:
        self.waits.append(seconds)
        self.now_ns += round(seconds * NS_PER_S)
        return self.stopped.is_set()

    def run(self, **settings: object) -> tuple[list, LiveCamera]:
        """Runs the camera `left` in this thread until its script is over; the frames it delivered."""
        frames: list = []
        silent_after_s = settings.pop("silent_after_s", 2.0)
        asked = {"device": str(self.dev / "video0"), **settings}
        camera = LiveCamera(
            "left",
            V4l2CameraSettings.model_validate(asked),
            host=self.host,
            silent_after_s=silent_after_s,
            put=frames.append,
            stopped=self.stopped,
            wait=self.wait,
        )
        self.on_end = self.stopped.set
        camera.open(camera.find())
        camera.run()
        return frames, camera


class FakeMemory(bytearray):
    def close(self) -> None:
        pass


class FakeHandle:
    """Implements Device; as strict as the kernel about the order of calls."""

    def __init__(self, machine: Machine, camera: FakeCamera) -> None:
        self._machine = machine
        self._camera = camera
        self._pix = abi.PixelLayout(
            width=camera.sizes[0][0], height=camera.sizes[0][1], pixelformat=camera.codes[0], bytesperline=1
        )
        self._memory: list[FakeMemory] = []
        self._queued: deque[int] = deque()
        self._streaming = False
        self._gone = False
        self.closed = False

    def ioctl(self, request: int, argument: Structure | c_int32) -> None:
        assert not self.closed, "used after it was closed"
        if self._gone:
            raise failure(errno.ENODEV)
        if self._camera.fail[request]:
            error = self._camera.fail[request].popleft()
            if error is not None:
                raise error
        answers = {
            abi.QUERYCAP: self._capabilities,
            abi.ENUM_FMT: self._enumerate_formats,
            abi.G_FMT: self._get_format,
            abi.S_FMT: self._set_format,
            abi.G_PARM: self._get_rate,
            abi.S_PARM: self._set_rate,
            abi.REQBUFS: self._request_buffers,
            abi.QUERYBUF: self._query_buffer,
            abi.QBUF: self._queue,
            abi.DQBUF: self._dequeue,
            abi.STREAMON: self._start,
            abi.STREAMOFF: self._stop,
            abi.QUERYCTRL: self._query_control,
            abi.QUERYMENU: self._query_menu,
            abi.G_CTRL: self._get_control,
            abi.S_CTRL: self._set_control,
            abi.ENUM_FRAMESIZES: self._enumerate_sizes,
            abi.ENUM_FRAMEINTERVALS: self._enumerate_rates,
        }
        answers[request](argument)

    def map(self, length: int, offset: int) -> FakeMemory:
        return self._memory[offset // 4096]

    def poll(self, timeout_s: float) -> int:
        assert self._streaming
        steps = self._camera.steps
        while steps and callable(steps[0]):
            steps.popleft()()
        if not steps:
            self._machine.on_end()
        if steps and isinstance(steps[0], Silence):
            steps[0].seconds -= timeout_s
            if steps[0].seconds <= 1e-9:
                steps.popleft()
            self._machine.now_ns += round(timeout_s * NS_PER_S)
            return 0
        if not steps:
            self._machine.stopped.wait(0.002)
            return 0
        if steps[0] is UNPLUG:
            steps.popleft()
            self._gone = True
            return ERROR
        return ERROR if steps[0] is POLL_ERROR else READABLE

    def close(self) -> None:
        assert not self.closed
        self.closed = True

    def _capabilities(self, asked: abi.Capability) -> None:
        asked.card, asked.bus_info = self._camera.card.encode(), self._camera.bus.encode()
        asked.capabilities = abi.CAP_DEVICE_CAPS | abi.CAP_VIDEO_CAPTURE | abi.CAP_STREAMING
        asked.device_caps = self._camera.capabilities

    def _enumerate_formats(self, asked: abi.FormatDescription) -> None:
        asked.pixelformat = nth(self._camera.codes, asked.index)

    def _enumerate_sizes(self, asked: abi.FrameSize) -> None:
        asked.type = abi.FRAME_DISCRETE
        asked.least_width, asked.most_width = nth(self._camera.sizes, asked.index)

    def _enumerate_rates(self, asked: abi.FrameInterval) -> None:
        fps = nth([self._camera.fps] if self._camera.fps else [], asked.index)
        asked.type, asked.least.numerator, asked.least.denominator = abi.FRAME_DISCRETE, 1, int(fps)

    def _get_format(self, asked: abi.Format) -> None:
        asked.pix = self._pix

    def _set_format(self, asked: abi.Format) -> None:
        size = (asked.pix.width, asked.pix.height)
        asked.pix.width, asked.pix.height = size if size in self._camera.sizes else self._camera.sizes[0]
        if asked.pix.pixelformat not in self._camera.codes:
            asked.pix.pixelformat = self._camera.codes[0]
        asked.pix.bytesperline = asked.pix.width * (2 if asked.pix.pixelformat == abi.fourcc("YUYV") else 1)
        asked.pix.sizeimage = asked.pix.bytesperline * asked.pix.height
        self._pix = abi.PixelLayout.from_buffer_copy(asked.pix)

    def _get_rate(self, asked: abi.StreamParameters) -> None:
        if self._camera.fps is None:
            raise failure(errno.ENOTTY)
        asked.capability = abi.CAP_TIMEPERFRAME
        asked.timeperframe.numerator, asked.timeperframe.denominator = 1, int(self._camera.fps)

    def _set_rate(self, asked: abi.StreamParameters) -> None:
        self._get_rate(asked)

    def _request_buffers(self, asked: abi.RequestBuffers) -> None:
        asked.count = min(asked.count, self._camera.most_buffers)
        self._memory = [FakeMemory(self._pix.sizeimage) for _ in range(asked.count)]

    def _query_buffer(self, asked: abi.Buffer) -> None:
        asked.offset, asked.length = asked.index * 4096, self._pix.sizeimage

    def _queue(self, given: abi.Buffer) -> None:
        assert given.index not in self._queued
        self._queued.append(given.index)

    def _dequeue(self, asked: abi.Buffer) -> None:
        step = self._camera.steps[0] if self._camera.steps else None
        if step is None or step is POLL_ERROR:
            if step is POLL_ERROR:
                self._camera.steps.popleft()
            raise failure(errno.EAGAIN)
        self._camera.steps.popleft()
        if isinstance(step, Exception):
            raise step
        assert isinstance(step, Shot)
        self._machine.now_ns += round(NS_PER_S / (self._camera.fps or 10))
        asked.index = self._queued.popleft()
        memory = self._memory[asked.index]
        memory[:] = bytes([step.level]) * len(memory)
        asked.length, asked.bytesused = len(memory), len(memory) if step.bytesused is None else step.bytesused
        asked.flags = step.flags
        asked.sequence = self._camera.sequence if step.sequence is None else step.sequence
        self._camera.sequence = (asked.sequence + 1) % (1 << 32)
        captured_ns = self._machine.now_ns if step.captured_ns is None else step.captured_ns
        asked.timestamp.seconds = captured_ns // NS_PER_S
        asked.timestamp.microseconds = captured_ns % NS_PER_S // 1000

    def _start(self, _: c_int32) -> None:
        self._streaming = True
        self._camera.sequence = 0

    def _stop(self, _: c_int32) -> None:
        self._streaming = False
        self._queued.clear()

    def _query_control(self, asked: abi.ControlDescription) -> None:
        wanted = asked.id & ~abi.CTRL_NEXT
        later = sorted(number for number in self._camera.controls if number > wanted)
        spec = self._camera.controls[nth(later, 0)]
        asked.id, asked.name, asked.type, asked.flags = spec.id, spec.title.encode(), spec.type, spec.flags
        asked.minimum, asked.maximum = spec.minimum, spec.maximum

    def _query_menu(self, asked: abi.MenuItem) -> None:
        word = nth(self._camera.controls[asked.id].menu, asked.index)
        if not word:
            raise failure(errno.EINVAL)
        asked.name = word.encode()

    def _get_control(self, asked: abi.Control) -> None:
        if asked.id not in self._camera.controls:
            raise failure(errno.EINVAL)
        asked.value = self._camera.controls[asked.id].value

    def _set_control(self, given: abi.Control) -> None:
        self._camera.set_to.append((given.id, given.value))
        self._camera.controls[given.id].value = min(given.value, 90)


def nth(values, index):
    """Drivers end their lists by refusing to say more."""
    if index >= len(values):
        raise failure(errno.EINVAL)
    return values[index]
