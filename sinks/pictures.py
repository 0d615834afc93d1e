"""Publishes every picture over Zenoh at full size, so that consumers of cameras can be fed by a recording."""

from __future__ import annotations

import json
import re
import threading
from contextlib import ExitStack
from pathlib import Path
from typing import Annotated, Any, Literal

import cv2
import zenoh
from pydantic import AfterValidator

from pipeline.frame import Frame
from pipeline.verdict import Report
from pipeline.zenoh_network import is_linked
from sinks.zenoh_link import ZenohLink
from sinks.zenoh_settings import PublishingSettings, is_key_chunk

HOST_CLOCK = "monotonic"
"""The clock of one machine, which says nothing on another."""

FIELD = re.compile(r"\{(rig|camera)\}")


def _key(value: str) -> str:
    if "{camera}" not in value or not all(is_key_chunk(chunk) for chunk in FIELD.sub("x", value).split("/")):
        raise ValueError(f"'{value}' is not a key with {{camera}} in it, e.g. pictures/{{rig}}/{{camera}}")
    return value


class PicturesSettings(PublishingSettings):
    """Where pictures are published, and as what.

    key: `{rig}` and `{camera}` stand for their names. encoding: `raw` pixels (mono8 or bgr8), or `png` or `jpeg` files.
    """

    type: Literal["pictures"] = "pictures"
    key: Annotated[str, AfterValidator(_key)] = "pictures/{rig}/{camera}"
    encoding: Literal["raw", "png", "jpeg"] = "raw"


class PicturesSink:
    """Every frame of the source, with faults, as a sample with the attachment that docs/zenoh-pictures.md describes.

    Frames before the network is reached are lost, as those of a camera would be. Raises RunError if nothing can be
    reached and that is `required`.
    """

    lossless = False
    wants_frames = True

    def __init__(self, settings: PicturesSettings, *, rig: str, base: Path = Path()) -> None:
        self._settings = settings
        self._rig = rig
        self._published: _Published | None = None
        self._lock = threading.Lock()
        self._link = ZenohLink(settings, self._publish_from, name="pictures", base=base)

    def start(self) -> None:
        self._link.start()

    def take(self, report: Report) -> None:
        """Reports are for other sinks."""

    def take_frame(self, frame: Frame) -> None:
        with self._lock:
            published = self._published
        if published is not None:
            key = self._settings.key.format(rig=self._rig, camera=frame.camera)
            payload, facts = _encoded(frame, self._settings.encoding, self._rig)
            published.put(key, payload, json.dumps(facts).encode())

    def stop(self) -> None:
        self._link.stop()

    def _publish_from(self, session: zenoh.Session) -> _Published:
        published = _Published(session)
        with self._lock:
            self._published = published
        return published


def _encoded(frame: Frame, encoding: str, rig: str) -> tuple[bytes, dict[str, Any]]:
    """The payload, and the attachment that explains it; rig: after which the clock of this machine is named."""
    facts = {
        "sequence": frame.sequence,
        "captured_ns": frame.captured_ns,
        "clock": f"{rig}/{frame.clock}" if frame.clock == HOST_CLOCK else frame.clock,
        "stamp_origin": frame.stamp_origin.value,
        "epoch": frame.epoch,
        "exposure_ns": frame.exposure_ns,
    }
    if encoding == "raw":
        height, width = frame.image.shape[:2]
        facts |= {"encoding": "mono8" if frame.image.ndim == 2 else "bgr8", "width": width, "height": height}
        payload = frame.image.tobytes()
    else:
        payload = cv2.imencode(f".{encoding}", frame.image)[1].tobytes()
    return payload, {name: fact for name, fact in facts.items() if fact is not None}


class _Published:
    """An open session with a publisher for each key; what cannot be sent at once is dropped, as cameras do."""

    def __init__(self, session: zenoh.Session) -> None:
        self._session = session
        self._open = ExitStack()
        self._open.enter_context(session)
        self._publishers: dict[str, zenoh.Publisher] = {}

    def put(self, key: str, payload: bytes, attachment: bytes) -> None:
        publisher = self._publishers.get(key)
        if publisher is None:
            declared = self._session.declare_publisher(key, congestion_control=zenoh.CongestionControl.DROP)
            publisher = self._publishers[key] = self._open.enter_context(declared)
        publisher.put(payload, attachment=attachment)

    def is_connected(self) -> bool:
        return is_linked(self._session)

    def close(self) -> None:
        self._open.close()
