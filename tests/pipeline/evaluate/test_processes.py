"""How an evaluation ends when it is not let to its end: at once, with all its processes."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from contextlib import contextmanager

import pytest

from tests.network import wait_for
from tests.pipeline.cli.test_selftest import processes_of

LONG = """
recordings:
  rendered: {type: synthetic, duration_s: 3000, fps: 30, width: 160, height: 120, motion: handheld}
scenarios:
  first: {recording: rendered, expect: {state: sync}}
  second: {recording: rendered, expect: {state: sync}}
detectors: {timestamp: {}}
"""


@contextmanager
def evaluating(folder):
    """A long evaluation whose two workers are at work."""
    (folder / "suite.yaml").write_text(LONG)
    command = [sys.executable, "-m", "syncwatch", "evaluate", "suite.yaml", "--jobs", "2"]
    with subprocess.Popen(
        command,
        cwd=folder,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        start_new_session=True,
        preexec_fn=_listen_to_ctrl_c,  # noqa: PLW1509 - no threads here
    ) as process:
        try:
            wait_for(lambda: sum(map(busy, {*processes_of(process.pid)} - {process.pid})) == 2, 40)
            yield process
        finally:
            for left in processes_of(process.pid):
                os.kill(left, signal.SIGKILL)


def _listen_to_ctrl_c() -> None:
    """A shell that runs the tests in the background has them, and what they start, ignore it."""
    signal.signal(signal.SIGINT, signal.SIG_DFL)


def busy(pid: int) -> bool:
    """Whether a process has computed for a second: its modules are loaded, it is at work."""
    try:
        with open(f"/proc/{pid}/stat") as stat:  # noqa: PTH123 - it may be gone
            ticks = sum(map(int, stat.read().rpartition(")")[2].split()[11:13]))
    except OSError:
        return False
    return ticks >= os.sysconf("SC_CLK_TCK")


@pytest.mark.parametrize("everyone", [False, True])
def test_ctrl_c_ends_it_at_once(tmp_path, everyone):
    with evaluating(tmp_path) as process:
        begun = time.monotonic()
        (os.killpg if everyone else os.kill)(process.pid, signal.SIGINT)
        output, _ = process.communicate(timeout=40)
        assert process.returncode == 130, output
        assert time.monotonic() - begun < 10
        assert "Traceback" not in output
        wait_for(lambda: not processes_of(process.pid), 40)


@pytest.mark.parametrize("number", [signal.SIGKILL, signal.SIGTERM])
def test_no_process_outlives_one_that_is_killed(tmp_path, number):
    with evaluating(tmp_path) as process:
        process.send_signal(number)
        process.wait(40)
        wait_for(lambda: not processes_of(process.pid), 40)
