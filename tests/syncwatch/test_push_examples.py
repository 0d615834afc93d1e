"""The examples that push run, the one for the Raspberry Pi against a stand-in for its library."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from functools import partial

import cv2

from sources.synthetic.settings import SyntheticSettings
from sources.synthetic.source import SyntheticSource
from tests.programs import ROOT

PICAMERA2 = """
import os, signal, time
import numpy as np


class Request:
    def __init__(self, number, stamp_ns):
        self.number, self.stamp_ns = number, stamp_ns

    def make_array(self, name):
        return np.full((48, 64, 3), 90, np.uint8)

    def get_metadata(self):
        return {"SensorTimestamp": self.stamp_ns + 20_000_000 * self.number, "ExposureTime": 5000}

    def release(self):
        pass


class Picamera2:
    def __init__(self, number):
        self.number, self.taken = number, 0

    def create_video_configuration(self, main):
        return main

    def configure(self, configuration):
        assert configuration["format"] == "RGB888"

    def set_controls(self, controls):
        pass

    def start(self):
        pass

    def stop(self):
        pass

    def capture_request(self):
        self.taken += 1
        time.sleep(0.01)
        if self.taken == 100 and self.number == 0:
            os.kill(os.getpid(), signal.SIGINT)
        return Request(self.number, self.taken * 33_333_333)
"""


def run(*command, **environment):
    env = {**os.environ, "PYTHONPATH": str(ROOT), **environment}
    command = [sys.executable, *map(str, command)]
    heeds = partial(signal.signal, signal.SIGINT, signal.default_int_handler)  # what runs in the background ignores it
    done = subprocess.run(
        command, check=False, cwd=ROOT, env=env, capture_output=True, text=True, timeout=100, preexec_fn=heeds
    )
    assert done.returncode == 0, done.stderr
    return done.stdout.splitlines()


def write_videos(folder, **right):
    cameras = ({"name": "left"}, {"name": "right", **right})
    settings = SyntheticSettings(width=192, height=144, fps=30, duration_s=2.5, cameras=cameras)
    source = SyntheticSource(settings, seed=3)
    source.open()
    writers = {
        name: cv2.VideoWriter(str(folder / f"{name}.avi"), cv2.VideoWriter.fourcc(*"MJPG"), 30, (192, 144))
        for name in ("left", "right")
    }
    for item in source.frames():
        writers[item.camera].write(cv2.cvtColor(item.image, cv2.COLOR_GRAY2BGR))
    for writer in writers.values():
        writer.release()
    return folder / "left.avi", folder / "right.avi"


def test_opencv_push_tells_of_pictures_that_are_apart(tmp_path):
    said = run("examples/opencv_push.py", *write_videos(tmp_path, offset_ms=-12))
    assert any(line.startswith("onset: right is 1") and "ms earlier" in line for line in said)
    assert said[-1] == "left-right: async"


def test_opencv_push_says_what_cannot_be_opened(tmp_path):
    said = run("examples/opencv_push.py", tmp_path / "no.avi", tmp_path / "none.avi")
    assert f"left: {tmp_path / 'no.avi'} cannot be opened" in said
    assert said[-1] == "left-right: unknown"


def test_picamera2_push_tells_of_cameras_that_are_apart(tmp_path):
    (tmp_path / "picamera2.py").write_text(PICAMERA2)
    said = run("examples/picamera2_push.py", PYTHONPATH=f"{ROOT}{os.pathsep}{tmp_path}")
    assert any(line.startswith("onset: right is 13.3 ms earlier") for line in said)
