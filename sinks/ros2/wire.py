"""What rmw_zenoh expects on the wire: keys, liveliness tokens, CDR payloads and attachments.

The formats are those of rmw_zenoh's design document (docs/design.md of ros2/rmw_zenoh, 0.2.4 and later).
"""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from functools import cache

from rosbags.typesys import Stores, get_typestore
from rosbags.typesys.store import Typestore
from zenoh.ext import Int64, z_serialize

from pipeline.frame import NS_PER_S
from sinks.ros2.diagnostics import Diagnostic

ARRAY = "diagnostic_msgs/msg/DiagnosticArray"
DDS_TYPE = "diagnostic_msgs::msg::dds_::DiagnosticArray_"
TOPIC = "diagnostics"
NO_HASH = "TypeHashNotSupported"
"""Stands where Humble has no hash."""

NODE, PUBLISHER = "NN", "MP"
ROOT = "%"
"""An empty enclave or namespace; slashes of names become it as well."""

NODE_ID, PUBLISHER_ID = "0", "1"

QOS = "::,10:,:,:,,"
"""Reliability, durability, history and depth, deadline, lifespan, liveliness; what is left out is rmw_zenoh's default:
reliable, volatile, keep last. Depth is 10, as `ros2 topic` and most subscribers have it."""


@cache
def typestore() -> Typestore:
    return get_typestore(Stores.LATEST)


def topic_key(domain_id: int, *, humble: bool) -> str:
    """The key under which the array is published."""
    return f"{domain_id}/{TOPIC}/{DDS_TYPE}/{_type_hash(humble=humble)}"


def tokens(domain_id: int, session: str, node: str, *, humble: bool) -> tuple[str, str]:
    """The keys of the liveliness tokens of the node and of its publisher. session: Zenoh's id of it, hexadecimal."""
    start = f"@ros2_lv/{domain_id}/{session}/{NODE_ID}"
    place = f"{ROOT}/{ROOT}/{node}"
    publisher = f"{ROOT}{TOPIC}/{DDS_TYPE}/{_type_hash(humble=humble)}/{QOS}"
    return f"{start}/{NODE_ID}/{NODE}/{place}", f"{start}/{PUBLISHER_ID}/{PUBLISHER}/{place}/{publisher}"


def gid(token: str) -> bytes:
    """16 bytes that are the publisher's own. rmw_zenoh derives them from the token, too, with another hash."""
    return hashlib.blake2b(token.encode(), digest_size=16).digest()


def attachment(sequence: int, at_ns: int, publisher: bytes) -> bytes:
    """33 bytes: counter from 1, nanoseconds since 1970, length and bytes of the publisher's gid."""
    return z_serialize((Int64(sequence), Int64(at_ns), publisher)).to_bytes()


def payload(at_ns: int, statuses: Sequence[Diagnostic]) -> bytes:
    """The array in CDR, little endian with its header. at_ns: nanoseconds since 1970."""
    types = typestore().types
    key_value, status = types["diagnostic_msgs/msg/KeyValue"], types["diagnostic_msgs/msg/DiagnosticStatus"]
    stamp = types["builtin_interfaces/msg/Time"](sec=at_ns // NS_PER_S, nanosec=at_ns % NS_PER_S)
    array = types[ARRAY](
        header=types["std_msgs/msg/Header"](stamp=stamp, frame_id=""),
        status=[
            status(
                level=int(one.level),
                name=one.name,
                message=one.message,
                hardware_id=one.hardware_id,
                values=[key_value(key=key, value=value) for key, value in one.values],
            )
            for one in statuses
        ],
    )
    return bytes(typestore().serialize_cdr(array, ARRAY))


def _type_hash(*, humble: bool) -> str:
    return NO_HASH if humble else typestore().hash_rihs01(ARRAY)
