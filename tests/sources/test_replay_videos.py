"""Replaying video files."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from pipeline.errors import InputError
from pipeline.frame import StampOrigin
from tests.sources.test_replay_kit import of, opened, replayed, said, shown, write_video

ROOT = Path(__file__).resolve().parents[2]


def test_frames_are_grouped_by_index_and_stamped_from_the_containers_rate(tmp_path):
    write_video(tmp_path / "left.avi", count=5, fps=20)
    write_video(tmp_path / "right.avi", count=5, fps=20)

    source = opened(tmp_path)
    frames = list(source.frames())

    assert [(f.camera, f.group, f.sequence) for f in frames[:3]] == [("left", 0, 0), ("right", 0, 0), ("left", 1, 1)]
    assert [f.captured_ns for f in of(frames, "right")] == [n * 50_000_000 for n in range(5)]
    assert {f.stamp_origin for f in frames} == {StampOrigin.SYNTHESISED}
    assert [c.fps for c in source.cameras] == [20, 20]
    assert source.frame_count == 5


def test_a_delivered_picture_is_not_overwritten_by_the_next(tmp_path):
    write_video(tmp_path / "left.mp4")
    write_video(tmp_path / "right.mp4")

    left = of(replayed(tmp_path), "left")

    assert [shown(f) for f in left] == [0, 1, 2, 3, 4]
    assert not np.shares_memory(left[0].image, left[1].image)


def test_a_given_frame_rate_wins(tmp_path):
    write_video(tmp_path / "left.avi", fps=20)
    write_video(tmp_path / "right.avi", fps=25)

    frames = replayed(tmp_path, fps=10)

    assert [f.captured_ns for f in of(frames, "right")][:2] == [0, 100_000_000]
    assert of(frames, "right")[1].group == 1


def test_rates_that_differ_by_less_than_a_percent_are_the_same(tmp_path, caplog):
    write_video(tmp_path / "left.mp4", fps=30)
    write_video(tmp_path / "right.mp4", fps=29.97)

    frames = replayed(tmp_path)

    assert [f.group for f in of(frames, "right")] == [0, 1, 2, 3, 4]
    assert of(frames, "right")[3].captured_ns == of(frames, "left")[3].captured_ns
    assert said(caplog) == []


def test_different_rates_pair_by_time_with_one_warning(tmp_path, caplog):
    write_video(tmp_path / "left.avi", count=3, fps=10)
    write_video(tmp_path / "right.avi", count=6, fps=20)

    source = opened(tmp_path)
    frames = list(source.frames())

    assert {f.group for f in frames} == {None}
    assert [f.camera for f in frames] == ["left", "right", "right"] * 3
    assert [c.fps for c in source.cameras] == [10, 20]
    assert said(caplog) == [
        "the videos' frame rates differ (left.avi 10 Hz, right.avi 20 Hz): frames are paired by time"
    ]


def test_pair_by_index_groups_videos_of_different_rates(tmp_path):
    write_video(tmp_path / "left.avi", count=3, fps=10)
    write_video(tmp_path / "right.avi", count=3, fps=20)

    assert [f.group for f in replayed(tmp_path, pair_by="index")] == [0, 0, 1, 1, 2, 2]


def test_pair_by_time_leaves_groups_out(tmp_path):
    write_video(tmp_path / "left.avi")
    write_video(tmp_path / "right.avi")

    assert {f.group for f in replayed(tmp_path, pair_by="time")} == {None}


def test_pair_by_number_is_refused(tmp_path):
    write_video(tmp_path / "left.avi")
    write_video(tmp_path / "right.avi")

    with pytest.raises(InputError, match="videos have no file numbers: pair_by index or time is possible"):
        opened(tmp_path, pair_by="number")


def test_a_video_that_ends_early_is_replayed_as_far_as_it_goes_and_said_once(tmp_path, caplog):
    write_video(tmp_path / "left.avi", count=20)
    cut_video(write_video(tmp_path / "right.avi", count=20), chunks=12)

    frames = replayed(tmp_path)

    got = len(of(frames, "right"))
    assert 10 <= got <= 13
    assert len(of(frames, "left")) == 20
    assert said(caplog) == [
        f"right.avi ends after {got} of 20 frames",
        f"left has {20 - got} frames that right does not have: they have no partner",
    ]


def test_looping_says_an_early_end_only_once(tmp_path, caplog):
    write_video(tmp_path / "left.avi", count=20)
    cut_video(write_video(tmp_path / "right.avi", count=20), chunks=12)
    source = opened(tmp_path, loop=True)

    for number, _ in enumerate(source.frames()):
        if number == 100:
            source.stop()

    assert len(said(caplog)) == 2


@pytest.mark.parametrize("content", [b"", b"this is not a video" * 50])
def test_a_file_that_is_no_video_is_refused(tmp_path, content):
    write_video(tmp_path / "cam1.mp4")
    (tmp_path / "cam2.mp4").write_bytes(content)

    with pytest.raises(InputError, match=r"cam2.mp4: cannot be opened as a video: it is damaged, empty or"):
        opened(tmp_path)


def test_bad_videos_leave_stderr_to_us(tmp_path):
    """In a process of its own: FFmpeg takes its log level once, and the writer of these tests was first here."""
    for side in ("left", "right"):
        (tmp_path / f"{side}.mp4").write_bytes(b"this is not a video" * 50)
    program = f"""
from pathlib import Path
from pipeline.errors import InputError
from sources.replay.settings import ReplaySettings
from sources.replay.source import ReplaySource
try:
    ReplaySource(ReplaySettings(path={str(tmp_path)!r}), base=Path()).open()
except InputError as error:
    print(error)
"""

    env = {key: value for key, value in os.environ.items() if not key.startswith("OPENCV_")}
    done = subprocess.run(
        [sys.executable, "-c", program], cwd=ROOT, env=env, capture_output=True, text=True, check=True
    )

    assert "left.mp4: cannot be opened as a video" in done.stdout
    assert done.stderr == ""


def test_videos_may_be_of_different_sizes(tmp_path):
    write_video(tmp_path / "left.avi", size=(64, 48))
    write_video(tmp_path / "right.avi", size=(48, 32))

    assert {(f.camera, f.image.shape) for f in replayed(tmp_path)} == {("left", (48, 64, 3)), ("right", (32, 48, 3))}


def test_videos_come_in_natural_order(tmp_path):
    for name in ("cam10.avi", "cam2.avi", "cam1.avi"):
        write_video(tmp_path / name, count=1)

    assert [c.name for c in opened(tmp_path).cameras] == ["cam1", "cam2", "cam10"]


def test_the_end_of_the_run_lets_the_files_go(tmp_path):
    write_video(tmp_path / "left.avi")
    write_video(tmp_path / "right.avi")
    source = opened(tmp_path)
    frames = source.frames()
    next(frames)
    assert open_files() == {"left.avi", "right.avi"}

    source.stop()

    assert list(frames) == []
    assert open_files() == set()


def test_open_leaves_no_file_open(tmp_path):
    write_video(tmp_path / "left.avi")
    write_video(tmp_path / "right.avi")

    opened(tmp_path)

    assert open_files() == set()


def cut_video(path: Path, chunks: int) -> None:
    """Leaves the header and some of the pictures of an AVI file."""
    data = path.read_bytes()
    at = data.index(b"movi")
    for _ in range(chunks + 1):
        at = data.index(b"00dc", at + 4)
    path.write_bytes(data[:at])


def open_files() -> set[str]:
    """The videos that this process holds open."""
    return {link.resolve().name for link in Path("/proc/self/fd").iterdir() if link.resolve().suffix == ".avi"}
