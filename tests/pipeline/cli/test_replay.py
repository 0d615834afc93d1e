"""`syncwatch replay`, from outside."""

from __future__ import annotations

import json
import re
import subprocess
import sys

import cv2
import numpy as np
import pytest

from tests.programs import inside, lines_of, syncwatch, write_folders


@pytest.fixture(scope="module")
def recording(tmp_path_factory):
    return write_folders(tmp_path_factory.mktemp("recording"))


@pytest.fixture(scope="module")
def judged(recording):
    """One recording with a slip from 2 s on, judged to standard output."""
    return syncwatch(
        "replay",
        recording,
        "--fps",
        "10",
        "--jsonl",
        "-",
        "--fault",
        "slip:camera=right,frames=1,start_s=2",
        "--detectors",
        "timestamp,spatial",
        cwd=recording,
    )


def test_both_witnesses_fill_every_line_by_default(recording, tmp_path):
    done = inside("replay", recording, "--fps", "10", "--jsonl", "-", cwd=tmp_path)
    for line in lines_of(done.stdout):
        assert list(line["evidence"]) == ["timestamp", "offset"]
        assert line["content"]["detector"] == "offset"
        assert line["content"]["reason"]


def test_every_frame_gets_a_line_and_nothing_else_is_on_stdout(judged):
    assert judged.returncode == 0, judged.stderr
    assert [line["frame"] for line in lines_of(judged.stdout)] == list(range(40))


def test_a_slip_makes_the_timestamp_evidence_async_from_then_on_and_only_then(judged):
    states = [line["evidence"]["timestamp"]["state"] for line in lines_of(judged.stdout)]
    assert states == ["sync"] * 20 + ["async"] * 19 + ["unknown"]


def test_pictures_tell_of_the_slip_as_well(judged):
    lines = lines_of(judged.stdout)
    offsets = [line["evidence"]["spatial"]["offset_frames"] for line in lines]
    assert offsets[:19] == [0.0] * 19
    assert offsets[21:38] == [1.0] * 17
    assert {line["cause"] for line in lines[25:38]} == {"slip"}


def test_the_summary_goes_to_stderr_when_stdout_is_taken(judged):
    assert "1 of 1 injected faults found" in judged.stderr


def test_a_jsonl_file_holds_the_same_and_the_console_keeps_stdout(recording, tmp_path):
    done = inside("replay", recording, "--fps", "10", "--jsonl", tmp_path / "out.jsonl", cwd=tmp_path)
    assert done.returncode == 0
    assert len(lines_of((tmp_path / "out.jsonl").read_text())) == 40
    assert "left-right: 40 frames: " in done.stdout


def test_detectors_can_be_chosen(recording, tmp_path):
    done = inside("replay", recording, "--fps", "10", "--detectors", "timestamp", "--jsonl", "-", cwd=tmp_path)
    (line, *_) = lines_of(done.stdout)
    assert list(line["evidence"]) == ["timestamp"]
    assert (line["state"], line["reason"], line["basis"]) == ("unknown", "no_evidence", "none")


def test_synthesised_stamps_decide_when_trusted(recording, tmp_path):
    done = inside(
        "replay", recording, "--detectors", "timestamp", "--set", "source.trust_stamps=true", "--fps", "10",
        "--jsonl", "-", cwd=tmp_path,
    )  # fmt: skip
    assert {line["state"] for line in lines_of(done.stdout)} == {"sync"}


def test_the_classic_style_prints_every_frame_as_the_report_does(recording, tmp_path):
    done = inside(
        "replay", recording, "--fps", "10", "--fault", "slip:frames=1,start_s=2", "--set", "judge.combine=classic",
        "--set", "sinks.console.style=classic", "--detectors", "timestamp,spatial", cwd=tmp_path,
    )  # fmt: skip
    assert "Frame: 5    Sync\n" in done.stdout
    assert re.search(
        r"^Frame: 20    Async\nInterval: 100000000\nTimestamps--> Left: 2000000000--> Right: 2100000000$",
        done.stdout,
        re.M,
    )


def test_more_cameras_make_a_pair_with_each_other_one(tmp_path):
    folder = write_folders(tmp_path / "rig", 6, ("front", "rear", "top"))
    done = inside("replay", folder, "--fps", "10", "--jsonl", "-", cwd=tmp_path)
    pairs = [(line["frame"], line["pair"]) for line in lines_of(done.stdout)]
    assert pairs == [(frame, pair) for frame in range(6) for pair in ("front-rear", "front-top")]


def test_a_frame_without_partner_still_gets_its_line(tmp_path):
    folder = write_folders(tmp_path / "rig", 8)
    (folder / "right" / "right3.png").unlink()
    (folder / "right" / "right7.png").unlink()
    done = inside("replay", folder, "--fps", "10", "--jsonl", "-", cwd=tmp_path)
    lines = lines_of(done.stdout)
    assert done.returncode == 0
    assert [(line["state"], line["reason"]) for line in lines if line["frame"] in {3, 7}] == [
        ("unknown", "unpaired")
    ] * 2
    assert lines[3]["captured_ns"]["right"] is None
    assert len(lines) == 8


