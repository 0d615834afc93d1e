"""`run`, `check`, `validate`, `init` and `schema`, from outside."""

from __future__ import annotations

import json
import signal
import subprocess
import sys

import pytest
import yaml

import syncwatch as face
from tests.network import wait_for
from tests.programs import ROOT, inside, syncwatch, write_folders

QUIET = ("--set", "sinks={console: {}}")


@pytest.fixture(scope="module")
def default_run(tmp_path_factory):
    """The shipped configuration, without the network."""
    return syncwatch("run", *QUIET, cwd=tmp_path_factory.mktemp("empty"))


def test_the_default_run_needs_nothing_and_finds_both_faults_without_a_false_alarm(default_run):
    assert default_run.returncode == 0, default_run.stderr
    assert "2 of 2 injected faults found" in default_run.stdout
    assert "0 false alarms" in default_run.stdout


def test_the_default_run_names_the_causes(default_run):
    lines = default_run.stdout.splitlines()
    told = {line.split()[4]: int(line.split()[0]) for line in lines if "ASYNC" in line}
    assert 120 <= told["slip"] <= 126
    assert 360 <= told["stamps_lie"] <= 366


def test_the_configuration_of_this_folder_is_taken_before_the_shipped_one(tmp_path):
    (tmp_path / "config.yaml").write_text("source: {type: synthetic, fps: 0}\ndetectors: {timestamp: }\n")
    done = syncwatch("run", cwd=tmp_path)
    assert done.returncode == 2
    assert done.stderr.startswith("config.yaml:1:")
    assert "source.fps: must be at least 0.001" in done.stderr


def test_all_errors_come_at_once_with_their_places(tmp_path):
    (tmp_path / "bad.yaml").write_text(
        "source: {type: synthetik}\n"
        "detectors:\n"
        "  timestamp: {threshold: 3}\n"
        "sinks:\n"
        "  zenoh: {prefx: a}\n"
        "faults:\n"
        "  - {type: slip, frame: 1}\n"
    )
    done = inside("validate", "bad.yaml", cwd=tmp_path)
    assert done.returncode == 2
    places = [line for line in done.stderr.splitlines() if ": error: " in line]
    assert [line.split(": error: ")[1].split(":")[0] for line in places] == [
        "source.type", "detectors.timestamp.threshold", "sinks.zenoh.prefx", "faults[0].frame",
    ]  # fmt: skip
    assert "bad.yaml:5:11: error: sinks.zenoh.prefx: unknown field - did you mean 'prefix'?" in done.stderr


def test_a_fault_on_a_camera_that_does_not_exist_is_placed(tmp_path):
    (tmp_path / "c.yaml").write_text(
        "source: {type: synthetic}\ndetectors: {timestamp: }\nfaults:\n  - {type: slip, camera: top}\n"
    )
    done = inside("run", "c.yaml", cwd=tmp_path)
    assert done.returncode == 2
    assert "c.yaml:4:26: error: faults[0].camera: no camera 'top': this rig has left, right" in done.stderr


def test_a_pair_of_a_camera_that_does_not_exist_is_placed(tmp_path):
    (tmp_path / "c.yaml").write_text("source: {type: synthetic}\ndetectors: {timestamp: }\npairs: [left-top]\n")
    done = inside("validate", "c.yaml", cwd=tmp_path)
    assert (done.returncode, "no camera 'top'" in done.stderr) == (2, True)


@pytest.mark.parametrize("command", ["run", "validate", "check"])
def test_a_missing_configuration_is_one_line(tmp_path, command):
    done = inside(command, "nothing.yaml", cwd=tmp_path)
    assert (done.returncode, done.stdout) == (2, "")
    assert len(done.stderr.splitlines()) == 1
    assert "nothing.yaml" in done.stderr


