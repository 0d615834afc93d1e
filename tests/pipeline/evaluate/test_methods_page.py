"""The comparison of methods: which windows count, what is counted, and the page and picture made of it."""

from __future__ import annotations

import json
import os
from dataclasses import asdict

import pytest

from benchmarks import methods, methods_page, methods_picture
from benchmarks.methods_scores import Measured, Method, Seen, right, right_of_all
from pipeline.evaluate.score import Score
from pipeline.evaluate.suite import load_suite
from pipeline.verdict import Basis, Evidence, State


def clips(suite: str, *overrides: str):
    return load_suite(methods.FOLDER / f"{suite}.yaml", os.environ, overrides)


def small(recording: str) -> list[str]:
    return [f"recordings.{recording}.width=160", f"recordings.{recording}.height=120"]


def evidence(state: State, offset: float | None = None, **numbers: float) -> Evidence:
    return Evidence("left-right", "it", Basis.CONTENT, state, "so", offset_frames=offset, numbers=numbers)


def test_the_static_experiment_has_46_late_frames_of_300_and_stamps_find_them_all():
    clip = next(
        each for each in clips("methods-report", *small("static"), "detectors={timestamp: {}, spatial: {}, offset: {}}")
    )
    name, counts = methods.experiment(clip)
    assert (name, counts["timestamp"]) == ("static", {"sync": {"sync": 254}, "async": {"async": 46}})
    assert counts["offset"] == {"sync": {"unknown": 254}, "async": {"unknown": 46}}
    assert counts[methods_page.REPORT]["async"] == {"async": 46}
    assert counts[methods_page.REPORT]["sync"]["async"] == counts["spatial"]["sync"]["async"] > 0
    assert counts[methods_page.DEFAULT] == {"sync": {"sync": 251, "async": 3}, "async": {"async": 43, "sync": 3}}


def test_the_same_windows_count_each_time_in_runs_that_leave_the_warm_up_out():
    clip = next(each for each in clips("methods") if each.recording == "pan")
    counted = methods.drawn(clip, 150)
    assert counted == methods.drawn(clip, 150)
    assert len(counted) == methods.BLOCKS * methods.BLOCK <= 100
    assert min(counted) >= 50
    assert max(counted) < 149


def test_every_method_is_given_the_same_windows():
    chosen = "detectors={spatial: {}, orb: {}, epipolar_classes: {}}"
    clip = next(
        each
        for each in clips("methods", *small("handheld"), "recordings.handheld.duration_s=2", chosen)
        if (each.recording, each.manipulation) == ("handheld", "+1")
    )
    recording, manipulation, seen = methods.compare(clip, 60)
    assert (recording, manipulation) == ("handheld", "+1")
    assert {one.name: one.said.windows for one in seen} == {"spatial": 30, "orb": 30, "epipolar_classes": 30}
    spatial = next(one for one in seen if one.name == "spatial")
    assert spatial.said.decided == spatial.said.windows
    assert spatial.said.whole_right > 20
    assert all(len(one.spent_ms) < 30 for one in seen)


@pytest.mark.parametrize(
    ("said", "guess"),
    [
        (evidence(State.UNKNOWN, fit_t=-0.4, **{"fit_t-1": -0.2, "fit_t+1": -0.3}), 1.0),
        (evidence(State.UNKNOWN, score_t=0.5, **{"score_t-1": 0.5, "score_t+1": 0.1}), 0.0),
        (evidence(State.UNKNOWN, offset=-0.9), -0.9),
        (evidence(State.UNKNOWN), None),
    ],
)
def test_who_abstains_leans_to_the_best_score(said, guess):
    assert methods.best_guess(said) == guess
    forced = methods.row(3, 1.0, said, forced=True)
    assert forced.content is (State.UNKNOWN if guess is None else State.SYNC if guess == 0 else State.ASYNC)
    assert methods.row(3, 1.0, said, forced=False).content is State.UNKNOWN


def made_up() -> Measured:
    def seen(name: str, recording: str, said: Score) -> Seen:
        return Seen(
            name, said, Score(recording, "0", 1, windows=10, decided=10, measured=10, whole_right=9), [2.0, 2.0]
        )

    names = list(methods_page.ABOUT)
    found = {
        name: Method(
            [
                seen(name, "boof", Score("boof", "0", 1, windows=10, decided=8, measured=8, whole_right=6)),
                seen(name, "kitti", Score("kitti", "0", 1, windows=10, decided=10, measured=10, whole_right=10)),
                seen(name, "still", Score("still", "0", 1, windows=10, decided=1, measured=1, whole_right=0)),
            ]
        )
        for name in names
    }
    confusion = {"sync": {"sync": 225, "async": 29}, "async": {"async": 46}}
    rules = (methods_page.REPORT, methods_page.DEFAULT, *names)
    return Measured(found, {"static": dict.fromkeys(rules, confusion)}, jobs=2, minutes=9.5)


def test_the_page_tells_of_every_method_and_experiment():
    text = methods_page.write(made_up())
    for name in methods_page.ABOUT:
        assert any(line.startswith(f"| `{name}` | {methods_page.ABOUT[name]} | 88.9 %") for line in text.splitlines())
    assert "| **the report's: timestamp and spatial** | **225** / 29 / 0 | 0 / **46** / 0 | 271 of 300 |" in text
    assert "| 10.0 % | 10.0 % |" in text
    assert "{" not in text


def test_shares_count_what_was_answered_and_what_was_not():
    moving = made_up().methods["orb"].moving()
    assert right(moving) == pytest.approx(16 / 18)
    assert right_of_all(moving) == pytest.approx(16 / 20)


def test_what_is_kept_makes_the_same_page_and_picture(tmp_path):
    measured = made_up()
    again = Measured.from_json(json.loads(json.dumps(asdict(measured))))
    assert methods_page.write(again) == methods_page.write(measured)
    for name, each in (("one", measured), ("other", again)):
        methods_picture.draw(each, tmp_path / name)
    assert (tmp_path / "one").read_bytes() == (tmp_path / "other").read_bytes()
    assert b"weighted_template" in (tmp_path / "one").read_bytes()


def test_scores_of_another_version_are_refused_in_a_sentence(tmp_path, capsys):
    file = tmp_path / "scores.json"
    file.write_text("{}")
    assert methods.main(["--scores", str(file)]) == 2
    assert f"{file}: not scores that this version kept ('methods'): leave --scores out" in capsys.readouterr().err


def test_the_committed_page_is_what_this_version_writes():
    page = methods.DOCUMENT.read_text(encoding="utf-8")
    assert methods_page.NOTES.splitlines()[0] in page
    assert methods_page.READING.strip() in page
    assert all(f"| `{name}` |" in page for name in methods_page.ABOUT)
    assert methods.PICTURE.exists()
