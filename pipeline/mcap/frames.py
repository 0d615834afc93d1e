"""Frames as messages and back: the picture in a schema of Foxglove's, and everything else about it in JSON."""

from __future__ import annotations

import json
from collections.abc import Mapping
from typing import Any, Literal, TypeAlias

import cv2
import numpy as np
import numpy.typing as npt
from foxglove_schemas_protobuf.CompressedImage_pb2 import CompressedImage
from foxglove_schemas_protobuf.RawImage_pb2 import RawImage
from google.protobuf.message import DecodeError
from google.protobuf.timestamp_pb2 import Timestamp

from pipeline.errors import RunError
from pipeline.frame import NS_PER_S, Frame, StampOrigin, StampReference, Truth
from pipeline.mcap.schemas import FRAME_SCHEMA

Pictures: TypeAlias = Literal["raw", "png", "jpeg", "none"]

Raw: TypeAlias = npt.NDArray[Any]

ImageMessage: TypeAlias = RawImage | CompressedImage

IMAGE_CLASSES: Mapping[str, type[ImageMessage]] = {
    "foxglove.RawImage": RawImage,
    "foxglove.CompressedImage": CompressedImage,
}

LONGEST_SIDE_PX = {"png": 1_000_000, "jpeg": 65_500}
"""What their encoders take."""

CHANNELS = {"mono8": 1, "bgr8": 3}

EARLIEST_S, LATEST_S = -62_135_596_800, 253_402_300_799
"""The years 1 to 9999: more a protobuf timestamp cannot say; the JSON beside it says any stamp."""


def frame_message(frame: Frame) -> dict[str, Any]:
    """Everything a frame carries beside its picture; what is None is left out."""
    height, width = frame.image.shape[:2]
    truth = frame.truth
    fields = {
        "schema": FRAME_SCHEMA,
        "camera": frame.camera,
        "sequence": frame.sequence,
        "captured_ns": frame.captured_ns,
        "clock": frame.clock,
        "arrived_ns": frame.arrived_ns,
        "group": frame.group,
        "epoch": frame.epoch,
        "exposure_ns": frame.exposure_ns,
        "stamp_reference": frame.stamp_reference.value,
        "stamp_origin": frame.stamp_origin.value,
        "truth": truth and {"shown_ns": truth.shown_ns, "faults": list(truth.faults), "assumed": truth.assumed},
        "width": width,
        "height": height,
        "channels": 1 if frame.image.ndim == 2 else 3,
    }
    return {name: value for name, value in fields.items() if value is not None}


def frame_fields(data: bytes) -> dict[str, Any]:
    """The fields of a Frame, but for its picture, that `frame_message` told. Raises ValueError for anything else."""
    told = json.loads(data)
    if not isinstance(told, dict):
        raise ValueError("not a JSON object")  # noqa: TRY004 - damaged input, not a wrong call
    try:
        truth = told.get("truth")
        fields = {
            "camera": str(told["camera"]),
            "sequence": _integer(told.get("sequence")),
            "captured_ns": int(told["captured_ns"]),
            "clock": str(told["clock"]),
            "arrived_ns": int(told["arrived_ns"]),
            "group": _integer(told.get("group")),
            "epoch": int(told["epoch"]),
            "exposure_ns": _integer(told.get("exposure_ns")),
            "stamp_reference": StampReference(told["stamp_reference"]),
            "stamp_origin": StampOrigin(told["stamp_origin"]),
            "truth": truth and Truth(int(truth["shown_ns"]), tuple(truth["faults"]), bool(truth["assumed"])),
        }
    except (KeyError, TypeError) as error:
        raise ValueError(f"{type(error).__name__}: {error}") from error
    return fields


def image_message(
    frame: Frame, pictures: Literal["raw", "png", "jpeg"], jpeg_quality: int
) -> RawImage | CompressedImage:
    """The picture of a frame, stamped by its camera. Raises RunError where it cannot be encoded."""
    stamp = _timestamp(frame.captured_ns)
    image = frame.image
    if pictures == "raw":
        height, width = image.shape[:2]
        encoding = "mono8" if image.ndim == 2 else "bgr8"
        return RawImage(
            timestamp=stamp,
            frame_id=frame.camera,
            width=width,
            height=height,
            encoding=encoding,
            step=width * CHANNELS[encoding],
            data=image.tobytes(),
        )
    if not 0 < min(image.shape[:2]) <= max(image.shape[:2]) <= LONGEST_SIDE_PX[pictures]:
        raise RunError(f"{frame.camera}: a picture of {image.shape[1]}x{image.shape[0]} pixels is no {pictures}")
    options = [cv2.IMWRITE_JPEG_QUALITY, jpeg_quality] if pictures == "jpeg" else []
    _, encoded = cv2.imencode(f".{pictures}", image, options)
    return CompressedImage(timestamp=stamp, frame_id=frame.camera, data=encoded.tobytes(), format=pictures)


def picture_of(schema: str, data: bytes) -> Raw:
    """The picture in a message of `image_message`, read-only. Raises ValueError where there is none."""
    try:
        message = IMAGE_CLASSES[schema].FromString(data)
    except (DecodeError, KeyError) as error:
        raise ValueError(f"no {schema}") from error
    if isinstance(message, RawImage):
        return _raw_picture(message)
    decoded: Raw | None = cv2.imdecode(np.frombuffer(message.data, np.uint8), cv2.IMREAD_UNCHANGED)
    if decoded is None:
        raise ValueError(f"no {message.format}")
    return decoded


def _raw_picture(message: RawImage) -> Raw:
    channels = CHANNELS.get(message.encoding)
    if channels is None or message.step != message.width * channels:
        raise ValueError(f"encoding '{message.encoding}' with rows of {message.step} bytes")
    shape = (message.height, message.width) if channels == 1 else (message.height, message.width, channels)
    return np.frombuffer(message.data, np.uint8).reshape(shape)


def _timestamp(stamp_ns: int) -> Timestamp:
    seconds, nanos = divmod(stamp_ns, NS_PER_S)
    return Timestamp(seconds=max(EARLIEST_S, min(LATEST_S, seconds)), nanos=nanos)


def _integer(value: Any) -> int | None:
    return None if value is None else int(value)
