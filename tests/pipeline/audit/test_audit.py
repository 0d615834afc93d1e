"""`syncwatch audit`, from outside."""

from __future__ import annotations

import csv
import os
import shutil
import signal
import subprocess
import sys
from dataclasses import replace

import pytest

from tests.formats import STAMPED, UNSTAMPED, rendered, scene_of
from tests.network import wait_for
from tests.pipeline.cli.test_selftest import processes_of
from tests.programs import inside, lines_of, syncwatch, write_folders
from tests.schemas import check


@pytest.fixture(scope="module")
def scene():
    source = rendered(3.0, width=160, height=120)
    source.open()
    return scene_of(source.frames())


@pytest.fixture(scope="module")
def stale(scene):
    """The same with pictures of the second camera that are a frame old from a second on; stamps deny it."""
    left, right = scene.values()
    old = [right[max(n - (n >= 20), 0)].image for n in range(len(right))]
    return {"left": left, "right": [_with(frame, image) for frame, image in zip(right, old, strict=True)]}


def _with(frame, image):
    return replace(frame, image=image)


@pytest.fixture(scope="module")
def archive(tmp_path_factory, scene, stale):
    root = tmp_path_factory.mktemp("archive")
    STAMPED["euroc"](root / "bad", stale)
    STAMPED["rosbag1"](root / "good", scene)
    UNSTAMPED["videos"](root / "broken", {name: frames[:5] for name, frames in scene.items()})
    (root / "broken" / "right.avi").write_bytes(b"no video")
    still = {name: [_with(frame, frames[0].image) for frame in frames] for name, frames in scene.items()}
    UNSTAMPED["folders"](root / "still", still)
    write_folders(root / "lone", 12, sides=("left",))
    return root


@pytest.fixture(scope="module")
def audited(tmp_path_factory, archive):
    folder = tmp_path_factory.mktemp("audited")
    return folder, syncwatch("audit", archive, "-o", "out", "--jobs", "2", cwd=folder)


def records(folder, name="out"):
    return lines_of((folder / name / "audit.jsonl").read_text())


def by_name(folder, archive):
    return {os.path.relpath(record["path"], archive): record for record in records(folder)}


def test_each_recording_gets_its_answer_and_the_worst_is_the_exit_status(audited, archive):
    folder, done = audited
    assert done.returncode == 3, done.stderr
    told = by_name(folder, archive)
    assert {name: (one["format"], one["state"]) for name, one in told.items()} == {
        "bad": ("euroc", "async"),
        "good/drive.bag": ("rosbag1", "sync"),
        "broken": ("videos", "unknown"),
        "still": ("folders", "unknown"),
        "lone/left": (None, "unknown"),
    }
    assert told["bad"]["cause"] == "stamps_lie"
    assert told["bad"]["offset_ms"] == pytest.approx(-50, abs=5)
    assert told["still"]["reason"] == "no_motion"
    assert "right.avi: cannot be opened" in told["broken"]["error"]
    assert told["lone/left"]["error"] == "one camera only (12 pictures)"
    good = told["good/drive.bag"]
    assert (good["error"], good["frames"], good["cameras"]) == (None, 60, ["left", "right"])
    assert good["duration_s"] == pytest.approx(3.0, abs=0.01)
    assert good["answer"].startswith("In sync.")


def test_every_line_keeps_its_schema(audited):
    folder, _ = audited
    for record in records(folder):
        check(record, "audit")


def test_segments_as_csv_cover_every_frame_and_say_which_are_bad(audited, archive):
    folder, _ = audited
    with (folder / "out" / "segments.csv").open() as file:
        rows = list(csv.DictReader(file))
    of_bad = [row for row in rows if row["path"] == str(archive / "bad")]
    frames = [n for row in of_bad for n in range(int(row["first_frame"]), int(row["last_frame"]) + 1)]
    assert frames == list(range(60))
    bad = [row for row in of_bad if row["state"] == "async"]
    assert abs(int(bad[0]["first_frame"]) - 20) <= 3
    assert (bad[0]["cause"], bad[-1]["last_frame"]) == ("stamps_lie", "59")
    assert float(bad[0]["start_s"]) == pytest.approx(int(bad[0]["first_frame"]) / 20, abs=0.001)
    good = [row for row in rows if row["path"].endswith("drive.bag") and row["state"] == "sync"]
    assert sum(int(row["last_frame"]) - int(row["first_frame"]) for row in good) > 30