def test_validate_prints_the_plan(tmp_path):
    done = inside("validate", cwd=tmp_path)
    assert done.returncode == 0
    assert "left-right (in sync within 3.3 ms)" in done.stdout
    assert "slip (4 s to 8 s)" in done.stdout


def test_validate_can_leave_the_environment_alone(tmp_path):
    (tmp_path / "c.yaml").write_text("source: {type: replay, path: nowhere}\ndetectors: {timestamp: }\n")
    assert inside("validate", "c.yaml", cwd=tmp_path).returncode == 2
    assert inside("validate", "--no-environment", "c.yaml", cwd=tmp_path).returncode == 0


def test_init_writes_what_run_would_have_used_and_never_overwrites(tmp_path):
    assert inside("init", cwd=tmp_path).returncode == 0
    assert (tmp_path / "config.yaml").read_text() == (ROOT / "config.yaml").read_text()
    schema = json.loads((tmp_path / "syncwatch.schema.json").read_text())
    assert "source" in schema["properties"]
    again = inside("init", cwd=tmp_path)
    assert again.returncode == 2
    assert "exists already" in again.stderr


def test_the_schema_knows_every_key_of_the_default_configuration(tmp_path):
    schema = json.loads(inside("schema", cwd=tmp_path).stdout)
    config = yaml.safe_load((ROOT / "config.yaml").read_text())
    assert set(config) <= set(schema["properties"])
    assert schema["additionalProperties"] is False


def test_the_environment_and_set_change_values(tmp_path):
    done = syncwatch("validate", "--set", "source.fps=10", cwd=tmp_path, HOSTNAME="cart7")
    assert "cart7" in done.stdout
    assert "left (10 fps)" in done.stdout


@pytest.mark.parametrize(
    ("changes", "status", "headline"),
    [
        (["faults=[]"], 0, "In sync."),
        (["faults=[{type: slip, frames: 1}]"], 3, "OUT OF SYNC."),
        (["faults=[]", "source.motion=still", "detectors={spatial: {}}", "source.duration_s=0.2"], 4, "Cannot tell."),
    ],
)
def test_check_answers_with_its_status_and_a_sentence(tmp_path, changes, status, headline):
    (tmp_path / "rig.yaml").write_text((ROOT / "config.yaml").read_text())
    arguments = [part for change in ("source.duration_s=2", *changes) for part in ("--set", change)]
    done = inside("check", "rig.yaml", *arguments, cwd=tmp_path)
    assert (done.returncode, headline in done.stdout) == (status, True), (done.stdout, done.stderr)


def test_check_takes_a_recording(tmp_path):
    folder = write_folders(tmp_path / "rig", 30)
    assert inside("check", folder, "--fps", "10", cwd=tmp_path).returncode == 0
    refused = inside("check", folder, "--from", "2", "--to", "1", cwd=tmp_path)
    assert (refused.returncode, refused.stdout) == (2, "")
    assert "to_s: must be more than from_s, which is 2" in refused.stderr
    beyond = inside("check", folder, "--from", "100", cwd=tmp_path)
    assert beyond.returncode == 2
    assert "the recording ends before 100 s" in beyond.stderr


def test_check_of_a_rig_can_be_limited_in_time(tmp_path):
    (tmp_path / "rig.yaml").write_text(
        "source: {type: synthetic, fps: 60, speed: 1.0, duration_s: 3600, width: 64, height: 48}\n"
        "detectors: {timestamp: }\n"
    )
    assert inside("check", "rig.yaml", "--for", "1s", cwd=tmp_path).returncode == 0
    assert inside("check", "rig.yaml", "--for", "soon", cwd=tmp_path).returncode == 2
    refused = inside("check", write_folders(tmp_path / "rig", 3), "--for", "1s", cwd=tmp_path)
    assert (refused.returncode, refused.stdout) == (2, "")
    assert "--for is of a live rig" in refused.stderr


