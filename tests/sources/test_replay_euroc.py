"""Replaying the EuRoC layout."""

from __future__ import annotations

import pytest

from pipeline.errors import InputError
from pipeline.frame import StampOrigin
from sources.replay.streams import fps_of
from tests.sources.test_replay_kit import of, opened, replayed, said, shown, write_euroc, write_euroc_camera

START_NS = 1_403_715_273_262_142_976
STEP_NS = 50_000_000
STAMPS_NS = [START_NS + n * STEP_NS for n in range(4)]


def test_stamps_come_from_data_csv_and_frames_have_no_groups(tmp_path):
    frames = replayed(write_euroc(tmp_path, STAMPS_NS, [stamp + 7 for stamp in STAMPS_NS]))

    assert [f.camera for f in frames] == ["left", "right"] * 4
    assert [f.captured_ns for f in of(frames, "left")] == STAMPS_NS
    assert [f.captured_ns for f in of(frames, "right")] == [stamp + 7 for stamp in STAMPS_NS]
    assert [(f.sequence, shown(f)) for f in of(frames, "right")] == [(n, n) for n in range(4)]
    assert {(f.group, f.stamp_origin) for f in frames} == {(None, StampOrigin.DEVICE)}
    assert len({f.clock for f in frames}) == 1


def test_the_mav0_folder_itself_is_a_recording(tmp_path):
    write_euroc(tmp_path, STAMPS_NS, STAMPS_NS)

    assert len(replayed(tmp_path / "mav0")) == 8


def test_the_frame_rate_is_measured_by_the_median_interval(tmp_path):
    late = [*STAMPS_NS[:3], STAMPS_NS[3] + 10 * STEP_NS]

    assert [c.fps for c in opened(write_euroc(tmp_path, STAMPS_NS, late)).cameras] == [20, 20]


def test_repeated_stamps_do_not_count_as_an_interval():
    assert fps_of([0, 0, 0, STEP_NS, STEP_NS, 2 * STEP_NS]) == 20
    assert fps_of([5, 5, 5]) is None


def test_a_given_frame_rate_wins(tmp_path):
    source = opened(write_euroc(tmp_path, STAMPS_NS, STAMPS_NS), fps=7)

    assert [c.fps for c in source.cameras] == [7, 7]
    assert [f.captured_ns for f in of(source.frames(), "left")] == STAMPS_NS


def test_cameras_come_in_natural_order_and_keep_their_names_when_they_are_many(tmp_path):
    for number in (10, 2, 0):
        write_euroc_camera(tmp_path / "mav0" / f"cam{number}", STAMPS_NS)

    assert [c.name for c in opened(tmp_path).cameras] == ["cam0", "cam2", "cam10"]


def test_spaces_carriage_returns_comments_and_further_columns_are_tolerated(tmp_path):
    lines = "\ufeff# timestamp [ns], filename\r\n\r\n" + "".join(f" {ns} , {ns}.png , 5\r\n" for ns in STAMPS_NS)
    write_euroc_camera(tmp_path / "mav0" / "cam0", STAMPS_NS, lines)
    write_euroc_camera(tmp_path / "mav0" / "cam1", STAMPS_NS)

    assert [f.captured_ns for f in of(replayed(tmp_path), "left")] == STAMPS_NS


def test_listed_pictures_that_are_absent_are_holes_with_one_warning(tmp_path, caplog):
    write_euroc(tmp_path, STAMPS_NS, STAMPS_NS)
    absent = tmp_path / "mav0" / "cam1" / "data" / f"{STAMPS_NS[1]}.png"
    absent.unlink()
    (tmp_path / "mav0" / "cam1" / "data" / f"{STAMPS_NS[2]}.png").unlink()

    source = opened(tmp_path)
    frames = list(source.frames())

    assert [(f.sequence, shown(f)) for f in of(frames, "right")] == [(0, 0), (3, 3)]
    assert len(of(frames, "left")) == 4
    assert source.frame_count == 4
    assert said(caplog) == [f"2 of 8 pictures listed in data.csv are absent, the first is {absent}: they are left out"]


def test_a_camera_without_any_listed_picture_is_refused(tmp_path):
    write_euroc(tmp_path, STAMPS_NS, STAMPS_NS)
    (tmp_path / "mav0" / "cam1" / "data").rename(tmp_path / "mav0" / "cam1" / "images")

    with pytest.raises(InputError, match=r"cam1: none of the 4 pictures that data.csv lists is in .*cam1/data$"):
        opened(tmp_path)


