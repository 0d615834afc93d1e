"""Pictures over a real Zenoh network: whose they are, what is left out, and networks that come and go."""

from __future__ import annotations

import logging
import threading
import time
import uuid
from contextlib import contextmanager

import cv2
import numpy as np
import pytest
import zenoh
from pydantic import ValidationError

from pipeline.frame import StampOrigin
from pipeline.zenoh_network import NetworkSettings, session_config
from sources.zenoh.settings import ZenohSourceSettings
from sources.zenoh.source import ZenohSource
from tests.network import free_endpoint, router, wait_for
from tests.programs import syncwatch
from tests.publishing import (
    PICTURE,
    network,
    publishing,
    rmw_attachment,
    rmw_key,
    ros_compressed,
    ros_image,
    said,
)

PNG = cv2.imencode(".png", PICTURE)[1].tobytes()
LARGE_PNG = cv2.imencode(".png", np.zeros((8, 8), np.uint8))[1].tobytes()


@pytest.fixture
def prefix() -> str:
    """Nobody else on this machine uses it."""
    return f"test{uuid.uuid4().hex[:8]}"


def settings(endpoint, prefix, key="0/{}/**", **more):
    cameras = {name: {"key": key.format(f"{prefix}/{name}"), "fps": 30} for name in ("left", "right")}
    return ZenohSourceSettings.model_validate({"connect": [endpoint], "cameras": cameras, **more})


class Reading:
    """A source that is read on a thread of its own."""

    def __init__(self, made: ZenohSource) -> None:
        self.source = made
        self.frames = []
        self.thread = threading.Thread(target=self._read, daemon=True)

    def _read(self) -> None:
        for item in self.source.frames():
            self.frames.append(item)

    def of(self, camera: str):
        return [item for item in list(self.frames) if item.camera == camera]


@contextmanager
def reading(made: ZenohSource):
    made.open()
    read = Reading(made)
    read.thread.start()
    try:
        yield read
    finally:
        began = time.monotonic()
        made.stop()
        read.thread.join(5)
        assert not read.thread.is_alive()
        made.close()
        assert time.monotonic() - began < 5


def put_until(read, session, key, make, condition):
    """Publishes until it has been heard: peers take a moment to find each other."""
    numbers = iter(range(1, 10_000))

    def once():
        payload, attachment = make(next(numbers))
        session.put(key, payload, attachment=attachment)
        return condition()

    wait_for(once)


def test_ros_images_of_two_cameras_become_frames_in_order(prefix):
    endpoint = free_endpoint()
    with publishing(endpoint, prefix), reading(ZenohSource(settings(endpoint, prefix))) as read:
        wait_for(lambda: len(read.of("left")) >= 10 and len(read.of("right")) >= 10)
    for name in ("left", "right"):
        frames = read.of(name)
        assert len({item.captured_ns - item.sequence * 10_000_000 for item in frames}) == 1
        assert [item.sequence for item in frames] == list(range(frames[0].sequence, frames[0].sequence + len(frames)))
        assert {(item.clock, item.stamp_origin, item.epoch) for item in frames} == {("ros", StampOrigin.DRIVER, 0)}
        assert np.array_equal(frames[0].image, PICTURE)


def test_a_picture_without_a_stamp_is_stamped_at_arrival(prefix):
    endpoint = free_endpoint()
    with network(endpoint) as session, reading(ZenohSource(settings(endpoint, prefix))) as read:
        put_until(read, session, f"0/{prefix}/left/png", lambda _: (PNG, None), lambda: read.frames)
    first = read.frames[0]
    assert (first.stamp_origin, first.clock) == (StampOrigin.ARRIVAL, "monotonic")
    assert first.captured_ns == first.arrived_ns


