"""What V4L2 cameras there are, what each can deliver, and how to name it in a configuration."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any

from pipeline.found import FoundCamera, Mode
from sources.v4l2 import abi
from sources.v4l2.device import Device, Host, explained
from sources.v4l2.formats import BY_CODE, FORMATS
from sources.v4l2.nodes import Node, format_codes, nodes

MOST_SIZES, MOST_RATES = 256, 64
"""More than any driver lists."""

USUAL_SIZE, USUAL_FPS = (640, 480), 30.0
"""What is proposed where a camera has it: enough to judge by."""


def v4l2_cameras(host: Host | None = None) -> list[FoundCamera]:
    """The cameras of this machine, in order of their numbers."""
    machine = host or Host()
    known = nodes(machine)
    return [_found(node, known, machine) for node in known]


def v4l2_source(found: Sequence[FoundCamera], names: Iterator[str]) -> dict[str, Any]:
    """A source that reads these cameras."""
    cameras = {next(names): dict(camera.settings) for camera in found}
    return {"type": "v4l2", "cameras": cameras}


def _found(node: Node, known: Sequence[Node], host: Host) -> FoundCamera:
    modes: tuple[Mode, ...] = ()
    problem = node.problem
    if problem is None:
        try:
            device = host.open(node.path)
        except OSError as error:
            problem = str(explained("opening it", error))
        else:
            modes = tuple(_modes(device))
            device.close()
    return FoundCamera(
        kind="v4l2",
        path=str(node.path),
        name=node.card,
        bus=node.bus,
        serial=node.serial,
        links=tuple(str(link) for link in node.links),
        modes=modes,
        problem=problem,
        settings={"device": _lasting_name(node, known), **_proposed(modes)},
    )


def _lasting_name(node: Node, known: Sequence[Node]) -> str:
    """By serial number where it is the only one of that number; else by place; else the path of the moment.

    Names by id of cameras without serial number tell two of one model not apart.
    """
    others = [other for other in known if other is not node]
    only = node.serial is not None and all(other.serial != node.serial or other.bus == node.bus for other in others)
    wanted = ("by-id", "by-path") if only else ("by-path",)
    for folder in wanted:
        for link in node.links:
            if link.parent.name == folder:
                return str(link)
    if node.bus and all(other.bus != node.bus for other in others):
        return node.bus
    return str(node.path)


def _proposed(modes: Sequence[Mode]) -> dict[str, Any]:
    """The readable format that costs least, near the usual size and rate."""
    order = list(FORMATS)
    readable = [mode for mode in modes if mode.readable]
    if not readable:
        return {}
    area = USUAL_SIZE[0] * USUAL_SIZE[1]
    best = min(readable, key=lambda mode: (abs(mode.size[0] * mode.size[1] - area), order.index(mode.format)))
    size = USUAL_SIZE if best.least is not None and best.least <= USUAL_SIZE <= best.size else best.size
    proposed: dict[str, Any] = {"size": list(size), "format": best.format}
    if best.fps:
        fps = min(best.fps, key=lambda rate: abs(rate - USUAL_FPS))
        proposed["fps"] = int(fps) if fps == int(fps) else round(fps, 3)
    return proposed


def _modes(device: Device) -> Iterator[Mode]:
    for code in format_codes(device):
        known = BY_CODE.get(code)
        name = abi.fourcc_text(code) if known is None else known.name
        for size in _sizes(device, code):
            ranged = size.type != abi.FRAME_DISCRETE
            yield Mode(
                format=name,
                size=size.most,
                fps=tuple(sorted(set(_rates(device, code, size.most)), reverse=True)),
                least=size.least if ranged else None,
                readable=known is not None,
            )


def _sizes(device: Device, code: int) -> Iterator[abi.FrameSize]:
    for index in range(MOST_SIZES):
        size = abi.FrameSize(index=index, pixel_format=code)
        try:
            device.ioctl(abi.ENUM_FRAMESIZES, size)
        except OSError:
            return  # there are no more
        yield size
        if size.type != abi.FRAME_DISCRETE:
            return


def _rates(device: Device, code: int, size: tuple[int, int]) -> Iterator[float]:
    for index in range(MOST_RATES):
        interval = abi.FrameInterval(index=index, pixel_format=code, width=size[0], height=size[1])
        try:
            device.ioctl(abi.ENUM_FRAMEINTERVALS, interval)
        except OSError:
            return  # there are no more
        bounds = (interval.least,) if interval.type == abi.FRAME_DISCRETE else (interval.least, interval.most)
        for each in bounds:
            if each.numerator:
                yield each.denominator / each.numerator
        if interval.type != abi.FRAME_DISCRETE:
            return
