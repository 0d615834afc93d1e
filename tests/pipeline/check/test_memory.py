"""A recording is checked in constant memory, however long it is."""

from __future__ import annotations

import subprocess
import sys

import cv2
import pytest
from foxglove_schemas_protobuf.CompressedImage_pb2 import CompressedImage
from mcap_protobuf.writer import Writer as ProtobufWriter

from pipeline.frame import NS_PER_S
from tests.formats import EPOCH_NS
from tests.frames import texture

FPS = 30
SIZE = (640, 480)
SHORT, LONG = 60, 450
GROWN = 1.15
"""The pictures of the long recording are several times the memory of the whole program."""


def write_recording(path, frames):
    scene = texture(1, 2 * SIZE[0], SIZE[1])
    pictures = [cv2.imencode(".jpg", scene[:, at : at + SIZE[0]])[1].tobytes() for at in range(0, 80, 8)]
    with path.open("wb") as file, ProtobufWriter(file) as writer:
        for number in range(frames):
            at_ns = EPOCH_NS + number * NS_PER_S // FPS
            for camera in ("left", "right"):
                message = CompressedImage(frame_id=camera, data=pictures[number % len(pictures)], format="jpeg")
                message.timestamp.seconds, message.timestamp.nanos = divmod(at_ns, NS_PER_S)
                writer.write_message(f"/{camera}/image", message, at_ns, at_ns)
    return path


MEASURED = """
import resource, subprocess, sys
done = subprocess.run(sys.argv[1:], stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
print(resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss)
sys.exit(done.returncode)
"""
"""A program is credited with the memory of the one that starts it: that has to be a small one."""


def peak_bytes(*arguments):
    """The most memory that a run of the program has had at once."""
    command = [sys.executable, "-c", MEASURED, sys.executable, "-m", "syncwatch", *map(str, arguments)]
    done = subprocess.run(command, capture_output=True, text=True, timeout=100, check=False)
    assert done.returncode in {0, 4}, done.stderr
    return int(done.stdout) * 1024


@pytest.mark.skipif(sys.platform != "linux", reason="ru_maxrss is in KiB on Linux")
def test_several_times_as_long_takes_no_more_memory(tmp_path):
    options = ("--all", "--set", "detectors={timestamp: {}}")
    short = peak_bytes("check", write_recording(tmp_path / "short.mcap", SHORT), *options)
    long = peak_bytes("check", write_recording(tmp_path / "long.mcap", LONG), *options)
    assert LONG * 2 * SIZE[0] * SIZE[1] > 2 * short, "or else this would show nothing"
    assert long < GROWN * short
