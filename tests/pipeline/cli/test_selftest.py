"""`syncwatch selftest`: footage that is out of sync, what it leaves alone, what it refuses, and how it ends."""

from __future__ import annotations

import json
import subprocess
import sys
from contextlib import suppress
from pathlib import Path

import pytest

from tests.network import wait_for
from tests.programs import syncwatch

RENDERED = """
rig: bench
source: {{type: synthetic, motion: {motion}, duration_s: {seconds}, width: 240, height: 180, speed: 1000}}
detectors: {{timestamp: , offset: {{}}}}
sinks: {{jsonl: {{path: never.jsonl}}}}
"""


def write(folder, motion: str, seconds: float) -> None:
    (folder / "rig.yaml").write_text(RENDERED.format(motion=motion, seconds=seconds))


@pytest.fixture(scope="module")
def proved(tmp_path_factory):
    """A rig carried by hand, its second camera half a frame late."""
    folder = tmp_path_factory.mktemp("proved")
    write(folder, "handheld", 3)
    late = "source.cameras=[{name: left}, {name: right, offset_ms: 16.667}]"
    return folder, syncwatch("selftest", "rig.yaml", "--set", late, "--json", "out.json", cwd=folder)


def test_footage_that_is_out_of_sync_proves_the_detector_and_is_told_as_it_is(proved):
    _, done = proved
    assert done.returncode == 0, (done.stdout, done.stderr)
    text = " ".join(done.stdout.split())
    assert "OUT OF SYNC by +0.5" in text
    assert "The smallest offset that this footage can show is" in text


def test_every_number_is_in_the_json(proved):
    folder, _ = proved
    told = json.loads((folder / "out.json").read_text())
    assert (told["schema"], told["conclusion"], told["rig"]) == ("syncwatch.selftest.v1", "proved", "bench")
    tests = {item["test"]: item for item in told["tests"]}
    assert tests["shift by +1"]["numbers"]["value_frames"] == pytest.approx(1, abs=0.1)
    assert tests["shift by -2"]["numbers"]["value_frames"] == pytest.approx(-2, abs=0.1)
    assert tests["swap"]["outcome"] == "pass"
    assert 0 <= tests["slip of one frame"]["numbers"]["delay_frames"] <= 20
    assert tests["odd / even points"]["outcome"] == "pass"
    (pair,) = told["pairs"]
    assert pair["async"] >= 10
    assert pair["smallest_offset_ms"] == pytest.approx(pair["smallest_offset_frames"] * told["period_ms"])


def test_the_sinks_of_the_configuration_are_left_alone(proved):
    folder, _ = proved
    assert sorted(path.name for path in folder.iterdir()) == ["out.json", "rig.yaml"]


LIVE = """
from syncwatch import Camera, Settings
class MySettings(Settings):
    type: str
class Mine:
    Settings = MySettings
    live, frame_count = True, None
    cameras = [Camera('left', 10), Camera('right', 10)]
    def __init__(self, settings): pass
    def open(self): raise OSError('a live camera was opened')
    def frames(self): return iter(())
    def stop(self): pass
    def close(self): pass
"""


def test_a_live_source_is_refused_before_it_is_opened(tmp_path):
    (tmp_path / "mine.py").write_text(LIVE)
    (tmp_path / "c.yaml").write_text("source: {type: 'mine:Mine'}\ndetectors: {offset: }\n")
    done = syncwatch("selftest", "c.yaml", cwd=tmp_path)
    assert (done.returncode, done.stdout, len(done.stderr.splitlines())) == (2, "", 1)
    assert "is live and cannot be run twice: record it" in done.stderr


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["nothing.yaml"], "nothing.yaml"),
        (["rig.yaml", "--jobs", "0"], "--jobs"),
        (["rig.yaml", "--json", "."], "it is a folder"),
        (["rig.yaml", "--set", "pairs=[left-top]"], "no camera 'top'"),
    ],
)
def test_what_cannot_be_used_is_one_line_and_status_2(tmp_path, arguments, said):
    write(tmp_path, "still", 0.2)
    done = syncwatch("selftest", *arguments, cwd=tmp_path)
    assert (done.returncode, done.stdout) == (2, "")
    assert said in done.stderr
    assert "Traceback" not in done.stderr


def test_no_process_outlives_one_that_is_killed(tmp_path):
    write(tmp_path, "handheld", 4)
    command = [sys.executable, "-m", "syncwatch", "selftest", "rig.yaml"]
    with subprocess.Popen(
        command, cwd=tmp_path, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True, start_new_session=True
    ) as process:
        assert process.stderr is not None
        for line in process.stderr:
            if "swapped" in line:
                break
        wait_for(lambda: len(processes_of(process.pid)) > 2, 30)
        process.kill()
        process.wait(30)
        wait_for(lambda: not processes_of(process.pid), 30)


def processes_of(group: int) -> list[int]:
    """The processes of a group, without those that have ended and wait to be fetched."""
    found = []
    for status in Path("/proc").glob("[0-9]*/stat"):
        with suppress(OSError):
            state, _, of_group = status.read_text().rpartition(")")[2].split()[:3]
            if int(of_group) == group and state != "Z":
                found.append(int(status.parent.name))
    return found
