"""`syncwatch evaluate`, from outside."""

from __future__ import annotations

import json
import re
from pathlib import Path

import pytest

from pipeline.assemble import KINDS
from pipeline.configtext.document import ConfigError
from pipeline.evaluate.runner import check
from pipeline.evaluate.subsample import SubsampledSource
from pipeline.evaluate.suite import load_suite
from syncwatch.testing import ScriptedSource
from tests.frames import PERIOD_NS, RIG, frame
from tests.programs import ROOT, inside, syncwatch, write_folders

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
    done = inside("evaluate", "suite.yaml", cwd=tmp_path)
    assert done.returncode == 2, done.stderr
    assert said in done.stderr
    assert "Traceback" not in done.stderr


STAGED = """
recordings:
  rendered: {type: synthetic, duration_s: 5, fps: 10, width: 160, height: 120}
scenarios:
  stale:
    row: F2
    about: Pictures are <b>old</b>.
    recording: rendered
    faults: [{type: slip, frames: -1, start_s: 2}]
    expect: {state: async, cause: slip}
  fine: {recording: rendered, expect: {state: sync}}
seeds: [0, 1]
detectors: {timestamp: {}}
"""


@pytest.fixture(scope="module")
def staged(tmp_path_factory):
    folder = tmp_path_factory.mktemp("staged")
    (folder / "suite.yaml").write_text(STAGED)
    done = syncwatch("evaluate", "suite.yaml", "--report", "out/report", "--json", "result.json", cwd=folder)
    assert done.returncode == 0, done.stderr
    return folder, done


def test_scenarios_are_judged_with_every_seed_and_told_in_a_table(staged):
    folder, done = staged
    told = json.loads((folder / "result.json").read_text())
    assert [(run["scenario"], run["seed"], run["right"]) for run in told["runs"]] == [
        ("stale", 0, True), ("stale", 1, True), ("fine", 0, True), ("fine", 1, True),
    ]  # fmt: skip
    assert told["scenarios"]["stale"]["row"] == "F2"
    assert told["scenarios"]["stale"]["right"] == "2/2"
    assert told["confusion"]["sync"]["async"] == 0
    assert "stale" in done.stdout
    assert "2/2" in done.stdout


def test_the_report_needs_nothing_else_and_says_what_is_wrong(staged):
    folder, _ = staged
    page = (folder / "out" / "report" / "index.html").read_text()
    assert "From 2.0 s on right is a frame (100.0 ms) behind left" in page
    assert "Pictures are &lt;b&gt;old&lt;/b&gt;." in page
    assert "Nothing is wrong with this rig." in page
    assert "4 of 4 runs were judged as they must be" in page
    assert page.count("<svg") == 1 + 4
    assert not re.search(r"src=|href=\"[^#]|@import|url\(|<script", page)
    assert (folder / "out" / "report" / "confusion.svg").read_text().startswith("<svg")


@pytest.mark.parametrize(
    ("broken", "said"),
    [
        (STAGED.replace("cause: slip", "cause: slips"), "'slips'"),
        (STAGED.replace("recording: rendered, expect", "recording: other, expect"), "no recording 'other'"),
        (STAGED.replace("state: sync}", "state: sync, notes: [dropp]}"), "'dropp'"),
        (STAGED.replace("state: sync}", "state: sync, cause: slip}"), "a cause belongs to the state async"),
        (STAGED.replace("expect: {state: sync}", "expects: {state: sync}"), "did you mean 'expect'?"),
    ],
)
def test_a_scenario_that_asks_for_what_does_not_exist_is_refused_with_its_place(tmp_path, broken, said):
    (tmp_path / "suite.yaml").write_text(broken)
    done = inside("evaluate", "suite.yaml", cwd=tmp_path)
    assert done.returncode == 2, done.stderr
    assert said in done.stderr
    assert done.stderr.startswith("suite.yaml:")
    assert "Traceback" not in done.stderr


@pytest.mark.parametrize(
    ("broken", "said"),
    [
        (STAGED.replace("type: slip", "type: slyp"), "suite.yaml:9:21: error: scenarios.stale.faults[0].type: "),
        (STAGED.replace("type: slip,", "type: slip, camera: rigth,"), "scenarios.stale.faults[0].camera: no camera"),
        (STAGED.replace("cause: slip}", "cause: slip, camera: top}"), "suite.yaml:10:49: error: scenarios.stale"),
        (STAGED.replace(", cause: slip", ""), "expect.cause is required"),
        (STAGED.replace("cause: slip}", "cause: slip}\n    judge: {sync_tolerance: 1}"), "scenarios.stale.judge"),
        (STAGED.replace("cause: slip}", "cause: slip}\n    buffer: {max_pending: 0}"), "scenarios.stale.buffer"),
        (STAGED.replace("fine: {recording: rendered,", "fine: {"), "a source of its own is required"),
        (STAGED.replace("timestamp: {}", "timestamp: {any: 1}"), "suite.yaml:13:25: error: detectors.timestamp.any"),
        (STAGED.replace("  fine: {", "  stale: {"), "scenarios.stale: given twice"),
        (STAGED.replace("seeds", "manipulations: {fine: {}}\nseeds"), "a manipulation has this name, too"),
        (STAGED.replace("state: sync}", "state: sync, event: knocked}"), "'knocked' is not one of"),
    ],
)
def test_what_is_wrong_with_a_clip_is_said_at_its_place_in_the_suite(tmp_path, monkeypatch, broken, said):
    monkeypatch.chdir(tmp_path)
    Path("suite.yaml").write_text(broken)
    with pytest.raises(ConfigError) as error:
        check(load_suite(Path("suite.yaml"), {}))
    assert said in str(error.value)
    assert str(error.value).startswith("suite.yaml:")


