"""`syncwatch run` as other programs hear it."""

from __future__ import annotations

import signal
import subprocess
import sys
import uuid

import pytest

from tests.network import free_endpoint, router, subscriber, wait_for
from tests.programs import syncwatch

CONFIG = """
rig: cart
source: {{type: synthetic, duration_s: {duration}, fps: 20, width: 160, height: 120, speed: 1.0}}
faults:
  - {{type: slip, frames: 1, start_s: 2, stop_s: 3}}
  - {{type: slip, frames: -1, start_s: 5, stop_s: 6}}
detectors: {{timestamp: {{}}}}
sinks:
  zenoh: {{{zenoh}, prefix: {prefix}}}
"""


@pytest.fixture
def prefix() -> str:
    return f"test/{uuid.uuid4().hex[:8]}"


def started(folder, **values: str) -> subprocess.Popen[str]:
    (folder / "config.yaml").write_text(CONFIG.format(**values))
    return subprocess.Popen([sys.executable, "-m", "syncwatch", "run"], cwd=folder, stderr=subprocess.PIPE, text=True)


def test_status_and_events_arrive_in_another_process(tmp_path, prefix):
    with subscriber(tmp_path, "--prefix", prefix, "--json") as heard:
        process = started(tmp_path, duration="4", zenoh="mode: peer", prefix=prefix)
        _, said = process.communicate(timeout=40)
        assert process.returncode == 0, said
        wait_for(lambda: len(heard.events()) == 2)
    onset, end = heard.events()
    assert (onset["phase"], end["phase"], end["id"]) == ("onset", "end", onset["id"])
    assert onset["text"] == "right is 50.0 ms later than left since frame 40"
    levels = [status["level"] for status in heard.statuses()]
    assert {"ok", "error"} == set(levels)
    assert heard.statuses()[-1]["pairs"]["left-right"]["state"] == "sync"


def test_a_router_killed_and_restarted_in_between_loses_no_event(tmp_path, prefix):
    endpoint = free_endpoint()
    with router(endpoint) as first, subscriber(tmp_path, "--connect", endpoint, "--prefix", prefix, "--json") as heard:
        process = started(tmp_path, duration="9", zenoh=f"mode: client, connect: [{endpoint}]", prefix=prefix)
        wait_for(lambda: len(heard.events()) == 1, 30)
        first.send_signal(signal.SIGKILL)
        first.wait()
        with pytest.raises(subprocess.TimeoutExpired):
            process.wait(2)
        with router(endpoint):
            _, said = process.communicate(timeout=40)
            assert process.returncode == 0, said
            wait_for(lambda: len(heard.events()) >= 4)
    assert [event["phase"] for event in heard.events()] == ["onset", "end", "onset", "end"]


def test_a_second_rig_of_the_same_name_is_refused_with_one_line(tmp_path, prefix):
    process = started(tmp_path, duration="20", zenoh="mode: peer", prefix=prefix)
    with subscriber(tmp_path, "--prefix", prefix, "--json") as heard:
        wait_for(heard.statuses, 30)
        second = syncwatch("run", cwd=tmp_path)
    process.terminate()
    process.communicate(timeout=20)
    assert process.returncode == 143
    assert second.returncode == 1
    assert "rig 'cart' is already published" in second.stderr
    assert len(second.stderr.splitlines()) == 1
