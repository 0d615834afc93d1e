"""docs/accuracy.md: what it says of made-up scores; and that the suites it is made from hold together."""

from __future__ import annotations

import os
from dataclasses import replace

import pytest

from benchmarks import accuracy
from benchmarks.accuracy_goals import AIMS, SECTIONS, SUITES
from benchmarks.accuracy_page import Measured, write
from benchmarks.cost import Cost
from pipeline.assemble import KINDS
from pipeline.evaluate.score import Score
from pipeline.evaluate.suite import load_suite
from tests.programs import ROOT

GOOD = Score("kitti", "+1", 0, windows=100, decided=100, measured=100, whole_right=100, errors=[0.01], sigmas=[0.01],
             with_sigma=100, within_two_sigma=97)  # fmt: skip
CHEAP = [Cost(640, 480, "handheld", [2.0] * 5, [10.0] * 5), Cost(1920, 1080, "handheld", [5.0] * 5, [100.0] * 5)]
NOTES = "### Notes\n\nWritten by hand: 100 % {as it is}\n"


def page(*whole: Score, costs=CHEAP) -> str:
    return write(Measured({"whole": list(whole)}, costs, 2, 1.0), NOTES)


def row(text: str, start: str) -> str:
    return next(line for line in text.splitlines() if line.startswith(start))


def test_a_goal_that_every_row_meets_is_met():
    summary = row(page(GOOD), "| ±1, ±2, ±5")
    assert "whole frame 100.0 %" in summary
    assert "| 1, 0, 0 | **met** |" in summary


def test_a_row_that_misses_is_named_with_its_number():
    text = page(GOOD, replace(GOOD, recording="boof", manipulation="-5", whole_right=40))
    assert "| 1, 1, 0 | **not met** |" in row(text, "| ±1, ±2, ±5")
    assert "- not met by boof: -5 40.0 %" in text.splitlines()
    assert "not met: whole frame" in row(text, "| boof | -5")


def test_a_row_that_is_hardly_decided_does_not_count_and_says_so():
    text = page(GOOD, replace(GOOD, recording="face", decided=20, measured=20, whole_right=0))
    assert "| 1, 0, 1 | **met** |" in row(text, "| ±1, ±2, ±5")
    assert "- face does not count: 1 row, 20.0 % decided" in text.splitlines()
    assert "does not count" in row(text, "| face | +1")


def test_a_goal_met_over_all_does_not_hide_the_row_that_misses():
    long = replace(GOOD, windows=10_000, decided=10_000, measured=10_000, whole_right=10_000)
    text = page(long, replace(GOOD, recording="boof", whole_right=90))
    assert "| 1, 1, 0 | **met over all, not by every row** |" in row(text, "| ±1, ±2, ±5")


def test_places_of_a_step_are_one_row():
    found = replace(GOOD, steps=1, delays=[3])
    lost = replace(GOOD, manipulation="-1", steps=1)
    text = write(Measured({"steps": [found, lost]}, CHEAP, 2, 1.0), NOTES)
    assert "1 of 2" in row(text, "| kitti | all 2")


def test_a_goal_without_rows_does_not_count():
    assert row(page(GOOD), "| wide baseline").endswith("**does not count** |")


def test_a_cost_past_its_limit_is_not_met():
    dear = replace(CHEAP[0], offset_ms=[6.0, 6.0, 6.0, 4.0, 8.0])
    text = page(GOOD, costs=[dear, CHEAP[1]])
    assert "0.60 (0.40..0.80) (handheld)" in row(text, "| CPU a pair beside `spatial`, 640x480")
    assert row(text, "| CPU a pair beside `spatial`, 640x480").endswith("**not met** |")
    assert row(text, "| CPU a pair beside `spatial`, 1920x1080").endswith("**met** |")


def test_notes_stand_at_the_end_as_they_are():
    assert page(GOOD).endswith(NOTES)


def test_scores_that_are_kept_make_the_same_page(tmp_path):
    measured = Measured({"whole": [GOOD]}, CHEAP, 2, 1.0)
    accuracy.keep(measured, tmp_path / "kept.json")
    assert write(accuracy.kept(tmp_path / "kept.json"), NOTES) == write(measured, NOTES)


@pytest.mark.parametrize("content", ["", "{}", '{"scores": {"clean": [{"no": 1}]}, "costs": []}'])
def test_scores_that_were_not_kept_by_this_version_are_refused(tmp_path, capsys, content):
    (tmp_path / "kept.json").write_text(content)
    assert accuracy.main(["--scores", str(tmp_path / "kept.json")]) == 2
    assert len(capsys.readouterr().err.splitlines()) == 1


def test_every_suite_is_sound_and_every_goal_has_rows():
    for suite in SUITES:
        clips = load_suite(accuracy.FOLDER / f"{suite}.yaml", {**os.environ, "SYNCWATCH_DATA": "/nowhere"})
        for clip in clips:
            clip.plan(KINDS)
        names = {clip.recording for clip in clips}
        for aim in AIMS:
            if suite in aim.suites and suite == aim.suites[0]:
                assert any(aim.about(suite, name) for name in names), aim.goal.name
    assert {suite for aim in AIMS for suite in aim.suites} == set(SUITES) == {section.suite for section in SECTIONS}


def test_paths_of_the_suites_lead_to_the_recordings_from_anywhere(recordings, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    files = [*accuracy.FOLDER.glob("*.yaml"), ROOT / "examples" / "suite-methods.yaml"]
    for file in files:
        bases = {clip.base for clip in load_suite(file, {"SYNCWATCH_DATA": str(recordings)})}
        assert bases <= {recordings, accuracy.FOLDER}, file
        default = {clip.base for clip in load_suite(file, {})}
        assert default <= {(ROOT / "../shared/data").resolve(), accuracy.FOLDER}, file


def test_a_relative_variable_counts_from_the_current_folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (clip, *_) = load_suite(accuracy.FOLDER / "clean.yaml", {"SYNCWATCH_DATA": "mine"})
    assert clip.base == tmp_path / "mine"
