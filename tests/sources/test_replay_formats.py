"""What a replay takes for a recording, how its cameras are named, and what it says to everything else."""

from __future__ import annotations

import re
from pathlib import Path

import pytest
from pydantic import ValidationError

from pipeline.errors import InputError
from sources.replay.formats import recognise
from sources.replay.settings import ReplaySettings
from sources.replay.source import ReplaySource
from tests.sources.test_replay_kit import (
    opened,
    picture,
    replayed,
    shown,
    write_euroc,
    write_folder,
    write_folders,
    write_video,
)

ONE_CAMERA = "two or more are needed; give the folder that holds all cameras, or one path a camera"


def names(source: ReplaySource) -> list[str]:
    return [camera.name for camera in source.cameras]


def test_streams_given_one_by_one_are_recognised(tmp_path):
    write_folders(tmp_path)
    videos = [write_video(tmp_path / f"{name}.avi") for name in "ab"]

    assert recognise([tmp_path / "left", tmp_path / "right"]) == "folders"
    assert recognise(videos) == "videos"


def test_a_format_by_name_wins_over_the_order_of_recognition(tmp_path):
    write_folders(tmp_path)
    write_video(tmp_path / "a.avi", count=1)
    write_video(tmp_path / "b.avi", count=1)

    assert len(replayed(tmp_path, fps=10)) == 6
    assert len(replayed(tmp_path, format="videos")) == 2


def test_a_wrong_format_by_name_is_answered_with_the_right_one(tmp_path):
    with pytest.raises(InputError, match="not in the format 'euroc': it looks like 'folders'"):
        opened(write_folders(tmp_path), format="euroc")


def test_two_streams_are_left_and_right_in_natural_order(tmp_path):
    write_folder(tmp_path / "cam10", {"0.png": picture(10)})
    write_folder(tmp_path / "cam2", {"0.png": picture(2)})

    assert [(f.camera, shown(f)) for f in replayed(tmp_path, fps=10)] == [("left", 2), ("right", 10)]


def test_two_paths_are_left_and_right_in_the_order_given(tmp_path):
    write_folder(tmp_path / "a", {"0.png": picture(1)})
    write_folder(tmp_path / "b", {"0.png": picture(2)})

    frames = replayed([tmp_path / "b", tmp_path / "a"], fps=10)

    assert [(f.camera, shown(f)) for f in frames] == [("left", 2), ("right", 1)]


def test_more_streams_take_their_sanitised_names(tmp_path):
    write_folders(tmp_path, cameras=["Front Left", "cam-2", "rear.wide"])

    assert names(opened(tmp_path, fps=10)) == ["cam_2", "front_left", "rear_wide"]


def test_streams_of_one_name_take_their_folders_name_too(tmp_path):
    videos = [write_video(tmp_path / place / "video.avi", count=1) for place in ("north", "south", "west")]

    assert names(opened(videos)) == ["north_video", "south_video", "west_video"]


def test_streams_that_still_share_a_name_are_counted_on(tmp_path):
    for name in ("cam.avi", "cam.mp4", "CAM.avi"):
        write_video(tmp_path / "x" / name, count=1)

    assert sorted(names(opened(tmp_path / "x"))) == ["x_cam", "x_cam_2", "x_cam_3"]


def test_names_by_configuration_win(tmp_path):
    assert names(opened(write_folders(tmp_path), fps=10, cameras=["port", "starboard"])) == ["port", "starboard"]


def test_another_number_of_names_than_streams_is_refused(tmp_path):
    with pytest.raises(
        InputError,
        match=r"cameras: 3 names \(a, b, c\) for 2 streams \(left, right\): give one name a stream, in that order",
    ):
        opened(write_folders(tmp_path), fps=10, cameras=["a", "b", "c"])


def test_a_relative_path_counts_from_the_base(tmp_path):
    write_folders(tmp_path / "recordings" / "one")
    source = ReplaySource(ReplaySettings(path="recordings/one", fps=10), base=tmp_path)

    source.open()

    assert source.frame_count == 3


def test_a_path_that_does_not_exist_is_named(tmp_path):
    with pytest.raises(InputError, match=rf"^no such file or folder: {tmp_path}/nowhere$"):
        opened([tmp_path, tmp_path / "nowhere"])


def test_an_empty_folder_is_called_empty(tmp_path):
    (tmp_path / ".DS_Store").write_bytes(b"")

    with pytest.raises(
        InputError,
        match=rf"^{tmp_path} is empty: expected an MCAP file, .* two or more videos, or one with both views$",
    ):
        opened(tmp_path)


def one_picture_folder(root: Path) -> Path:
    return write_folder(root / "left", [f"{n}.png" for n in range(5)])


def one_folder_beside_notes(root: Path) -> Path:
    one_picture_folder(root)
    (root / "right").mkdir()
    return root


def one_euroc_camera(root: Path) -> Path:
    return write_euroc(root, [1, 2, 3])


def one_video_in_a_folder(root: Path) -> Path:
    return write_video(root / "left.avi").parent


