"""The replay as a source: its order, pace, loop and life cycle."""

from __future__ import annotations

import threading
import time
from itertools import islice, pairwise
from pathlib import Path

import pytest

from pipeline.frame import Source
from sources.replay.settings import ReplaySettings
from sources.replay.source import ReplaySource
from tests.sources.test_replay_kit import (
    of,
    opened,
    said,
    shown,
    write_euroc,
    write_euroc_camera,
    write_folder,
    write_folders,
    write_video,
)

STAMPS_NS = [1_000_000_000 + n * 50_000_000 for n in range(4)]
PERIOD_NS = 100_000_000


def made(path: Path, clock_ns=time.monotonic_ns, **settings) -> ReplaySource:
    source: Source = ReplaySource(
        ReplaySettings.model_validate({"path": str(path), **settings}), base=Path(), clock_ns=clock_ns
    )
    source.open()
    return source


def test_arrival_is_the_clock_at_delivery(tmp_path):
    ticks = iter(range(5000, 6000))
    frames = list(made(write_folders(tmp_path), clock_ns=lambda: next(ticks), fps=10).frames())

    assert [f.arrived_ns for f in frames] == list(range(5000, 5006))


def test_a_hole_does_not_hold_up_the_other_cameras(tmp_path):
    write_folder(tmp_path / "a", ["0.png", "1.png", "2.png"])
    write_folder(tmp_path / "b", ["1.png", "2.png"])
    write_folder(tmp_path / "c", ["0.png", "2.png"])

    frames = opened(tmp_path, fps=10).frames()

    assert [(f.group, f.camera) for f in frames] == [(0, "a"), (0, "c"), (1, "a"), (1, "b"), *((2, c) for c in "abc")]


def test_frames_without_groups_come_in_order_of_their_stamps(tmp_path):
    staggered = [stamp + 20_000_000 for stamp in STAMPS_NS]

    stamps = [f.captured_ns for f in opened(write_euroc(tmp_path, staggered, STAMPS_NS)).frames()]

    assert stamps == sorted(STAMPS_NS + staggered)


def test_pictures_are_read_only_as_they_are_delivered(tmp_path):
    """So that memory does not grow: a picture that is replaced in time is the one that is seen."""
    write_folders(tmp_path, count=4)
    frames = opened(tmp_path, fps=10).frames()
    first = next(frames)
    (tmp_path / "left" / "000003.png").write_bytes((tmp_path / "left" / "000000.png").read_bytes())

    assert [shown(f) for f in (first, *of(frames, "left"))] == [0, 1, 2, 0]


def test_a_loop_goes_on_rising_and_leaves_a_gap_of_one_number_at_the_seam(tmp_path):
    frames = list(islice(opened(write_folders(tmp_path, count=3), fps=10, loop=True).frames(), 18))

    left = of(frames, "left")
    assert [f.group for f in left] == [0, 1, 2, 4, 5, 6, 8, 9, 10]
    assert [f.sequence for f in left] == [0, 1, 2, 4, 5, 6, 8, 9, 10]
    assert [f.captured_ns for f in left] == [n * PERIOD_NS for n in (0, 1, 2, 4, 5, 6, 8, 9, 10)]
    assert [shown(f) for f in left] == [0, 1, 2] * 3
    assert [f.group for f in of(frames, "right")] == [f.group for f in left]


def test_a_loop_over_device_stamps_goes_on_two_periods_after_the_last(tmp_path):
    frames = islice(opened(write_euroc(tmp_path, STAMPS_NS, STAMPS_NS), loop=True).frames(), 16)

    stamps = [f.captured_ns for f in of(frames, "right")]

    assert [after - before for before, after in pairwise(stamps)] == [50_000_000] * 3 + [100_000_000] + [50_000_000] * 3


def test_a_loop_over_streams_of_unequal_length_starts_all_of_them_anew_together(tmp_path):
    write_folder(tmp_path / "left", ["5.png", "6.png"])
    write_folder(tmp_path / "right", ["5.png", "6.png", "7.png", "8.png"])

    frames = list(islice(opened(tmp_path, fps=10, loop=True).frames(), 12))

    assert [f.group for f in of(frames, "left")] == [0, 1, 5, 6]
    assert [f.group for f in of(frames, "right")] == [0, 1, 2, 3, 5, 6, 7, 8]
    assert [f.sequence for f in of(frames, "left")] == [5, 6, 10, 11]


def test_a_loop_over_videos_opens_them_again(tmp_path):
    write_video(tmp_path / "left.avi", count=2)
    write_video(tmp_path / "right.avi", count=2)

    frames = islice(opened(tmp_path, loop=True).frames(), 12)

    assert [shown(f) for f in of(frames, "left")] == [0, 1] * 3


