"""Turns the bytes of ROS image messages (sensor_msgs/Image and CompressedImage) into pictures."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, TypeAlias

import cv2
import numpy as np
import numpy.typing as npt

from pipeline.errors import InputError
from sources.replay.pictures import damage, quiet

Raw: TypeAlias = npt.NDArray[Any]
"""H x W (grey) or H x W x 3 (blue, green, red), uint8 or uint16 in the byte order of the machine."""

BAYER_TO_GREY = {
    "rggb": cv2.COLOR_BayerBG2GRAY,
    "bggr": cv2.COLOR_BayerRG2GRAY,
    "gbrg": cv2.COLOR_BayerGR2GRAY,
    "grbg": cv2.COLOR_BayerGB2GRAY,
}
"""By the colours of the first two rows, as ROS names them; OpenCV names a pattern by its second row and column."""


def _as_it_is(raw: Raw) -> Raw:
    return raw


def _to_bgr(code: int) -> Callable[[Raw], Raw]:
    return lambda raw: cv2.cvtColor(raw, code)


def _brightness(index: int) -> Callable[[Raw], Raw]:
    return lambda raw: raw[:, :, index]


@dataclass(frozen=True, slots=True)
class _Layout:
    """How pixels lie in the rows of a message: values a pixel, bytes a value, and what makes a picture of them."""

    channels: int
    depth: int
    convert: Callable[[Raw], Raw] = _as_it_is


def _layouts() -> dict[str, _Layout]:
    made: dict[str, _Layout] = {}
    for depth in (1, 2):
        bits = 8 * depth
        made |= {
            f"mono{bits}": _Layout(1, depth),
            f"bgr{bits}": _Layout(3, depth),
            f"rgb{bits}": _Layout(3, depth, _to_bgr(cv2.COLOR_RGB2BGR)),
            f"bgra{bits}": _Layout(4, depth, _to_bgr(cv2.COLOR_BGRA2BGR)),
            f"rgba{bits}": _Layout(4, depth, _to_bgr(cv2.COLOR_RGBA2BGR)),
            f"{bits}UC1": _Layout(1, depth),
            f"{bits}UC3": _Layout(3, depth),
            f"{bits}UC4": _Layout(4, depth, _to_bgr(cv2.COLOR_BGRA2BGR)),
        }
        made |= {f"bayer_{first}{bits}": _Layout(1, depth, _to_bgr(code)) for first, code in BAYER_TO_GREY.items()}
    made |= dict.fromkeys(("yuv422", "uyvy"), _Layout(2, 1, _brightness(1)))
    made |= dict.fromkeys(("yuv422_yuy2", "yuyv"), _Layout(2, 1, _brightness(0)))
    made |= dict.fromkeys(("nv12", "nv21", "nv24"), _Layout(1, 1))  # the colours come after the rows of brightness
    return made


_LAYOUTS = _layouts()
ENCODINGS = tuple(sorted(_LAYOUTS))
"""The encodings of sensor_msgs/Image that are understood."""


def decode(encoding: str, height: int, width: int, step: int, data: Any, is_bigendian: bool) -> Raw:
    """The picture of a sensor_msgs/Image; it may be a view of `data`.

    height, width: in pixels. step: bytes a row, padding included; 0 means no padding. data: bytes, or anything else
    with a contiguous buffer. is_bigendian: matters for 16 bits only. Of YUV and Bayer pictures, brightness alone is
    made: it is what detectors look at.

    Raises InputError naming what cannot be: an encoding (and those allowed), a size, too few bytes.
    """
    layout = _LAYOUTS.get(encoding)
    if layout is None:
        raise InputError(f"encoding '{encoding}' is not understood: allowed are {', '.join(ENCODINGS)}")
    least = 2 if encoding.startswith("bayer_") else 1
    if height < least or width < least:
        raise InputError(f"{width}x{height} pixels of {encoding}: a picture has at least {least}x{least}")
    pixel = layout.channels * layout.depth
    step = step or width * pixel
    if step < width * pixel:
        raise InputError(f"step {step}: {width} pixels of {encoding} take {width * pixel} bytes a row")
    values = np.frombuffer(data, np.uint8)
    needed = step * (height - 1) + width * pixel
    if len(values) < needed:
        raise InputError(f"{len(values)} bytes of data: {width}x{height} pixels of {encoding} take {needed}")
    stored: np.dtype[Any] = np.dtype("u1") if layout.depth == 1 else np.dtype(">u2" if is_bigendian else "<u2")
    shape, strides = (height, width, layout.channels), (step, pixel, layout.depth)
    raw: Raw = np.ndarray(shape, stored, values.data, 0, strides).astype(stored.newbyteorder("="), copy=False)
    return layout.convert(raw[:, :, 0] if layout.channels == 1 else raw)


def decode_compressed(format: str, data: Any) -> Raw:  # noqa: A002
    """The picture of a sensor_msgs/CompressedImage, or of any JPEG or PNG.

    format: as the message has it ("jpeg", "rgb8; jpeg compressed bgr8", ...); what counts is what the data is.
    Raises InputError for data that is damaged or no picture, video and compressedDepth among them.
    """
    stored = bytes(data)
    if (wrong := damage(stored)) is not None:
        raise InputError(f"the picture {wrong}")
    with quiet():
        try:
            raw: Raw | None = cv2.imdecode(np.frombuffer(stored, np.uint8), cv2.IMREAD_UNCHANGED)
        except cv2.error:  # e.g. more pixels than OpenCV is willing to read
            raw = None
    if raw is None:
        raise InputError(f"format '{format}' cannot be decoded: allowed are jpeg and png, one whole picture a message")
    return cv2.cvtColor(raw, cv2.COLOR_BGRA2BGR) if raw.ndim == 3 and raw.shape[2] == 4 else raw
