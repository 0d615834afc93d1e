"""Two cameras of a real kernel, and every fault its virtual driver can have."""

from __future__ import annotations

import os
import re
from itertools import pairwise

import pytest
import yaml

from pipeline.errors import InputError
from pipeline.frame import NS_PER_S, StampReference
from tests.guest.machine import (
    GREY_SMALL,
    LEFT,
    PERIOD_NS,
    RIGHT,
    configuration,
    control,
    gaps_agree,
    unplug_and_replug,
    watched,
)
from tests.programs import inside

MISSING_WITHIN_NS = 3 * PERIOD_NS + NS_PER_S // 2
SLOW_NS = 5 * NS_PER_S
"""What an emulated machine may take to say what it knows."""


def stamps(frames) -> list[tuple[int, int]]:
    return [(one.sequence, one.captured_ns) for one in frames]


def test_both_cameras_deliver_with_counters_and_stamps_of_one_clock(vivid):
    with watched(configuration()) as run:
        for camera in ("left", "right"):
            frames = run.until_frames(camera, 20)
            assert {(one.clock, one.reference, one.epoch) for one in frames} == {("monotonic", StampReference.END, 0)}
            assert {one.shape for one in frames} == {(180, 320)}
            gaps_agree(stamps(frames), PERIOD_NS)
        run.until(lambda: any(verdict.evidence and verdict.interval_ns is not None for verdict in run.verdicts))


@pytest.mark.parametrize("name", ["YUYV", "NV12", "Y16", "SRGGB8", "RGB3"])
def test_every_format_shows_the_same_picture(vivid, name):
    config = configuration()
    config["source"]["cameras"]["right"]["format"] = name
    with watched(config) as run:
        frames = run.until_frames("right", 3)
        assert {one.shape for one in frames} == {(180, 320)}


def test_a_stamp_at_the_start_of_exposure_is_told_from_one_at_the_end(vivid):
    control(RIGHT, timestamp_source=1)
    with watched(configuration()) as run:
        assert run.until_frames("right", 2)[0].reference is StampReference.START
        assert run.until_frames("left", 2)[0].reference is StampReference.END


def test_what_the_driver_changes_is_said(vivid):
    config = configuration()
    config["source"]["cameras"]["right"].update(size=[322, 181], fps=60)
    with watched(config) as run:
        assert "right: asked for 322x181, the driver gives 320x180" in run.log
        run.until_frames("right", 2)


