"""Recordings played to other programs: every picture over a real Zenoh network, and back into a source."""

from __future__ import annotations

import subprocess
import sys
import threading
import uuid

import numpy as np
import pytest
import zenoh

from pipeline.frame import StampOrigin
from pipeline.zenoh_network import NetworkSettings, session_config
from sinks.pictures import PicturesSettings, PicturesSink
from sources.zenoh.samples import read_sample
from sources.zenoh.settings import ZenohSourceSettings
from sources.zenoh.source import ZenohSource
from syncwatch.testing import render_rig
from tests.frames import frame
from tests.network import free_endpoint, router, wait_for
from tests.programs import inside


def heard(subscriber):
    samples = []
    while (sample := subscriber.try_recv()) is not None:
        samples.append(sample)
    return samples


@pytest.mark.parametrize("encoding", ["raw", "png"])
def test_a_recording_is_published_picture_by_picture(tmp_path, encoding):
    rig = render_rig(tmp_path / "rig.mcap", seconds=1.5, fps=20, width=64, height=48)
    sent = {(one.camera, one.sequence): one for one in rig.frames()}
    endpoint, name = free_endpoint(), f"rig{uuid.uuid4().hex[:8]}"
    with router(endpoint), zenoh.open(session_config(NetworkSettings(mode="client", connect=(endpoint,)))) as session:
        pictures = session.declare_subscriber(f"pictures/{name}/*", zenoh.handlers.FifoChannel(1000))
        states = session.declare_subscriber(f"syncwatch/{name}/status", zenoh.handlers.FifoChannel(1000))
        wait_for(session.info.routers_zid)
        arguments = [str(rig.path), "--publish", "--connect", endpoint, "--set", f"rig={name}"]
        arguments += ["--set", f"sinks.pictures.encoding={encoding}", "--set", "sinks.pictures.required=true"]
        command = [sys.executable, "-m", "syncwatch", "replay", *arguments]
        subprocess.run(command, cwd=tmp_path, capture_output=True, timeout=60, check=True)
        samples = heard(pictures)
        assert heard(states)
    assert len(samples) > 40
    for sample in samples:
        shot = read_sample(str(sample.key_expr), sample.payload.to_bytes(), sample.attachment.to_bytes())
        camera = str(sample.key_expr).rpartition("/")[2]
        original = sent[camera, shot.sequence]
        assert shot.captured_ns == original.captured_ns
        assert np.array_equal(shot.image, original.image)


@pytest.mark.parametrize("origin", list(StampOrigin))
def test_who_listens_is_told_what_stamps_are_worth_and_of_which_machine(origin):
    endpoint, name = free_endpoint(), f"rig{uuid.uuid4().hex[:8]}"
    sink = PicturesSink(PicturesSettings(listen=[endpoint]), rig=name)
    network = {"mode": "client", "connect": [endpoint]}
    source = ZenohSource(ZenohSourceSettings(cameras={"left": {"key": f"pictures/{name}/left", "fps": 30}}, **network))
    sink.start()
    source.open()
    frames = source.frames()
    sent = frame("left", 5, 1, clock="monotonic", stamp_origin=origin)
    said = threading.Event()
    threading.Thread(target=lambda: [sink.take_frame(sent) for _ in iter(lambda: said.wait(0.05), True)]).start()
    try:
        heard_of = next(frames)
    finally:
        said.set()
        source.close()
        sink.stop()
    assert (heard_of.captured_ns, heard_of.clock, heard_of.stamp_origin) == (5, f"{name}/monotonic", origin)


def test_without_publish_a_router_is_refused(tmp_path):
    done = inside("replay", tmp_path, "--connect", "tcp/127.0.0.1:7447", cwd=tmp_path)
    assert done.returncode == 2
    assert "--connect is of --publish" in done.stderr


@pytest.mark.parametrize("key", ["pictures/{rig}", "a//{camera}", "**/{camera}", "{camera}/#"])
def test_keys_that_cannot_be_are_refused(key):
    with pytest.raises(ValueError, match="not a key"):
        PicturesSettings(key=key)
