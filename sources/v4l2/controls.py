"""Controls of a camera, exposure, gain, trigger mode and the like, by their names."""

from __future__ import annotations

import difflib
import re
from collections.abc import Mapping
from ctypes import c_uint32
from dataclasses import dataclass

from pipeline.errors import InputError
from sources.v4l2 import abi
from sources.v4l2.device import Device, explained

MOST_CONTROLS = 1000
"""More than any driver has: a list that does not end is a fault of the driver."""

SETTABLE = {
    abi.CTRL_INTEGER,
    abi.CTRL_BOOLEAN,
    abi.CTRL_MENU,
    abi.CTRL_BUTTON,
    abi.CTRL_BITMASK,
    abi.CTRL_INTEGER_MENU,
}


@dataclass(frozen=True, slots=True)
class CameraControl:
    """A control that has a number for a value. menu: the words, or numbers, that values of a menu stand for."""

    id: int
    name: str
    type: int
    minimum: int
    maximum: int
    flags: int
    menu: Mapping[int, str]

    @property
    def allowed(self) -> str:
        if self.type == abi.CTRL_BOOLEAN:
            return "true or false"
        if self.menu:
            return "one of " + ", ".join(f"{value} ({word})" for value, word in self.menu.items())
        return f"{self.minimum} to {self.maximum}"


def controls_of(device: Device) -> dict[str, CameraControl]:
    """All settable controls by name, spelled as v4l2-ctl does: `Exposure Time, Absolute` is exposure_time_absolute."""
    found: dict[str, CameraControl] = {}
    wanted = 0
    for _ in range(MOST_CONTROLS):
        described = abi.ControlDescription(id=wanted | abi.CTRL_NEXT)
        try:
            device.ioctl(abi.QUERYCTRL, described)
        except OSError:
            break  # there are no more
        wanted = int(described.id)
        if described.flags & abi.CTRL_DISABLED or described.type not in SETTABLE:
            continue
        name = control_name(described.name.decode("utf-8", "replace"))
        found[name] = CameraControl(
            wanted,
            name,
            int(described.type),
            int(described.minimum),
            # a bitmask's maximum has all bits of it set
            int(c_uint32(described.maximum).value if described.type == abi.CTRL_BITMASK else described.maximum),
            int(described.flags),
            _menu(device, described),
        )
    return found


def control_name(title: str) -> str:
    return re.sub(r"[^a-z0-9]+", "_", title.lower()).strip("_")


def set_controls(device: Device, wanted: Mapping[str, bool | int | str]) -> list[str]:
    """Sets controls in the order given; what to tell of them.

    Raises InputError for one that is not there or a value it does not take, TroubleError where the driver fails.
    """
    if not wanted:
        return []
    known = controls_of(device)
    return [said for name, value in wanted.items() for said in _set(device, _known(name, known), value)]


def _known(name: str, known: Mapping[str, CameraControl]) -> CameraControl:
    control = known.get(control_name(name))
    if control is not None:
        return control
    near = difflib.get_close_matches(name, list(known), n=1)
    hint = f" - did you mean '{near[0]}'?" if near else "."
    raise InputError(f"controls.{name}: no such control{hint} It has {', '.join(known) or 'none'}")


def _set(device: Device, control: CameraControl, value: bool | int | str) -> list[str]:
    where = f"controls.{control.name}"
    number = _number(control, value)
    if number is None:
        raise InputError(f"{where}: {value} is not allowed: give {control.allowed}")
    if control.flags & abi.CTRL_READ_ONLY:
        raise InputError(f"{where}: can only be read on this camera")
    try:
        device.ioctl(abi.S_CTRL, abi.Control(id=control.id, value=number))
    except OSError as error:
        raise explained(f"setting {control.name} to {value}", error) from error
    if control.type == abi.CTRL_BUTTON:
        return []
    told = []
    now = _value(device, control.id)
    if now is not None and now != number:
        told.append(f"{control.name}: asked for {value}, the driver set {now}")
    if control.flags & abi.CTRL_INACTIVE:
        told.append(f"{control.name}: set, but without effect while another control rules it (automatic exposure?)")
    return told


def _number(control: CameraControl, value: bool | int | str) -> int | None:
    """The value as the driver takes it; None where it is not allowed."""
    if isinstance(value, str):
        same = [number for number, word in control.menu.items() if control_name(word) == control_name(value)]
        return same[0] if same else None
    number = int(value)
    if control.menu:
        return number if number in control.menu else None
    if control.type == abi.CTRL_BUTTON:
        return number
    least = 0 if control.type == abi.CTRL_BITMASK else control.minimum
    return number if least <= number <= control.maximum else None


def exposure_ns(device: Device) -> int | None:
    """How long the camera exposes, where it says so and no automatism changes it."""
    ruled_by = _value(device, abi.CTRL_ID_EXPOSURE_AUTO)
    if ruled_by not in {None, abi.EXPOSURE_MANUAL, abi.EXPOSURE_SHUTTER_PRIORITY}:
        return None
    units = _value(device, abi.CTRL_ID_EXPOSURE_ABSOLUTE)
    return units * abi.EXPOSURE_UNIT_NS if units else None


def _value(device: Device, number: int) -> int | None:
    """The value of a control; None where it is not there or can only be written."""
    asked = abi.Control(id=number)
    try:
        device.ioctl(abi.G_CTRL, asked)
    except OSError:
        return None
    return int(asked.value)


def _menu(device: Device, described: abi.ControlDescription) -> dict[int, str]:
    if described.type not in {abi.CTRL_MENU, abi.CTRL_INTEGER_MENU}:
        return {}
    menu = {}
    for index in range(max(0, described.minimum), described.maximum + 1):
        item = abi.MenuItem(id=described.id, index=index)
        try:
            device.ioctl(abi.QUERYMENU, item)
        except OSError:
            continue  # menus have gaps
        numbers = described.type == abi.CTRL_INTEGER_MENU
        menu[index] = str(item.value) if numbers else item.name.decode("utf-8", "replace")
    return menu
