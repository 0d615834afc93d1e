"""One open camera: asked for size, format, rate and controls, then streaming into mapped buffers."""

from __future__ import annotations

import errno
from contextlib import suppress
from ctypes import Structure, c_int32
from dataclasses import dataclass
from fractions import Fraction
from pathlib import Path

import numpy as np

from pipeline.errors import InputError
from pipeline.frame import Picture
from sources.v4l2 import abi
from sources.v4l2.controls import exposure_ns, set_controls
from sources.v4l2.device import ERROR, Device, Host, Memory, TroubleError, explained
from sources.v4l2.formats import BY_CODE, FORMATS, Layout, PixelFormat
from sources.v4l2.nodes import format_codes
from sources.v4l2.settings import V4l2CameraSettings
from sources.v4l2.stamps import Stamp, StampReader

ALIKE = 0.005
"""Relative difference of frame rates that is rounding."""


@dataclass(frozen=True, slots=True)
class Shot:
    """What the driver delivered. damage: why there is no picture, in words."""

    sequence: int
    stamp: Stamp
    arrived_ns: int
    picture: Picture | None
    damage: str | None = None


class Capture:
    """Opens and sets up a camera.

    changes: what the driver changed of what was asked. fps: its frame rate in Hz as it states it. exposure_ns: how long
    it exposes. Both are None where it does not say.
    Raises InputError for what this camera cannot do, TroubleError where it fails or is not free.
    """

    def __init__(self, camera: str, settings: V4l2CameraSettings, path: Path, host: Host) -> None:
        self.changes: list[str] = []
        self.fps: float | None = None
        self.exposure_ns: int | None = None
        self._host = host
        self._reader = StampReader(camera, host)
        self._memory: list[Memory] = []
        self._lent: int | None = None
        try:
            self._device: Device = host.open(path)
        except OSError as error:
            raise explained("opening it", error) from error
        try:
            self._format, self._layout = self._set_format(settings)
            self.fps = self._set_rate(settings.fps)
            self.changes += set_controls(self._device, settings.controls)
            self.exposure_ns = exposure_ns(self._device)
            self._map(settings.buffers)
        except BaseException:
            self.close()
            raise

    def start(self) -> None:
        """Starts streaming. Raises TroubleError."""
        for index in range(len(self._memory)):
            self._queue(index)
        try:
            self._device.ioctl(abi.STREAMON, c_int32(abi.VIDEO_CAPTURE))
        except OSError as error:
            raise explained("starting it", error) from error

    def read(self, timeout_s: float) -> Shot | None:
        """The next picture; None when none came in time. Raises TroubleError when the camera fails."""
        if self._lent is not None:
            index, self._lent = self._lent, None
            self._queue(index)
        try:
            events = self._device.poll(timeout_s)
        except OSError as error:
            raise explained("waiting for it", error) from error
        if not events:
            return None
        buffer = self._buffer()
        try:
            self._device.ioctl(abi.DQBUF, buffer)
        except OSError as error:
            if error.errno != errno.EAGAIN:
                raise explained("reading from it", error) from error
            if events & ERROR:
                raise TroubleError("it stopped with an error") from error
            return None
        arrived_ns = self._host.monotonic_ns()
        self._lent = int(buffer.index)
        picture, damage = self._picture(buffer)
        return Shot(self._reader.sequence(buffer), self._reader.stamp(buffer), arrived_ns, picture, damage)

    def close(self) -> None:
        """Stops streaming and gives everything back; whatever fails by now does not matter any more."""
        steps = [*(memory.close for memory in self._memory), self._device.close]
        self._memory = []
        with suppress(OSError):
            self._device.ioctl(abi.STREAMOFF, c_int32(abi.VIDEO_CAPTURE))
        for step in steps:
            with suppress(OSError):
                step()

    def _picture(self, buffer: abi.Buffer) -> tuple[Picture | None, str | None]:
        if buffer.flags & abi.FLAG_ERROR:
            return None, "the driver marked it as damaged"
        used = min(buffer.bytesused or buffer.length, buffer.length)
        data = np.frombuffer(self._memory[buffer.index], np.uint8, used)
        try:
            return self._format.decode(data, self._layout), None
        except TroubleError as error:
            return None, str(error)

    def _set_format(self, settings: V4l2CameraSettings) -> tuple[PixelFormat, Layout]:
        asked = abi.Format(type=abi.VIDEO_CAPTURE)
        self._call("asking for its format", abi.G_FMT, asked)
        wanted = self._wanted(settings, int(asked.pix.pixelformat))
        width, height = settings.size or (int(asked.pix.width), int(asked.pix.height))
        asked.pix.width, asked.pix.height, asked.pix.pixelformat = width, height, wanted.code
        asked.pix.field, asked.pix.bytesperline, asked.pix.sizeimage = abi.FIELD_NONE, 0, 0
        self._call(f"setting it to {width}x{height} {wanted.name}", abi.S_FMT, asked)
        given = BY_CODE.get(int(asked.pix.pixelformat))
        if given is None:
            raise InputError(
                f"format: {wanted.name} became {abi.fourcc_text(asked.pix.pixelformat)}, which is not read here: "
                f"take one of {self._offered()}"
            )
        layout = Layout(int(asked.pix.width), int(asked.pix.height), int(asked.pix.bytesperline))
        if given is not wanted:
            self.changes.append(f"asked for {wanted.name}, the driver gives {given.name} (it has {self._offered()})")
        if (layout.width, layout.height) != (width, height):
            self.changes.append(f"asked for {width}x{height}, the driver gives {layout.width}x{layout.height}")
        if asked.pix.field not in {abi.FIELD_NONE, abi.FIELD_ANY}:
            self.changes.append("its pictures are interlaced: two moments in one picture")
        return given, layout

    def _wanted(self, settings: V4l2CameraSettings, current: int) -> PixelFormat:
        """What is configured, else what the camera is set to, else the first that can be read."""
        if settings.format is not None:
            return FORMATS[settings.format]
        if current in BY_CODE:
            return BY_CODE[current]
        offered = set(format_codes(self._device))
        for each in FORMATS.values():
            if each.code in offered:
                return each
        raise InputError(f"format: none of its formats is read here: it has {self._offered()}")

    def _offered(self) -> str:
        codes = format_codes(self._device)
        return ", ".join(BY_CODE[code].name if code in BY_CODE else abi.fourcc_text(code) for code in codes)

    def _set_rate(self, fps: float | None) -> float | None:
        parameters = abi.StreamParameters(type=abi.VIDEO_CAPTURE)
        try:
            self._device.ioctl(abi.G_PARM, parameters)
            if fps is not None and parameters.capability & abi.CAP_TIMEPERFRAME:
                period = (1 / Fraction(fps).limit_denominator(1001)).limit_denominator(1_000_000)
                parameters.timeperframe.numerator = period.numerator
                parameters.timeperframe.denominator = period.denominator
                self._device.ioctl(abi.S_PARM, parameters)
        except OSError as error:
            if error.errno not in {errno.ENOTTY, errno.EINVAL}:
                raise explained("setting its frame rate", error) from error
            parameters.timeperframe.numerator = 0  # it knows nothing of frame rates
        period = parameters.timeperframe
        given = period.denominator / period.numerator if period.numerator and period.denominator else None
        if fps is not None and given is None:
            self.changes.append(f"asked for {fps:g} fps, but the driver lets nobody set the rate")
        elif fps is not None and given is not None and abs(given / fps - 1) > ALIKE:
            self.changes.append(f"asked for {fps:g} fps, the driver gives {given:g}")
        return given

    def _map(self, count: int) -> None:
        granted = abi.RequestBuffers(count=count, type=abi.VIDEO_CAPTURE, memory=abi.MEMORY_MMAP)
        self._call("asking for buffers", abi.REQBUFS, granted)
        if granted.count != count:
            self.changes.append(f"asked for {count} buffers, the driver gives {granted.count}")
        for index in range(granted.count):
            buffer = self._buffer(index)
            self._call("asking for a buffer", abi.QUERYBUF, buffer)
            try:
                self._memory.append(self._device.map(int(buffer.length), int(buffer.offset)))
            except OSError as error:
                raise explained("mapping a buffer", error) from error

    def _queue(self, index: int) -> None:
        self._call("giving a buffer back", abi.QBUF, self._buffer(index))

    def _buffer(self, index: int = 0) -> abi.Buffer:
        return abi.Buffer(index=index, type=abi.VIDEO_CAPTURE, memory=abi.MEMORY_MMAP)

    def _call(self, what: str, request: int, argument: Structure) -> None:
        try:
            self._device.ioctl(request, argument)
        except OSError as error:
            raise explained(what, error) from error
