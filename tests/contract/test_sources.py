"""What every kind of source promises."""

from __future__ import annotations

import threading
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import ExitStack

import numpy as np
import pytest

from pipeline.buffer import BufferSettings
from pipeline.errors import InputError
from pipeline.faults.seq_offset import SeqOffset, SeqOffsetSettings
from pipeline.faults.source import FaultedSource
from pipeline.frame import Frame, Source
from sources.push import PushSettings, PushSource
from sources.replay.settings import ReplaySettings
from sources.replay.source import ReplaySource
from sources.several import SeveralSources
from sources.synthetic.settings import SyntheticSettings
from sources.synthetic.source import SyntheticSource
from sources.v4l2.settings import V4l2Settings
from sources.v4l2.source import V4l2Source
from sources.video.settings import VideoSettings
from sources.video.source import VideoSource
from sources.zenoh.settings import ZenohSourceSettings
from sources.zenoh.source import ZenohSource
from syncwatch.testing import ScriptedSource
from tests.frames import PERIOD_NS, RIG, frame
from tests.network import free_endpoint
from tests.programs import write_folders
from tests.publishing import publishing
from tests.recorded import record
from tests.sources.v4l2_kernel import FakeCamera, Machine, Shot
from tests.streaming import film

Make = Callable[..., Source]


def synthetic(_, *, endless: bool) -> Source:
    settings = SyntheticSettings(width=64, height=48, duration_s=0.5, fps=10, speed=0.001 if endless else "max")
    return SyntheticSource(settings, seed=0)


def replayed(folder, *, endless: bool) -> Source:
    if not (folder / "left").exists():
        write_folders(folder, 5)
    return ReplaySource(ReplaySettings(path=str(folder), fps=10, speed=0.001 if endless else "max"), base=folder)


def recorded(folder, *, endless: bool) -> Source:
    path = folder / "a.mcap"
    if not path.exists():
        record(path, *(frame(name, n * PERIOD_NS, n, group=n) for n in range(5) for name in ("left", "right")))
    return ReplaySource(ReplaySettings(path=str(path), speed=0.001 if endless else "max"), base=folder)


def faulted(folder, *, endless: bool) -> Source:
    made = replayed(folder, endless=endless)
    return FaultedSource(made, lambda cameras: [SeqOffset(SeqOffsetSettings(), cameras, 0)])


def scripted(_, *, endless: bool) -> Source:
    steps = [frame(name, n, n, group=n) for n in range(5) for name in ("left", "right")]
    return ScriptedSource(RIG.cameras, [*steps, threading.Event()] if endless else steps)


def pushed(_, *, endless: bool) -> Source:
    source = PushSource(PushSettings(cameras={"left": 10, "right": 10}))
    source.attach()
    for n in range(5):
        for name in ("left", "right"):
            source.push(name, np.full((4, 6), 100, np.uint8), captured_ns=n)
    if not endless:
        source.finish()
    return source


def published(folder, *, endless: bool) -> Source:
    """Of pictures that are published while the test lasts."""
    endpoint = (folder / "endpoint").read_text()
    cameras = {name: {"key": f"0/contract/{name}/**", "fps": 10} for name in ("left", "right")}
    return ZenohSource(ZenohSourceSettings.model_validate({"connect": [endpoint], "cameras": cameras}))


def v4l2(folder, *, endless: bool) -> Source:
    """Two cameras on a scripted kernel, which end by being stopped: of themselves they never do."""
    machine = Machine(folder)
    ended = []

    def end():
        ended.append(True)
        if len(ended) == 2:
            source.stop()

    for number in range(2):
        steps = [] if endless else [*[Shot()] * 5, end]
        machine.plug(f"video{number}", FakeCamera(steps, bus=f"usb-{number}"))
    cameras = {name: {"device": f"usb-{number}"} for number, name in enumerate(("left", "right"))}
    source = V4l2Source(V4l2Settings(cameras=cameras), host=machine.host)
    return source


def streamed(folder, *, endless: bool) -> Source:
    for name in ("left", "right"):
        film(folder / f"{name}.mp4", count=6, fps=10)
    cameras = {name: f"{name}.mp4" for name in ("left", "right")}
    return VideoSource(VideoSettings(cameras=cameras), base=folder)


def one_of(camera: str, *, endless: bool) -> PushSource:
    source = PushSource(PushSettings(cameras={camera: 10}))
    source.attach()
    for n in range(5):
        source.push(camera, np.full((4, 6), 100, np.uint8), captured_ns=n)
    if not endless:
        source.finish()
    return source


def several_live(_, *, endless: bool) -> Source:
    return several([one_of(camera, endless=endless) for camera in ("left", "right")])


def several_recorded(_, *, endless: bool) -> Source:
    """Two recordings, of which one is waited for."""
    wait = [threading.Event()] if endless else []
    return several(
        [
            ScriptedSource([camera], [*(frame(camera.name, n * PERIOD_NS, n) for n in range(5)), *wait])
            for camera in RIG.cameras
        ]
    )


def several(sources: list[Source]) -> Source:
    return SeveralSources(sources, refuse=lambda _, text: InputError(text), pairing=BufferSettings())


LIVE = {"pushed", "published", "v4l2", "streamed", "several_live"}


@pytest.fixture(
    params=[
        synthetic,
        replayed,
        recorded,
        faulted,
        scripted,
        pushed,
        published,
        v4l2,
        streamed,
        several_live,
        several_recorded,
    ],
    ids=lambda make: make.__name__,
)
def make(request, tmp_path) -> Iterator[Make]:
    with ExitStack() as stack:
        if request.param is published:
            endpoint = free_endpoint()
            (tmp_path / "endpoint").write_text(endpoint)
            stack.enter_context(publishing(endpoint, "contract"))
        yield lambda *, endless=False: request.param(tmp_path, endless=endless)


def first_frames(source: Source, count: int = 5) -> list[Frame]:
    """Until every camera has shown so many; a source of less ends by itself."""
    frames = []
    for item in source.frames():
        frames.append(item)
        seen = Counter(one.camera for one in frames)
        if len(seen) == 2 and min(seen.values()) >= count:
            source.stop()
    return frames


def test_cameras_are_known_once_it_is_open(make):
    source = make()
    source.open()
    assert [camera.name for camera in source.cameras] == ["left", "right"]
    assert all(camera.fps == 10 for camera in source.cameras)
    source.close()


def test_frames_of_one_camera_come_in_order_and_belong_to_known_cameras(make):
    source = make()
    source.open()
    frames = first_frames(source)
    source.close()
    assert {item.camera for item in frames} == {"left", "right"}
    for name in ("left", "right"):
        stamps = [item.captured_ns for item in frames if item.camera == name]
        assert len(stamps) >= 5
        assert stamps == sorted(stamps)


def test_pictures_cannot_be_written_to(make):
    source = make()
    source.open()
    for item in first_frames(source):
        with pytest.raises(ValueError, match="read-only"):
            item.image[0, 0] = 1
    source.close()


def test_stopping_ends_the_iteration_from_another_thread(make):
    source = make(endless=True)
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


def test_cameras_cannot_wait_and_everything_else_can(make, request):
    assert make().live is any(f"[{name}]" in request.node.name for name in LIVE)
