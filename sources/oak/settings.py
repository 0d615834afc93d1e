"""The settings of OAK cameras."""

from __future__ import annotations

from collections import Counter
from typing import Annotated, Literal

from pydantic import Field, model_validator

from pipeline.settings import Settings
from sources.live import FRAMES_AHEAD, CameraName, Fps, FramesAhead

Socket = Literal["CAM_A", "CAM_B", "CAM_C", "CAM_D", "CAM_E", "CAM_F", "CAM_G", "CAM_H"]
Clock = Literal["device", "host", "ptp"]
Role = Literal["auto", "master", "slave"]


class OakDeviceSettings(Settings):
    """One OAK.

    device:  its id, IP address or USB port; left out: the only one there is.
    cameras: names and sockets.
    sync:    its role in hardware synchronization with other devices; left out: it is left as it is.
    """

    device: Annotated[str, Field(min_length=1)] | None = None
    cameras: dict[CameraName, Socket] = Field(default={"left": "CAM_B", "right": "CAM_C"}, min_length=1)
    sync: Role | None = None


class OakSettings(Settings):
    """Cameras of one or more OAK devices, grey and not rectified.

    clock:     whose stamps count. `device`: the device's own clock; stamps of two devices then do not compare. `host`:
               the device's clock as depthai translates it to CLOCK_MONOTONIC of this machine, good to a part of a
               millisecond. `ptp`: the device's system clock, where PTP keeps devices together. `auto`: `device` for one
               device, `host` for more.
    wait:      a device that is not there at the start is waited for; else that is an error.
    stall_s:   silence of all cameras of a device after which it is opened anew.
    telemetry: let depthai send its usage data to Luxonis, which it does by default.
    """

    type: Literal["oak"] = "oak"
    devices: tuple[OakDeviceSettings, ...] = Field(default=(OakDeviceSettings(),), min_length=1)
    fps: Fps = 30.0
    width: int = Field(default=640, ge=32, le=8192)
    height: int = Field(default=400, ge=32, le=8192)
    clock: Literal["auto"] | Clock = "auto"
    wait: bool = False
    stall_s: float = Field(default=3.0, ge=0.1, le=3600)
    frames_ahead: FramesAhead = FRAMES_AHEAD
    telemetry: bool = False

    @property
    def stamps(self) -> Clock:
        """The clock that is meant."""
        if self.clock != "auto":
            return self.clock
        return "device" if len(self.devices) == 1 else "host"

    @property
    def camera_names(self) -> tuple[str, ...]:
        return tuple(name for device in self.devices for name in device.cameras)

    @model_validator(mode="after")
    def _each_is_one(self) -> OakSettings:
        if len(self.devices) > 1 and any(device.device is None for device in self.devices):
            raise ValueError("of several devices each needs its id or IP address as 'device'")
        twice = [name for name, count in Counter(one.device for one in self.devices).items() if count > 1]
        if twice:
            raise ValueError(f"device '{twice[0]}' is given twice: list all its cameras under one")
        names = [name for name, count in Counter(self.camera_names).items() if count > 1]
        if names:
            raise ValueError(f"two cameras are named {names[0]}: every camera of the rig needs a name of its own")
        for device in self.devices:
            sockets = [socket for socket, count in Counter(device.cameras.values()).items() if count > 1]
            if sockets:
                raise ValueError(f"two cameras are at {sockets[0]} of one device")
        return self
