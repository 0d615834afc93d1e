"""What every kind of source promises."""

from __future__ import annotations

import threading
from collections.abc import Callable

import pytest

from pipeline.faults.seq_offset import SeqOffset, SeqOffsetSettings
from pipeline.faults.source import FaultedSource
from pipeline.frame import Source
from sources.replay.settings import ReplaySettings
from sources.replay.source import ReplaySource
from sources.synthetic.settings import SyntheticSettings
from sources.synthetic.source import SyntheticSource
from syncwatch.testing import ScriptedSource
from tests.frames import PERIOD_NS, RIG, frame
from tests.programs import write_folders
from tests.recorded import record

Make = Callable[..., Source]


def synthetic(_, **settings) -> Source:
    return SyntheticSource(SyntheticSettings(width=64, height=48, duration_s=0.5, fps=10, **settings), seed=0)


def replayed(folder, **settings) -> Source:
    if not (folder / "left").exists():
        write_folders(folder, 5)
    return ReplaySource(ReplaySettings(path=str(folder), fps=10, **settings), base=folder)


def recorded(folder, **settings) -> Source:
    path = folder / "a.mcap"
    if not path.exists():
        record(path, *(frame(name, n * PERIOD_NS, n, group=n) for n in range(5) for name in ("left", "right")))
    return ReplaySource(ReplaySettings(path=str(path), **settings), base=folder)


def faulted(folder, **settings) -> Source:
    return FaultedSource(replayed(folder, **settings), lambda cameras: [SeqOffset(SeqOffsetSettings(), cameras, 0)])


def scripted(_, **settings) -> Source:
    return ScriptedSource(RIG.cameras, [frame(name, n, n, group=n) for n in range(5) for name in ("left", "right")])


@pytest.fixture(params=[synthetic, replayed, recorded, faulted, scripted], ids=lambda make: make.__name__)
def make(request, tmp_path) -> Make:
    return lambda **settings: request.param(tmp_path, **settings)


def test_cameras_are_known_once_it_is_open(make):
    source = make()
    source.open()
    assert [camera.name for camera in source.cameras] == ["left", "right"]
    assert all(camera.fps == 10 for camera in source.cameras)
    source.close()


def test_frames_of_one_camera_come_in_order_and_belong_to_known_cameras(make):
    source = make()
    source.open()
    frames = list(source.frames())
    source.close()
    assert {item.camera for item in frames} == {"left", "right"}
    for name in ("left", "right"):
        stamps = [item.captured_ns for item in frames if item.camera == name]
        assert len(stamps) == 5
        assert stamps == sorted(stamps)


def test_pictures_cannot_be_written_to(make):
    source = make()
    source.open()
    for item in source.frames():
        with pytest.raises(ValueError, match="read-only"):
            item.image[0, 0] = 1
    source.close()


def test_stopping_ends_the_iteration_from_another_thread(make, request):
    if "scripted" in request.node.name:
        source = ScriptedSource(RIG.cameras, [threading.Event()])
    elif "synthetic" in request.node.name:
        source = make(speed=0.001)
    else:
        source = make(speed=0.001)
    source.open()
    threading.Timer(0.2, source.stop).start()
    reader = threading.Thread(target=lambda: list(source.frames()), daemon=True)
    reader.start()
    reader.join(5)
    assert not reader.is_alive()
    source.close()


def test_stopping_before_iterating_and_twice_is_safe(make):
    source = make()
    source.open()
    source.stop()
    source.stop()
    assert len(list(source.frames())) <= 1
    source.close()


def test_it_is_not_live_so_that_every_frame_is_judged(make):
    assert make().live is False
