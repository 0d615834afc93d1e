"""Finds an OAK and builds the pipeline that delivers its pictures."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

from pipeline.errors import InputError, RunError, SyncwatchError
from sources.oak.settings import OakDeviceSettings, OakSettings


class NotThereError(InputError):
    """No device answers, or not the one that is wanted."""


@dataclass(frozen=True, slots=True)
class Built:
    """A pipeline that is ready to start. outputs: by camera; close: gives the device back after the pipeline's end."""

    device: str
    pipeline: Any
    outputs: Mapping[str, Any]
    close: Callable[[], object]


def build_on_device(dai: Any, wanted: OakDeviceSettings, settings: OakSettings) -> Built:
    """Raises NotThereError, InputError where it is unclear what is meant or a camera is absent, else RunError."""
    try:
        info = _found(dai, wanted.device)
    except RuntimeError as error:
        raise RunError(f"OAKs cannot be looked for: {error}") from None
    name = info.getDeviceId() or info.name
    try:
        device = dai.Device(info)
    except RuntimeError as error:
        raise RunError(f"OAK {name} cannot be opened: {error}") from None
    try:
        _check_sockets(device, name, wanted)
        device.setMaxReconnectionAttempts(0)  # it would come back with its counters set back and not say so
        _set_role(dai, device, name, wanted)
        pipeline = dai.Pipeline(device)
        outputs = {camera: _output(dai, pipeline, socket, settings) for camera, socket in wanted.cameras.items()}
    except (RuntimeError, ValueError) as error:
        device.close()
        raise RunError(f"OAK {name} cannot be set up: {error}") from None
    except SyncwatchError:
        device.close()
        raise
    return Built(name, pipeline, outputs, device.close)


def _found(dai: Any, wanted: str | None) -> Any:
    """The device; looking takes half a second, where opening one that is absent would take ten."""
    if wanted is not None:
        is_found, info = dai.Device.getDeviceByIdOrName(wanted)
        if is_found:
            return info
    others = dai.Device.getAllAvailableDevices()
    names = ", ".join(other.getDeviceId() or other.name for other in others)
    if wanted is not None:
        there = f"there are {names}" if others else "there is none"
        raise NotThereError(f"no OAK '{wanted}' is found on USB or the network: {there} that no other program uses")
    if not others:
        raise NotThereError(
            "no OAK is found on USB or the network: is one plugged in, powered, and used by no other program? "
            "On Linux, USB needs the udev rules of Luxonis; across networks give its IP address as 'device'"
        )
    if len(others) > 1:
        raise InputError(f"several OAKs are found ({names}): say by 'device' which are meant")
    return others[0]


def _check_sockets(device: Any, name: str, wanted: OakDeviceSettings) -> None:
    there = [socket.name for socket in device.getConnectedCameras()]
    absent = [socket for socket in wanted.cameras.values() if socket not in there]
    if absent:
        raise InputError(f"OAK {name} has no camera at {absent[0]}: it has {', '.join(there) or 'none'}")


def _set_role(dai: Any, device: Any, name: str, wanted: OakDeviceSettings) -> None:
    if wanted.sync is None:
        return
    role = {
        "auto": dai.ExternalFrameSyncRole.AUTO_DETECT,
        "master": dai.ExternalFrameSyncRole.MASTER,
        "slave": dai.ExternalFrameSyncRole.SLAVE,
    }[wanted.sync]
    is_set, reason = device.setExternalFrameSyncRole(role)
    if not is_set:
        raise RunError(f"OAK {name} cannot be {wanted.sync} of hardware synchronization: {reason}")


def _output(dai: Any, pipeline: Any, socket: str, settings: OakSettings) -> Any:
    camera = pipeline.create(dai.node.Camera).build(getattr(dai.CameraBoardSocket, socket), sensorFps=settings.fps)
    size = (settings.width, settings.height)
    return camera.requestOutput(size, type=dai.ImgFrame.Type.GRAY8, fps=settings.fps)
