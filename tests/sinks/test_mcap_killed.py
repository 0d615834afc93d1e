"""A recorder that is killed, or that has no more room, leaves what it had recorded."""

from __future__ import annotations

import os
import random
import resource
import signal
import subprocess
import sys
import time

from tests.programs import ROOT, inside, lines_of
from tests.recorded import replayed, salvaged

FPS = 30

RECORDERS = f"""
import os, sys
import numpy as np
from pathlib import Path
from pipeline.frame import Frame
from tests.frames import RIG
from tests.recorded import Clock, mcap_sink

noise = np.random.default_rng(0).integers(0, 256, (1000, 48, 64), np.uint8)

def record(path, chunk_bytes, progress):
    clock = Clock()
    sink = mcap_sink(path, clock=clock, live=True, chunk_bytes=chunk_bytes)
    sink.start()
    for number in range(100_000):
        clock.now_ns = number * 1_000_000_000 // {FPS}
        for camera in ("left", "right"):
            sink.take_frame(Frame(camera, number, clock(), "rig", clock(), noise[number % 1000], group=number))
        os.pwrite(progress, b"%9d" % number, 0)

for line in sys.stdin:
    path, chunk_bytes = line.split()
    progress = os.open(path + ".progress", os.O_CREAT | os.O_RDWR)
    recorder = os.fork()
    if recorder == 0:
        record(Path(path), int(chunk_bytes), progress)
    print(recorder, flush=True)
    os.waitpid(recorder, 0)
    print("gone", flush=True)
"""
"""Forks a recorder for each line it reads, a path and the size of chunks; each tells the last frame it has taken."""

KILLED = 20


def test_killed_at_any_moment_it_leaves_all_but_the_last_second(tmp_path):
    rng = random.Random(0)
    command = [sys.executable, "-c", RECORDERS]
    with subprocess.Popen(command, cwd=ROOT, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True) as recorders:
        for run in range(KILLED):
            path = tmp_path / f"{run}.mcap"
            recorders.stdin.write(f"{path} {rng.choice([20_000, 1_000_000])}\n")
            recorders.stdin.flush()
            recorder = int(recorders.stdout.readline())
            until = rng.randrange(2 * FPS, 8 * FPS)
            while progress(path) < until and recorders.poll() is None:
                time.sleep(rng.random() / 100)
            os.kill(recorder, signal.SIGKILL)
            assert recorders.stdout.readline() == "gone\n"
            check_all_but_the_last_second(path, progress(path))
            path.unlink()
        recorders.stdin.close()


def progress(path):
    """The number of the last frame that was taken."""
    told = path.with_name(f"{path.name}.progress").read_text()
    return int(told) if told else -1


def check_all_but_the_last_second(path, taken):
    messages = salvaged(path)
    for name in ("left", "right"):
        numbers = [message.sequence for message in messages[f"/{name}/image"]]
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