def test_a_truncated_picture_ends_the_run_and_keeps_what_was_judged(tmp_path):
    folder = write_folders(tmp_path / "rig", 10)
    broken = folder / "right" / "right6.png"
    broken.write_bytes(broken.read_bytes()[:-20])
    done = inside("replay", folder, "--fps", "10", "--jsonl", tmp_path / "out.jsonl", cwd=tmp_path)
    assert done.returncode == 2
    assert "right6.png" in done.stderr.splitlines()[-1]
    assert "Traceback" not in done.stderr
    assert len((tmp_path / "out.jsonl").read_text().splitlines()) >= 6


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["nowhere"], "nowhere"),
        (["{recording}", "--fps", "0"], "source.fps: must be at least 0.001"),
        (["{recording}", "--fps", "ten"], "--fps"),
        (["{recording}", "--set", "judge.sync_tolerance_ms=1.0e+305"], "judge.sync_tolerance_ms"),
        (["{recording}", "--set", "detectors.timestamp.threshold_ms=-5"], "detectors.timestamp.threshold_ms"),
        (["{recording}", "--fault", "stamp_drift:ppm=1.0e+300"], "faults[0].ppm"),
        (["{recording}", "--fault", "slip:camera=top"], "no camera 'top': this rig has left, right"),
        (["{recording}", "--fault", "slop"], "did you mean 'slip'?"),
        (["{recording}", "--fault", "slip:frame=1"], "did you mean 'frames'?"),
        (["{recording}", "--fault", "slip:frames"], "is not KEY=VALUE"),
        (["{recording}", "--fault", "slip:frames=0.5"], "only rendered pictures"),
        (["{recording}", "--detectors", "spacial"], "did you mean 'spatial'?"),
        (["{recording}", "--set", "judge.combin=classic"], "did you mean 'combine'?"),
        (["{recording}", "--set", "judge"], "KEY=VALUE"),
        (["{recording}", "--jsonl", "/no/such/folder/out.jsonl"], "/no/such/folder/out.jsonl"),
        (["{recording}/left"], "one camera only"),
        (["{recording}", "--nonsense"], "--nonsense"),
        ([], "PATH"),
    ],
)
def test_bad_input_is_one_clear_line_and_status_2(recording, tmp_path, arguments, said):
    done = inside("replay", *(item.format(recording=recording) for item in arguments), cwd=tmp_path)
    assert done.returncode == 2, done.stderr
    assert done.stdout == ""
    assert said in done.stderr
    assert "Traceback" not in done.stderr


def test_an_empty_folder_is_refused(tmp_path):
    done = inside("replay", tmp_path, cwd=tmp_path)
    assert (done.returncode, done.stdout) == (2, "")


def test_a_reader_that_goes_away_ends_the_run_quietly(recording, tmp_path):
    command = f"{sys.executable} -m syncwatch replay {recording} --fps 10 --jsonl - --set source.loop=true | head -2"
    done = subprocess.run(
        ["bash", "-c", command], cwd=tmp_path, capture_output=True, text=True, timeout=60, check=False
    )
    assert len(done.stdout.splitlines()) == 2
    assert "Traceback" not in done.stderr
    assert "reader of standard output has gone away" in done.stderr


def test_what_decides_is_the_same_in_every_run(recording, tmp_path):
    arguments = (
        "replay",
        recording,
        "--fps",
        "10",
        "--jsonl",
        "-",
        "--fault",
        "drop:probability=0.3",
        "--set",
        "seed=4",
    )
    assert syncwatch(*arguments, cwd=tmp_path).stdout == syncwatch(*arguments, cwd=tmp_path).stdout


@pytest.mark.parametrize(
    ("name", "frames", "pairs"),
    [
        ("kitti_odo_seq1", 51, ["left-right"]),
        ("euroc_v101_start", 95, ["left-right"]),
        ("boof_backyard", 191, ["left-right"]),
    ],
)
def test_real_recordings_are_judged_frame_by_frame(recordings, tmp_path, name, frames, pairs):
    done = inside("replay", recordings / name, "--fps", "10", "--detectors", "timestamp", "--jsonl", "-", cwd=tmp_path)
    lines = lines_of(done.stdout)
    assert done.returncode == 0
    assert [line["frame"] for line in lines] == list(range(frames))
    assert [line["pair"] for line in lines] == pairs * frames


def test_sixteen_bit_and_colour_pictures_are_said_once(tmp_path):
    folder = write_folders(tmp_path / "rig", 5)
    for number in range(5):
        file = folder / "right" / f"right{number}.png"
        image = cv2.imread(str(file), cv2.IMREAD_GRAYSCALE).astype(np.uint16) * 257
        cv2.imwrite(str(file), image)
    done = inside("replay", folder, "--fps", "10", "--detectors", "spatial", "--jsonl", "-", cwd=tmp_path)
    assert done.returncode == 0
    assert done.stderr.count("16-bit") == 1
    assert json.loads(done.stdout.splitlines()[2])["state"] == "sync"