def test_what_cannot_be_decoded_is_counted_and_said_once_a_kind(prefix, caplog):
    endpoint = free_endpoint()
    made = ZenohSource(settings(endpoint, prefix))
    with network(endpoint) as session, reading(made) as read:
        key = f"0/{prefix}/left/raw"
        put_until(read, session, key, lambda _: (b"junk", None), lambda: made.refused["left"] > 3)
        facts = {"encoding": "mono8", "height": 4}
        put_until(read, session, key, lambda n: (b"x" * n, said(width=n, **facts)), lambda: made.refused["left"] > 8)
        put_until(read, session, key, lambda n: (ros_image(n), None), lambda: read.frames)
    refusals = [line for line in caplog.messages if key in line]
    assert len(refusals) == 2
    assert "neither a ROS image nor JPEG nor PNG" in refusals[0]
    assert "bytes of data" in refusals[1]
    assert any(line.startswith(f"left: {made.refused['left']} samples could not be used") for line in caplog.messages)


def test_pictures_of_another_size_are_left_out_until_those_of_before_have_ceased(prefix, caplog):
    endpoint = free_endpoint()
    made = ZenohSource(settings(endpoint, prefix))
    with network(endpoint) as session, reading(made) as read:
        key = f"0/{prefix}/left/raw"
        put_until(read, session, key, lambda n: (ros_image(n), None), lambda: read.frames)
        large = np.zeros((8, 8), np.uint8)
        put_until(read, session, key, lambda n: (ros_image(n, large), None), lambda: made.refused["left"])
        assert {item.image.shape for item in read.frames} == {(4, 6)}
        put_until(read, session, key, lambda n: (ros_image(n, large), None), lambda: read.frames[-1].epoch)
    assert (read.frames[-1].epoch, read.frames[-1].image.shape) == (1, (8, 8))
    assert any("8x8 pixels are left out, for pictures of 6x4 are heard" in line for line in caplog.messages)


def test_a_second_publisher_under_the_same_wildcard_is_left_out_and_said(prefix, caplog):
    endpoint = free_endpoint()
    made = ZenohSource(settings(endpoint, prefix))
    with network(endpoint) as session, reading(made) as read:
        raw, packed = rmw_key(f"{prefix}/left"), rmw_key(f"{prefix}/left/compressed", "CompressedImage")
        put_until(read, session, raw, lambda n: (ros_image(n), rmw_attachment(n)), lambda: read.frames)
        for number in range(100, 103):
            session.put(raw, ros_image(number), attachment=rmw_attachment(number))
            session.put(packed, ros_compressed(number, PNG), attachment=rmw_attachment(number, gid=9))
        wait_for(lambda: made.refused["left"] >= 3)
    assert {item.epoch for item in read.frames} == {0}
    assert sum("give the camera a key that only one publisher has" in line for line in caplog.messages) == 1


def test_a_publisher_that_is_restarted_is_heard_again_in_a_new_epoch(prefix, monkeypatch):
    monkeypatch.setattr("sources.zenoh.source.SWITCH_AFTER_NS", 100_000_000)
    endpoint = free_endpoint()
    with network(endpoint) as session, reading(ZenohSource(settings(endpoint, prefix))) as read:
        key = rmw_key(f"{prefix}/left")
        put_until(read, session, key, lambda n: (ros_image(n), rmw_attachment(n)), lambda: read.frames)
        time.sleep(0.15)
        session.put(key, ros_image(1), attachment=rmw_attachment(1, gid=8))
        wait_for(lambda: read.frames[-1].epoch == 1)


def test_an_epoch_that_the_publisher_states_never_falls(prefix):
    endpoint = free_endpoint()
    with network(endpoint) as session, reading(ZenohSource(settings(endpoint, prefix))) as read:
        key = f"0/{prefix}/left/png"
        put_until(read, session, key, lambda n: (PNG, said(captured_ns=n, epoch=4)), lambda: read.frames)
        for epoch, picture in ((5, PNG), (5, PNG), (0, LARGE_PNG)):
            session.put(key, picture, attachment=said(captured_ns=1, epoch=epoch))
        wait_for(lambda: len(read.frames) >= 4 and read.frames[-1].epoch == 2)
    assert [item.epoch for item in read.frames[-3:]] == [1, 1, 2]
    assert read.frames[-1].image.shape == (8, 8)


