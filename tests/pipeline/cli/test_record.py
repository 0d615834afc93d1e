"""`syncwatch record`, from outside."""

from __future__ import annotations

import json
import subprocess
import sys

import jsonschema
import pytest

from tests.programs import inside, lines_of, write_folders
from tests.recorded import decoded, replayed, salvaged, schemas

CONFIG = """
rig: cart7
source: {type: synthetic, duration_s: 6, width: 160, height: 120}
faults: [{type: slip, camera: right, frames: 1, start_s: 2, stop_s: 3}]
detectors: {timestamp: {}}
sinks: {zenoh: {}, jsonl: {path: not-wanted.jsonl}}
"""


@pytest.fixture(scope="module")
def recorded(tmp_path_factory):
    """A configured rig that was recorded as it is, and what was said meanwhile."""
    folder = tmp_path_factory.mktemp("recorded")
    (folder / "rig.yaml").write_text(CONFIG)
    return folder, inside("record", "rig.yaml", "-o", "{rig}.mcap", cwd=folder)


def test_a_configured_rig_is_judged_and_recorded_and_nothing_else(recorded):
    folder, done = recorded
    assert done.returncode == 0, done.stderr
    assert done.stdout.startswith("cart7: OUT OF SYNC. left-right: 180 of 180 frames could be judged")
    assert f"{folder / 'cart7.mcap'}: frames: 180 of left, 180 of right; " in done.stderr
    assert sorted(path.name for path in folder.iterdir()) == ["cart7.mcap", "rig.yaml"]


def test_verdicts_of_a_real_run_fit_their_schema(recorded):
    folder, _ = recorded
    messages = decoded(folder / "cart7.mcap")
    described = schemas(folder / "cart7.mcap")
    for topic in ("/syncwatch/verdict/left-right", "/syncwatch/status", "/syncwatch/event"):
        schema = json.loads(described[topic].data)
        for message in messages[topic]:
            jsonschema.validate(message, schema)
            assert set(message) <= set(schema["properties"])
    verdicts = messages["/syncwatch/verdict/left-right"]
    assert [line["frame"] for line in verdicts] == list(range(180))
    assert [line["phase"] for line in messages["/syncwatch/event"]] == ["onset", "end"]


def test_the_recording_is_judged_as_the_rig_was(recorded, tmp_path):
    folder, _ = recorded
    arguments = ("--detectors", "timestamp", "--jsonl", "-")
    again = inside("replay", folder / "cart7.mcap", *arguments, cwd=tmp_path)
    lines = lines_of(again.stdout)
    verdicts = decoded(folder / "cart7.mcap")["/syncwatch/verdict/left-right"]
    assert [(line["state"], line["captured_ns"]) for line in lines] == [
        (verdict["state"], verdict["captured_ns"]) for verdict in verdicts
    ]
    assert "1 of 1 injected faults found" in again.stderr


