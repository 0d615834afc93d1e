"""Several V4L2 cameras as one source, on a scripted kernel and through the assembly."""

from __future__ import annotations

import errno
import logging
import threading
import time

import pytest

from pipeline.assemble import KINDS
from pipeline.configtext.document import ConfigError, load_text
from pipeline.errors import InputError, RunError
from pipeline.plan import make_plan
from sources.v4l2 import abi
from sources.v4l2.settings import V4l2Settings
from sources.v4l2.source import V4l2Source
from tests.sources.v4l2_kernel import UNPLUG, FakeCamera, Machine, Shot, failure


@pytest.fixture
def machine(tmp_path):
    return Machine(tmp_path)


@pytest.fixture(autouse=True)
def _log_is_heard(monkeypatch):
    monkeypatch.setattr(logging.getLogger("syncwatch"), "propagate", True)


def source(machine, left="video0", right="video1", **settings) -> V4l2Source:
    devices = {"left": left, "right": right}
    cameras = {
        name: {"device": device if device.count("-") else str(machine.dev / device)} for name, device in devices.items()
    }
    return V4l2Source(V4l2Settings(cameras=cameras, **settings), host=machine.host)


def gathered(running: V4l2Source, count: int) -> list:
    """The first `count` frames; then the source is stopped and closed."""
    frames = []
    for frame in running.frames():
        frames.append(frame)
        if len(frames) == count:
            running.stop()
    running.close()
    return frames


def refused(machine, **settings) -> str:
    with pytest.raises(InputError) as caught:
        source(machine, **settings).open()
    assert not any(camera.is_open for camera in machine.cameras.values())
    return str(caught.value)


def test_cameras_deliver_side_by_side(machine):
    machine.plug("video0", FakeCamera([Shot(level=1)] * 4, bus="usb-1"))
    machine.plug("video1", FakeCamera([Shot(level=2)] * 4, bus="usb-2"))
    running = source(machine)
    running.open()
    frames = gathered(running, 8)
    levels = {name: [int(f.image[0, 0]) for f in frames if f.camera == name] for name in ("left", "right")}
    assert levels == {"left": [1] * 4, "right": [2] * 4}
    assert not any(camera.is_open for camera in machine.cameras.values())


def test_one_camera_failing_does_not_disturb_the_other(machine):
    machine.plug("video0", FakeCamera([Shot()] * 6, bus="usb-1"))
    machine.plug("video1", FakeCamera([Shot(), UNPLUG, Shot()], bus="usb-2"))
    running = source(machine)
    running.open()
    frames = gathered(running, 8)
    assert [f.epoch for f in frames if f.camera == "left"] == [0] * 6
    assert [f.epoch for f in frames if f.camera == "right"] == [0, 1]


def test_an_absent_camera_is_an_error_that_names_those_that_are_there(machine):
    machine.plug("video0", FakeCamera(card="Some Cam", bus="usb-1"), serial="A1")
    machine.plug("video1", FakeCamera(capabilities=abi.CAP_STREAMING, bus="usb-1"))  # delivers metadata
    assert refused(machine, right="video7") == (
        f"source.cameras.right.device: no camera '{machine.dev}/video7': this machine has {machine.dev}/video0 "
        "(Some Cam, usb-1, serial A1) (wait: true waits for it)"
    )


def test_a_machine_without_cameras_says_so(machine):
    assert "no camera 'usb-3': this machine has no camera (wait" in refused(machine, left="usb-3")


@pytest.mark.parametrize("device", ["video0", "circle", "nothing\0"])
def test_what_is_no_camera_is_not_taken_for_one(machine, device):
    machine.plug("video0", FakeCamera(capabilities=abi.CAP_STREAMING))
    (machine.dev / "circle").symlink_to(machine.dev / "circle")
    assert f"{device}': this machine has no camera" in refused(machine, left=device)


def test_a_camera_can_be_given_by_serial_number_bus_and_lasting_name(machine):
    machine.plug("video3", FakeCamera(bus="usb-3"), serial="SN-3", by_id="usb-Fake-index0")
    machine.plug("video4", FakeCamera(bus="usb-4"), serial="SN-4")
    for left, right in (("SN-3", "SN-4"), ("usb-3", "usb-4"), ("usb-Fake-index0", "SN-4")):
        running = source(machine, left, right)
        running.open()
        assert [live.node.path.name for live in running._live] == ["video3", "video4"]
        running.close()


def test_a_serial_number_that_two_cameras_share_is_ambiguous(machine):
    machine.plug("video0", FakeCamera(bus="usb-1"), serial="SN-0001")
    machine.plug("video1", FakeCamera(bus="usb-2"), serial="SN-0001")
    words = refused(machine, left="SN-0001")
    assert f"'SN-0001' is several cameras, {machine.dev}/video0 and {machine.dev}/video1: give a path" in words


def test_one_camera_cannot_be_two(machine):
    machine.plug("video0", FakeCamera())
    assert refused(machine, right="video0") == f"source.cameras.right.device: {machine.dev}/video0 is 'left' already"


