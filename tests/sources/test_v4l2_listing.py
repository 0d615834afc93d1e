"""What is told of the cameras of a machine, and the command that tells it."""

from __future__ import annotations

import errno
import json

import pytest
import yaml
from click.testing import CliRunner

from pipeline.assemble import KINDS
from pipeline.cli import cameras as command
from pipeline.configtext.document import load_text
from pipeline.found import Finder, FoundCamera
from pipeline.plan import make_plan
from sources.oak.listing import oak_source
from sources.v4l2 import abi
from sources.v4l2.listing import v4l2_cameras, v4l2_source
from tests.sources.v4l2_kernel import FakeCamera, Machine, failure


@pytest.fixture
def machine(tmp_path):
    return Machine(tmp_path)


def told(machine, monkeypatch, *arguments: str) -> str:
    monkeypatch.setattr(command, "FINDERS", (Finder(lambda: v4l2_cameras(machine.host), v4l2_source),))
    result = CliRunner().invoke(command.cameras, arguments, standalone_mode=False)
    assert result.return_value == 0
    return result.output


def rig(machine) -> None:
    machine.plug(
        "video10",
        FakeCamera(bus="usb-2", card="Depth", formats=("MJPG", "H264"), sizes=((1280, 720), (640, 480)), fps=30),
        serial="B",
        by_id="usb-B-index0",
    )
    machine.plug("video2", FakeCamera(bus="usb-1", card="Plain", sizes=((640, 480),), fps=25))
    machine.plug("video3", FakeCamera(bus="usb-1", capabilities=abi.CAP_STREAMING))


def test_the_table_names_each_camera_with_what_it_delivers(machine, monkeypatch):
    rig(machine)
    text = told(machine, monkeypatch).replace(f"{machine.dev}", "/dev")
    assert text.split("\n\n")[0].splitlines() == [
        "/dev/video2   Plain  usb-1",
        "    YUYV, GREY: 640x480 at 25 fps",
        "/dev/video10  Depth  usb-2  serial B",
        "    /dev/v4l/by-id/usb-B-index0",
        "    MJPEG: 1280x720 at 30 fps; 640x480 at 30 fps",
        "    not read here: H264",
    ]


def test_the_snippet_is_a_valid_source_with_names_that_stay(machine, monkeypatch, tmp_path):
    rig(machine)
    snippet = told(machine, monkeypatch).split("\n\n")[1]
    data = yaml.safe_load(snippet)
    assert data["source"]["cameras"] == {
        "left": {"device": "usb-1", "size": [640, 480], "format": "GREY", "fps": 25},
        "right": {
            "device": f"{machine.dev}/v4l/by-id/usb-B-index0",
            "size": [640, 480],
            "format": "MJPEG",
            "fps": 30,
        },
    }
    make_plan(load_text(f"rig: bench\n{snippet}\ndetectors: {{timestamp: {{}}}}\n", "c", {}, []), KINDS, tmp_path)


def test_cameras_of_two_kinds_are_a_list_of_sources_and_each_has_a_name_of_its_own(machine, monkeypatch, tmp_path):
    rig(machine)
    depth = FoundCamera("oak", "1.1", "OAK", "usb", settings={"device": "14442C10D13EABCE00"}, views=2)
    of_a_kind = [Finder(lambda: v4l2_cameras(machine.host), v4l2_source), Finder(lambda: [depth], oak_source)]
    monkeypatch.setattr(command, "FINDERS", (*of_a_kind, Finder(list, v4l2_source)))
    text = CliRunner().invoke(command.cameras, standalone_mode=False).output
    assert "a rig needs two" not in text
    snippet = text.split("\n\n")[1]
    plain, oak = yaml.safe_load(snippet)["source"]
    assert (plain["type"], list(plain["cameras"])) == ("v4l2", ["cam0", "cam1"])
    assert (oak["type"], list(oak["devices"][0]["cameras"])) == ("oak", ["cam2", "cam3"])
    make_plan(load_text(f"rig: bench\n{snippet}\ndetectors: {{timestamp: {{}}}}\n", "c", {}, []), KINDS, tmp_path)


def test_json_has_everything(machine, monkeypatch):
    rig(machine)
    first, second = json.loads(told(machine, monkeypatch, "--json"))
    assert (first["kind"], first["name"], first["serial"], first["problem"]) == ("v4l2", "Plain", None, None)
    assert second["links"] == [f"{machine.dev}/v4l/by-id/usb-B-index0"]
    assert [(mode["format"], mode["size"], mode["fps"], mode["readable"]) for mode in second["modes"]] == [
        ("MJPEG", [1280, 720], [30.0], True),
        ("MJPEG", [640, 480], [30.0], True),
        ("H264", [1280, 720], [30.0], False),
        ("H264", [640, 480], [30.0], False),
    ]


def test_two_cameras_of_one_serial_number_are_named_by_where_they_are(machine, monkeypatch):
    machine.plug("video0", FakeCamera(bus="usb-1"), serial="0001", by_id="usb-A-index0")
    machine.plug("video2", FakeCamera(bus="usb-2"), serial="0001")
    found = v4l2_cameras(machine.host)
    assert [camera.settings["device"] for camera in found] == ["usb-1", "usb-2"]


def test_a_camera_without_permission_is_listed_with_what_to_do(machine, monkeypatch):
    machine.plug("video0", FakeCamera()).fail[-1].extend([failure(errno.EACCES)] * 9)
    text = told(machine, monkeypatch)
    assert "cannot be used: no permission: add your user to the group 'video'" in text
    assert "source:" not in text


def test_a_camera_with_the_multi_planar_interface_only_is_listed_as_unusable(machine, monkeypatch):
    machine.plug("video0", FakeCamera(capabilities=abi.CAP_VIDEO_CAPTURE_MPLANE | abi.CAP_STREAMING))
    assert "cannot be used: its driver has the multi-planar interface only" in told(machine, monkeypatch)


def test_a_machine_without_cameras_says_so(machine, monkeypatch):
    assert "no cameras here" in told(machine, monkeypatch)
    assert json.loads(told(machine, monkeypatch, "--json")) == []
