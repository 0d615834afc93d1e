"""One V4L2 camera and everything that befalls it, on a scripted kernel."""

from __future__ import annotations

import errno
import logging

import pytest

from pipeline.frame import NS_PER_S, StampOrigin, StampReference
from sources.v4l2 import abi
from tests.sources.v4l2_kernel import POLL_ERROR, UNPLUG, FakeCamera, Machine, Shot, Silence, failure


@pytest.fixture
def machine(tmp_path):
    return Machine(tmp_path)


@pytest.fixture(autouse=True)
def _log_is_heard(monkeypatch):
    monkeypatch.setattr(logging.getLogger("syncwatch"), "propagate", True)


def shots(count: int, **fields) -> list[Shot]:
    return [Shot(**fields) for _ in range(count)]


def epochs(frames) -> list[int]:
    return [frame.epoch for frame in frames]


def test_frames_say_what_the_driver_said(machine):
    machine.plug("video0", FakeCamera([Shot(level=7), Shot(level=8)]))
    frames, _ = machine.run()
    assert [frame.sequence for frame in frames] == [0, 1]
    assert [frame.image.shape for frame in frames] == [(16, 32)] * 2
    assert [int(frame.image[3, 3]) for frame in frames] == [7, 8]
    assert frames[1].captured_ns - frames[0].captured_ns == NS_PER_S // 10
    assert frames[0].arrived_ns == frames[0].captured_ns
    assert {(frame.clock, frame.stamp_origin, frame.stamp_reference) for frame in frames} == {
        ("monotonic", StampOrigin.DRIVER, StampReference.END)
    }


def test_a_stamp_at_the_start_of_exposure_says_so(machine):
    machine.plug("video0", FakeCamera([Shot(flags=abi.FLAG_TIMESTAMP_MONOTONIC | abi.FLAG_SOURCE_START)]))
    frames, _ = machine.run()
    assert frames[0].stamp_reference is StampReference.START


def test_a_driver_without_stamps_leaves_the_arrival(machine):
    machine.plug("video0", FakeCamera([Shot(captured_ns=0)]))
    frames, _ = machine.run()
    assert frames[0].stamp_origin is StampOrigin.ARRIVAL
    assert frames[0].captured_ns == frames[0].arrived_ns


@pytest.mark.parametrize(
    ("captured_ns", "clock"), [(1000 * NS_PER_S, "monotonic"), (10**18 + 1000 * NS_PER_S, "realtime"), (5, "left")]
)
def test_stamps_whose_clock_the_kernel_does_not_tell_are_of_the_clock_they_are_near(machine, captured_ns, clock):
    machine.plug("video0", FakeCamera([Shot(flags=0, captured_ns=captured_ns + 1000)]))
    frames, _ = machine.run()
    assert (frames[0].clock, frames[0].stamp_reference) == (clock, StampReference.UNKNOWN)


def test_a_picture_from_before_the_start_is_not_delivered(machine):
    machine.plug("video0", FakeCamera([Shot(captured_ns=machine.now_ns - 1000), Shot()]))
    frames, camera = machine.run()
    assert [frame.sequence for frame in frames] == [1]
    assert camera.counts.text == ""


def test_a_damaged_picture_is_left_out_counted_and_said(machine, caplog):
    bad = Shot(flags=abi.FLAG_TIMESTAMP_MONOTONIC | abi.FLAG_ERROR)
    machine.plug("video0", FakeCamera([Shot(), bad, bad, Shot()]))
    frames, camera = machine.run()
    assert [frame.sequence for frame in frames] == [0, 3]
    assert epochs(frames) == [0, 0]
    assert camera.counts.skipped == {"the driver marked it as damaged": 2}
    assert [r.message for r in caplog.records if "left out" in r.message] == [
        "left: picture 1 left out: the driver marked it as damaged (1 so far)"
    ]


def test_a_short_picture_is_left_out(machine):
    machine.plug("video0", FakeCamera([Shot(bytesused=100), Shot()]))
    frames, camera = machine.run()
    assert [frame.sequence for frame in frames] == [1]
    assert camera.counts.text == "1 pictures left out (a picture of 100 bytes is 924 bytes short)"


