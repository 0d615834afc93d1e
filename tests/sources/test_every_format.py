"""One rendered scene in every format: the same frames, and the same verdicts."""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

import numpy as np
import pytest

from pipeline.assemble import assemble, build_source
from pipeline.cli.recording import recording_plan
from pipeline.run import Run
from pipeline.verdict import Cause, State, Verdict
from sources.replay.formats import FORMATS, recognise
from tests.formats import LOSSY, STAMPED, UNSTAMPED, Scene, rendered, scene_of, stamp_ns
from tests.sources.test_replay_kit import replayed

SLIP_AT = 26


class Told(NamedTuple):
    frame: int | None
    state: State
    cause: Cause | None


def told(path) -> list[Told]:
    """What is said of each frame of a recording."""
    plan = recording_plan([str(path)])
    verdicts: list[Verdict] = []
    source = build_source(plan)
    source.open()
    parts = assemble(
        plan, source, console=None, on_report=lambda one: verdicts.append(one) if isinstance(one, Verdict) else None
    )
    Run(parts).execute()
    return [Told(one.frame, one.state, one.cause) for one in verdicts]


@pytest.fixture(scope="session")
def scene() -> Scene:
    """Two cameras in sync at first; from SLIP_AT on the second shows what it saw a frame later, under old stamps."""
    source = rendered(2.6)
    source.open()
    frames = scene_of(source.frames())
    source.close()
    left, right = frames["left"], frames["right"]
    shown = [*right[:SLIP_AT], *right[SLIP_AT + 1 :]]
    slipped = [replace(frame, image=later.image) for frame, later in zip(right, shown, strict=False)]
    return {"left": left[: len(slipped)], "right": slipped}


@pytest.fixture(scope="session")
def recordings(tmp_path_factory, scene):
    """Writes each format once."""
    written = {}

    def path_of(name):
        if name not in written:
            root = tmp_path_factory.mktemp(name) / "recording"
            written[name] = (STAMPED | UNSTAMPED)[name](root, scene)
        return written[name]

    return path_of


@pytest.mark.parametrize("name", [*STAMPED, *UNSTAMPED])
def test_frames_are_those_that_were_written(name, recordings, scene):
    frames = replayed(recordings(name))
    for camera, written in scene.items():
        read = [frame for frame in frames if frame.camera == camera]
        assert len(read) == len(written)
        for one, other in zip(read, written, strict=True):
            grey = one.image if one.image.ndim == 2 else one.image[:, :, 1]
            worst = np.abs(grey.astype(int) - other.image).mean()
            assert worst <= (4 if name in LOSSY else 0), f"frame {other.sequence}"
        if name in STAMPED:
            assert [one.captured_ns for one in read] == [stamp_ns(other) for other in written]


@pytest.mark.parametrize("name", STAMPED)
def test_with_stamps_all_say_what_euroc_says(name, recordings):
    expected = told(recordings("euroc"))
    assert SLIP_AT <= _async_from(expected) <= SLIP_AT + 10
    assert told(recordings(name)) == expected


@pytest.mark.parametrize("name", UNSTAMPED)
def test_without_stamps_all_say_what_folders_say(name, recordings):
    expected = told(recordings("folders"))
    assert SLIP_AT <= _async_from(expected) <= SLIP_AT + 10
    assert told(recordings(name)) == expected


def _async_from(said: list[Told]) -> int | None:
    return next((one.frame for one in said if one.state is State.ASYNC), None)


KIND = {
    "kitti_raw": "kitti", "kitti_odometry": "kitti", "rosbag1_lz4": "rosbag1", "rosbag2_mcap": "rosbag2",
    "rosbag2_zstd_file": "rosbag2", "rosbag2_zstd_message": "rosbag2", "rosbag2_compressed": "rosbag2",
    "rosbag2_split": "rosbag2", "foxglove_raw": "mcap", "foxglove_compressed": "mcap", "foxglove_json": "mcap",
    "foxglove_video": "mcap", "side_by_side": "halves", "top_bottom": "halves",
}  # fmt: skip


@pytest.mark.parametrize("name", [*STAMPED, *UNSTAMPED])
def test_formats_are_recognised_by_content(name, recordings):
    assert recognise([recordings(name)]) == KIND.get(name, name)


def test_every_format_there_is_has_been_written():
    assert {KIND.get(name, name) for name in [*STAMPED, *UNSTAMPED]} | {"syncwatch"} == set(FORMATS)
