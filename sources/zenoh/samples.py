"""Reads the pictures in Zenoh samples: ROS 2 images, JPEG, PNG, and raw bytes that an attachment explains."""

from __future__ import annotations

import functools
import struct
from dataclasses import dataclass
from typing import Any

from pydantic import BaseModel, ConfigDict, Field, ValidationError
from rosbags.serde import SerdeError
from rosbags.typesys import Stores, get_typestore
from rosbags.typesys.store import Typestore

from pipeline.errors import InputError
from pipeline.frame import NS_PER_S, StampOrigin
from sources.replay.pictures import JPEG_START, PNG_START
from sources.ros_images import ENCODINGS, Raw, decode, decode_compressed

ROS_CLOCK = "ros"
IMAGE, COMPRESSED = "sensor_msgs/msg/Image", "sensor_msgs/msg/CompressedImage"
COMPRESSED_IN_KEY = "::dds_::CompressedImage_"

CDR_STARTS = (b"\x00\x00", b"\x00\x01")
"""The first bytes of plain CDR, big and little endian."""

RMW_ATTACHMENT = struct.Struct("<qqB16s")
GID_LENGTH = 16
"""What rmw_zenoh attaches: sequence number, time of sending, and the publisher's id after its length."""


class Attachment(BaseModel):
    """The JSON object that may come with a picture (docs/zenoh-pictures.md); keys it does not know are left alone."""

    model_config = ConfigDict(extra="ignore", frozen=True, allow_inf_nan=False)

    sequence: int | None = None
    captured_ns: int | None = None
    clock: str = Field(default="rig", min_length=1)
    stamp_origin: StampOrigin = StampOrigin.DRIVER
    epoch: int = 0
    exposure_ns: int | None = Field(default=None, ge=0)
    encoding: str | None = None
    width: int = Field(default=0, ge=0)
    height: int = Field(default=0, ge=0)
    step: int = Field(default=0, ge=0)
    is_bigendian: bool = False


@dataclass(frozen=True, slots=True)
class Shown:
    """A picture and what was said of it. publisher: the id of who sent it, if that is known."""

    image: Raw
    captured_ns: int | None
    clock: str
    sequence: int | None = None
    exposure_ns: int | None = None
    epoch: int = 0
    publisher: bytes | None = None
    stamp_origin: StampOrigin = StampOrigin.DRIVER


def read_sample(key: str, payload: bytes, attached: bytes | None) -> Shown:
    """Raises InputError for what is no picture, or one that is damaged."""
    if attached is not None and attached.lstrip().startswith(b"{"):
        return _explained(payload, _parsed(attached))
    if payload.startswith((JPEG_START, PNG_START)):
        return Shown(decode_compressed("", payload), None, "")
    if payload.startswith(CDR_STARTS):
        return _ros(key, payload, attached)
    raise InputError("neither a ROS image nor JPEG nor PNG, and no JSON attachment says what else (raw bytes need one)")


def _parsed(attached: bytes) -> Attachment:
    try:
        return Attachment.model_validate_json(attached)
    except ValidationError as error:
        first = error.errors(include_url=False, include_context=False)[0]
        place = ".".join(str(part) for part in first["loc"])
        raise InputError(f"attachment: {place + ': ' if place else ''}{first['msg']}") from None


def _explained(payload: bytes, said: Attachment) -> Shown:
    if said.encoding in ENCODINGS:
        image = decode(said.encoding, said.height, said.width, said.step, payload, said.is_bigendian)
    elif payload.startswith((JPEG_START, PNG_START)):
        image = decode_compressed(said.encoding or "", payload)
    else:
        raise InputError(
            f"attachment: encoding '{said.encoding}' is not one of {', '.join(('jpeg', 'png', *ENCODINGS))}"
        )
    return Shown(
        image,
        said.captured_ns,
        said.clock,
        said.sequence,
        said.exposure_ns,
        said.epoch,
        stamp_origin=said.stamp_origin,
    )


def _ros(key: str, payload: bytes, attached: bytes | None) -> Shown:
    sequence, publisher = None, None
    if attached is not None and len(attached) == RMW_ATTACHMENT.size and attached[GID_LENGTH] == GID_LENGTH:
        sequence, _, _, publisher = RMW_ATTACHMENT.unpack(attached)
    message = _deserialized(payload, COMPRESSED_IN_KEY in key)
    stamp = message.header.stamp
    stamp_ns = stamp.sec * NS_PER_S + stamp.nanosec
    if hasattr(message, "format"):
        image = decode_compressed(message.format, message.data)
    else:
        image = decode(
            message.encoding, message.height, message.width, message.step, message.data, bool(message.is_bigendian)
        )
    return Shown(image, stamp_ns or None, ROS_CLOCK, sequence, publisher=publisher)


def _deserialized(payload: bytes, is_compressed: bool) -> Any:
    """The message; a bridge from DDS does not say of which of the two types it is."""
    for name in (COMPRESSED,) if is_compressed else (IMAGE, COMPRESSED):
        try:
            return _typestore().deserialize_cdr(payload, name)
        except (SerdeError, ValueError):  # the latter for text that is none
            continue
    raise InputError("a message, but neither sensor_msgs/Image nor sensor_msgs/CompressedImage, or a damaged one")


@functools.cache
def _typestore() -> Typestore:
    return get_typestore(Stores.ROS2_HUMBLE)
