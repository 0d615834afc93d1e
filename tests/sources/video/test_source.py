"""Streams over HTTP and RTSP, and files: what is delivered, and what happens when a server dies, stalls or changes."""

from __future__ import annotations

import logging
import os
import re
import signal
import threading
import time
from itertools import pairwise

import cv2
import numpy as np
import pytest

from pipeline.errors import InputError
from pipeline.frame import StampOrigin
from sources.video.settings import VideoSettings
from sources.video.source import VideoSource
from tests.network import wait_for
from tests.streaming import Rtsp, Streams, film, plain


@pytest.fixture(autouse=True)
def _log_is_heard(monkeypatch):
    monkeypatch.setattr(logging.getLogger("syncwatch"), "propagate", True)


@pytest.fixture
def streams():
    with Streams({"left": plain(1), "right": plain(7)}) as made:
        yield made


def source(folder, cameras, **settings) -> VideoSource:
    return VideoSource(VideoSettings(cameras=cameras, **settings), base=folder)


def both(streams, **more) -> dict:
    return {name: {"url": streams.url(name, "user:secret@"), "fps": 30, **more} for name in ("left", "right")}


class Watched:
    """A source that is open and read on a thread, with the frames it delivered by camera."""

    def __init__(self, running: VideoSource) -> None:
        self.source = running
        self.frames: dict[str, list] = {camera.name: [] for camera in running.cameras}
        self.thread = threading.Thread(target=self._read, daemon=True)

    def _read(self):
        for frame in self.source.frames():
            self.frames[frame.camera].append(frame)

    def epochs(self, camera):
        return [frame.epoch for frame in self.frames[camera]]

    def __enter__(self) -> Watched:
        self.thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        started_s = time.monotonic()
        self.source.stop()
        self.thread.join(5)
        self.source.close()
        assert not self.thread.is_alive()
        assert time.monotonic() - started_s < 1, "it takes a second to stop"


def watched(running) -> Watched:
    running.open()
    return Watched(running)


def test_streams_are_read_side_by_side_and_stamped_with_their_arrival(streams, tmp_path, caplog):
    streams.login = "Basic dXNlcjpzZWNyZXQ="
    with watched(source(tmp_path, both(streams))) as seen:
        wait_for(lambda: min(map(len, seen.frames.values())) >= 20)
    for name, frames in seen.frames.items():
        assert {(f.stamp_origin, f.clock, f.sequence, f.epoch) for f in frames} == {
            (StampOrigin.ARRIVAL, "monotonic", None, 0)
        }
        assert all(f.captured_ns == f.arrived_ns and f.image.shape == (72, 96, 3) for f in frames)
        assert all(later.arrived_ns > sooner.arrived_ns for sooner, later in pairwise(frames))
        shown = cv2.imdecode(np.frombuffer(streams.pictures[name][0], np.uint8), cv2.IMREAD_COLOR)
        assert min(int(np.abs(f.image.astype(int) - shown).max()) for f in frames) < 12
    assert not caplog.records


def test_a_server_that_dies_is_waited_for_and_a_new_epoch_begins_while_the_other_camera_goes_on(tmp_path, caplog):
    with Streams({"left": plain(1)}) as alive, Streams({"right": plain(7)}) as dying:
        cameras = {"left": {"url": alive.url("left"), "fps": 30}, "right": {"url": dying.url("right"), "fps": 30}}
        with watched(source(tmp_path, cameras)) as seen:
            wait_for(lambda: len(seen.frames["right"]) > 5)
            dying.die()
            wait_for(lambda: "right: Connection refused; trying again until it works" in caplog.text)
            before = len(seen.frames["left"])
            wait_for(lambda: len(seen.frames["left"]) > before + 10)
            dying.rise()
            wait_for(lambda: 1 in seen.epochs("right"))
    assert set(seen.epochs("left")) == {0}
    assert seen.epochs("right") == sorted(seen.epochs("right"))
    said = [record.message for record in caplog.records]
    assert said[0] == "right: the stream has ended; trying again until it works"
    assert said[-1].startswith("right: pictures again, after ")


def test_a_stream_that_stalls_is_opened_anew(streams, tmp_path, caplog):
    with watched(source(tmp_path, both(streams), silent_after_s=0.4)) as seen:
        wait_for(lambda: len(seen.frames["right"]) > 5)
        streams.stalled.add("right")
        wait_for(lambda: "right: no picture for 0." in caplog.text)
        streams.stalled.clear()
        wait_for(lambda: 1 in seen.epochs("right"))
    assert set(seen.epochs("left")) == {0}


def test_stopping_does_not_wait_for_a_stream_that_stalls(streams, tmp_path):
    with watched(source(tmp_path, both(streams), silent_after_s=60)) as seen:
        wait_for(lambda: len(seen.frames["right"]) > 5)
        streams.stalled |= {"left", "right"}
        time.sleep(0.1)
    assert not any(thread.name.startswith("video-") for thread in threading.enumerate())


def test_a_reader_that_is_killed_is_replaced(streams, tmp_path, caplog):
    with watched(source(tmp_path, both(streams))) as seen:
        wait_for(lambda: len(seen.frames["left"]) > 5)
        os.kill(seen.source._streams[0]._reader._process.pid, signal.SIGSEGV)
        wait_for(lambda: 1 in seen.epochs("left"))
    assert "left: its reader has died (SIGSEGV); trying again until it works" in caplog.text


