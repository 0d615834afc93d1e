"""The kernel's V4L2 interface as far as cameras need it: structures, requests and flags, for 64-bit machines.

Source: the kernel's documentation of its user space API ("Part I - Video for Linux API"), which is kept stable.
"""

from __future__ import annotations

import ctypes
from ctypes import Structure, Union, c_char, c_int32, c_int64, c_long, c_uint8, c_uint32, c_uint64
from typing import Final

MAGIC: Final = ord("V")
WRITE, READ, READ_WRITE = 1, 2, 3


def request(direction: int, number: int, argument: type[Structure] | type[c_int32]) -> int:
    """The number of an ioctl, as x86-64 and AArch64 encode it."""
    return direction << 30 | ctypes.sizeof(argument) << 16 | MAGIC << 8 | number


class Capability(Structure):
    """v4l2_capability."""

    _fields_ = (
        ("driver", c_char * 16),
        ("card", c_char * 32),
        ("bus_info", c_char * 32),
        ("version", c_uint32),
        ("capabilities", c_uint32),
        ("device_caps", c_uint32),
        ("reserved", c_uint32 * 3),
    )


class FormatDescription(Structure):
    """v4l2_fmtdesc."""

    _fields_ = (
        ("index", c_uint32),
        ("type", c_uint32),
        ("flags", c_uint32),
        ("description", c_char * 32),
        ("pixelformat", c_uint32),
        ("mbus_code", c_uint32),
        ("reserved", c_uint32 * 3),
    )


class PixelLayout(Structure):
    """v4l2_pix_format. bytesperline: distance of rows."""

    _fields_ = (
        ("width", c_uint32),
        ("height", c_uint32),
        ("pixelformat", c_uint32),
        ("field", c_uint32),
        ("bytesperline", c_uint32),
        ("sizeimage", c_uint32),
        ("colorspace", c_uint32),
        ("priv", c_uint32),
        ("flags", c_uint32),
        ("ycbcr_enc", c_uint32),
        ("quantization", c_uint32),
        ("xfer_func", c_uint32),
    )


class _AnyFormat(Union):
    _fields_ = (("pix", PixelLayout), ("raw", c_uint8 * 200), ("aligned", c_uint64))


class Format(Structure):
    """v4l2_format."""

    _anonymous_ = ("fmt",)
    _fields_ = (("type", c_uint32), ("fmt", _AnyFormat))


class Fraction(Structure):
    """v4l2_fract."""

    _fields_ = (("numerator", c_uint32), ("denominator", c_uint32))


class StreamParameters(Structure):
    """v4l2_streamparm of a capture device."""

    _fields_ = (
        ("type", c_uint32),
        ("capability", c_uint32),
        ("capturemode", c_uint32),
        ("timeperframe", Fraction),
        ("extendedmode", c_uint32),
        ("readbuffers", c_uint32),
        ("reserved", c_uint32 * 44),
    )


class RequestBuffers(Structure):
    """v4l2_requestbuffers."""

    _fields_ = (
        ("count", c_uint32),
        ("type", c_uint32),
        ("memory", c_uint32),
        ("capabilities", c_uint32),
        ("flags", c_uint8),
        ("reserved", c_uint8 * 3),
    )


class TimeValue(Structure):
    """timeval."""

    _fields_ = (("seconds", c_long), ("microseconds", c_long))


class _Memory(Union):
    _fields_ = (("offset", c_uint32), ("pointer", c_uint64))


class Buffer(Structure):
    """v4l2_buffer."""

    _anonymous_ = ("m",)
    _fields_ = (
        ("index", c_uint32),
        ("type", c_uint32),
        ("bytesused", c_uint32),
        ("flags", c_uint32),
        ("field", c_uint32),
        ("timestamp", TimeValue),
        ("timecode", c_uint32 * 4),
        ("sequence", c_uint32),
        ("memory", c_uint32),
        ("m", _Memory),
        ("length", c_uint32),
        ("reserved", c_uint32 * 2),
    )


class ControlDescription(Structure):
    """v4l2_queryctrl."""

    _fields_ = (
        ("id", c_uint32),
        ("type", c_uint32),
        ("name", c_char * 32),
        ("minimum", c_int32),
        ("maximum", c_int32),
        ("step", c_int32),
        ("default", c_int32),
        ("flags", c_uint32),
        ("reserved", c_uint32 * 2),
    )


class _MenuValue(Union):
    _pack_ = 1
    _fields_ = (("name", c_char * 32), ("value", c_int64))


class MenuItem(Structure):
    """v4l2_querymenu."""

    _pack_ = 1
    _anonymous_ = ("item",)
    _fields_ = (("id", c_uint32), ("index", c_uint32), ("item", _MenuValue), ("reserved", c_uint32))


