"""What a driver's timestamps and counters mean: which clock, which moment, and how counters go on past their end."""

from __future__ import annotations

from dataclasses import dataclass

from pipeline.frame import NS_PER_S, StampReference
from sources.v4l2 import abi
from sources.v4l2.device import Host

NEAR_NS = 2 * NS_PER_S
"""A stamp this close to a clock of this machine when its picture arrives was taken from that clock."""

COUNTER_SPAN = 1 << 32

MONOTONIC, REALTIME = "monotonic", "realtime"


@dataclass(frozen=True, slots=True)
class Stamp:
    """captured_ns: None where the driver makes no stamps."""

    captured_ns: int | None
    clock: str
    reference: StampReference


class StampReader:
    """Reads the stamps and counters of one stream.

    The kernel says of its own clock that a stamp is of it (`monotonic`), and only then which moment it marks. Where it
    does not say, the clock of this machine that the first stamp is near to is taken; else the stamps are of a clock of
    the camera's own, named after it. Counters are of 32 bits and are counted on when they wrap.
    """

    def __init__(self, camera: str, host: Host) -> None:
        self._camera = camera
        self._host = host
        self._clock: str | None = None
        self._sequence: int | None = None

    def stamp(self, buffer: abi.Buffer) -> Stamp:
        captured_ns = buffer.timestamp.seconds * NS_PER_S + buffer.timestamp.microseconds * 1000
        if captured_ns == 0:
            return Stamp(None, MONOTONIC, StampReference.UNKNOWN)
        if buffer.flags & abi.FLAG_TIMESTAMP_MASK == abi.FLAG_TIMESTAMP_MONOTONIC:
            start = buffer.flags & abi.FLAG_SOURCE_MASK == abi.FLAG_SOURCE_START
            return Stamp(captured_ns, MONOTONIC, StampReference.START if start else StampReference.END)
        if self._clock is None:
            self._clock = self._nearest(captured_ns)
        return Stamp(captured_ns, self._clock, StampReference.UNKNOWN)

    def sequence(self, buffer: abi.Buffer) -> int:
        """The counter, which goes on where the 32 bits of the driver start again."""
        number = int(buffer.sequence)
        if self._sequence is not None:
            number += self._sequence // COUNTER_SPAN * COUNTER_SPAN
            if self._sequence - number > COUNTER_SPAN // 2:
                number += COUNTER_SPAN
        self._sequence = number
        return number

    def _nearest(self, captured_ns: int) -> str:
        if abs(self._host.monotonic_ns() - captured_ns) < NEAR_NS:
            return MONOTONIC
        if abs(self._host.realtime_ns() - captured_ns) < NEAR_NS:
            return REALTIME
        return self._camera
