"""Replaying folders of pictures."""

from __future__ import annotations

import pytest

from pipeline.errors import InputError
from pipeline.frame import StampOrigin
from tests.sources.test_replay_kit import of, opened, picture, replayed, said, shown, write_folder, write_folders

EPOCH_NS = 1_403_715_273_262_142_976
MS = 1_000_000


def test_frames_alternate_over_the_cameras_with_equal_groups(tmp_path):
    frames = replayed(write_folders(tmp_path, count=3), fps=10)

    assert [(f.camera, f.group, f.sequence, shown(f)) for f in frames] == [
        ("left", 0, 0, 0),
        ("right", 0, 0, 0),
        ("left", 1, 1, 1),
        ("right", 1, 1, 1),
        ("left", 2, 2, 2),
        ("right", 2, 2, 2),
    ]


def test_stamps_are_synthesised_from_the_group_and_fps(tmp_path):
    frames = replayed(write_folders(tmp_path, count=3), fps=30)

    assert [f.captured_ns for f in of(frames, "right")] == [0, 33_333_333, 66_666_667]
    assert {f.stamp_origin for f in frames} == {StampOrigin.SYNTHESISED}
    assert len({f.clock for f in frames}) == 1


def test_without_fps_30_is_assumed_and_said_once(tmp_path, caplog):
    source = opened(write_folders(tmp_path))

    assert [camera.fps for camera in source.cameras] == [30, 30]
    assert said(caplog) == ["no frame rate known: 30 is assumed; give --fps or source.fps"]


def test_with_fps_nothing_is_assumed(tmp_path, caplog):
    source = opened(write_folders(tmp_path), fps=12.5)

    assert [camera.fps for camera in source.cameras] == [12.5, 12.5]
    assert said(caplog) == []


def test_unpadded_numbers_come_in_natural_order(tmp_path):
    for side in ("left", "right"):
        write_folder(tmp_path / side, [f"{side}{n}.png" for n in range(1, 13)])

    left = of(replayed(tmp_path, fps=10), "left")

    assert [shown(f) for f in left] == list(range(12))
    assert [f.sequence for f in left] == list(range(1, 13))
    assert [f.group for f in left] == list(range(12))


def test_a_number_missing_on_one_side_is_a_hole_on_that_side_only(tmp_path):
    write_folders(tmp_path, count=5)
    (tmp_path / "right" / "000002.png").unlink()

    frames = replayed(tmp_path, fps=10)

    assert [f.group for f in of(frames, "left")] == [0, 1, 2, 3, 4]
    assert [(f.group, shown(f)) for f in of(frames, "right")] == [(0, 0), (1, 1), (3, 3), (4, 4)]


def test_numbers_that_rise_by_ten_give_neighbouring_groups_and_holes_stay_holes(tmp_path):
    for side in ("left", "right"):
        write_folder(tmp_path / side, [f"{n:05}.png" for n in (100, 110, 120, 140)])

    left = of(replayed(tmp_path, fps=10), "left")

    assert [f.group for f in left] == [0, 1, 2, 4]
    assert [f.sequence for f in left] == [100, 110, 120, 140]


def test_one_side_that_starts_later_keeps_its_groups_and_both_excesses_are_said(tmp_path, caplog):
    write_folder(tmp_path / "left", [f"{n}.png" for n in range(5)])
    write_folder(tmp_path / "right", [f"{n}.png" for n in range(2, 8)])

    frames = replayed(tmp_path, fps=10)

    assert [f.group for f in of(frames, "right")] == [2, 3, 4, 5, 6, 7]
    assert said(caplog) == [
        "left has 2 frames that right does not have; right has 3 frames that left does not have: they have no partner"
    ]


def test_names_without_numbers_pair_by_place_and_that_is_said_once(tmp_path, caplog):
    for side in ("left", "right"):
        write_folder(tmp_path / side, ["a.png", "b.png"])

    frames = replayed(tmp_path, fps=10)

    assert [(f.camera, f.group, f.sequence) for f in frames] == [
        ("left", 0, 0),
        ("right", 0, 0),
        ("left", 1, 1),
        ("right", 1, 1),
    ]
    assert said(caplog) == [
        f"{tmp_path}/left/a.png: no number in the file name: frames are paired by their place in natural order"
    ]


def test_repeated_last_numbers_pair_by_place(tmp_path, caplog):
    for side in ("left", "right"):
        write_folder(tmp_path / side, ["000000_10.png", "000001_10.png"])

    assert [f.group for f in of(replayed(tmp_path, fps=10), "right")] == [0, 1]
    assert "000000_10.png and 000001_10.png have the same number 10" in said(caplog)[0]


def test_numbers_of_which_less_than_half_are_shared_pair_by_place(tmp_path, caplog):
    write_folder(tmp_path / "left", [f"{n}.png" for n in (0, 1, 2, 3, 4)])
    write_folder(tmp_path / "right", [f"{n}.png" for n in (3, 4, 5, 6, 7)])

    assert [f.group for f in of(replayed(tmp_path, fps=10), "right")] == [0, 1, 2, 3, 4]
    assert "only 2 of 5 file numbers are also in" in said(caplog)[0]


def test_numbers_of_which_half_are_shared_pair_by_number(tmp_path):
    write_folder(tmp_path / "left", [f"{n}.png" for n in (0, 1, 2, 3)])
    write_folder(tmp_path / "right", [f"{n}.png" for n in (2, 3, 4, 5)])

    assert [f.group for f in of(replayed(tmp_path, fps=10), "right")] == [2, 3, 4, 5]