class Control(Structure):
    """v4l2_control."""

    _fields_ = (("id", c_uint32), ("value", c_int32))


class FrameSize(Structure):
    """v4l2_frmsizeenum; a discrete size is in `least_width` and `most_width`."""

    _fields_ = (
        ("index", c_uint32),
        ("pixel_format", c_uint32),
        ("type", c_uint32),
        ("least_width", c_uint32),
        ("most_width", c_uint32),
        ("step_width", c_uint32),
        ("least_height", c_uint32),
        ("most_height", c_uint32),
        ("step_height", c_uint32),
        ("reserved", c_uint32 * 2),
    )

    @property
    def least(self) -> tuple[int, int]:
        """The smallest width and height."""
        if self.type == FRAME_DISCRETE:
            return self.least_width, self.most_width
        return self.least_width, self.least_height

    @property
    def most(self) -> tuple[int, int]:
        """The largest width and height."""
        if self.type == FRAME_DISCRETE:
            return self.least
        return self.most_width, self.most_height


class FrameInterval(Structure):
    """v4l2_frmivalenum; a discrete interval is in `least`."""

    _fields_ = (
        ("index", c_uint32),
        ("pixel_format", c_uint32),
        ("width", c_uint32),
        ("height", c_uint32),
        ("type", c_uint32),
        ("least", Fraction),
        ("most", Fraction),
        ("step", Fraction),
        ("reserved", c_uint32 * 2),
    )


QUERYCAP: Final = request(READ, 0, Capability)
ENUM_FMT: Final = request(READ_WRITE, 2, FormatDescription)
G_FMT: Final = request(READ_WRITE, 4, Format)
S_FMT: Final = request(READ_WRITE, 5, Format)
REQBUFS: Final = request(READ_WRITE, 8, RequestBuffers)
QUERYBUF: Final = request(READ_WRITE, 9, Buffer)
QBUF: Final = request(READ_WRITE, 15, Buffer)
DQBUF: Final = request(READ_WRITE, 17, Buffer)
STREAMON: Final = request(WRITE, 18, c_int32)
STREAMOFF: Final = request(WRITE, 19, c_int32)
G_PARM: Final = request(READ_WRITE, 21, StreamParameters)
S_PARM: Final = request(READ_WRITE, 22, StreamParameters)
G_CTRL: Final = request(READ_WRITE, 27, Control)
S_CTRL: Final = request(READ_WRITE, 28, Control)
QUERYCTRL: Final = request(READ_WRITE, 36, ControlDescription)
QUERYMENU: Final = request(READ_WRITE, 37, MenuItem)
ENUM_FRAMESIZES: Final = request(READ_WRITE, 74, FrameSize)
ENUM_FRAMEINTERVALS: Final = request(READ_WRITE, 75, FrameInterval)

VIDEO_CAPTURE: Final = 1
"""The type of the buffers of a camera."""

MEMORY_MMAP: Final = 1
FIELD_ANY, FIELD_NONE = 0, 1

CAP_VIDEO_CAPTURE: Final = 0x1
CAP_VIDEO_CAPTURE_MPLANE: Final = 0x1000
CAP_STREAMING: Final = 0x4000000
CAP_DEVICE_CAPS: Final = 0x80000000
CAP_TIMEPERFRAME: Final = 0x1000

FLAG_ERROR: Final = 0x40
FLAG_TIMESTAMP_MASK, FLAG_TIMESTAMP_MONOTONIC = 0xE000, 0x2000
FLAG_SOURCE_MASK, FLAG_SOURCE_START = 0x70000, 0x10000

CTRL_NEXT: Final = 0x80000000
CTRL_DISABLED, CTRL_READ_ONLY, CTRL_INACTIVE = 0x1, 0x4, 0x10
CTRL_INTEGER, CTRL_BOOLEAN, CTRL_MENU, CTRL_BUTTON, CTRL_BITMASK, CTRL_INTEGER_MENU = 1, 2, 3, 4, 8, 9

CTRL_ID_EXPOSURE_AUTO, CTRL_ID_EXPOSURE_ABSOLUTE = 0x009A0901, 0x009A0902
EXPOSURE_MANUAL, EXPOSURE_SHUTTER_PRIORITY = 1, 2
EXPOSURE_UNIT_NS: Final = 100_000

FRAME_DISCRETE: Final = 1


def fourcc(text: str) -> int:
    """The number of a pixel format's four characters."""
    return int.from_bytes(text.encode("ascii"), "little")


def fourcc_text(number: int) -> str:
    """The characters of a pixel format, without padding; formats of big-endian order end in -BE."""
    text = (number & 0x7FFFFFFF).to_bytes(4, "little").decode("ascii", "replace").rstrip()
    return f"{text}-BE" if number >> 31 else text