def test_the_table_is_printed_and_kept(audited):
    folder, done = audited
    assert "5 recordings: 1 in sync, 1 out of sync, 1 cannot tell, 1 broken, 1 not judged." in done.stdout
    for words in ("good/drive.bag", "OUT OF SYNC", "stamps_lie", "nothing moves in a way that tells time"):
        assert words in done.stdout
        assert words in (folder / "out" / "summary.txt").read_text()
    assert "5/5 " in done.stderr
    assert "Traceback" not in done.stderr


def test_what_is_done_is_not_done_again_unless_it_changed(tmp_path, audited, archive):
    folder, done = audited
    shutil.copytree(folder / "out", tmp_path / "out")
    kept = tmp_path / "out" / "audit.jsonl"
    before = kept.read_text()
    again = inside("audit", archive, "-o", "out", cwd=tmp_path)
    assert (again.returncode, again.stderr) == (3, "5 found, 5 of them judged before\n")
    assert again.stdout == done.stdout
    assert kept.read_text() == before

    kept.write_text(before + before[:50])
    other = inside("audit", archive / "good", "-o", "out", "--set", "judge.sync_tolerance_ms=9", cwd=tmp_path)
    assert (other.returncode, other.stderr.splitlines()[0]) == (0, "1 found, 0 of them judged before")
    after = records(tmp_path)
    assert len(after) == 5, "a line a recording, and the one that was not whole is gone"
    was = {record["path"]: record for record in lines_of(before)}
    changed = [record["path"] for record in after if record != was[record["path"]]]
    assert changed == [str(archive / "good" / "drive.bag")]


def test_nothing_bad_but_something_that_cannot_be_told_is_status_4(tmp_path, archive):
    done = inside("audit", archive / "still", archive / "broken", "--segments", "bad.csv", cwd=tmp_path)
    assert done.returncode == 4, done.stderr
    assert (tmp_path / "bad.csv").read_text().startswith("path,pair,start_s,")
    assert sorted(file.name for file in (tmp_path / "audit").iterdir()) == ["audit.jsonl", "summary.txt"]


FLAKY = """
import os, signal, time
from pathlib import Path
from typing import Literal
from syncwatch import Settings

class FlakySettings(Settings):
    type: Literal["flaky:Flaky"] = "flaky:Flaky"

class Flaky:
    Settings = FlakySettings
    def __init__(self, settings, *, name, rig):
        self._rig = rig.name
    def observe(self, window):
        if not Path("well").exists():
            if self._rig == "crashes":
                os.kill(os.getpid(), signal.SIGKILL)
            while self._rig == "hangs":
                time.sleep(0.1)
        return []
"""
"""A detector that kills the process of one recording, and never ends on another."""

WITH_FLAKY = ("--set", "detectors={flaky: {type: 'flaky:Flaky'}}")


def test_a_recording_that_crashes_its_process_is_broken_and_the_others_are_judged(tmp_path):
    (tmp_path / "flaky.py").write_text(FLAKY)
    for name in ("a", "b", "crashes", "d", "e"):
        write_folders(tmp_path / "archive" / name, 12)
    command = ("audit", "archive", "-o", "out", "--jobs", "2", *WITH_FLAKY)
    done = syncwatch(*command, cwd=tmp_path)
    assert done.returncode == 4, done.stderr
    told = {record["path"].rpartition("/")[2]: record["error"] for record in records(tmp_path)}
    assert told.pop("crashes").startswith("the process that judged it was killed or crashed")
    assert told == dict.fromkeys("abde")

    (tmp_path / "well").touch()
    again = inside(*command, cwd=tmp_path)
    assert "5 found, 5 of them judged before" in again.stderr
    retried = inside(*command, "--retry-broken", cwd=tmp_path)
    assert "5 found, 4 of them judged before" in retried.stderr
    assert [record["error"] for record in records(tmp_path)] == [None] * 5


