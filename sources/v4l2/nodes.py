"""Which cameras this machine has, what identifies them, and which of them a configuration means."""

from __future__ import annotations

import errno
import re
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

from sources.v4l2 import abi
from sources.v4l2.device import Device, Host, TroubleError, explained

MOST_LISTED = 256
"""More formats than any driver has."""


@dataclass(frozen=True, slots=True)
class Node:
    """One device node that delivers pictures.

    links: its names that stay, /dev/v4l/by-id before /dev/v4l/by-path. interface, index: which of several sensors
    behind one plug. problem: why no more is known of it.
    """

    path: Path
    card: str = ""
    bus: str = ""
    driver: str = ""
    serial: str | None = None
    interface: str = ""
    index: str = ""
    links: tuple[Path, ...] = field(default=())
    problem: str | None = None

    def is_now(self, other: Node) -> bool:
        """Whether this camera may have become `other`, plugged in anew: by serial number, else by model and place."""
        if (self.card, self.interface, self.index) != (other.card, other.interface, other.index):
            return False
        return self.bus == other.bus if self.serial is None else self.serial == other.serial

    def __str__(self) -> str:
        if self.problem is not None:
            return f"{self.path} ({self.problem})"
        serial = "" if self.serial is None else f", serial {self.serial}"
        return f"{self.path} ({self.card}, {self.bus}{serial})"


def nodes(host: Host) -> list[Node]:
    """The nodes of this machine that deliver pictures, and those that could not be asked, in order of their numbers."""
    found = (node_at(path, host) for path in sorted(host.dev.glob("video*"), key=_number))
    return [node for node in found if node is not None]


def node_at(path: Path, host: Host) -> Node | None:
    """What is at a path; None where nothing is, or what delivers no pictures (metadata, output, codecs)."""
    try:
        real = path.resolve()
    except (OSError, RuntimeError, ValueError):  # links in a circle, or what is no path at all
        return None
    links = _links(real, host)
    try:
        device = host.open(real)
    except OSError as error:
        gone = error.errno in {errno.ENOENT, errno.ENODEV, errno.ENXIO}
        return None if gone else Node(real, links=links, problem=str(explained("opening it", error)))
    try:
        asked = abi.Capability()
        device.ioctl(abi.QUERYCAP, asked)
    except OSError:
        return None  # no V4L2 device
    finally:
        device.close()
    able = asked.device_caps if asked.capabilities & abi.CAP_DEVICE_CAPS else asked.capabilities
    if not able & (abi.CAP_VIDEO_CAPTURE | abi.CAP_VIDEO_CAPTURE_MPLANE):
        return None
    problem = None
    if not able & abi.CAP_VIDEO_CAPTURE:
        problem = "its driver has the multi-planar interface only, which is not read here"
    elif not able & abi.CAP_STREAMING:
        problem = "its driver cannot stream"
    place = host.sys / "class" / "video4linux" / real.name
    return Node(
        path=real,
        card=asked.card.decode("utf-8", "replace"),
        bus=asked.bus_info.decode("utf-8", "replace"),
        driver=asked.driver.decode("utf-8", "replace"),
        serial=_serial(place),
        interface=(place / "device").resolve().name.partition(":")[2],
        index=_text(place / "index") or "",
        links=links,
        problem=problem,
    )


def find(device: str, host: Host) -> Node:
    """The camera that a configuration means by path, serial number or bus. Raises TroubleError where none is.

    A serial number that several cameras share identifies none of them, and is left out.
    """
    known = nodes(host)
    if device.startswith("/"):
        node = node_at(Path(device), host)
        if node is None:
            raise TroubleError(f"no camera '{device}'")
        shared = any(other.serial == node.serial and other.bus != node.bus for other in known)
        return replace(node, serial=None) if shared else node
    alike = [node for node in known if device in {node.serial, node.bus, *(link.name for link in node.links)}]
    if not alike:
        raise TroubleError(f"no camera '{device}'")
    if len({node.bus for node in alike}) > 1:
        several = " and ".join(str(node.path) for node in alike)
        raise TroubleError(f"'{device}' is several cameras, {several}: give a path that stays (/dev/v4l/by-path/...)")
    return alike[0]


def find_again(device: str, before: Node, host: Host) -> Node:
    """The camera of before, wherever it is now. Raises TroubleError where it is not to be found."""
    again = [node for node in nodes(host) if node.problem is None and before.is_now(node)]
    if again:
        named = [node for node in again if device.startswith("/") and node.path == Path(device).resolve()]
        return (named or again)[0]
    try:
        other = find(device, host)
    except TroubleError:
        raise TroubleError("it is gone") from None
    if other.problem is not None:
        raise TroubleError(other.problem)
    raise TroubleError(f"it is gone, and {other} is another camera: start anew to take that one")


def here(host: Host) -> str:
    """The cameras of this machine in words."""
    known = nodes(host)
    return "this machine has " + (", ".join(map(str, known)) if known else "no camera")


def format_codes(device: Device) -> Sequence[int]:
    """The pixel formats a camera offers."""
    codes = []
    for index in range(MOST_LISTED):
        described = abi.FormatDescription(index=index, type=abi.VIDEO_CAPTURE)
        try:
            device.ioctl(abi.ENUM_FMT, described)
        except OSError:
            break  # there are no more
        codes.append(int(described.pixelformat))
    return codes


def _number(path: Path) -> tuple[int, str]:
    digits = re.search(r"\d+$", path.name)
    return (int(digits[0]) if digits else -1, path.name)


def _links(real: Path, host: Host) -> tuple[Path, ...]:
    folders = (host.dev / "v4l" / name for name in ("by-id", "by-path"))
    return tuple(link for folder in folders for link in sorted(folder.glob("*")) if link.resolve() == real)


def _serial(place: Path) -> str | None:
    """The serial number of the USB device that a node belongs to."""
    device = (place / "device").resolve()
    for folder in (device, device.parent):
        serial = _text(folder / "serial")
        if serial:
            return serial
    return None


def _text(path: Path) -> str | None:
    try:
        return path.read_text(encoding="utf-8", errors="replace").strip()
    except OSError:
        return None
