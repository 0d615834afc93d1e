"""Which recordings an archive holds."""

from __future__ import annotations

import errno
import os
from pathlib import Path

import pytest

from pipeline.audit.find import find
from pipeline.audit.task import file_facts, fingerprint
from tests.formats import STAMPED, UNSTAMPED, rendered, scene_of, side_by_side, top_bottom
from tests.programs import write_folders


@pytest.fixture(scope="module")
def scene():
    source = rendered(0.4)
    source.open()
    return scene_of(source.frames())


def found(*roots, skip=()):
    """Format, or trouble, by path from the first root."""
    return {os.path.relpath(one.path, roots[0]): one.format or one.trouble for one in find(roots, skip)}


@pytest.mark.parametrize("name", [*STAMPED, *UNSTAMPED])
def test_a_recording_in_every_format_is_found_once_and_nothing_inside_of_it(tmp_path, scene, name):
    path = {**STAMPED, **UNSTAMPED}[name](tmp_path / "day" / "recording", scene)
    told = found(tmp_path)
    assert len(told) == 1, told
    where, kind = next(iter(told.items()))
    assert (tmp_path / where) in {path, tmp_path / "day" / "recording"}
    aliases = {"side_by_side": "halves", "top_bottom": "halves"}
    assert kind in {aliases.get(name, name.partition("_")[0]), "mcap"}


def test_an_archive_is_looked_through_at_every_depth(tmp_path, scene):
    write_folders(tmp_path / "hall1" / "monday" / "first", 12)
    write_folders(tmp_path / "hall1" / "monday" / "second", 12)
    UNSTAMPED["videos"](tmp_path / "hall2", scene)
    (tmp_path / "hall2" / "notes.txt").write_text("a pair of videos and something else")
    (tmp_path / "hall2" / "calibration").mkdir()
    assert found(tmp_path) == {
        "hall1/monday/first": "folders",
        "hall1/monday/second": "folders",
        "hall2": "videos",
    }


def test_recordings_with_a_preview_beside_them_are_not_the_cameras_of_one_recording(tmp_path):
    for day in ("one", "two"):
        folder = write_folders(tmp_path / day, 12)
        (folder / "preview.png").write_bytes((folder / "left" / "left0.png").read_bytes())
    assert found(tmp_path) == {"one": "folders", "two": "folders"}


def test_videos_with_two_views_each_are_not_the_cameras_of_one_recording(tmp_path, scene):
    side_by_side(tmp_path / "wide", scene).rename(tmp_path / "first.avi")
    top_bottom(tmp_path / "high", scene).rename(tmp_path / "second.avi")
    assert found(tmp_path) == {"first.avi": "halves", "second.avi": "halves"}


def test_what_is_hidden_is_left_out(tmp_path):
    write_folders(tmp_path / ".trash" / "old", 12)
    write_folders(tmp_path / "rig", 12)
    assert found(tmp_path) == {"rig": "folders"}


def test_links_lead_on_but_never_in_circles_and_nothing_is_found_twice(tmp_path):
    archive, elsewhere = tmp_path / "archive", tmp_path / "elsewhere"
    write_folders(archive / "z" / "real", 12)
    write_folders(elsewhere / "linked", 12)
    (archive / "a").mkdir()
    (archive / "a" / "latest").symlink_to(archive / "z" / "real")
    (archive / "a" / "up").symlink_to(archive)
    (archive / "a" / "one_side").symlink_to(archive / "z" / "real" / "left")
    (archive / "a" / "self").symlink_to(archive / "a" / "self")
    (archive / "a" / "gone").symlink_to(archive / "nothing")
    (archive / "other").symlink_to(elsewhere)
    assert found(archive, archive / "z") == {"z/real": "folders", "other/linked": "folders"}


