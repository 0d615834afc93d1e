"""What depthai says of a frame, in our units."""

from __future__ import annotations

from dataclasses import dataclass
from datetime import timedelta
from typing import Any

from pipeline.errors import InputError
from sources.live import ARRIVAL_CLOCK
from sources.oak.settings import Clock
from sources.ros_images import Raw

MICROSECOND = timedelta(microseconds=1)
PLAIN = ("GRAY8", "RAW8", "RAW10", "RAW12", "RAW14", "RAW16")


@dataclass(frozen=True, slots=True)
class Said:
    """A frame of an OAK. captured_ns: the end of the exposure; exposure_ns: None where it is not known."""

    image: Raw
    sequence: int
    captured_ns: int
    exposure_ns: int | None


def read_message(message: Any, clock: Clock) -> Said:
    """Takes a dai.ImgFrame. Raises InputError where it has no stamp of that clock, or no picture."""
    exposure_ns = to_ns(message.getExposureTime())
    try:
        image = message.getFrame() if message.getType().name in PLAIN else message.getCvFrame()
    except (RuntimeError, ValueError) as error:
        raise InputError(f"a frame of type {message.getType().name} cannot be read: {error}") from None
    return Said(image, message.getSequenceNum(), _captured_ns(message, clock), exposure_ns or None)


def clock_name(clock: Clock, device: str) -> str:
    """What the clock is called in frames: cameras of clocks of one name are compared directly."""
    return {"device": device, "host": ARRIVAL_CLOCK, "ptp": "ptp"}[clock]


def to_ns(since: timedelta) -> int:
    return since // MICROSECOND * 1000


def _captured_ns(message: Any, clock: Clock) -> int:
    if clock == "device":
        return to_ns(message.getTimestampDevice())
    if clock == "host":
        return to_ns(message.getTimestamp())
    system = message.getTimestampSystem()
    if system is None:
        raise InputError("the device gives no PTP time: choose clock: host, or set up PTP on devices that have it")
    return int(round(system.timestamp() * 1e6) * 1000)
