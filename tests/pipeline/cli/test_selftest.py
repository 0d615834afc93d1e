"""`syncwatch selftest`: footage that is out of sync, what it leaves alone, what it refuses, and how it ends."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from contextlib import suppress
from pathlib import Path

import pytest

from tests.network import wait_for
from tests.programs import inside, syncwatch

RENDERED = """
rig: bench
source: {{type: synthetic, motion: {motion}, duration_s: {seconds}, width: 240, height: 180, speed: 1000}}
detectors: {{timestamp: , offset: {{}}}}
sinks: {{jsonl: {{path: never.jsonl}}}}
"""


def write(folder, motion: str, seconds: float) -> None:
    (folder / "rig.yaml").write_text(RENDERED.format(motion=motion, seconds=seconds))


LIVE = """
from sources.synthetic.settings import SyntheticSettings
from sources.synthetic.source import SyntheticSource
from syncwatch import Settings

class MySettings(Settings):
    type: str
    silent: str = ''

class Mine(SyntheticSource):
    Settings = MySettings
    live = True

    def __init__(self, settings):
        cameras = [{'name': 'left'}, {'name': 'right', 'offset_ms': 16.667}]
        super().__init__(SyntheticSettings(motion='handheld', width=240, height=180, speed=1, cameras=cameras), seed=0)
        self._silent = settings.silent

    def frames(self):
        return (frame for frame in super().frames() if frame.camera != self._silent)
"""

CONFIG = "rig: bench\nsource: {type: 'mine:Mine'}\ndetectors: {offset: }\nsinks: {jsonl: {path: never.jsonl}}\n"


def make_live(folder: Path) -> None:
    (folder / "mine.py").write_text(LIVE)
    (folder / "rig.yaml").write_text(CONFIG)
    (folder / "tmp").mkdir()


@pytest.fixture(scope="module")
def proved(tmp_path_factory):
    """A live rig carried by hand, its second camera half a frame late."""
    folder = tmp_path_factory.mktemp("proved")
    make_live(folder)
    options = ("--for", "2.5s", "--json", "out.json")
    return folder, syncwatch("selftest", "rig.yaml", *options, cwd=folder, TMPDIR=str(folder / "tmp"))


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


def test_a_live_rig_is_recorded_while_it_is_moved_and_nothing_is_left_behind(proved):
    folder, done = proved
    assert "syncwatch: move the rig up and down now" in done.stderr.splitlines()
    left = sorted(path.name for path in folder.iterdir() if path.name != "__pycache__")
    assert left == ["mine.py", "out.json", "rig.yaml", "tmp"]
    assert not list((folder / "tmp").iterdir())


@pytest.fixture
def live(tmp_path):
    make_live(tmp_path)
    return tmp_path


def test_a_live_rig_of_which_a_camera_is_silent_is_an_error_that_names_it(live):
    done = syncwatch("selftest", "rig.yaml", "--for", "1s", "--set", "source.silent=right", cwd=live)
    assert (done.returncode, done.stdout) == (2, "")
    assert "error: nothing came of right within" in done.stderr


def test_a_selftest_that_is_interrupted_while_it_records_leaves_nothing(live):
    command = [sys.executable, "-m", "syncwatch", "selftest", "rig.yaml", "--for", "60s"]
    env = {**os.environ, "TMPDIR": str(live / "tmp")}
    with subprocess.Popen(
        command, cwd=live, env=env, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    ) as program:
        assert program.stderr is not None
        for line in program.stderr:
            if "move the rig" in line:
                break
        program.terminate()
        output, _ = program.communicate(timeout=30)
    assert (program.returncode, output) == (143, "")
    assert not list((live / "tmp").iterdir())


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["nothing.yaml"], "nothing.yaml"),
        (["rig.yaml", "--jobs", "0"], "--jobs"),
        (["rig.yaml", "--for", "3s"], "--for is of a live rig"),
        (["rig.yaml", "--json", "."], "it is a folder"),
        (["rig.yaml", "--set", "pairs=[left-top]"], "no camera 'top'"),
    ],
)
def test_what_cannot_be_used_is_one_line_and_status_2(tmp_path, arguments, said):
    write(tmp_path, "still", 0.2)
    done = inside("selftest", *arguments, cwd=tmp_path)
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
