"""`syncwatch report`, from outside."""

from __future__ import annotations

import base64
import json
import re
from pathlib import Path

import cv2
import numpy as np
import pytest

from pipeline.verdict import Reason
from pipeline.words import REASON_ADVICE
from tests.pipeline.report.pages import Page
from tests.programs import inside, syncwatch, write_folders

SOURCE = "source: {type: synthetic, speed: max, fps: 30, duration_s: 3, width: 320, height: 240, motion: %s}\n"
DETECTORS = "detectors: {timestamp: {}, offset: {}}\n"
CLIPS = {
    "sync": "rig: good\n" + SOURCE % "handheld" + DETECTORS,
    "slip": "rig: bad\n" + SOURCE % "handheld" + DETECTORS + "faults: [{type: slip, camera: right, start_s: 1.2}]\n",
    "static": "rig: still\n" + SOURCE % "still" + "detectors: {offset: {}}\n",
}
HEADLINES = {"sync": "In sync.", "slip": "OUT OF SYNC.", "static": "Cannot tell."}


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    """What `report` and `check` say of each clip, and the folder with pages and numbers."""
    folder = tmp_path_factory.mktemp("reports")
    for name, text in CLIPS.items():
        (folder / f"{name}.yaml").write_text(text)

    reports = [("report", f"{name}.yaml", "-o", f"{name}.html", "--json", f"{name}.json") for name in CLIPS]
    checks = [("check", f"{name}.yaml") for name in CLIPS]
    done = [inside(*command, cwd=folder) for command in [*reports, *checks]]
    said = {name: (done[n], done[n + len(CLIPS)]) for n, name in enumerate(CLIPS)}
    return folder, said


def page(made, clip) -> Page:
    return Page((made[0] / f"{clip}.html").read_text())


def numbers(made, clip):
    return json.loads((made[0] / f"{clip}.json").read_text())


@pytest.mark.parametrize("clip", CLIPS)
def test_it_says_what_check_says_and_ends_well_whatever_that_is(made, clip):
    report, check = made[1][clip]
    assert report.returncode == 0, report.stderr
    assert report.stdout == f"{check.stdout}The report is in {clip}.html\n"
    text = check.stdout.partition(": ")[2].strip()
    assert numbers(made, clip)["text"] == text
    assert page(made, clip).text.startswith(f"{check.stdout.partition(':')[0]}: syncwatch report")
    assert f"As syncwatch check says it: {text}" in page(made, clip).text
    assert text.startswith(HEADLINES[clip])


@pytest.mark.parametrize("clip", CLIPS)
def test_the_page_starts_with_the_answer_and_needs_nothing_else(made, clip):
    seen = page(made, clip)
    assert seen.text.index(HEADLINES[clip]) < seen.text.index("What to do") < seen.text.index("Verdict over time")
    assert seen.needs == seen.handlers == seen.unclosed == []
    assert not {"script", "link", "iframe", "object", "embed", "base", "form"} & set(seen.tags)
    assert "http" not in (made[0] / f"{clip}.html").read_text()
    assert len(seen.ids) == len(set(seen.ids))


def test_where_nothing_can_be_told_nothing_is_claimed(made):
    text = page(made, "static").text
    assert "Nothing is known of it: no frame could be judged." in text
    assert "nothing was out of sync" not in text
    assert "No drift was seen" not in text


def test_a_slip_is_told_with_its_time_amount_and_remedy(made):
    seen, told = page(made, "slip"), numbers(made, "slip")
    assert "right is a frame (33." in seen.text
    assert "ahead of left: frames are paired with the wrong partners" in seen.text
    pair = told["pairs"]["left-right"]
    assert list(pair["causes"]) == ["slip"]
    assert pair["stretches"][0]["offset_ms"] == pytest.approx(33.3, abs=1.0)
    assert 32 <= pair["stretches"][0]["first_frame"] <= 42
    assert pair["events"][0]["kind"] == "async onset"
    assert told["cameras"]["right"]["drops"] == 1
    assert [moment["cause"] for moment in pair["moments"]] == ["slip"]


def test_the_worst_moment_shows_both_frames_with_points_before_and_after(made):
    text = (made[0] / "slip.html").read_text()
    pictures = re.findall(r'href="data:image/jpeg;base64,([^"]+)"', text)
    assert len(pictures) == 2
    for data in pictures:
        assert cv2.imdecode(np.frombuffer(base64.b64decode(data), np.uint8), cv2.IMREAD_COLOR).shape == (240, 320, 3)
    for mark in ("here", "shown", "back"):
        assert text.count(f'<circle class="{mark}"') > 5
    before, after = map(
        float, re.findall(r"off their rows by ([\d.]+) px, and once moved back by ([\d.]+) px", text)[0]
    )
    assert after < 0.5 * before