def test_pair_by_number_takes_numbers_that_are_hardly_shared(tmp_path):
    write_folder(tmp_path / "left", [f"{n}.png" for n in (0, 1, 2, 3, 4)])
    write_folder(tmp_path / "right", [f"{n}.png" for n in (4, 5, 6, 7, 8)])

    assert [f.group for f in of(replayed(tmp_path, fps=10, pair_by="number"), "right")] == [4, 5, 6, 7, 8]


def test_pair_by_number_refuses_names_without_numbers(tmp_path):
    for side in ("left", "right"):
        write_folder(tmp_path / side, ["a.png", "b.png"])

    with pytest.raises(InputError, match=r"left/a.png: no number in the file name: pair_by number is not possible"):
        opened(tmp_path, pair_by="number")


def test_pair_by_index_ignores_numbers(tmp_path, caplog):
    write_folder(tmp_path / "left", ["1.png", "2.png", "4.png"])
    write_folder(tmp_path / "right", ["1.png", "2.png", "3.png"])

    frames = replayed(tmp_path, fps=10, pair_by="index")

    assert [f.group for f in of(frames, "left")] == [0, 1, 2]
    assert said(caplog) == []


@pytest.mark.parametrize("unit_ns", [1, 1000])
def test_names_that_are_epoch_stamps_are_timestamps(tmp_path, unit_ns):
    start = EPOCH_NS // 1000 * 1000
    stamps = [start + n * 50 * MS for n in range(4)]
    for side in ("left", "right"):
        write_folder(tmp_path / side, [f"{stamp // unit_ns}.png" for stamp in stamps])

    source = opened(tmp_path)
    frames = list(source.frames())

    assert [f.captured_ns for f in of(frames, "right")] == stamps
    assert {f.group for f in frames} == {None}
    assert {f.stamp_origin for f in frames} == {StampOrigin.DEVICE}
    assert [camera.fps for camera in source.cameras] == [20, 20]


def test_sixteen_digit_counters_are_no_timestamps(tmp_path):
    for side in ("left", "right"):
        write_folder(tmp_path / side, [f"{n:016}.png" for n in range(3)])

    assert [f.group for f in of(replayed(tmp_path, fps=10), "left")] == [0, 1, 2]


def test_pair_by_time_refuses_names_that_are_no_timestamps(tmp_path):
    with pytest.raises(InputError, match=r"left/000000.png: the name is no timestamp"):
        opened(write_folders(tmp_path), pair_by="time")


def test_stamps_that_never_overlap_are_replayed_side_by_side(tmp_path, caplog):
    far_ns = 37_000 * 1000 * MS
    write_folder(tmp_path / "left", [f"{EPOCH_NS + n * 50 * MS}.png" for n in range(3)])
    write_folder(tmp_path / "right", [f"{EPOCH_NS + far_ns + n * 50 * MS}.png" for n in range(3)])

    frames = replayed(tmp_path)

    assert [f.camera for f in frames] == ["left", "right"] * 3
    assert of(frames, "right")[0].captured_ns == EPOCH_NS + far_ns
    assert said(caplog) == [
        "the cameras' timestamps do not overlap: each camera's time is counted from its own first frame"
    ]


@pytest.mark.parametrize("suffix", ["png", "jpg", "jpeg", "bmp", "tif", "tiff", "pgm", "webp", "PNG", "JpG"])
def test_pictures_of_every_known_suffix_are_found(tmp_path, suffix):
    for side in ("left", "right"):
        write_folder(tmp_path / side, [f"{n}.{suffix}" for n in range(2)])

    assert [shown(f) for f in of(replayed(tmp_path, fps=10), "left")] == [0, 1]


def test_hidden_and_other_files_are_left_out(tmp_path):
    write_folders(tmp_path, count=2)
    (tmp_path / "left" / "._000000.png").write_bytes(b"resource fork")
    (tmp_path / "left" / "notes.txt").write_text("calibrated on Monday")
    (tmp_path / ".thumbnails").mkdir()
    (tmp_path / ".thumbnails" / "0.png").write_bytes(b"")
    (tmp_path / "calibration").mkdir()
    (tmp_path / "calibration" / "stereo.yaml").write_text("baseline_m: 0.1")

    frames = replayed(tmp_path, fps=10)

    assert [(f.camera, shown(f)) for f in frames] == [("left", 0), ("right", 0), ("left", 1), ("right", 1)]


def test_streams_of_unequal_length_are_all_delivered_and_it_is_said_once(tmp_path, caplog):
    write_folder(tmp_path / "left", [f"{n}.png" for n in range(3)])
    write_folder(tmp_path / "right", [f"{n}.png" for n in range(8)])

    frames = replayed(tmp_path, fps=10)

    assert [shown(f) for f in of(frames, "right")] == list(range(8))
    assert said(caplog) == ["right has 5 frames that left does not have: they have no partner"]


def test_cameras_may_have_different_sizes(tmp_path):
    write_folder(tmp_path / "left", {"0.png": picture(0, (64, 48)), "1.png": picture(1, (64, 48))})
    write_folder(tmp_path / "right", {"0.png": picture(0, (40, 30)), "1.png": picture(1, (40, 30))})

    assert [f.image.shape for f in replayed(tmp_path, fps=10)] == [(48, 64), (30, 40)] * 2