def test_a_counter_of_32_bits_goes_on_when_it_wraps(machine):
    machine.plug("video0", FakeCamera([Shot(sequence=2**32 - 2), Shot(), Shot(), Shot()]))
    frames, _ = machine.run()
    assert [frame.sequence for frame in frames] == [2**32 - 2, 2**32 - 1, 2**32, 2**32 + 1]


def test_a_counter_that_is_set_back_is_passed_on_as_it_is(machine):
    machine.plug("video0", FakeCamera([Shot(sequence=500), Shot(sequence=3)]))
    frames, _ = machine.run()
    assert [frame.sequence for frame in frames] == [500, 3]


@pytest.mark.parametrize(
    ("trouble", "words"),
    [
        (failure(errno.EIO), "left: reading from it failed: Input/output error; trying again until it works"),
        (failure(errno.ENODEV), "left: it is gone; trying again until it works"),
        (POLL_ERROR, "left: it stopped with an error; trying again until it works"),
    ],
)
def test_a_camera_that_fails_is_opened_anew_with_a_new_epoch(machine, caplog, trouble, words):
    fake = machine.plug("video0", FakeCamera([*shots(3), trouble, *shots(2)]))
    frames, camera = machine.run()
    assert epochs(frames) == [0, 0, 0, 1, 1]
    assert [frame.sequence for frame in frames] == [0, 1, 2, 0, 1]
    assert camera.counts.restarts == 1
    assert machine.waits == [0.2]
    said = [record.message for record in caplog.records]
    assert said == [words, f"left: pictures again at {machine.dev}/video0, after 0.3 s"]
    assert not fake.is_open


def test_a_camera_that_comes_back_with_another_size_goes_on_in_a_new_epoch(machine):
    fake = machine.plug("video0", FakeCamera([Shot(), failure(errno.EIO), Shot()]))
    fake.steps.insert(1, lambda: setattr(fake, "sizes", ((64, 48),)))
    frames, _ = machine.run()
    assert [(frame.epoch, frame.image.shape) for frame in frames] == [(0, (16, 32)), (1, (48, 64))]


@pytest.mark.parametrize("request_number", [abi.QBUF, abi.STREAMON, abi.REQBUFS])
def test_a_refusal_of_the_driver_is_tried_again(machine, request_number):
    fake = FakeCamera([*shots(2), failure(errno.EIO), *shots(2)])

    def refuse():
        fake.fail[request_number].extend([failure(errno.EINVAL)] * 2)

    fake.steps.insert(2, refuse)
    machine.plug("video0", fake)
    frames, _ = machine.run()
    assert epochs(frames)[-2:] == [1, 1]
    assert len(machine.waits) >= 2
    assert not fake.is_open


def test_a_buffer_that_cannot_be_given_back_does_not_cost_its_picture(machine):
    fake = FakeCamera([Shot(level=1), Shot(level=2), Shot(level=3)])
    fake.steps.insert(1, lambda: fake.fail[abi.QBUF].append(failure(errno.EINVAL)))
    machine.plug("video0", fake)
    frames, _ = machine.run()
    assert [int(frame.image[0, 0]) for frame in frames] == [1, 2, 3]
    assert epochs(frames) == [0, 0, 1]


def test_waits_grow_to_two_seconds_and_start_anew_with_the_first_picture(machine):
    fake = FakeCamera([Shot(), failure(errno.EIO), Shot(), failure(errno.EIO), Shot()])
    fake.steps.insert(1, lambda: fake.fail[abi.STREAMON].extend([failure(errno.EIO)] * 8))
    machine.plug("video0", fake)
    machine.run()
    expected = [0.2, 0.3, 0.45, 0.675, 1.0125, 1.51875, 2.0, 2.0, 2.0, 0.2]
    assert machine.waits == pytest.approx(expected)


