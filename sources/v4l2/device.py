"""The only way to the kernel: opening a device node, its ioctls, its memory, and waiting for it."""

from __future__ import annotations

import errno
import fcntl
import mmap
import os
import select
import time
from collections.abc import Callable
from ctypes import Structure, c_int32
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol

READABLE, ERROR = select.POLLIN, select.POLLERR | select.POLLHUP | select.POLLNVAL

WORDS = {
    errno.EACCES: "no permission: add your user to the group 'video' and log in anew",
    errno.EPERM: "no permission: add your user to the group 'video' and log in anew",
    errno.EBUSY: "another program is using it",
    errno.ENODEV: "it is gone",
    errno.ENXIO: "it is gone",
    errno.ENOENT: "it is gone",
    errno.ENOSPC: "not enough USB bandwidth: take a smaller size, a lower rate, MJPEG, or another USB controller",
}


class TroubleError(Exception):
    """A camera does not do what it should. The text says what it did, without naming it."""


class Memory(Protocol):
    """A mapped buffer: readable through the buffer protocol until `close`."""

    def __buffer__(self, flags: int, /) -> memoryview: ...

    def close(self) -> None: ...


class Device(Protocol):
    """An open device node, which never blocks but in `poll`. Every method may raise OSError."""

    def ioctl(self, request: int, argument: Structure | c_int32) -> None:
        """Calls the kernel, which changes `argument`."""
        ...

    def map(self, length: int, offset: int) -> Memory: ...

    def poll(self, timeout_s: float) -> int:
        """Waits until there is a buffer (READABLE) or something is amiss (ERROR); 0 after `timeout_s`."""
        ...

    def close(self) -> None: ...


class KernelDevice:
    """Implements Device."""

    def __init__(self, path: Path) -> None:
        self._fd = os.open(path, os.O_RDWR | os.O_NONBLOCK | os.O_CLOEXEC)
        self._poll = select.poll()
        self._poll.register(self._fd, select.POLLIN)

    def ioctl(self, request: int, argument: Structure | c_int32) -> None:
        while True:
            try:
                fcntl.ioctl(self._fd, request, argument)
            except InterruptedError:
                continue
            return

    def map(self, length: int, offset: int) -> mmap.mmap:
        return mmap.mmap(self._fd, length, mmap.MAP_SHARED, mmap.PROT_READ, offset=offset)

    def poll(self, timeout_s: float) -> int:
        ready = self._poll.poll(round(timeout_s * 1000))
        return ready[0][1] if ready else 0

    def close(self) -> None:
        os.close(self._fd)


@dataclass(frozen=True, slots=True)
class Host:
    """The machine: where its device nodes are, how they are opened, and its clocks."""

    dev: Path = Path("/dev")
    sys: Path = Path("/sys")
    open: Callable[[Path], Device] = KernelDevice
    monotonic_ns: Callable[[], int] = time.monotonic_ns
    realtime_ns: Callable[[], int] = time.time_ns


def explained(what: str, error: OSError) -> TroubleError:
    """`error` in words, and which step it came from."""
    known = WORDS.get(error.errno or 0)
    return TroubleError(known or f"{what} failed: {error.strerror or error}")