def test_a_reader_that_is_slow_loses_the_oldest_and_it_is_said(prefix, caplog):
    endpoint = free_endpoint()
    made = ZenohSource(settings(endpoint, prefix, frames_ahead=3))
    made.open()
    with publishing(endpoint, prefix):
        frames = made.frames()
        first = next(frames)
        wait_for(lambda: all(made._inbox.dropped.values()))
        second = next(item for item in frames if item.camera == first.camera)
        made.stop()
        assert list(frames) == []
        made.close()
    assert second.sequence > first.sequence + 1
    assert any("frames were not taken fast enough" in line for line in caplog.messages)


def test_a_router_that_is_absent_and_one_that_is_restarted_are_waited_for(prefix, caplog):
    caplog.set_level(logging.INFO, "syncwatch.sources.zenoh")
    endpoint = free_endpoint()
    made = ZenohSource(settings(endpoint, prefix, mode="client"))
    publisher = session_config(NetworkSettings(mode="client", connect=(endpoint,)))
    with reading(made) as read:
        assert any(f"cannot reach {endpoint} yet" in line for line in caplog.messages)
        key = rmw_key(f"{prefix}/left")
        with router(endpoint), zenoh.open(publisher) as session:
            put_until(read, session, key, lambda n: (ros_image(n), rmw_attachment(n)), lambda: read.frames)
        heard = len(read.frames)
        with router(endpoint), zenoh.open(publisher) as session:
            put_until(read, session, key, lambda n: (ros_image(n), None), lambda: len(read.frames) > heard)
    assert sum("cannot reach" in line for line in caplog.messages) == 1


def test_a_topic_nobody_publishes_is_hinted_at_once(prefix, caplog, monkeypatch):
    monkeypatch.setattr("sources.zenoh.source.HINT_AFTER_NS", 100_000_000)
    endpoint = free_endpoint()
    with reading(ZenohSource(settings(endpoint, prefix))):
        wait_for(lambda: len(caplog.messages) >= 2)
    assert (
        caplog.messages[0] == f"left: nothing is published on 0/{prefix}/left/** yet ({endpoint}: nobody answers there)"
    )


def test_it_can_be_closed_without_having_been_read(prefix):
    made = ZenohSource(settings(free_endpoint(), prefix))
    made.open()
    made.close()


def config(folder, endpoint, prefix, right="right"):
    (folder / "config.yaml").write_text(
        f"""
source:
  type: zenoh
  connect: [{endpoint}]
  cameras:
    left: {{key: "0/{prefix}/left/**", fps: 30}}
    right: {{key: "0/{prefix}/{right}/**", fps: 30}}
detectors: {{timestamp: {{}}}}
"""
    )


def test_check_says_of_a_ros_rig_that_it_is_in_sync(prefix, tmp_path):
    """Stamps of 33 ms apart, heard at their pace."""
    endpoint = free_endpoint()
    config(tmp_path, endpoint, prefix)
    with publishing(endpoint, prefix, 33_333_333):
        done = syncwatch("check", "config.yaml", "--for", "3s", cwd=tmp_path)
    assert done.returncode == 0, done.stderr


def test_check_says_that_a_camera_is_missing(prefix, tmp_path):
    endpoint = free_endpoint()
    config(tmp_path, endpoint, prefix, right="rihgt")
    with publishing(endpoint, prefix, 33_333_333):
        done = syncwatch("check", "config.yaml", "--for", "3s", cwd=tmp_path)
    assert done.returncode == 3, done.stderr
    assert "right delivers nothing" in done.stdout


@pytest.mark.parametrize("keys", [("rig/left", "rig/left"), ("rig/**", "rig/right"), ("rig/left", "rig/*")])
def test_a_camera_that_would_hear_another_ones_pictures_is_an_error(keys):
    cameras = {name: {"key": key, "fps": 30} for name, key in zip(("left", "right"), keys, strict=True)}
    with pytest.raises(ValidationError, match="would hear all pictures of"):
        ZenohSourceSettings.model_validate({"cameras": cameras})
