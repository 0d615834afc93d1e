"""Turns the bytes of picture messages into stamps and pictures: of ROS 1, ROS 2 and Foxglove."""

from __future__ import annotations

import base64
import json
from collections.abc import Callable, Mapping
from functools import cache, partial
from types import SimpleNamespace
from typing import TYPE_CHECKING, Any, NamedTuple, TypeAlias

from foxglove_schemas_protobuf.CompressedImage_pb2 import CompressedImage
from foxglove_schemas_protobuf.CompressedVideo_pb2 import CompressedVideo
from foxglove_schemas_protobuf.RawImage_pb2 import RawImage
from google.protobuf.message import Message
from rosbags.typesys import Stores, get_types_from_msg, get_typestore
from rosbags.typesys.store import Typestore

from pipeline.errors import InputError
from pipeline.frame import NS_PER_S
from sources.replay.messages.container import Topic
from sources.replay.streams import Raw
from sources.ros_images import decode, decode_compressed

if TYPE_CHECKING:
    from sources.replay.messages.video import VideoDecoder


class Seen(NamedTuple):
    """stamp_ns: what the message says of itself, None where it is 0. sequence: its counter, where it has one."""

    stamp_ns: int | None
    sequence: int | None
    load: Callable[[], Raw]


Decoder: TypeAlias = Callable[[bytes], Seen]
"""Decodes the messages of one topic, in their order. Raises InputError for one that cannot be."""

Fields: TypeAlias = Any
"""A message with its fields as attributes."""

PROTOBUF: Mapping[str, type[Message]] = {
    "foxglove.RawImage": RawImage,
    "foxglove.CompressedImage": CompressedImage,
    "foxglove.CompressedVideo": CompressedVideo,
}
RAW_KINDS = {"sensor_msgs/msg/Image", "foxglove.RawImage", "foxglove_msgs/msg/RawImage"}
COMPRESSED_KINDS = {
    "sensor_msgs/msg/CompressedImage",
    "foxglove.CompressedImage",
    "foxglove_msgs/msg/CompressedImage",
}
VIDEO_KINDS = {"foxglove.CompressedVideo", "foxglove_msgs/msg/CompressedVideo"}
KINDS = RAW_KINDS | COMPRESSED_KINDS | VIDEO_KINDS


def holds_pictures(topic: Topic) -> bool:
    return topic.kind in KINDS and topic.encoding in {"ros1", "cdr", "protobuf", "json"}


def make_decoder(topic: Topic) -> Decoder:
    """The decoder of a topic for which `holds_pictures` is true; one for every pass over it."""
    parse = _parser(topic)
    video = _video_decoder() if topic.kind in VIDEO_KINDS else None

    def decoder(data: bytes) -> Seen:
        try:
            message = parse(data)
        except Exception as error:  # a parser fed with damaged bytes raises anything
            raise InputError(f"the message cannot be parsed as {topic.kind}: {error}") from error
        return Seen(_stamp_ns(message), _sequence(message), _loader(topic.kind, message, video))

    return decoder


def _video_decoder() -> VideoDecoder:
    from sources.replay.messages.video import VideoDecoder  # noqa: PLC0415 - PyAV is slow to import, and rarely needed

    return VideoDecoder()


def _parser(topic: Topic) -> Callable[[bytes], Fields]:
    if topic.encoding == "protobuf":
        parse: Callable[[bytes], Fields] = PROTOBUF[topic.kind].FromString
        return parse
    if topic.encoding == "json":
        return _from_json
    if topic.encoding == "ros1":
        store = _typestore(Stores.ROS1_NOETIC)
        return lambda data: store.deserialize_ros1(data, topic.kind)
    store = _typestore(Stores.LATEST)
    if topic.kind not in store.fielddefs:
        store.register(get_types_from_msg(topic.definition, topic.kind))
    return lambda data: store.deserialize_cdr(data, topic.kind)


@cache
def _typestore(which: Stores) -> Typestore:
    return get_typestore(which)


def _from_json(data: bytes) -> Fields:
    fields = json.loads(data)
    fields["timestamp"] = SimpleNamespace(**fields["timestamp"])
    fields["data"] = base64.b64decode(fields["data"])
    return SimpleNamespace(**fields)


def _loader(kind: str, message: Fields, video: VideoDecoder | None) -> Callable[[], Raw]:
    if video is not None:
        return video.loader(message.format, bytes(message.data))
    if kind in COMPRESSED_KINDS:
        return partial(decode_compressed, message.format, message.data)
    big_endian = bool(getattr(message, "is_bigendian", False))
    return partial(
        decode, message.encoding, message.height, message.width, message.step, message.data, is_bigendian=big_endian
    )


def _stamp_ns(message: Fields) -> int | None:
    header = getattr(message, "header", None)
    time = message.timestamp if header is None else header.stamp
    seconds = time.seconds if hasattr(time, "seconds") else time.sec
    part = next(int(getattr(time, name)) for name in ("nanos", "nanosec", "nsec") if hasattr(time, name))
    return int(seconds) * NS_PER_S + part or None


def _sequence(message: Fields) -> int | None:
    sequence = getattr(getattr(message, "header", None), "seq", None)
    return None if sequence is None else int(sequence)