def test_lost_frames_are_counted_for_the_camera_that_lost_them(vivid):
    with watched(configuration()) as run:
        run.until_frames("right", 5)
        control(RIGHT, percentage_of_dropped_buffers=30)
        run.until_frames("right", 60)
        control(RIGHT, percentage_of_dropped_buffers=0)
        for camera in ("left", "right"):
            gaps_agree(stamps(run.of(camera, 0)), PERIOD_NS)
        lost = run.of("right")[-1].sequence + 1 - len(run.of("right"))
        run.until(lambda: run.status and run.status.cameras["right"].drops >= lost // 2)
        lost_before = {name: camera.drops - camera.overwritten for name, camera in run.status.cameras.items()}
        assert lost_before["right"] > 2 * lost_before["left"]
        run.until(lambda: run.begun("drop", "right"))


def test_a_silent_camera_is_missing_and_opened_anew_until_it_is_back(vivid):
    with watched(configuration()) as run:
        run.until_frames("right", 20)
        control(RIGHT, percentage_of_dropped_buffers=100)
        onset = run.until(lambda: run.missing("right", "onset"))[0]
        assert onset.pair == "left-right"
        assert run.told_ns(onset) - run.of("right")[-1].arrived_ns < MISSING_WITHIN_NS + SLOW_NS
        run.until(lambda: any("right: no picture for" in text for text in run.log))
        control(RIGHT, percentage_of_dropped_buffers=0)
        run.until_frames("right", 5, epoch=1)
        run.until(lambda: run.missing("right", "end"))
        assert {one.epoch for one in run.of("left")} == {0}
        assert any("right: pictures again" in text for text in run.log)
        assert not run.wrongly_missing("left")


def test_the_first_camera_silent_is_told_as_well(vivid):
    with watched(configuration()) as run:
        run.until_frames("left", 20)
        control(LEFT, percentage_of_dropped_buffers=100)
        run.until(lambda: run.missing("left", "onset"))
        control(LEFT, percentage_of_dropped_buffers=0)
        run.until(lambda: run.missing("left", "end"))
        assert not run.wrongly_missing("right")


def test_both_cameras_silent_are_told_while_nothing_comes(vivid):
    with watched(configuration()) as run:
        run.until_frames("left", 20)
        for device in (LEFT, RIGHT):
            control(device, percentage_of_dropped_buffers=100)
        onset = run.until(lambda: run.missing("left", "onset"))[0]
        assert onset.text
        for device in (LEFT, RIGHT):
            control(device, percentage_of_dropped_buffers=0)
        run.until(lambda: run.missing("left", "end"))


def test_a_damaged_buffer_is_left_out_and_is_a_gap_of_one(vivid):
    with watched(configuration()) as run:
        run.until_frames("right", 10)
        control(RIGHT, inject_v4l2_buf_flag_error=1)
        said = run.until(lambda: [text for text in run.log if "left out" in text])
        number = int(said[0].split()[2])
        assert said == [f"right: picture {number} left out: the driver marked it as damaged (1 so far)"]
        run.until(lambda: run.of("right")[-1].sequence > number)
        assert number not in {one.sequence for one in run.of("right")}
        assert {one.epoch for one in run.of("right")} == {0}
        gaps_agree(stamps(run.of("right")), PERIOD_NS)
        run.until(lambda: any("drop" in verdict.notes for verdict in run.verdicts))
        for _ in range(2):
            count = len(run.of("right"))
            control(RIGHT, inject_v4l2_buf_flag_error=1)
            run.until_frames("right", count + 5)
        run.until(lambda: run.begun("drop", "right"))


def test_a_fatal_error_while_streaming_is_survived(vivid):
    with watched(configuration()) as run:
        run.until_frames("right", 10)
        control(RIGHT, inject_fatal_streaming_error=1)
        frames = run.until_frames("right", 10, epoch=1)
        assert frames[0].sequence <= 1
        assert {one.epoch for one in run.of("left")} == {0}
        assert any(text.startswith("right: ") and "failed: Input/output error" in text for text in run.log)
        run.until(lambda: run.status and run.status.cameras["right"].restarts == 1)
        assert run.status.cameras["left"].restarts == 0
        run.until(lambda: run.begun("restarted", "right"))
        assert not run.begun("restarted", "left")


@pytest.mark.parametrize(
    ("fault", "words"),
    [
        ("inject_vidioc_streamon_error", "right: starting it failed: Invalid argument"),
        ("inject_vidioc_reqbufs_error", "right: asking for buffers failed: Invalid argument"),
    ],
)
def test_a_camera_that_refuses_to_start_again_is_asked_until_it_does(vivid, fault, words):
    with watched(configuration()) as run:
        run.until_frames("right", 10)
        control(RIGHT, **{fault: 1})
        control(RIGHT, inject_fatal_streaming_error=1)
        run.until_frames("right", 5, epoch=1)
        assert any(words in text for text in run.log)
        assert {one.epoch for one in run.of("left")} == {0}
        run.until(lambda: run.begun("restarted", "right"))


def test_a_buffer_that_is_refused_is_survived(vivid):
    with watched(configuration()) as run:
        run.until_frames("right", 10)
        control(RIGHT, inject_vidioc_qbuf_error=1)
        run.until_frames("right", 5, epoch=1)
        assert any("right: giving a buffer back failed: Invalid argument" in text for text in run.log)
        run.until(lambda: run.begun("restarted", "right"))


def test_a_camera_that_is_disconnected_comes_back(vivid):
    with watched(configuration()) as run:
        run.until_frames("right", 10)
        control(RIGHT, disconnect=1)
        run.until_frames("right", 10, epoch=1)
        assert any(text.startswith("right: it is gone") for text in run.log)
        assert {one.epoch for one in run.of("left")} == {0}
        run.until(lambda: run.begun("restarted", "right"))
        assert not run.begun("restarted", "left")
        assert not run.wrongly_missing("left")


def test_a_counter_that_wraps_goes_on(vivid):
    control(RIGHT, wrap_sequence_number=True)
    config = configuration()
    for camera in config["source"]["cameras"].values():
        camera["fps"] = 25
    with watched(config) as run:
        frames = run.until(lambda: run.of("right") and run.of("right")[-1].sequence > 2**32 + 5 and run.of("right"))
        assert frames[0].sequence < 2**32
        assert all(later.sequence > earlier.sequence for earlier, later in pairwise(frames))
        past = run.until(lambda: [one for one in run.verdicts if (one.sequence["right"] or 0) >= 2**32])
        assert "counter_reset" not in past[0].notes


def test_cameras_that_are_unplugged_and_plugged_in_again_are_found(vivid):
    with watched(configuration(left="platform:vivid-000", right=RIGHT)) as run:
        run.until_frames("right", 10)
        unplug_and_replug(lambda: run.until(lambda: run.missing("left", "onset")))
        run.until_frames("left", 5, epoch=1)
        run.until_frames("right", 5, epoch=1)
        assert any(text.startswith("right: it is gone") for text in run.log)
        run.until(lambda: run.missing("left", "end"))


def test_a_camera_that_comes_back_under_another_number_is_found(vivid):
    with watched(configuration()) as run:
        run.until_frames("right", 10)
        held = os.open(RIGHT, os.O_RDWR)  # so that its number is not free when it comes back
        try:
            unplug_and_replug(lambda: run.until(lambda: any("right: it is gone" in text for text in run.log)))
            run.until_frames("right", 5, epoch=1)
            assert any("right: pictures again at /dev/video" in text and RIGHT not in text for text in run.log)
        finally:
            os.close(held)
    unplug_and_replug()


def test_a_camera_that_is_not_there_is_an_error_that_names_those_that_are(vivid):
    with pytest.raises(InputError) as caught, watched(configuration(right="/dev/video9")):
        pass
    said = str(caught.value)
    assert "source.cameras.right.device: no camera '/dev/video9'" in said
    assert "/dev/video0 (vivid, platform:vivid-000), /dev/video2 (vivid, platform:vivid-001)" in said


def test_what_the_command_proposes_is_valid_and_delivers(vivid, tmp_path):
    listed = inside("cameras", cwd=tmp_path).stdout
    assert re.search(r"^/dev/video0 +vivid +platform:vivid-000$", listed, re.MULTILINE)
    assert "YUYV" in listed
    source = yaml.safe_load(listed.partition("\n\n")[2])["source"]
    virtual = [camera for camera in source["cameras"].values() if camera["device"].startswith("platform:vivid")]
    proposed = configuration()
    proposed["source"] = {**source, "cameras": dict(zip(("left", "right"), virtual, strict=True))}
    (tmp_path / "rig.yaml").write_text(yaml.safe_dump(proposed))
    validated = inside("validate", "rig.yaml", cwd=tmp_path)
    assert (validated.returncode, "left-right (in sync within" in validated.stdout) == (0, True), validated.stderr
    with watched(proposed) as run:
        run.until_frames("left", 2)
        run.until_frames("right", 2)


def test_a_camera_that_another_program_streams_from_is_an_error(vivid):
    with watched(configuration()) as run:
        run.until_frames("right", 2)
        with (
            pytest.raises(InputError, match="left: /dev/video0: another program is using it"),
            watched(configuration()),
        ):
            pass


def test_the_size_that_is_asked_for_is_what_comes(vivid):
    config = configuration()
    config["source"]["cameras"]["right"].update({**GREY_SMALL, "size": [640, 360]})
    with watched(config) as run:
        assert run.until_frames("right", 2)[0].shape == (360, 640)
