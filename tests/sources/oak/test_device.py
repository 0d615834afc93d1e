"""Finding and setting up an OAK, against a stand-in for the calls of depthai that need a device."""

from __future__ import annotations

from types import SimpleNamespace

import pytest
import yaml
from click.testing import CliRunner

from pipeline.cli import cameras as command
from pipeline.errors import InputError, RunError
from pipeline.found import Finder
from sources.oak.device import build_on_device
from sources.oak.listing import oak_cameras, oak_source
from sources.oak.settings import OakDeviceSettings, OakSettings


class Info:
    protocol = SimpleNamespace(name="X_LINK_USB_VSC")

    def __init__(self, name: str) -> None:
        self.name = name

    def getDeviceId(self) -> str:
        return self.name if len(self.name) > 12 else ""


class StandIn:
    """depthai with some devices: what was called, in order, is in `calls`."""

    def __init__(self, *names: str, hidden: tuple[str, ...] = (), fails: str = "") -> None:
        self.calls: list[object] = []
        calls = self.calls

        class Device:
            def __init__(self, info) -> None:
                if fails == "open":
                    raise RuntimeError("X_LINK_DEVICE_ALREADY_IN_USE")
                calls.append(("open", info.name))

            @staticmethod
            def getAllAvailableDevices():
                if fails == "search":
                    raise RuntimeError("USB is not to be had")
                return [Info(name) for name in names]

            @staticmethod
            def getDeviceByIdOrName(wanted):
                return wanted in (*names, *hidden), Info(wanted)

            def getConnectedCameras(self):
                return [SimpleNamespace(name=f"CAM_{letter}") for letter in ("AB" if fails == "socket" else "ABC")]

            def setMaxReconnectionAttempts(self, count):
                calls.append(("reconnect", count))

            def setExternalFrameSyncRole(self, role):
                calls.append(("role", role))
                return fails != "role", "not supported by this device"

            def close(self):
                calls.append("close")

        class Camera:
            def build(self, socket, sensorFps):
                if fails == socket:
                    raise RuntimeError(f"no sensor at {socket}")
                calls.append((socket, sensorFps))
                return self

            def requestOutput(self, size, type, fps):
                calls.append((size, type, fps))
                return f"output {len(calls)}"

        self.Device = Device
        self.Pipeline = lambda device: SimpleNamespace(create=lambda node: node())
        self.node = SimpleNamespace(Camera=Camera)
        self.CameraBoardSocket = SimpleNamespace(CAM_B="B", CAM_C="C")
        self.ExternalFrameSyncRole = SimpleNamespace(AUTO_DETECT="auto", MASTER="master", SLAVE="slave")
        self.ImgFrame = SimpleNamespace(Type=SimpleNamespace(GRAY8="GRAY8"))


ID, OTHER = "14442C10D13EABCE00", "14442C1071659ACD00"
SETTINGS = OakSettings(fps=20, width=320, height=200)


def test_the_only_device_is_taken_and_gives_raw_left_and_right():
    dai = StandIn(ID)
    built = build_on_device(dai, OakDeviceSettings(), SETTINGS)
    assert built.device == ID
    assert list(built.outputs) == ["left", "right"]
    picture = ((320, 200), "GRAY8", 20.0)
    assert dai.calls == [("open", ID), ("reconnect", 0), ("B", 20.0), picture, ("C", 20.0), picture]


def test_a_device_is_taken_by_its_address_though_it_does_not_answer_a_search():
    dai = StandIn(ID, hidden=("10.0.0.5",))
    assert build_on_device(dai, OakDeviceSettings(device="10.0.0.5"), SETTINGS).device == "10.0.0.5"


@pytest.mark.parametrize("role", ["auto", "master", "slave"])
def test_the_role_in_hardware_synchronization_is_set_before_anything_is_built(role):
    dai = StandIn(ID)
    build_on_device(dai, OakDeviceSettings(sync=role), SETTINGS)
    assert dai.calls[2] == ("role", role)


@pytest.mark.parametrize(
    ("dai", "wanted", "text"),
    [
        (StandIn(), None, "no OAK is found on USB or the network: is one plugged in, powered"),
        (StandIn(ID, OTHER), None, f"several OAKs are found \\({ID}, {OTHER}\\): say by 'device' which are meant"),
        (StandIn(ID), OTHER, f"no OAK '{OTHER}' is found on USB or the network: there are {ID} that no other"),
        (StandIn(), OTHER, "there is none that no other program uses"),
    ],
)
def test_a_device_that_is_not_there_is_bad_input(dai, wanted, text):
    with pytest.raises(InputError, match=text):
        build_on_device(dai, OakDeviceSettings(device=wanted), SETTINGS)
    assert dai.calls == []


@pytest.mark.parametrize(
    ("fails", "text"),
    [
        ("search", "OAKs cannot be looked for: USB is not to be had"),
        ("open", f"OAK {ID} cannot be opened: X_LINK_DEVICE_ALREADY_IN_USE"),
        ("role", f"OAK {ID} cannot be master of hardware synchronization: not supported by this device"),
        ("C", f"OAK {ID} cannot be set up: no sensor at C"),
    ],
)
def test_a_device_that_cannot_be_set_up_is_said_and_given_back(fails, text):
    dai = StandIn(ID, fails=fails)
    with pytest.raises(RunError, match=text):
        build_on_device(dai, OakDeviceSettings(sync="master"), SETTINGS)
    assert fails in {"search", "open"} or dai.calls[-1] == "close"


def test_a_camera_that_the_device_does_not_have_is_bad_input_that_names_those_it_has():
    dai = StandIn(ID, fails="socket")
    with pytest.raises(InputError, match=f"OAK {ID} has no camera at CAM_C: it has CAM_A, CAM_B"):
        build_on_device(dai, OakDeviceSettings(), SETTINGS)
    assert dai.calls[-1] == "close"


@pytest.mark.parametrize(
    ("names", "cameras"),
    [
        ((ID,), [{"left": "CAM_B", "right": "CAM_C"}]),
        ((ID, "10.0.0.5"), [{"cam0": "CAM_B", "cam1": "CAM_C"}, {"cam2": "CAM_B", "cam3": "CAM_C"}]),
    ],
)
def test_the_devices_that_are_there_are_listed_with_a_source_that_reads_them(monkeypatch, names, cameras):
    finder = Finder(lambda: oak_cameras(lambda: StandIn(*names)), oak_source)
    monkeypatch.setattr(command, "FINDERS", (finder,))
    shown = CliRunner().invoke(command.cameras, standalone_mode=False).output
    assert f"{ID}  OAK  usb_vsc  serial {ID}" in shown
    assert "two or more" not in shown
    source = yaml.safe_load(shown.partition("\n\n")[2])["source"]
    assert source.pop("type") == "oak"
    devices = OakSettings.model_validate(source).devices
    assert [(one.device, one.cameras) for one in devices] == list(zip(names, cameras, strict=True))


def test_where_depthai_does_not_work_there_is_no_oak():
    assert oak_cameras(lambda: StandIn(ID, fails="search")) == []