def test_around_events_is_shorter(recorded, tmp_path):
    folder, _ = recorded
    options = ("--around-events", "500ms", "--pictures", "jpeg", "--set", "sinks.mcap.jpeg_quality=50")
    done = inside("record", folder / "rig.yaml", "-o", tmp_path / "a.mcap", *options, cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    frames = [item.sequence for item in replayed(tmp_path / "a.mcap") if item.camera == "left"]
    assert frames == list(range(frames[0], frames[-1] + 1))
    assert 45 <= frames[0] <= 55
    assert 100 <= frames[-1] <= 130


def test_another_recording_can_be_recorded_for_a_while(tmp_path):
    folder = write_folders(tmp_path / "rig", 20)
    done = inside("record", folder, "--fps", "10", "-o", "a.mcap", "--pictures", "png", cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    assert len(replayed(tmp_path / "a.mcap")) == 40
    live = ("--set", "source={type: synthetic, width: 64, height: 48, duration_s: 3600, speed: 1.0}")
    (tmp_path / "rig.yaml").write_text(CONFIG)
    done = inside("record", "rig.yaml", "-o", "b.mcap", "--for", "1s", *live, cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    assert replayed(tmp_path / "b.mcap")


def test_a_recorder_that_is_killed_leaves_a_recording(tmp_path):
    (tmp_path / "rig.yaml").write_text(CONFIG)
    live = ("--set", "source={type: synthetic, width: 64, height: 48, duration_s: 3600, speed: 1.0}")
    command = [sys.executable, "-m", "syncwatch", "record", "rig.yaml", "-o", "a.mcap", *live]
    with subprocess.Popen(command, cwd=tmp_path, stderr=subprocess.DEVNULL) as recorder:
        while recorder.poll() is None and len(salvaged_images(tmp_path / "a.mcap")) < 20:
            with pytest.raises(subprocess.TimeoutExpired):
                recorder.wait(0.1)
        recorder.kill()
    done = inside("check", "a.mcap", "--set", "detectors={timestamp: {}}", cwd=tmp_path)
    assert done.returncode in {0, 3}
    (line,) = done.stderr.splitlines()
    assert "a.mcap has no end, as after a recorder that was killed: it is read up to its last whole piece" in line


@pytest.mark.parametrize(
    "command",
    [
        ["record", "in.mcap", "-o", "in.mcap", "--force"],
        ["replay", "in.mcap", "--jsonl", "in.mcap"],
        ["run", "two.yaml", "--set", "sinks.jsonl.path=in.mcap"],
    ],
)
def test_what_is_read_is_never_written_over(recorded, tmp_path, command):
    folder, _ = recorded
    before = (folder / "cart7.mcap").read_bytes()
    for name in ("in.mcap", "other.mcap"):
        (tmp_path / name).write_bytes(before)
    (tmp_path / "two.yaml").write_text(
        "source:\n- {type: replay, path: other.mcap, cameras: [a, b]}\n- {type: replay, path: in.mcap}\n"
        "detectors: {timestamp: {}}\n"
    )
    done = inside(*command, cwd=tmp_path)
    assert (done.returncode, done.stdout) == (2, ""), done.stderr
    assert "in.mcap is what is read, which is never changed: name another file" in done.stderr
    assert (tmp_path / "in.mcap").read_bytes() == before


def salvaged_images(path):
    return salvaged(path)["/left/image"] if path.exists() else []


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["rig.yaml"], "Missing option '-o'"),
        (["-o", "a.mcap"], "PATH"),
        (["nowhere.yaml", "-o", "a.mcap"], "nowhere.yaml"),
        (["nowhere", "-o", "a.mcap"], "no such file or folder"),
        (["rig.yaml", "-o", "nowhere/a.mcap"], "there is no folder"),
        (["rig.yaml", "-o", "{day}.mcap"], "unknown placeholder {day}"),
        (["rig.yaml", "-o", "-"], "cannot go to standard output"),
        (["rig.yaml", "-o", "there.mcap"], "there.mcap: exists already"),
        (["rig.yaml", "-o", "a.mcap", "--pictures", "bmp"], "--pictures"),
        (["rig.yaml", "-o", "a.mcap", "--around-events", "soon"], "--around-events 'soon'"),
        (["rig.yaml", "-o", "a.mcap", "--around-events", "2h"], "around_events_s: must be at most 3600"),
        (["rig.yaml", "-o", "a.mcap", "--for", "0s"], "--for '0s'"),
        (["rig.yaml", "-o", "a.mcap", "--set", "sinks.mcap.jpeg_quality=0"], "jpeg_quality: must be at least 1"),
        (["rig.yaml", "-o", "a.mcap", "--set", "sinks.mcap.picture=raw"], "did you mean 'pictures'?"),
    ],
)
def test_bad_arguments_are_one_clear_line_and_status_2(tmp_path, arguments, said):
    (tmp_path / "rig.yaml").write_text(CONFIG)
    (tmp_path / "there.mcap").write_text("mine")
    done = inside("record", *arguments, cwd=tmp_path)
    assert (done.returncode, done.stdout) == (2, ""), done.stderr
    assert said in done.stderr
    assert "Traceback" not in done.stderr
    assert (tmp_path / "there.mcap").read_text() == "mine"
    assert not (tmp_path / "a.mcap").exists()
