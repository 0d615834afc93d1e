"""A recorder that is killed, or that has no more room, leaves what it had recorded."""

from __future__ import annotations

import random
import resource
import signal
import subprocess
import sys

import pytest

from tests.programs import ROOT, inside, lines_of
from tests.recorded import replayed, salvaged

FPS = 30

RECORDER = f"""
import sys
import numpy as np
from pathlib import Path
from pipeline.frame import Frame
from tests.frames import RIG
from tests.recorded import Clock, mcap_sink

clock = Clock()
sink = mcap_sink(Path(sys.argv[1]), clock=clock, live=True, chunk_bytes=int(sys.argv[2]))
sink.start()
noise = np.random.default_rng(0).integers(0, 256, (1000, 48, 64), np.uint8)
for number in range(100_000):
    clock.now_ns = number * 1_000_000_000 // {FPS}
    for camera in ("left", "right"):
        sink.take_frame(Frame(camera, number, clock(), "rig", clock(), noise[number % 1000], group=number))
    print(number, flush=True)
"""


@pytest.mark.parametrize("seed", range(6))
def test_killed_at_any_moment_it_leaves_all_but_the_last_second(tmp_path, seed):
    rng = random.Random(seed)
    path = tmp_path / "a.mcap"
    command = [sys.executable, "-c", RECORDER, str(path), str(rng.choice([20_000, 1_000_000]))]
    with subprocess.Popen(command, cwd=ROOT, stdout=subprocess.PIPE, text=True) as recorder:
        until = rng.randrange(2 * FPS, 20 * FPS)
        for line in recorder.stdout:
            if int(line) >= until:
                recorder.send_signal(signal.SIGKILL)
                break
        taken = max([until, *map(int, recorder.stdout.read().split())])
    for name in ("left", "right"):
        numbers = [message.sequence for message in salvaged(path)[f"/{name}/image"]]
        assert numbers == list(range(len(numbers)))
        assert len(numbers) >= taken - FPS
    back = replayed(path)
    assert len(back) >= 2 * (taken - FPS)
    assert {item.captured_ns for item in back} >= {n * 1_000_000_000 // FPS for n in range(taken - FPS)}


CONFIG = """
source: {type: synthetic, duration_s: 4, width: 160, height: 120}
detectors: {timestamp: {}}
sinks: {jsonl: {path: out.jsonl}, mcap: {path: a.mcap, chunk_bytes: 200000}}
"""


def test_a_full_disk_ends_the_recording_and_not_the_monitoring(tmp_path):
    (tmp_path / "rig.yaml").write_text(CONFIG)
    most = 1_500_000
    done = subprocess.run(
        [sys.executable, "-m", "syncwatch", "run", "rig.yaml"],
        cwd=tmp_path,
        capture_output=True,
        text=True,
        timeout=60,
        check=False,
        preexec_fn=lambda: resource.setrlimit(resource.RLIMIT_FSIZE, (most, most)),
    )
    assert done.returncode == 0, done.stderr
    (said,) = [line for line in done.stderr.splitlines() if "error" in line]
    assert said.startswith("syncwatch: error: ")
    assert "a.mcap: cannot be written any more: File too large: recording ended with what is whole" in said
    assert len(lines_of((tmp_path / "out.jsonl").read_text())) == 120
    assert (tmp_path / "a.mcap").stat().st_size <= most
    back = replayed(tmp_path / "a.mcap")
    assert 30 < len(back) < 100
    for name in ("left", "right"):
        numbers = [item.sequence for item in back if item.camera == name]
        assert numbers == list(range(len(numbers)))


def test_no_room_at_all_is_said_before_anything_runs(tmp_path):
    (tmp_path / "rig.yaml").write_text(CONFIG)
    done = inside("run", "rig.yaml", "--set", "sinks.mcap={path: /dev/full, overwrite: true}", cwd=tmp_path)
    assert done.returncode == 2
    assert done.stderr == "syncwatch: error: /dev/full: cannot be written: No space left on device\n"
