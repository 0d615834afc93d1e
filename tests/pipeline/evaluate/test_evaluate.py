"""`syncwatch evaluate`, from outside."""

from __future__ import annotations

import json

import pytest

from pipeline.evaluate.subsample import SubsampledSource
from pipeline.evaluate.suite import load_suite
from syncwatch.testing import ScriptedSource
from tests.frames import PERIOD_NS, RIG, frame
from tests.programs import syncwatch, write_folders

SUITE = """
data: clips
recordings:
  folders: {type: replay, path: rig, fps: 10}
  rendered: {type: synthetic, duration_s: 4, fps: 10, width: 160, height: 120}
manipulations:
  clean: {}
  stale: {faults: [{type: content_shift, frames: -1}]}
  step: {faults: [{type: content_shift, frames: -1, start_s: 3}]}
  half: {subsample: {every: 2, plus: 1}}
detectors: {spatial: {}}
"""


@pytest.fixture(scope="module")
def evaluated(tmp_path_factory):
    folder = tmp_path_factory.mktemp("suite")
    write_folders(folder / "clips" / "rig", 45)
    (folder / "suite.yaml").write_text(SUITE)
    return syncwatch("evaluate", "suite.yaml", "--json", "-", cwd=folder)


def test_every_recording_and_manipulation_is_scored(evaluated):
    assert evaluated.returncode == 0, evaluated.stderr
    told = json.loads(evaluated.stdout)
    assert told["schema"] == "syncwatch.evaluation.v1"
    names = [(clip["recording"], clip["manipulation"]) for clip in told["clips"]]
    assert names == [(r, m) for r in ("folders", "rendered") for m in ("clean", "stale", "step", "half")]


def test_the_spatial_detector_is_right_on_what_it_can_see(evaluated):
    clips = {(clip["recording"], clip["manipulation"]): clip for clip in json.loads(evaluated.stdout)["clips"]}
    clean, stale, step, half = (clips["folders", name] for name in ("clean", "stale", "step", "half"))
    assert clean["whole_right"] == clean["windows"] == 30
    assert stale["whole_right"] == stale["windows"] - 1 == 28  # the last frame has no t+1 to match
    assert (step["steps"], step["delays"]) == (1, [0])
    assert half["small_error"] == 0


@pytest.mark.parametrize(
    ("suite", "said"),
    [
        ("recordings: {a: {type: synthetic}}\ndetectors: {spatial: }\n", "manipulations or scenarios are required"),
        (SUITE.replace("frames: -1}", "frame: -1}"), "did you mean 'frames'?"),
        (SUITE.replace("spatial", "spacial"), "did you mean 'spatial'?"),
        (SUITE.replace("every: 2", "every: 0"), "must be at least 1"),
        (SUITE, "recording 'folders', manipulation 'clean': "),
        (SUITE, "no such file or folder"),
        (SUITE.replace("half: {", "half: {recordings: [folder], "), "no recording 'folder' - did you mean 'folders'?"),
    ],
)
def test_a_suite_that_cannot_run_is_refused(tmp_path, suite, said):
    (tmp_path / "suite.yaml").write_text(suite)
    done = syncwatch("evaluate", "suite.yaml", cwd=tmp_path)
    assert done.returncode == 2, done.stderr
    assert said in done.stderr
    assert "Traceback" not in done.stderr


def test_a_missing_recording_is_one_line_said_before_anything_runs(tmp_path):
    suite = SUITE.replace("recordings:\n", "recordings:\n  first: {type: synthetic, motion: still, duration_s: 3}\n")
    (tmp_path / "suite.yaml").write_text(suite)
    done = syncwatch("evaluate", "suite.yaml", cwd=tmp_path)
    assert (done.returncode, len(done.stderr.splitlines())) == (2, 1), done.stderr


def test_a_manipulation_may_be_for_some_recordings_only(tmp_path):
    (tmp_path / "suite.yaml").write_text(SUITE.replace("half: {", "half: {recordings: [rendered], "))
    clips = load_suite(tmp_path / "suite.yaml", {})
    assert [clip.recording for clip in clips if clip.manipulation == "half"] == ["rendered"]
    assert [clip.recording for clip in clips if clip.manipulation == "stale"] == ["folders", "rendered"]


def test_a_suite_runs_from_any_folder_and_tells_how_far_it_is(tmp_path):
    write_folders(tmp_path / "here" / "clips" / "rig", 30)
    (tmp_path / "here" / "suite.yaml").write_text(SUITE.replace("  rendered:", "  # rendered:"))
    (tmp_path / "elsewhere").mkdir()
    done = syncwatch("evaluate", "../here/suite.yaml", "--jobs", "1", cwd=tmp_path / "elsewhere")
    assert done.returncode == 0, done.stderr
    assert "4/4 folders half" in done.stderr
    assert "sigma" in done.stdout


def test_a_missing_suite_is_one_line(tmp_path):
    done = syncwatch("evaluate", "nothing.yaml", cwd=tmp_path)
    assert (done.returncode, len(done.stderr.splitlines())) == (2, 1)


@pytest.mark.parametrize("grouped", [True, False])
def test_subsampling_shifts_one_side_by_a_fraction_of_the_new_period(grouped):
    frames = [
        frame(name, n * PERIOD_NS, n, group=n if grouped else None) for n in range(12) for name in ("left", "right")
    ]
    source = SubsampledSource(ScriptedSource(RIG.cameras, frames), every=4, plus=1)
    source.open()
    assert [camera.fps for camera in source.cameras] == [2.5, 2.5]
    by_camera = {"left": [], "right": []}
    for item in source.frames():
        by_camera[item.camera].append((item.group, item.truth.shown_ns // PERIOD_NS))
    assert by_camera == {"left": [(0, 0), (1, 4), (2, 8)], "right": [(0, 1), (1, 5), (2, 9)]}
