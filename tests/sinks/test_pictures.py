"""Recordings played to other programs: every picture over a real Zenoh network, and back into a source."""

from __future__ import annotations

import subprocess
import sys
import uuid

import numpy as np
import pytest
import zenoh

from pipeline.zenoh_network import NetworkSettings, session_config
from sinks.pictures import PicturesSettings
from sources.zenoh.samples import read_sample
from syncwatch.testing import render_rig
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
        frame = sent[camera, shot.sequence]
        assert shot.captured_ns == frame.captured_ns
        assert np.array_equal(shot.image, frame.image)


def test_without_publish_a_router_is_refused(tmp_path):
    done = inside("replay", tmp_path, "--connect", "tcp/127.0.0.1:7447", cwd=tmp_path)
    assert done.returncode == 2
    assert "--connect is of --publish" in done.stderr


@pytest.mark.parametrize("key", ["pictures/{rig}", "a//{camera}", "**/{camera}", "{camera}/#"])
def test_keys_that_cannot_be_are_refused(key):
    with pytest.raises(ValueError, match="not a key"):
        PicturesSettings(key=key)