@pytest.mark.parametrize(("number", "status"), [(signal.SIGINT, 130), (signal.SIGTERM, 143)])
def test_a_signal_drains_prints_the_summary_and_sets_the_status(tmp_path, number, status):
    command = [sys.executable, "-m", "syncwatch", "run", *QUIET, "--set", "source.speed=1.0",
               "--set", "sinks.jsonl={path: out.jsonl}"]  # fmt: skip
    with subprocess.Popen(command, cwd=tmp_path, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as process:
        wait_for(lambda: lines(tmp_path / "out.jsonl") >= 20, 30)
        process.send_signal(number)
        out, err = process.communicate(timeout=30)
    assert process.returncode == status, err
    assert "frames:" in out
    complete = (tmp_path / "out.jsonl").read_text().splitlines()
    assert [json.loads(line)["frame"] for line in complete] == list(range(len(complete)))


def lines(file) -> int:
    return len(file.read_text().splitlines()) if file.exists() else 0


def test_a_signal_ends_a_detector_that_is_stuck(tmp_path):
    (tmp_path / "mine.py").write_text(
        "import time\nfrom pathlib import Path\nimport pipeline.cli.common as common\nfrom syncwatch import Settings\n"
        "common.GIVE_UP_S = 1\n"
        "class MySettings(Settings):\n    type: str\n"
        "class Mine:\n    Settings = MySettings\n"
        "    def __init__(self, settings, *, name, rig): pass\n"
        "    def observe(self, window):\n        Path('stuck').touch()\n        time.sleep(3600)\n"
    )
    (tmp_path / "c.yaml").write_text(
        "source: {type: synthetic, width: 64, height: 48}\ndetectors: {own: {type: 'mine:Mine'}}\n"
    )
    command = [sys.executable, "-m", "syncwatch", "run", "c.yaml"]
    with subprocess.Popen(command, cwd=tmp_path, stderr=subprocess.PIPE, text=True) as process:
        wait_for((tmp_path / "stuck").exists, 30)
        process.terminate()
        _, err = process.communicate(timeout=30)
    assert process.returncode == 1
    assert "did not end within 1 s of the signal" in err
    assert "Traceback" not in err


def test_a_detector_of_ones_own_is_found_beside_the_configuration(tmp_path):
    (tmp_path / "mine.py").write_text(
        "from typing import Literal\n"
        "from syncwatch import Basis, Evidence, Settings, State\n"
        "class MySettings(Settings):\n"
        "    type: str\n"
        "    word: str = 'hello'\n"
        "class Mine:\n"
        "    Settings = MySettings\n"
        "    def __init__(self, settings, *, name, rig):\n"
        "        self.said = (name, settings.word, rig)\n"
        "    def observe(self, window):\n"
        "        name, word, rig = self.said\n"
        "        return [Evidence(pair.name, name, Basis.CONTENT, State.SYNC, word) for pair in rig.pairs]\n"
    )
    (tmp_path / "c.yaml").write_text(
        "source: {type: synthetic, duration_s: 0.2, width: 64, height: 48}\n"
        "detectors: {own: {type: 'mine:Mine', word: moin}}\n"
        "sinks: {jsonl: {path: '-'}}\n"
    )
    done = syncwatch("run", "c.yaml", cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    assert json.loads(done.stdout.splitlines()[0])["content"]["reason"] == "moin"


OWN_SOURCE = """
from syncwatch import Camera, Settings
class MySettings(Settings):
    type: str
class Mine:
    Settings = MySettings
    live, frame_count = False, None
    cameras = [Camera(name, 10) for name in {cameras}]
    def __init__(self, settings): pass
    def open(self): {opening}
    def frames(self): return iter(())
    def stop(self): pass
    def close(self): pass
"""


@pytest.mark.parametrize(
    ("cameras", "opening", "status", "said"),
    [
        (["left"], "pass", 2, "two or more cameras"),
        (["left", "left"], "pass", 2, "of different names"),
        (["left", "right"], "raise OSError('no such bus')", 1, "the source cannot be opened: OSError: no such bus"),
    ],
)
def test_a_source_of_ones_own_that_does_not_work_is_one_line(tmp_path, cameras, opening, status, said):
    (tmp_path / "mine.py").write_text(OWN_SOURCE.format(cameras=cameras, opening=opening))
    (tmp_path / "c.yaml").write_text("source: {type: 'mine:Mine'}\ndetectors: {timestamp: }\n")
    done = syncwatch("run", "c.yaml", cwd=tmp_path)
    assert (done.returncode, said in done.stderr, "Traceback" in done.stderr) == (status, True, False), done.stderr


def test_a_reader_of_the_console_that_goes_away_ends_the_run(tmp_path):
    arguments = "--set 'sinks={console: {style: classic}}' --set source.width=64 --set source.height=48"
    command = f"{sys.executable} -m syncwatch run {arguments} --set source.duration_s=100 --set 'faults=[]' | head -1"
    done = subprocess.run(
        ["bash", "-c", command], cwd=tmp_path, capture_output=True, text=True, timeout=60, check=False
    )
    assert len(done.stdout.splitlines()) == 1
    assert "the reader of standard output has gone away" in done.stderr
    assert "Traceback" not in done.stderr


def test_jsonl_on_stdout_moves_the_console_to_stderr(tmp_path):
    small = ("--set", "source.duration_s=0.3", "--set", "sinks={console: {}, jsonl: {path: '-'}}")
    done = syncwatch("run", *small, cwd=tmp_path)
    assert [json.loads(line)["frame"] for line in done.stdout.splitlines()] == list(range(9))
    assert "9 frames" in done.stderr


@pytest.mark.parametrize(
    ("setting", "said"),
    [
        ("rig=a b", "cannot be a rig's name"),
        ("pairs=[left-right, left-right]", "'left-right' is given twice"),
        ("sinks.jsonl={path: nowhere/x.jsonl}", "there is no folder"),
    ],
)
def test_validate_refuses_what_run_would_refuse(tmp_path, setting, said):
    done = inside("validate", "--set", setting, cwd=tmp_path)
    assert (done.returncode, said in done.stderr) == (2, True), done.stderr


@pytest.mark.parametrize("wanted", ["mine:Mine", "json:loads", "os:nothing"])
def test_a_type_of_ones_own_that_does_not_work_is_one_line(tmp_path, wanted):
    (tmp_path / "c.yaml").write_text(f"source: {{type: synthetic}}\ndetectors: {{own: {{type: '{wanted}'}}}}\n")
    done = syncwatch("validate", "c.yaml", cwd=tmp_path)
    assert done.returncode == 2
    assert f"detectors.own.type: cannot use '{wanted}'" in done.stderr
    assert "Traceback" not in done.stderr


@pytest.mark.parametrize("arguments", [["--help"], *([name, "--help"] for name in ("run", "replay", "check", "init"))])
def test_help_is_help(tmp_path, arguments):
    done = inside(*arguments, cwd=tmp_path)
    assert (done.returncode, "Usage:" in done.stdout) == (0, True)


@pytest.mark.parametrize("arguments", [["rum"], ["run", "a.yaml", "b.yaml"], ["--loud"], ["check"]])
def test_wrong_arguments_are_one_line_and_status_2(tmp_path, arguments):
    done = inside(*arguments, cwd=tmp_path)
    assert (done.returncode, done.stdout, len(done.stderr.splitlines())) == (2, "", 1)


def test_the_version_is_that_of_the_package(tmp_path):
    assert syncwatch("--version", cwd=tmp_path).stdout == "syncwatch 0.1.0\n"


def test_the_public_face_has_what_it_promises():
    assert all(hasattr(face, name) for name in face.__all__)
    assert (ROOT / "syncwatch" / "config.yaml").is_symlink()