@pytest.mark.parametrize("again", [False, True], ids=["within a stream", "after it was opened anew"])
def test_pictures_of_another_size_are_brought_to_the_first_one(streams, tmp_path, caplog, again):
    with watched(source(tmp_path, both(streams))) as seen:
        wait_for(lambda: len(seen.frames["right"]) > 3)
        streams.pictures["right"] = plain(7, (128, 96))
        if again:
            streams.die()
            streams.rise()
            wait_for(lambda: 1 in seen.epochs("right"))
        count = len(seen.frames["right"])
        wait_for(lambda: len(seen.frames["right"]) > count + 5)
    assert {frame.image.shape for frame in seen.frames["right"]} == {(72, 96, 3)}
    assert ("right: pictures are 128x96 now, brought to 96x72 as before" in caplog.text) is again


def test_frames_that_nobody_takes_give_way_to_newer_ones_and_are_counted(streams, tmp_path, caplog):
    running = source(tmp_path, both(streams), frames_ahead=2)
    running.open()
    reader = running.frames()
    next(reader)
    wait_for(lambda: running.dropped["left"] > 3)
    running.stop()
    running.close()
    assert "left: frames were not taken fast enough: " in caplog.text


def test_files_are_played_at_their_own_rate_and_end_the_run(tmp_path):
    film(tmp_path / "a.mp4", count=12, fps=25)
    film(tmp_path / "b.mp4", count=6, fps=25)
    with watched(source(tmp_path, {"left": "a.mp4", "right": f"file://{tmp_path}/b.mp4"})) as seen:
        seen.thread.join(10)
        assert not seen.thread.is_alive()
        assert seen.source.ended == {"left", "right"}
    assert [(camera.name, camera.fps) for camera in seen.source.cameras] == [("left", 25), ("right", 25)]
    assert {name: len(frames) for name, frames in seen.frames.items()} == {"left": 12, "right": 6}
    left = seen.frames["left"]
    assert left[-1].arrived_ns - left[0].arrived_ns > 0.4e9
    assert {frame.stamp_origin for frame in left} == {StampOrigin.ARRIVAL}


def test_a_rate_that_is_given_is_the_rate_a_file_is_played_at(tmp_path):
    film(tmp_path / "a.mp4", count=5, fps=50)
    with watched(source(tmp_path, {"left": {"url": "a.mp4", "fps": 10}})) as seen:
        seen.thread.join(10)
    times = [frame.arrived_ns for frame in seen.frames["left"]]
    assert times[-1] - times[0] > 0.35e9


def test_a_file_that_breaks_off_is_told_and_its_camera_has_not_ended(tmp_path, caplog):
    path = film(tmp_path / "a.avi", count=120)
    path.write_bytes(path.read_bytes()[: path.stat().st_size // 4])
    with watched(source(tmp_path, {"left": {"url": "a.avi", "fps": 1000}})) as seen:
        seen.thread.join(10)
        assert not seen.thread.is_alive()
    assert seen.source.ended == set()
    assert "left: " in caplog.text
    assert " of 120 pictures" in caplog.text


def test_a_file_whose_reader_is_killed_is_not_begun_again(tmp_path, caplog):
    film(tmp_path / "a.avi", count=120)
    with watched(source(tmp_path, {"left": {"url": "a.avi", "fps": 50}})) as seen:
        wait_for(lambda: len(seen.frames["left"]) > 3)
        os.kill(seen.source._streams[0]._reader._process.pid, signal.SIGKILL)
        seen.thread.join(10)
        assert not seen.thread.is_alive()
    assert seen.source.ended == set()
    assert set(seen.epochs("left")) == {0}
    assert re.search(r"left: \S+a.avi ends after \d+ pictures \(its reader has died \(SIGKILL\)\)", caplog.text)


def test_a_file_that_is_waited_for_is_said_to_be_there(tmp_path, caplog):
    running = source(tmp_path, {"left": {"url": "a.avi", "fps": 50}}, wait=True)
    with watched(running) as seen:
        film(tmp_path / "new.avi", count=12).rename(tmp_path / "a.avi")
        seen.thread.join(10)
    assert len(seen.frames["left"]) == 12
    assert "left: pictures again" in caplog.text


def test_a_camera_that_is_waited_for_may_come_later(streams, tmp_path, caplog):
    streams.die()
    running = source(tmp_path, both(streams), wait=True)
    with watched(running) as seen:
        streams.rise()
        wait_for(lambda: min(map(len, seen.frames.values())) > 3)
    assert set(seen.epochs("left")) == {0}
    assert f"left: {streams.url('left')}: not there yet: waiting for it" in caplog.text
    assert "secret" not in caplog.text


def test_an_rtsp_stream_is_read_over_tcp_unless_told_otherwise(tmp_path):
    with Rtsp() as server:
        with watched(source(tmp_path, {"left": {"url": server.url, "fps": 30}})) as seen:
            wait_for(lambda: len(seen.frames["left"]) > 5)
        assert {frame.image.shape for frame in seen.frames["left"]} == {(72, 96, 3)}
        refused = source(tmp_path, {"left": {"url": server.url, "options": {"rtsp_transport": "udp"}}})
        with pytest.raises(InputError, match=r"rtsp://127.0.0.1:\d+/stream: ") as caught:
            refused.open()
        assert "secret" not in str(caught.value)