def test_pictures_that_are_not_listed_are_left_out(tmp_path):
    listed = "".join(f"{ns},{ns}.png\n" for ns in STAMPS_NS[1:])
    write_euroc_camera(tmp_path / "mav0" / "cam0", STAMPS_NS, listed)
    write_euroc_camera(tmp_path / "mav0" / "cam1", STAMPS_NS)

    assert [shown(f) for f in of(replayed(tmp_path), "left")] == [1, 2, 3]


def test_a_listed_name_never_leads_out_of_the_recording(tmp_path, caplog):
    write_euroc(tmp_path, STAMPS_NS, STAMPS_NS)
    lines = f"{STAMPS_NS[0]},{STAMPS_NS[0]}.png\n{STAMPS_NS[1]},../../cam1/data/{STAMPS_NS[1]}.png\n"
    (tmp_path / "mav0" / "cam0" / "data.csv").write_text(lines)

    assert [shown(f) for f in of(replayed(tmp_path), "left")] == [0]
    assert "1 of 6 pictures listed in data.csv are absent" in said(caplog)[0]


def test_repeated_and_backward_stamps_are_delivered_in_the_order_of_the_list(tmp_path):
    odd = [STAMPS_NS[0], STAMPS_NS[2], STAMPS_NS[1], STAMPS_NS[1], STAMPS_NS[3]]
    lines = "".join(f"{ns},{ns}.png\n" for ns in odd)
    write_euroc_camera(tmp_path / "mav0" / "cam0", STAMPS_NS, lines)
    write_euroc_camera(tmp_path / "mav0" / "cam1", STAMPS_NS)

    left = of(replayed(tmp_path), "left")

    assert [f.captured_ns for f in left] == odd
    assert [f.sequence for f in left] == [0, 1, 2, 3, 4]


def test_pair_by_index_groups_by_row(tmp_path):
    frames = replayed(write_euroc(tmp_path, STAMPS_NS, STAMPS_NS), pair_by="index")

    assert [f.group for f in of(frames, "right")] == [0, 1, 2, 3]
    assert [f.captured_ns for f in of(frames, "right")] == STAMPS_NS


def test_pair_by_number_is_refused(tmp_path):
    with pytest.raises(InputError, match="pairs by time or index, not by number"):
        opened(write_euroc(tmp_path, STAMPS_NS, STAMPS_NS), pair_by="number")


def test_a_camera_that_ends_a_period_later_is_not_called_longer(tmp_path, caplog):
    replayed(write_euroc(tmp_path, STAMPS_NS, [stamp + STEP_NS for stamp in STAMPS_NS]))

    assert said(caplog) == []


def test_a_camera_that_goes_on_much_longer_is_said(tmp_path, caplog):
    frames = replayed(write_euroc(tmp_path, STAMPS_NS[:2], [START_NS + n * STEP_NS for n in range(6)]))

    assert len(of(frames, "right")) == 6
    assert said(caplog) == ["right has 3 frames that left does not have: they have no partner"]


@pytest.mark.parametrize(
    ("lines", "message"),
    [
        ("# header\n1.5e9,a.png\n", r"cam0/data.csv:2: '1.5e9' is not a timestamp in ns: expected timestamp,filename"),
        ("-5,a.png\n", r"cam0/data.csv:1: '-5' is not a timestamp"),
        ("12345678901234567890,a.png\n", r"cam0/data.csv:1: '12345678901234567890' is not a timestamp"),
        ("١٢٣,a.png\n", r"cam0/data.csv:1: '١٢٣' is not a timestamp"),
        (b"5,a.png\n\xff\xfe,b.png\n", r"cam0/data.csv:2: b'.xff.xfe,b.png' is not UTF-8 text"),
        ("5\n", r"cam0/data.csv:1: '5' names no picture"),
        ("# only a header\n", r"cam0/data.csv: lists no pictures"),
        ("", r"cam0/data.csv: lists no pictures"),
    ],
)
def test_an_odd_data_csv_is_refused_with_its_line_and_value(tmp_path, lines, message):
    write_euroc_camera(tmp_path / "mav0" / "cam0", STAMPS_NS, lines)
    write_euroc_camera(tmp_path / "mav0" / "cam1", STAMPS_NS)

    with pytest.raises(InputError, match=message):
        opened(tmp_path)
