"""`syncwatch selftest`, as a user runs it."""

from __future__ import annotations

import json

import pytest

from tests.programs import inside, syncwatch


def config(folder, motion, **source):
    settings = {"type": "synthetic", "motion": motion, "duration_s": 3, "width": 320, "height": 240, **source}
    path = folder / "rig.yaml"
    path.write_text(f"rig: bench\nsource: {json.dumps(settings)}\ndetectors: {{offset: {{}}}}\n")
    return path


def test_rendered_footage_proves_the_detector(tmp_path):
    done = syncwatch("selftest", config(tmp_path, "handheld"), "--json", "proof.json", cwd=tmp_path)
    assert done.returncode == 0, done.stdout + done.stderr
    assert "PASSED" in done.stdout
    assert "smallest offset" in " ".join(done.stdout.split())
    proof = json.loads((tmp_path / "proof.json").read_text())
    assert (proof["schema"], proof["conclusion"]) == ("syncwatch.selftest.v1", "proved")
    outcomes = {test["test"]: test["outcome"] for test in proof["tests"]}
    assert {"shift by +1", "shift by -2", "swap", "slip of one frame", "odd / even points"} <= set(outcomes)
    assert set(outcomes.values()) == {"pass"}


def test_nothing_is_proved_where_nothing_moves(tmp_path):
    done = inside("selftest", config(tmp_path, "still"), cwd=tmp_path)
    assert done.returncode == 4
    assert "NOTHING CAN BE PROVED HERE" in " ".join(done.stdout.split())
    assert "nothing moves" in " ".join(done.stdout.split())


def test_json_alone_goes_to_standard_output(tmp_path):
    done = inside("selftest", config(tmp_path, "still"), "--json", "-", cwd=tmp_path)
    assert json.loads(done.stdout)["conclusion"] == "not proved"


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["nowhere"], "nowhere"),
        (["--fps", "often", "nowhere"], "--fps"),
        ([], "PATH"),
        (["rig.yaml", "--json", "no/such/folder.json"], "no folder"),
    ],
)
def test_wrong_arguments_are_one_line_and_status_2(tmp_path, arguments, said):
    config(tmp_path, "still")
    done = inside("selftest", *arguments, cwd=tmp_path)
    assert done.returncode == 2
    assert said in done.stderr
    assert "Traceback" not in done.stderr


def test_a_drive_is_proved_on_real_pictures(recordings, tmp_path):
    done = inside("selftest", recordings / "kitti_odo_seq1", "--fps", "10", cwd=tmp_path)
    assert done.returncode == 0, done.stdout


def test_a_still_camera_before_a_still_scene_proves_nothing(recordings, tmp_path):
    assert inside("selftest", recordings / "robot_static", cwd=tmp_path).returncode == 4


def test_loose_webcams_are_told_as_they_are(recordings, tmp_path):
    done = inside("selftest", recordings / "webcams_loose", cwd=tmp_path)
    assert "OUT OF SYNC, and the offset changes" in " ".join(done.stdout.split())
