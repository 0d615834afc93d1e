"""What OAKs there are, and how to name them in a configuration."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from importlib.util import find_spec
from typing import Any

from pipeline.errors import InputError
from pipeline.found import FoundCamera
from sources.oak.library import load
from sources.oak.settings import OakDeviceSettings

SOCKETS = tuple(OakDeviceSettings().cameras.values())
"""Where the two cameras of a stereo OAK are."""


def oak_cameras(library: Callable[[], Any] | None = None) -> list[FoundCamera]:
    """The OAKs on USB and the network; none where depthai is not installed. library: gives the module depthai."""
    if library is None and find_spec("depthai") is None:
        return []
    try:
        dai = library() if library is not None else load(telemetry=False)
        return [_found(info) for info in dai.Device.getAllAvailableDevices()]
    except (InputError, RuntimeError):  # it does not work here
        return []


def oak_source(found: Sequence[FoundCamera], names: Iterator[str]) -> dict[str, Any]:
    """A source that reads the stereo pairs of these."""
    devices = [{**one.settings, "cameras": {next(names): socket for socket in SOCKETS}} for one in found]
    return {"type": "oak", "devices": devices}


def _found(info: Any) -> FoundCamera:
    device_id = info.getDeviceId()
    return FoundCamera(
        kind="oak",
        path=info.name,
        name="OAK",
        bus=info.protocol.name.removeprefix("X_LINK_").lower(),
        serial=device_id or None,
        views=len(SOCKETS),
        settings={"device": device_id or info.name},
    )
