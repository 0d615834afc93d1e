"""A rendered rig shown through two V4L2 cameras whose stamps look fine while the pictures of one come late."""

from __future__ import annotations

import re
import subprocess
import sys
from statistics import median

import pytest

from tests.guest.machine import RESULTS, running

FPS = 1
"""What an emulated machine looks at in time, unless the one below it is busy."""

STARTING_S, FINDING_S = 400, 300
"""Limits for a machine that has much else to do; else it is a fifth of that."""

JUDGED = 10
LEAST_IN_SYNC = 8
LASTING = 7
"""Verdicts after which the console tells of a change, and then some."""


def by_pictures(lines, state):
    return [line for line in lines if (line["state"], line["basis"]) == (state, "content")]


@pytest.mark.timeout(900)
def test_pictures_a_frame_late_are_found_although_stamps_agree(loopback, tmp_path):
    left, right = loopback
    camera = {"format": "GREY", "size": [320, 240], "fps": FPS}
    config = {
        "rig": "bench",
        "source": {
            "type": "v4l2",
            "cameras": {"left": {"device": left, **camera}, "right": {"device": right, **camera}},
        },
        "detectors": {"timestamp": {}, "offset": {}},
    }
    play = [sys.executable, "-m", "tests.guest.play", str(FPS), str(RESULTS / "rig.npz"), left, right]
    pipes = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE, "text": True}
    with subprocess.Popen(play, **pipes) as player:
        try:
            assert player.stdout.readline() == "playing\n"
            with running(config, tmp_path) as program:
                program.until(lambda lines: len(by_pictures(lines, "sync")) >= LEAST_IN_SYNC, within_s=STARTING_S)
                player.stdin.write("late\n")
                player.stdin.flush()
                onset_ns = int(player.stdout.readline())
                program.until(lambda lines: len(by_pictures(lines, "async")) >= LASTING, within_s=FINDING_S)
                player.kill()
                program.until_quiet()
                output, log = program.terminate()
                judged = program.judged()
        finally:
            player.kill()
    before = [line for line in judged if line["captured_ns"]["left"] < onset_ns]
    after = judged[len(before) :]
    found = by_pictures(after, "async")[0]
    told = re.search(r"detection was too slow: (\d+) windows dropped", log)
    dropped = int(told[1]) if told else 0
    print(f"found after {after.index(found)} judged windows; {len(judged)} judged, {dropped} dropped")  # noqa: T201
    assert not by_pictures(before, "async")
    assert after.index(found) < JUDGED
    assert len(judged) + dropped == judged[-1]["frame"] + 1
    assert found["cause"] == "stamps_lie"
    assert found["offset_frames"] == pytest.approx(-1, abs=0.1)
    assert median(line["interval_ms"] for line in judged if line["interval_ms"] is not None) < found["tolerance_ms"]
    assert "ASYNC stamps_lie" in output
