"""What pixel formats are read, and how their grey picture is taken out of a buffer."""

from __future__ import annotations

import sys
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial
from typing import Any, TypeAlias

import cv2
import numpy as np
import numpy.typing as npt

from pipeline.frame import Picture
from sources.v4l2.abi import fourcc
from sources.v4l2.device import TroubleError

JPEG_START, JPEG_END = b"\xff\xd8", b"\xff\xd9"

Bytes: TypeAlias = npt.NDArray[np.uint8]


@dataclass(frozen=True, slots=True)
class Layout:
    """Size in pixels, and the distance of rows in bytes."""

    width: int
    height: int
    stride: int


Decode: TypeAlias = Callable[[Bytes, Layout], Picture]
"""The grey picture, H x W, in memory of its own. Raises TroubleError for a buffer that does not hold a whole one."""


@dataclass(frozen=True, slots=True)
class PixelFormat:
    """name: as in the configuration. code: as the kernel names it."""

    name: str
    code: int
    decode: Decode


def _rows(data: Bytes, layout: Layout, row_bytes: int) -> Bytes:
    """The first plane of a buffer, H x stride, without what pads its rows."""
    needed = layout.stride * (layout.height - 1) + row_bytes
    if data.size < needed:
        raise TroubleError(f"a picture of {data.size} bytes is {needed - data.size} bytes short")
    return np.lib.stride_tricks.as_strided(data, (layout.height, row_bytes), (layout.stride, 1))


def _luma(data: Bytes, layout: Layout, *, first: int = 0, step: int = 1) -> Picture:
    """Every `step`th byte of a row from `first` on: the grey of a packed or planar format."""
    return _rows(data, layout, layout.width * step)[:, first::step].copy()


def _deep(data: Bytes, layout: Layout, *, bits: int) -> Picture:
    """The upper eight bits of samples in two bytes each."""
    samples = _rows(data, layout, layout.width * 2).copy().view("<u2")
    return (samples >> (bits - 8)).astype(np.uint8)


def _colour(data: Bytes, layout: Layout, *, conversion: int) -> Picture:
    rows = _rows(data, layout, layout.width * 3).reshape(layout.height, layout.width, 3)
    return _converted(rows, conversion)


def _mosaic(data: Bytes, layout: Layout, *, conversion: int, bits: int) -> Picture:
    """The grey of a colour filter array, interpolated to full size."""
    raw = _luma(data, layout) if bits == 8 else _deep(data, layout, bits=bits)
    return _converted(raw, conversion)


def _converted(raw: npt.NDArray[Any], conversion: int) -> Picture:
    return np.asarray(cv2.cvtColor(np.ascontiguousarray(raw), conversion), np.uint8)


def _jpeg(data: Bytes, layout: Layout) -> Picture:
    coded = data.tobytes()
    if not coded.startswith(JPEG_START) or coded.rfind(JPEG_END) < 0:
        raise TroubleError(f"a JPEG of {len(coded)} bytes is cut off")
    try:
        picture = cv2.imdecode(data, cv2.IMREAD_GRAYSCALE)
    except cv2.error:  # more pixels than OpenCV is willing to read
        picture = None
    if picture is None:
        raise TroubleError("a JPEG cannot be decoded")
    if picture.shape != (layout.height, layout.width):
        height, width = picture.shape
        raise TroubleError(f"a JPEG is {width}x{height} and not {layout.width}x{layout.height}")
    return np.asarray(picture, np.uint8)


def _mosaics() -> list[PixelFormat]:
    """Bayer formats by order of the first two rows and depth; deeper ones than 8 bits are in two bytes each."""
    conversions = {
        "RGGB": cv2.COLOR_BayerRGGB2GRAY,
        "GRBG": cv2.COLOR_BayerGRBG2GRAY,
        "GBRG": cv2.COLOR_BayerGBRG2GRAY,
        "BGGR": cv2.COLOR_BayerBGGR2GRAY,
    }
    codes = {
        8: {"RGGB": "RGGB", "GRBG": "GRBG", "GBRG": "GBRG", "BGGR": "BA81"},
        10: {"RGGB": "RG10", "GRBG": "BA10", "GBRG": "GB10", "BGGR": "BG10"},
        12: {"RGGB": "RG12", "GRBG": "BA12", "GBRG": "GB12", "BGGR": "BG12"},
        16: {"RGGB": "RG16", "GRBG": "GR16", "GBRG": "GB16", "BGGR": "BYR2"},
    }
    return [
        PixelFormat(f"S{order}{bits}", fourcc(code), partial(_mosaic, conversion=conversions[order], bits=bits))
        for bits, orders in codes.items()
        for order, code in orders.items()
    ]


_ALL = (
    PixelFormat("GREY", fourcc("GREY"), _luma),
    PixelFormat("YUYV", fourcc("YUYV"), partial(_luma, step=2)),
    PixelFormat("UYVY", fourcc("UYVY"), partial(_luma, first=1, step=2)),
    PixelFormat("NV12", fourcc("NV12"), _luma),
    PixelFormat("NV21", fourcc("NV21"), _luma),
    PixelFormat("YU12", fourcc("YU12"), _luma),
    PixelFormat("YV12", fourcc("YV12"), _luma),
    PixelFormat("Y16", fourcc("Y16 "), partial(_luma, first=1, step=2)),
    PixelFormat("Y12", fourcc("Y12 "), partial(_deep, bits=12)),
    PixelFormat("Y10", fourcc("Y10 "), partial(_deep, bits=10)),
    *_mosaics(),
    PixelFormat("BGR3", fourcc("BGR3"), partial(_colour, conversion=cv2.COLOR_BGR2GRAY)),
    PixelFormat("RGB3", fourcc("RGB3"), partial(_colour, conversion=cv2.COLOR_RGB2GRAY)),
    PixelFormat("MJPEG", fourcc("MJPG"), _jpeg),
    PixelFormat("JPEG", fourcc("JPEG"), _jpeg),
)

FORMATS: Mapping[str, PixelFormat] = {one.name: one for one in _ALL}
"""By name, those first that cost least."""

BY_CODE: Mapping[int, PixelFormat] = {one.code: one for one in _ALL}

assert sys.byteorder == "little", "the samples of deep formats are read in the order of little-endian machines"