def test_one_camera_alone_is_told_once_with_its_folder(tmp_path, scene):
    STAMPED["euroc"](tmp_path / "drone", {"left": scene["left"]})
    UNSTAMPED["videos"](tmp_path / "phone", {"left": scene["left"]})
    write_folders(tmp_path / "half", 12, sides=("left",))
    (tmp_path / "phone" / "clips").mkdir()
    assert found(tmp_path) == {
        "drone": "one camera only (EuRoC camera 'cam0')",
        "phone": "one camera only (video 'left.avi')",
        "half/left": "one camera only (12 pictures)",
    }


def test_a_few_pictures_are_no_recording(tmp_path):
    write_folders(tmp_path / "docs", 3, sides=("figures",))
    assert found(tmp_path) == {}


def test_containers_that_are_empty_are_told(tmp_path):
    for name in ("a.bag", "b.mcap", "c.db3"):
        (tmp_path / name).touch()
    (tmp_path / "d.txt").touch()
    assert found(tmp_path) == {
        name: f"empty or damaged: no {name[2:]} file, as its name says" for name in ("a.bag", "b.mcap", "c.db3")
    }


def test_a_folder_that_cannot_be_looked_into_hides_nothing_beside_it(tmp_path, monkeypatch):
    """As for somebody who is not root: both listing it and asking for a file in it are refused."""
    write_folders(tmp_path / "day" / "rig", 12)
    secret = tmp_path / "day" / "secret"
    secret.mkdir()
    scandir, is_file = os.scandir, Path.is_file

    def refuse(path):
        if Path(path) == secret or secret in Path(path).parents:
            raise PermissionError(errno.EACCES, "Permission denied", str(path))

    monkeypatch.setattr(os, "scandir", lambda path: refuse(path) or scandir(path))
    monkeypatch.setattr(Path, "is_file", lambda path: refuse(path) or is_file(path))
    assert found(tmp_path) == {"day/rig": "folders", "day/secret": f"{secret}: cannot be read: Permission denied"}


def test_special_files_are_left_alone(tmp_path):
    os.mkfifo(tmp_path / "left.mp4")
    os.mkfifo(tmp_path / "pipe.bag")
    write_folders(tmp_path / "rig", 12)
    assert "rig" in found(tmp_path)


def test_results_inside_of_an_archive_are_no_part_of_it(tmp_path):
    rig = write_folders(tmp_path / "rig", 12)
    results = write_folders(tmp_path / "rig" / "audit", 12)
    before = fingerprint(file_facts(rig, {str(results)}))
    (results / "left" / "left0.png").unlink()
    assert fingerprint(file_facts(rig, {str(results)})) == before != fingerprint(file_facts(rig))


@pytest.mark.parametrize("harm", ["added", "removed", "longer", "touched"])
def test_the_fingerprint_tells_every_change_of_files(tmp_path, harm):
    rig = write_folders(tmp_path / "rig", 3)
    before = fingerprint(file_facts(rig))
    assert fingerprint(file_facts(rig)) == before
    picture = rig / "right" / "right1.png"
    if harm == "added":
        (rig / "right" / "right9.png").write_bytes(picture.read_bytes())
    elif harm == "removed":
        picture.unlink()
    elif harm == "longer":
        status = picture.stat()
        picture.write_bytes(picture.read_bytes() + b"x")
        os.utime(picture, ns=(status.st_atime_ns, status.st_mtime_ns))
    else:
        os.utime(picture, ns=(1, 1))
    assert fingerprint(file_facts(rig)) != before


def test_the_real_archive(recordings):
    formats = {
        "boof_backyard": "folders",
        "calis_charuco": "caliscope",
        "euroc_v101_start": "euroc",
        "face_3dcam": "videos",
        "hand_2webcam": "videos",
        "kitti_odo_seq1": "folders",
        "p2s_single_60fps": "videos",
        "robot_static": "videos",
        "rover_rand": "folders",
        "webcams_loose": "videos",
    }
    assert found(recordings) == formats