def test_nothing_that_moves_is_told_as_such_with_what_to_do(made):
    seen, pair = page(made, "static"), numbers(made, "static")["pairs"]["left-right"]
    assert "nothing moves in a way that tells time" in seen.text
    assert REASON_ADVICE[Reason.NO_MOTION] in seen.text
    assert (pair["decided"], pair["coverage"], pair["offset_ms"]) == (0, 0.0, None)


def test_the_numbers_have_the_documented_fields(made):
    told = numbers(made, "sync")
    assert set(told) == {
        *("schema", "version", "rig", "state", "text", "unread", "advice", "dropped_windows", "cameras", "pairs")
    }
    assert (told["schema"], told["rig"], told["state"]) == ("syncwatch.report.v1", "good", "sync")
    pair = told["pairs"]["left-right"]
    assert set(pair) == {
        "state", "text", "told", "frames", "decided", "coverage", "duration_s", "states", "causes", "reasons", "basis",
        "silences", "tolerance_ms", "expected_offset_ms", "offset_ms", "stamps_ms", "pictures_ms", "contradictions",
        "drift", "stretches", "events", "events_left_out", "notes", "moments", "series",
    }  # fmt: skip
    assert pair["frames"] == sum(pair["states"].values()) == 90
    assert pair["coverage"] == pytest.approx(pair["decided"] / 90, abs=1e-4)
    assert {len(curve) for curve in pair["series"].values()} == {90}
    assert pair["series"]["to_s"][-1] == 3.0
    assert abs(pair["offset_ms"]["mean"]) < 1.0
    camera = told["cameras"]["left"]
    assert (camera["width"], camera["height"], camera["frames"], camera["stamps_made_up"]) == (320, 240, 90, False)
    assert camera["interval_ms"]["mean"] == pytest.approx(33.333, abs=0.01)


def test_the_numbers_alone_are_on_standard_output_where_they_are_asked_for(tmp_path):
    folder = write_folders(tmp_path / "<img src=x onerror=alert(1)>&'\"", 20)
    done = inside("report", folder, "--json", "-", "--fps", "10", cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    assert json.loads(done.stdout)["cameras"]["left"]["stamps_made_up"] is True
    assert "The report is in report.html" in done.stderr
    seen = Page((tmp_path / "report.html").read_text())
    assert (seen.needs, seen.handlers) == ([], [])
    assert str(folder) in seen.text
    assert "has no timestamps of its own" in seen.text


@pytest.mark.parametrize(
    ("arguments", "complaint"),
    [
        (("nowhere",), "nowhere"),
        (("clip.yaml", "-o", "."), "-o .: cannot be written: it is a folder"),
        (("clip.yaml", "-o", "none/r.html"), "-o none/r.html: cannot be written: there is no folder none"),
        (("clip.yaml", "-o", "clip.yaml"), "-o clip.yaml: cannot be written: it is what is to be read"),
        (("clip.yaml", "--json", "none/r.json"), "--json none/r.json: cannot be written: there is no folder none"),
        (("clip.yaml", "-o", "r", "--json", "r"), "--json r: cannot be written: the page goes there"),
        (("clip.yaml", "--for", "soon"), "--for 'soon'"),
    ],
)
def test_what_cannot_be_done_is_one_line_before_any_work(tmp_path, arguments, complaint):
    (tmp_path / "clip.yaml").write_text(CLIPS["sync"])
    done = inside("report", *arguments, cwd=tmp_path)
    assert done.returncode == 2
    assert complaint in done.stderr
    assert len(done.stderr.splitlines()) == 1
    assert sorted(path.name for path in tmp_path.iterdir()) == ["clip.yaml"]
    assert (tmp_path / "clip.yaml").read_text() == CLIPS["sync"]


def test_of_a_recording_that_cannot_be_read_to_its_end_there_is_a_page_of_what_can(tmp_path):
    folder = write_folders(tmp_path / "rig", 20)
    (folder / "right" / "right15.png").write_bytes(b"")
    done = syncwatch("report", "rig", "--fps", "10", "--json", "numbers.json", cwd=tmp_path)
    assert done.returncode == 2, done.stderr
    why = "rig/right/right15.png: is empty (0 bytes)"
    assert why in done.stderr.splitlines()[-1]
    assert (
        f"The recording could be read in part only: {tmp_path}/{why}"
        in Page((tmp_path / "report.html").read_text()).text
    )
    told = json.loads((tmp_path / "numbers.json").read_text())
    assert why in told["unread"]
    assert told["text"].endswith("This is of the part that could be read.")
    assert told["pairs"]["left-right"]["frames"] in {15, 16}


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="no /dev/full here")
def test_a_disk_that_is_full_is_one_line(tmp_path):
    (tmp_path / "clip.yaml").write_text(CLIPS["static"].replace("duration_s: 3", "duration_s: 0.5"))
    done = syncwatch("report", "clip.yaml", "-o", "/dev/full", cwd=tmp_path)
    assert done.returncode == 1
    assert done.stderr.endswith("syncwatch: error: -o /dev/full: cannot be written: No space left on device\n")