def test_a_loop_says_unequal_lengths_only_once(tmp_path, caplog):
    write_folder(tmp_path / "left", ["0.png"])
    write_folder(tmp_path / "right", ["0.png", "1.png"])

    list(islice(opened(tmp_path, fps=10, loop=True).frames(), 20))

    assert len(said(caplog)) == 1


def test_the_frame_count_is_the_first_cameras_and_none_in_a_loop(tmp_path):
    write_folder(tmp_path / "left", ["0.png"])
    write_folder(tmp_path / "right", ["0.png", "1.png"])

    assert opened(tmp_path, fps=10).frame_count == 1
    assert opened(tmp_path, fps=10, loop=True).frame_count is None


@pytest.mark.parametrize(("speed", "takes_s"), [(1.0, 0.3), (3.0, 0.1)])
def test_speed_paces_by_the_stamps(tmp_path, speed, takes_s):
    source = made(write_folders(tmp_path, count=4), fps=10, speed=speed)
    started_s = time.monotonic()

    arrivals = [f.arrived_ns for f in of(source.frames(), "left")]

    assert takes_s <= time.monotonic() - started_s < takes_s + 0.25
    gaps_s = [(after - before) / 1e9 for before, after in pairwise(arrivals)]
    assert gaps_s == pytest.approx([takes_s / 3] * 3, abs=0.04)


def test_full_speed_does_not_wait(tmp_path):
    source = made(write_folders(tmp_path, count=4), fps=0.01, speed="max")
    started_s = time.monotonic()

    assert len(list(source.frames())) == 8
    assert time.monotonic() - started_s < 1


def test_a_replay_at_real_speed_catches_up_when_its_reader_was_slow(tmp_path):
    now_ns = [0]
    source = made(write_folders(tmp_path, count=4), clock_ns=lambda: now_ns[0], fps=10, speed=1.0)
    frames = source.frames()
    next(frames)
    now_ns[0] = 10 * PERIOD_NS

    assert [f.arrived_ns for f in frames] == [10 * PERIOD_NS] * 7


def test_cameras_whose_clocks_are_hours_apart_are_paced_together(tmp_path):
    write_euroc(tmp_path, STAMPS_NS, [stamp + 10**14 for stamp in STAMPS_NS])
    started_s = time.monotonic()

    frames = list(made(tmp_path, speed=1.0).frames())

    assert [f.camera for f in frames] == ["left", "right"] * 4
    assert time.monotonic() - started_s < 1


def test_unequal_lengths_are_told_against_the_first_camera(tmp_path, caplog):
    write_folder(tmp_path / "a", ["0.png", "1.png"])
    write_folder(tmp_path / "b", ["0.png"])
    write_folder(tmp_path / "c", ["0.png", "1.png", "2.png"])

    list(opened(tmp_path, fps=10).frames())

    assert said(caplog) == [
        "a has 1 frame that b does not have; c has 1 frame that a does not have: they have no partner"
    ]


def test_stamps_that_go_back_are_not_waited_for(tmp_path):
    odd = [STAMPS_NS[3], STAMPS_NS[0], STAMPS_NS[1]]
    for number in (0, 1):
        lines = "".join(f"{ns},{ns}.png\n" for ns in odd)
        write_euroc_camera(tmp_path / "mav0" / f"cam{number}", STAMPS_NS, lines)
    source = made(tmp_path, clock_ns=lambda: 0, speed=1.0)

    assert [f.captured_ns for f in of(source.frames(), "left")] == odd


@pytest.mark.parametrize("speed", ["max", 1.0])
def test_a_replay_is_never_live(tmp_path, speed):
    assert not made(write_folders(tmp_path), fps=10, speed=speed).live


def test_stop_wakes_a_replay_that_waits(tmp_path):
    source = made(write_folders(tmp_path), fps=0.001, speed=1.0)
    threading.Timer(0.1, source.stop).start()
    started_s = time.monotonic()

    frames = list(source.frames())

    assert [f.group for f in frames] == [0, 0]
    assert time.monotonic() - started_s < 2


def test_stop_before_the_start_delivers_nothing(tmp_path):
    source = opened(write_folders(tmp_path), fps=10)
    source.stop()
    source.stop()

    assert list(source.frames()) == []


def test_stop_ends_a_loop(tmp_path):
    source = opened(write_folders(tmp_path, count=2), fps=10, loop=True)
    delivered = 0
    for delivered, _ in enumerate(source.frames(), 1):
        if delivered == 9:
            source.stop()

    assert delivered == 9


def test_a_stopped_replay_says_nothing_of_unequal_lengths(tmp_path, caplog):
    write_folder(tmp_path / "left", ["0.png", "1.png"])
    write_folder(tmp_path / "right", ["1.png", "2.png", "3.png"])
    source = opened(tmp_path, fps=10)
    for frame in source.frames():
        if frame.group == 2:
            source.stop()
    source.close()

    assert said(caplog) == []