def test_a_camera_that_another_program_uses_is_an_error(machine):
    machine.plug("video0", FakeCamera(bus="usb-1"))
    machine.plug("video1", FakeCamera(bus="usb-2")).fail[abi.S_FMT].append(failure(errno.EBUSY))
    assert refused(machine) == f"source.cameras.right: {machine.dev}/video1: another program is using it"


def test_a_camera_that_may_not_be_opened_is_an_error_that_says_what_to_do(machine):
    machine.plug("video0", FakeCamera()).fail[-1].extend([failure(errno.EACCES)] * 9)
    assert "no permission: add your user to the group 'video'" in refused(machine)


def test_a_camera_of_unread_formats_says_which_it_has(machine):
    machine.plug("video0", FakeCamera(formats=("H264", "HEVC")))
    assert "source.cameras.left.format: none of its formats is read here: it has H264, HEVC" in refused(machine)


def test_a_camera_that_is_waited_for_may_come_later(machine, caplog):
    machine.plug("video0", FakeCamera([Shot()] * 3, bus="usb-1"))
    running = source(machine, wait=True)
    running.open()
    assert [(camera.name, camera.fps) for camera in running.cameras] == [("left", 10), ("right", 30)]
    frames = []
    for frame in running.frames():
        frames.append(frame)
        if len(frames) == 3:
            machine.plug("video1", FakeCamera([Shot()] * 2, bus="usb-2"))
        if len(frames) == 5:
            running.stop()
    running.close()
    assert [frame.epoch for frame in frames if frame.camera == "right"] == [0, 0]
    said = [record.message for record in caplog.records]
    assert f"right: no camera '{machine.dev}/video1' yet: waiting for it" in said
    assert "right: frame rate unknown: 30 is assumed; set fps" in said


def test_frames_that_nobody_takes_give_way_to_newer_ones_and_are_counted(machine, caplog):
    over = threading.Event()
    machine.plug("video0", FakeCamera([*[Shot()] * 100, over.set], bus="usb-1"))
    machine.plug("video1", FakeCamera(bus="usb-2"))
    running = source(machine)
    running.open()
    reader = running.frames()
    first = next(reader)
    assert over.wait(10)
    running.stop()
    rest = list(reader)
    running.close()
    assert rest[-1].sequence == 99
    assert len(rest) <= 8
    assert running.dropped == {"left": 100 - len([first, *rest]), "right": 0}
    assert f"left: frames were not taken fast enough: {running.dropped['left']} dropped" in caplog.text


def test_stopping_ends_it_within_a_second_and_lets_go_of_the_cameras(machine):
    machine.plug("video0", FakeCamera(bus="usb-1"))
    machine.plug("video1", FakeCamera(bus="usb-2"))
    running = source(machine)
    running.open()
    reader = threading.Thread(target=lambda: list(running.frames()), daemon=True)
    reader.start()
    started_s = time.monotonic()
    running.stop()
    reader.join(5)
    running.close()
    assert time.monotonic() - started_s < 1
    assert not any(camera.is_open for camera in machine.cameras.values())


def test_a_fault_of_this_program_ends_the_run_in_words(machine):
    machine.plug("video0", FakeCamera([Shot(), ZeroDivisionError("oops")], bus="usb-1"))
    machine.plug("video1", FakeCamera(bus="usb-2"))
    running = source(machine)
    running.open()
    with pytest.raises(RunError, match="left: ZeroDivisionError: oops"):
        list(running.frames())
    running.close()


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("{cameras: {left: {device: /dev/video0, fromat: YUYV}}}", "did you mean 'format'"),
        ("{cameras: {left: {device: /dev/video0, format: H264}}}", "no pixel format 'H264' is read here: take one of"),
        ("{cameras: {left: {device: /dev/video0, size: [640]}}}", "source.cameras.left.size"),
        ("{cameras: {Left: {device: /dev/video0}}}", "source.cameras.Left"),
        ("{cameras: {}}", "source.cameras"),
        ("{}", "source.cameras"),
    ],
)
def test_a_wrong_configuration_is_told_with_its_place(tmp_path, text, words):
    document = load_text(f"rig: bench\nsource: {{type: v4l2, {text[1:]}\ndetectors: {{timestamp: {{}}}}\n", "c", {}, [])
    with pytest.raises(ConfigError) as caught:
        make_plan(document, KINDS, tmp_path)
    assert words in str(caught.value)


def test_the_configuration_of_the_manual_is_valid(tmp_path):
    text = """
rig: bench
source:
  type: v4l2
  cameras:
    left: {device: /dev/video0, size: [640, 480], format: YUYV, fps: 30, buffers: 4, controls: {exposure: 100}}
    right: {device: /dev/v4l/by-id/usb-x-index0, format: mjpg, controls: {auto_exposure: Manual Mode, mirror: true}}
  wait: false
  silent_after_s: null
detectors: {timestamp: {}}
"""
    settings = make_plan(load_text(text, "c", {}, []), KINDS, tmp_path).source.settings
    assert settings.cameras["right"].format == "MJPEG"
    assert settings.cameras["right"].controls == {"auto_exposure": "Manual Mode", "mirror": True}
    assert settings.cameras["left"].size == (640, 480)
