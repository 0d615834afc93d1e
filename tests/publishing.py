"""Publishes pictures over Zenoh as ROS 2 and others do."""

from __future__ import annotations

import json
import struct
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from functools import cache

import numpy as np
import zenoh
from rosbags.typesys import Stores, get_typestore
from rosbags.typesys.store import Typestore

from pipeline.zenoh_network import NetworkSettings, session_config

RIHS01 = "RIHS01_d31d41a9a4c4bc8eae9be757b0beed306564f7526c88ea6a4588fb9582527d47"
NAMES = {"Image": "sensor_msgs::msg::dds_::Image_", "CompressedImage": "sensor_msgs::msg::dds_::CompressedImage_"}
PICTURE = np.full((4, 6), 100, np.uint8)


@cache
def typestore() -> Typestore:
    return get_typestore(Stores.ROS2_HUMBLE)


def header(stamp_ns: int):
    types = typestore().types
    stamp = types["builtin_interfaces/msg/Time"](stamp_ns // 10**9, stamp_ns % 10**9)
    return types["std_msgs/msg/Header"](stamp, "camera")


def ros_image(stamp_ns: int, image: np.ndarray = PICTURE, encoding: str = "mono8", **changes) -> bytes:
    height, width = image.shape[:2]
    data = np.ascontiguousarray(image).view(np.uint8).reshape(-1)
    fields = {"height": height, "width": width, "is_bigendian": 0, "step": len(data) // height, **changes}
    made = typestore().types["sensor_msgs/msg/Image"](header(stamp_ns), encoding=encoding, data=data, **fields)
    return bytes(typestore().serialize_cdr(made, "sensor_msgs/msg/Image"))


def ros_compressed(stamp_ns: int, data: bytes, form: str = "jpeg") -> bytes:
    made = typestore().types["sensor_msgs/msg/CompressedImage"](header(stamp_ns), form, np.frombuffer(data, np.uint8))
    return bytes(typestore().serialize_cdr(made, "sensor_msgs/msg/CompressedImage"))


def rmw_key(topic: str, kind: str = "Image") -> str:
    return f"0/{topic}/{NAMES[kind]}/{RIHS01}"


def rmw_attachment(sequence: int, gid: int = 7) -> bytes:
    return struct.pack("<qqB16s", sequence, 1_790_000_000_000_000_000, 16, bytes([gid]) * 16)


def said(**facts) -> bytes:
    return json.dumps(facts).encode()


@contextmanager
def network(endpoint: str) -> Iterator[zenoh.Session]:
    """A peer at which others connect."""
    with zenoh.open(session_config(NetworkSettings(listen=(endpoint,)))) as session:
        yield session


@contextmanager
def publishing(endpoint: str, prefix: str, period_ns: int = 10_000_000) -> Iterator[None]:
    """Publishes ROS images of a left and a right camera until it is left; stamps are those of their moments."""
    done = threading.Event()

    def publish(session: zenoh.Session) -> None:
        start_ns, number = time.time_ns(), 0
        while not done.wait(max(0.0, (start_ns + number * period_ns - time.time_ns()) / 1e9)):
            for name in ("left", "right"):
                image = ros_image(start_ns + number * period_ns)
                session.put(rmw_key(f"{prefix}/{name}"), image, attachment=rmw_attachment(number))
            number += 1

    with network(endpoint) as session:
        thread = threading.Thread(target=publish, args=(session,))
        thread.start()
        try:
            yield
        finally:
            done.set()
            thread.join()
