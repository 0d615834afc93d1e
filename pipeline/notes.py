"""The names of what is remarkable about a camera or a pair and does not by itself make it out of sync."""

from __future__ import annotations

from enum import Enum


class Note(str, Enum):
    """What is written beside a verdict, and what events of a camera are called.

    Of one moment: drop, duplicate_timestamp, backward_timestamp, duplicate_frame, counter_reset, restarted, unpaired.
    Lasting: all others.
    """

    SEQUENCE_OFFSET = "sequence_offset"
    DROP = "drop"
    DUPLICATE_TIMESTAMP = "duplicate_timestamp"
    BACKWARD_TIMESTAMP = "backward_timestamp"
    DUPLICATE_FRAME = "duplicate_frame"
    COUNTER_RESET = "counter_reset"
    RESTARTED = "restarted"
    JITTER = "jitter"
    CLOCK_EPOCH = "clock_epoch"
    CLOCK_DRIFT = "clock_drift"
    STAMP_REFERENCE = "stamp_reference"
    UNPAIRED = "unpaired"
    FROZEN = "frozen"
    DARK = "dark"
    SATURATED = "saturated"
    BLURRED = "blurred"
    STALLED = "stalled"
    MISSING = "missing"