@pytest.mark.parametrize(("number", "status"), [(signal.SIGINT, 130), (signal.SIGTERM, 143)])
def test_a_signal_ends_it_and_the_same_command_goes_on(tmp_path, number, status):
    (tmp_path / "flaky.py").write_text(FLAKY)
    for name in ("first", "hangs"):
        write_folders(tmp_path / "archive" / name, 12)
    command = ["audit", "archive", "-o", "out", "--jobs", "1", *WITH_FLAKY]
    with subprocess.Popen(
        [sys.executable, "-m", "syncwatch", *command],
        cwd=tmp_path,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_DFL),  # noqa: PLW1509 - no threads here
    ) as process:
        kept = tmp_path / "out" / "audit.jsonl"
        wait_for(lambda: kept.exists() and kept.read_text().endswith("\n"), 40)
        other = inside(*command, cwd=tmp_path)
        assert (other.returncode, other.stdout) == (2, "")
        assert "another audit is writing there" in other.stderr
        process.send_signal(number)
        output, errors = process.communicate(timeout=40)
        assert process.returncode == status, errors
        wait_for(lambda: not processes_of(process.pid), 40)
    assert "1 recording: 1 cannot tell." in output
    assert "interrupted: the same command goes on from here" in errors
    assert "Traceback" not in errors
    (tmp_path / "well").touch()
    done = inside(*command, cwd=tmp_path)
    assert "2 found, 1 of them judged before" in done.stderr
    assert len(records(tmp_path)) == 2


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["nowhere"], "no such file or folder: nowhere"),
        (["empty"], "empty is empty: expected"),
        (["empty", "figures"], "no recording of two or more cameras in empty, figures"),
        (["lone"], "lone/left: one camera only (12 pictures)"),
        (["rig", "-o", "file"], "-o file: "),
        (["rig", "-o", "file/below"], "is a file: name a folder"),
        (["rig", "--segments", "empty"], "--segments empty: cannot be written: it is a folder"),
        (["rig", "--jobs", "0"], "0 is not in the range"),
        (["rig", "--fps", "-1"], "source.fps"),
        (["rig", "--detectors", "ofset"], "unknown type 'ofset'"),
        (["rig", "--set", "source.loop=true"], "would never end"),
        (["rig", "--set", "source.path=other"], "what is found at PATH"),
        (["rig", "--set", "sinks={jsonl: {path: all.jsonl}}"], "--set sinks.jsonl"),
        (["s3://bucket/archive"], "give --cluster ADDRESS"),
        (["rig", "--cluster", "nonsense"], "such as tcp://scheduler:8786"),
        ([], "Missing argument 'PATH...'"),
    ],
)
def test_what_cannot_be_used_is_one_line_and_status_2(tmp_path, arguments, said):
    (tmp_path / "empty").mkdir()
    (tmp_path / "figures").mkdir()
    (tmp_path / "file").touch()
    write_folders(tmp_path / "rig", 2)
    write_folders(tmp_path / "lone", 12, sides=("left",))
    done = inside("audit", *arguments, cwd=tmp_path)
    assert (done.returncode, done.stdout) == (2, ""), done.stderr
    assert said in done.stderr
    assert "Traceback" not in done.stderr
    assert not (tmp_path / "audit").exists(), "nothing is left behind"


def test_names_that_are_no_text_are_told_and_do_not_stop_it(tmp_path, scene):
    (tmp_path / "archive").mkdir()
    write_folders(tmp_path / "odd", 12).rename(tmp_path / "archive" / os.fsdecode(b"caf\xe9"))
    inside_of = UNSTAMPED["videos"](tmp_path / "archive" / "fine", {name: own[:12] for name, own in scene.items()})
    (inside_of / "left.avi").rename(inside_of / os.fsdecode(b"l\xe9ft.avi"))
    write_folders(tmp_path / "archive" / "line\nbreak", 12)
    done = inside("audit", "archive", "--detectors", "timestamp", cwd=tmp_path)
    assert done.returncode == 4, done.stderr
    assert "Traceback" not in done.stderr
    assert "caf\\udce9" in done.stdout
    assert "line\\nbreak" in done.stdout
    errors = [record["error"] for record in records(tmp_path, "audit")]
    assert ["UTF-8" in error for error in errors if error is not None] == [True, True]
    assert len(errors) == 3


def test_real_recordings_get_the_answers_that_are_known(tmp_path, recordings):
    names = ("kitti_odo_seq1", "robot_static", "webcams_loose")
    done = syncwatch("audit", *(recordings / name for name in names), "--jobs", "2", cwd=tmp_path)
    assert done.returncode == 3, done.stderr
    told = {record["path"].rpartition("/")[2]: record for record in records(tmp_path, "audit")}
    assert [told[name]["state"] for name in names] == ["sync", "unknown", "async"]
