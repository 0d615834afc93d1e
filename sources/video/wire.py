"""What the process that reads a stream and the one that judges it say to each other."""

from __future__ import annotations

import struct
from typing import NamedTuple

OPENED, FRAME, FAILED = b"O", b"F", b"E"

MOST = (1 << 32) - 1


class Order(NamedTuple):
    """Asks the reader, as a line of JSON, to open a stream; a second line, empty, lets it read on.

    url: as FFmpeg takes it. options: as OpenCV takes them. period_s: of frames if that is known, else 0.
    is_file: it is played from its first picture on; of a stream, what is waiting at the start is stale.
    """

    url: str
    options: str
    open_within_ms: int
    silent_after_ms: int
    period_s: float
    is_file: bool


class Head(NamedTuple):
    """Begins what the reader says.

    OPENED: the stream shows pictures. number: frame rate in Hz, 0 if unknown; size: how many frames, 0 if unknown.
    FRAME:  arrived_ns: host's monotonic time; number: seconds from the start of a recording; a picture of
            height x width x channels follows, `size` bytes.
    FAILED: a sentence of `size` bytes in UTF-8 follows.
    """

    kind: bytes
    arrived_ns: int = 0
    number: float = 0.0
    size: int = 0
    height: int = 0
    width: int = 0
    channels: int = 0

    def pack(self) -> bytes:
        return LAYOUT.pack(*self)


LAYOUT = struct.Struct("<cqdIIII")


def read_head(data: bytes | bytearray) -> Head:
    return Head(*LAYOUT.unpack(data))