def test_single_scenarios_can_be_chosen(tmp_path):
    (tmp_path / "suite.yaml").write_text(STAGED)
    done = inside("evaluate", "suite.yaml", "--only", "fine", "--json", "-", cwd=tmp_path)
    assert [run["scenario"] for run in json.loads(done.stdout)["runs"]] == ["fine", "fine"]
    wrong = inside("evaluate", "suite.yaml", "--only", "stael", cwd=tmp_path)
    assert (wrong.returncode, "did you mean 'stale'?" in wrong.stderr) == (2, True)


def test_a_suite_that_does_not_exist_is_one_line(tmp_path):
    done = inside("evaluate", "nope.yaml", cwd=tmp_path)
    assert (done.returncode, done.stderr) == (2, "syncwatch: error: nope.yaml: there is no such suite file\n")


@pytest.mark.parametrize(
    ("option", "target", "said"),
    [
        ("--report", "taken", "this is a file"),
        ("--report", "taken/inside", "the folder cannot be made"),
        ("--json", "folder", "this is a folder"),
        ("--json", "nowhere/out.json", "there is no folder nowhere"),
    ],
)
def test_what_cannot_be_written_is_said_in_one_line_before_anything_runs(tmp_path, option, target, said):
    (tmp_path / "suite.yaml").write_text(STAGED)
    (tmp_path / "taken").write_text("")
    (tmp_path / "folder").mkdir()
    done = inside("evaluate", "suite.yaml", option, target, cwd=tmp_path)
    assert (done.returncode, len(done.stderr.splitlines())) == (2, 1), done.stderr
    assert said in done.stderr


OWN = """
scenarios:
  own:
    source: {type: synthetic, duration_s: 3, fps: 10, width: 160, height: 120}
    buffer: {max_pending: 8}
    judge: {sync_tolerance_ms: 150}
    faults: [{type: slip, frames: 1}]
    expect: {state: sync}
detectors: {timestamp: {}}
judge: {sync_tolerance_ms: 5}
"""


def test_a_scenario_may_have_a_source_a_buffer_and_a_judge_of_its_own(tmp_path):
    (tmp_path / "suite.yaml").write_text(OWN)
    done = inside("evaluate", "suite.yaml", "--json", "-", cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    (run,) = json.loads(done.stdout)["runs"]
    assert (run["recording"], run["right"]) == ("own", True)


def test_a_recording_of_unknown_truth_makes_neither_confusion_nor_false_alarms(tmp_path):
    suite = STAGED.replace("recording: rendered\n", "recording: rendered\n    truth: unknown\n")
    (tmp_path / "suite.yaml").write_text(suite.replace(", cause: slip}", "}"))
    done = inside("evaluate", "suite.yaml", "--only", "stale", "--json", "-", cwd=tmp_path)
    told = json.loads(done.stdout)
    assert told["confusion"] == told["confusion_by_recording"] == {}
    assert [run["false_alarms"] for run in told["runs"]] == [0, 0]


@pytest.mark.parametrize("suite", ["suite.yaml", "suite-real.yaml", "suite-hours.yaml"])
def test_the_suites_that_come_along_can_be_read(suite):
    clips = load_suite(ROOT / "examples" / suite, {})
    for clip in clips:
        clip.plan(KINDS)
    assert clips


def test_there_is_a_scenario_for_every_row_of_the_catalogue():
    rows = [clip.scenario.row for clip in load_suite(ROOT / "examples" / "suite.yaml", {}) if clip.scenario]
    assert [row for row in rows if row] == [f"F{n}" for n in range(1, 28)]


def test_a_missing_recording_is_one_line_said_before_anything_runs(tmp_path):
    suite = SUITE.replace("recordings:\n", "recordings:\n  first: {type: synthetic, motion: still, duration_s: 3}\n")
    (tmp_path / "suite.yaml").write_text(suite)
    done = inside("evaluate", "suite.yaml", cwd=tmp_path)
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