def one_video(root: Path) -> Path:
    return write_video(root / "left.avi")


@pytest.mark.parametrize(
    ("name", "said"),
    [
        ("left.mp4", "left.mp4: cannot be opened as a video: it is damaged, empty or of an unknown kind"),
        ("drive.mcap", "drive.mcap is empty (0 bytes): expected an MCAP file"),
        ("drive.bag", "drive.bag is empty (0 bytes): expected an MCAP file"),
    ],
)
def test_a_file_that_is_not_what_its_name_says_is_told(tmp_path, name, said):
    (tmp_path / name).touch()
    with pytest.raises(InputError, match=re.escape(f"{tmp_path}/{said}")):
        opened(tmp_path / name)


def test_a_folder_around_a_container_asks_for_the_file(tmp_path):
    for name in ("noon.mcap", "night.mcap"):
        (tmp_path / name).write_bytes(b"\x89MCAP0\r\n" + bytes(100))
    (tmp_path / "notes.txt").touch()
    with pytest.raises(InputError, match=r"a folder with night\.mcap, noon\.mcap in it: name the file that is meant"):
        opened(tmp_path)


@pytest.mark.parametrize(
    ("make", "found"),
    [
        (one_picture_folder, "5 pictures"),
        (one_folder_beside_notes, "folder 'left', 5 pictures"),
        (one_euroc_camera, "EuRoC camera 'cam0'"),
        (one_video_in_a_folder, "video 'left.avi'"),
        (one_video, "video 'left.avi'"),
    ],
)
def test_one_camera_only_says_what_was_found_and_what_to_do(tmp_path, make, found):
    path = make(tmp_path)

    with pytest.raises(InputError) as caught:
        opened(path)
    assert str(caught.value) == f"{path}: one camera only ({found}): {ONE_CAMERA}"


def test_a_single_picture_is_no_recording(tmp_path):
    with pytest.raises(InputError, match=r"0.png: a single picture: expected"):
        opened(one_picture_folder(tmp_path) / "0.png")


def test_another_file_is_no_recording(tmp_path):
    (tmp_path / "notes.txt").write_text("hello")

    with pytest.raises(InputError, match=r"notes.txt: no recording that is known: expected"):
        opened(tmp_path / "notes.txt")
    with pytest.raises(InputError, match=rf"^{tmp_path}: no recording that is known: expected"):
        opened(tmp_path)


def test_folders_and_videos_do_not_mix(tmp_path):
    folder, video = one_picture_folder(tmp_path), write_video(tmp_path / "right.avi")

    with pytest.raises(InputError, match=r"left is a folder and .*right.avi is a file: several paths are all folders"):
        opened([folder, video])


def test_several_paths_to_files_that_are_no_videos_are_refused(tmp_path):
    video, text = write_video(tmp_path / "left.avi"), tmp_path / "right.txt"
    text.write_text("hello")

    with pytest.raises(InputError, match=r"right.txt: not a video: expected one of mp4, avi"):
        opened([video, text])


def test_a_folder_given_as_a_stream_needs_pictures(tmp_path):
    folder = one_picture_folder(tmp_path)
    (tmp_path / "right").mkdir()

    with pytest.raises(InputError, match=r"right: no pictures in this folder: expected png, jpg"):
        opened([folder, tmp_path / "right"])


def test_a_folder_that_cannot_be_listed_is_named(tmp_path, monkeypatch):
    def refuse(path):
        raise PermissionError(13, "Permission denied")

    monkeypatch.setattr("os.scandir", refuse)

    with pytest.raises(InputError, match=rf"^{tmp_path}: cannot be read: Permission denied$"):
        opened(tmp_path)


def test_a_folder_below_that_cannot_be_looked_into_is_named(tmp_path, monkeypatch):
    secret = tmp_path / "secret"
    secret.mkdir()
    is_file = Path.is_file

    def refuse(path):
        if secret in path.parents:
            raise PermissionError(13, "Permission denied", str(path))
        return is_file(path)

    monkeypatch.setattr(Path, "is_file", refuse)
    with pytest.raises(InputError, match=rf"^{secret}/.*: cannot be read: Permission denied$"):
        opened(tmp_path)


@pytest.mark.parametrize(
    "settings",
    [
        {"fps": 0},
        {"fps": -1},
        {"fps": float("nan")},
        {"speed": 0},
        {"speed": "fast"},
        {"cameras": ["Left", "right"]},
        {"cameras": ["left", "left"]},
        {"path": []},
        {"path": ""},
        {"pair_by": "luck"},
        {"format": "betamax"},
        {"colour": True},
    ],
)
def test_settings_that_cannot_be_meant_are_refused(settings):
    with pytest.raises(ValidationError, match=next(iter(settings))):
        ReplaySettings.model_validate({"path": "x", **settings})


def test_settings_default_to_full_speed_once_through():
    settings = ReplaySettings(path="x")

    assert (settings.speed, settings.loop, settings.fps, settings.format) == ("max", False, None, "auto")
    assert (settings.cameras, settings.pair_by, settings.trust_stamps) == (None, "auto", False)
