"""Replaying real recordings."""

from __future__ import annotations

import logging
from itertools import islice

import pytest

from pipeline.frame import StampOrigin
from sources.replay.formats import recognise
from tests.sources.test_replay_kit import of, opened, replayed


@pytest.mark.parametrize(
    ("name", "recording_format", "count", "fps"),
    [
        ("boof_backyard", "folders", 191, 30),
        ("calis_charuco", "caliscope", 111, 6),
        ("euroc_v101_start", "euroc", 95, 20),
        ("face_3dcam", "videos", 1112, 29.97),
        ("hand_2webcam", "videos", 378, 30),
        ("kitti_odo_seq1", "folders", 51, 30),
        ("p2s_single_60fps", "videos", 100, 60),
        ("robot_static", "videos", 147, 30),
        ("rover_rand", "folders", 325, 30),
        ("webcams_loose", "videos", 190, 20),
    ],
)
def test_a_real_recording_is_recognised_with_its_frames_and_rate(recordings, name, recording_format, count, fps):
    source = opened(recordings / name)

    assert recognise([recordings / name]) == recording_format
    assert source.frame_count == count
    assert [camera.fps for camera in source.cameras] == pytest.approx([fps] * len(source.cameras), abs=0.01)


@pytest.mark.parametrize(
    ("name", "cameras"),
    [
        ("kitti_odo_seq1", ["left", "right"]),
        ("p2s_single_60fps", ["cam01", "cam02", "cam03", "cam04"]),
        ("calis_charuco", ["cam_0", "cam_1", "cam_2", "cam_3"]),
    ],
)
def test_cameras_of_real_recordings_have_their_names(recordings, name, cameras):
    assert [camera.name for camera in opened(recordings / name).cameras] == cameras


def test_kitti_is_grouped_by_file_number_without_holes(recordings):
    frames = replayed(recordings / "kitti_odo_seq1", fps=10)

    assert [(f.camera, f.group) for f in frames] == [(c, n) for n in range(51) for c in ("left", "right")]
    assert {f.image.shape for f in frames} == {(370, 1226)}


def test_euroc_is_paired_by_its_own_stamps(recordings):
    frames = replayed(recordings / "euroc_v101_start")

    assert [len(of(frames, camera)) for camera in ("left", "right")] == [95, 95]
    assert {(f.group, f.stamp_origin) for f in frames} == {(None, StampOrigin.DEVICE)}
    assert frames[0].captured_ns == 1403715273262142976


def test_boof_comes_in_natural_order(recordings):
    left = of(replayed(recordings / "boof_backyard"), "left")

    assert [f.sequence for f in left] == list(range(1, 192))
    assert [f.group for f in left] == list(range(191))


def test_a_mocap_rig_has_a_camera_of_another_size(recordings):
    first = islice(opened(recordings / "p2s_single_60fps").frames(), 4)

    assert {f.camera: f.image.shape[1] for f in first} == {"cam01": 1080, "cam02": 1080, "cam03": 1088, "cam04": 1088}


@pytest.mark.parametrize("name", ["webcams_loose", "robot_static"])
def test_a_real_video_has_as_many_frames_as_it_says(recordings, caplog, name):
    source = opened(recordings / name)

    assert len(of(source.frames(), "right")) == source.frame_count
    assert [record for record in caplog.records if record.levelno > logging.INFO] == []