def test_a_silent_camera_is_opened_anew(machine, caplog):
    machine.plug("video0", FakeCamera([*shots(2), Silence(2.5), *shots(2)]))
    frames, _ = machine.run()
    assert epochs(frames) == [0, 0, 1, 1]
    assert "left: no picture for 2.1 s; trying again until it works" in [r.message for r in caplog.records]


def test_a_slow_camera_is_not_taken_for_a_silent_one(machine):
    machine.plug("video0", FakeCamera([Shot(), Silence(8), Shot()], fps=1))
    frames, _ = machine.run()
    assert epochs(frames) == [0, 0]


def test_a_camera_whose_trigger_may_pause_is_never_opened_anew_for_silence(machine):
    machine.plug("video0", FakeCamera([Shot(), Silence(100), Shot()]))
    frames, _ = machine.run(silent_after_s=None)
    assert epochs(frames) == [0, 0]


def test_damaged_pictures_alone_do_not_count_as_alive(machine):
    bad = [Shot(flags=abi.FLAG_ERROR) for _ in range(25)]
    machine.plug("video0", FakeCamera([Shot(), *bad, Shot()]))
    frames, camera = machine.run()
    assert epochs(frames) == [0, 1]
    assert sum(camera.counts.skipped.values()) == 25


def test_a_camera_that_comes_back_under_another_number_is_found_by_its_serial_number(machine):
    fake = FakeCamera([Shot(), UNPLUG, Shot()])

    def move():
        machine.unplug("video0")
        machine.plug("video0", FakeCamera(bus="usb-9", card="Another"), serial="other")
        machine.plug("video5", fake, serial="abc")
        fake.bus = "usb-7"

    machine.plug("video0", fake, serial="abc")
    fake.steps.insert(1, move)
    frames, camera = machine.run()
    assert epochs(frames) == [0, 1]
    assert camera.node.path.name == "video5"


def test_another_camera_in_its_place_is_not_taken_for_it(machine, caplog):
    fake = FakeCamera([Shot(), UNPLUG, Shot()])

    def replace():
        machine.unplug("video0")
        machine.plug("video0", FakeCamera(card="Another", bus="usb-1"))

    machine.plug("video0", fake)
    fake.steps.insert(1, replace)
    waited = machine.wait

    def wait(seconds):
        if len(machine.waits) == 3:
            machine.plug("video0", fake)
        return waited(seconds)

    machine.wait = wait
    frames, _ = machine.run()
    assert epochs(frames) == [0, 1]
    assert any("(Another, usb-1) is another camera: start anew" in record.message for record in caplog.records)


def test_a_camera_that_stays_away_is_told_of_once_for_each_reason(machine, caplog):
    fake = FakeCamera([Shot(), UNPLUG, Shot()])
    machine.plug("video0", fake)
    fake.steps.insert(1, lambda: machine.unplug("video0"))
    waited = machine.wait

    def wait(seconds):
        if len(machine.waits) == 20:
            machine.plug("video0", fake)
        return waited(seconds)

    machine.wait = wait
    frames, _ = machine.run()
    assert epochs(frames) == [0, 1]
    assert [r.message for r in caplog.records if "gone" in r.message] == [
        "left: it is gone; trying again until it works"
    ]


def test_stopping_is_heeded_while_waiting_to_open_anew(machine):
    fake = machine.plug("video0", FakeCamera([Shot(), failure(errno.EIO), Shot()]))
    fake.steps.insert(1, machine.stopped.set)
    frames, _ = machine.run()
    assert len(frames) == 1
    assert not fake.is_open


def test_what_the_driver_changed_is_said_once(machine, caplog):
    fake = FakeCamera([Shot(), failure(errno.EIO), Shot()], fps=10, most_buffers=3)
    machine.plug("video0", fake)
    machine.run(size=[640, 480], format="nv12", fps=30)
    assert [record.message for record in caplog.records if "asked" in record.message] == [
        "left: asked for NV12, the driver gives YUYV (it has YUYV, GREY)",
        "left: asked for 640x480, the driver gives 32x16",
        "left: asked for 30 fps, the driver gives 10",
        "left: asked for 4 buffers, the driver gives 3",
    ]
