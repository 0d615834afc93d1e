"""`check` on recordings too long to look at all of: headers first, then parts, until the answer is sure."""

from __future__ import annotations

import os
from itertools import pairwise

import cv2
import pytest

from pipeline.check.sampled import Look, sample
from pipeline.check.stretches import STRETCH_FRAMES, is_short, stretches
from pipeline.check.survey import Survey, by_length
from pipeline.frame import Camera
from pipeline.tally import Tally
from pipeline.verdict import Basis, Cause, Reason, State, Verdict
from tests.formats import EPOCH_NS, rendered, scene_of, write_png
from tests.programs import inside

PERIOD_NS = 50_000_000
ROUNDS = 36
"""How often a clip is repeated: the recording is long enough that parts of it are looked at."""


@pytest.fixture(scope="session")
def clip(tmp_path_factory):
    """The pictures of a rendered clip, a folder a camera."""
    root = tmp_path_factory.mktemp("clip")
    source = rendered(3.0, width=160, height=120)
    source.open()
    for camera, frames in scene_of(source.frames()).items():
        (root / camera).mkdir()
        for index, frame in enumerate(frames):
            write_png(root / camera / f"{index:03}.png", frame)
    source.close()
    return root


def write_long(root, clip, *, shown=lambda index: index, stamp_ns=lambda index: index * PERIOD_NS, rounds=ROUNDS):
    """A EuRoC recording that repeats the clip; the second camera shows `shown` frames and stamps them `stamp_ns`."""
    for number, side in enumerate(("left", "right")):
        pictures = sorted((clip / side).iterdir())
        folder = root / "mav0" / f"cam{number}" / "data"
        folder.mkdir(parents=True)
        rows = []
        for index in range(rounds * len(pictures)):
            which, at_ns = (index, index * PERIOD_NS) if number == 0 else (shown(index), stamp_ns(index))
            name = f"{EPOCH_NS + at_ns}.png"
            os.link(pictures[which % len(pictures)], folder / name)
            rows.append(f"{EPOCH_NS + at_ns},{name}\n")
        (folder.parent / "data.csv").write_text("".join(rows))
    return root


def test_a_long_recording_in_sync_is_known_from_parts_of_it_and_losses_from_all_headers(tmp_path, clip):
    root = write_long(tmp_path / "long", clip)
    listing = root / "mav0" / "cam1" / "data.csv"
    rows = listing.read_text().splitlines(keepends=True)
    listing.write_text("".join(rows[:333] + rows[336:]))
    done = inside("check", root, cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    assert "In sync." in done.stdout
    assert "The headers of all 2160 frames were read: right 3 lost." in done.stdout
    assert "Of 2160 frames, 4 parts of 240 frames were looked at; --all looks at every one." in done.stdout


def test_pictures_that_slip_near_the_end_are_found_though_stamps_are_perfect(tmp_path, clip):
    done = inside("check", write_long(tmp_path / "long", clip, shown=lambda n: n + (n > 1900)), cwd=tmp_path)
    assert done.returncode == 3, done.stderr
    assert "OUT OF SYNC." in done.stdout
    first = int(done.stdout.split("Frames ")[1].split(" ")[0])
    assert first >= 1900, "frames are counted from the start of the recording"


def test_where_stamps_are_suspect_pictures_are_looked_at_first(tmp_path, clip):
    """Six seconds of a second camera triggered 20 ms late, between the places that are looked at anyway."""

    def late(index):
        return index * PERIOD_NS + (20_000_000 if 600 <= index < 720 else 0)

    done = inside("check", write_long(tmp_path / "long", clip, stamp_ns=late), cwd=tmp_path)
    assert "Of 2160 frames" in done.stdout
    assert done.returncode == 0, "pictures outrank stamps: they show that nothing has changed"
    assert "of 1200 frames could be judged" in done.stdout, "four parts spread over it, and the one with the suspect"


def test_a_part_can_be_asked_for(tmp_path, clip):
    root = write_long(tmp_path / "long", clip, shown=lambda n: n + (n > 1900))
    done = inside("check", root, "--from", "10", "--to", "20", cwd=tmp_path)
    assert done.returncode == 0, done.stdout + done.stderr
    assert "of 200 frames could be judged" in done.stdout


def test_a_long_recording_that_never_moves_is_looked_at_as_a_whole(tmp_path, clip, monkeypatch):
    monkeypatch.setattr("pipeline.check.stretches.WORTH_IT", 3)
    for side in ("left", "right"):
        (tmp_path / "still" / side).mkdir(parents=True)
        picture = cv2.resize(cv2.imread(str(clip / side / "000.png"), cv2.IMREAD_GRAYSCALE), (80, 60))
        cv2.imwrite(str(tmp_path / "small.png"), picture)
        for index in range(800):
            os.link(tmp_path / "small.png", tmp_path / "still" / side / f"{index:05}.png")
        (tmp_path / "small.png").unlink()
    done = inside("check", tmp_path / "still", cwd=tmp_path)
    assert done.returncode == 4, done.stdout + done.stderr
    assert "show too little: all of it is looked at" in done.stderr
    assert "none of 800 frames could be judged" in done.stdout


def survey_of(frames, fps=20.0, suspects=()):
    found = by_length(Camera("left", fps), frames)
    found.suspects_s.extend(suspects)
    return found


def test_stretches_spread_over_the_recording_and_do_not_overlap():
    survey = survey_of(20_000)
    planned = stretches(survey.duration_s, survey.fps, [])
    assert planned[0].from_s == 0
    assert planned[1].to_s == pytest.approx(survey.duration_s)
    assert planned[2].from_s == pytest.approx((survey.duration_s - STRETCH_FRAMES / 20) / 2)
    ordered = sorted(planned, key=lambda one: one.from_s)
    assert all(one.to_s <= other.from_s for one, other in pairwise(ordered))


def test_suspects_come_first():
    planned = stretches(1000.0, 20.0, [333.0])
    assert planned[0].from_s < 333.0 < planned[0].to_s


def test_what_is_short_is_judged_whole():
    assert is_short(1000)
    assert not is_short(10_000)


def said(state, frame, reason=None):
    cause = Cause.SLIP if state is State.ASYNC else None
    basis = Basis.NONE if state is State.UNKNOWN else Basis.CONTENT
    return Verdict("rig", "left-right", frame, state, basis, cause=cause, reason=reason, offset_ns=0)


def sampled(states, survey=None):
    """Samples a recording whose stretches are in these states; what came out, and the stretches looked at."""
    survey = survey or survey_of(20_000)
    planned = stretches(survey.duration_s, survey.fps, survey.suspects_s)
    seen = []

    def look(stretch, one: Look) -> bool:
        state = states[len(seen)] if len(seen) < len(states) else states[-1]
        seen.append(stretch)
        for frame in range(50):
            one.add(said(state, frame, Reason.NO_MOTION if state is State.UNKNOWN else None))
        return True

    return sample(survey, planned, look), seen


def test_one_stretch_out_of_sync_settles_it():
    result, seen = sampled([State.SYNC, State.ASYNC, State.SYNC])
    assert (result.answer.state, result.sure, len(seen)) == (State.ASYNC, True, 2)


def test_stretches_that_show_nothing_are_passed_over():
    result, seen = sampled([State.UNKNOWN] * 5 + [State.SYNC])
    assert (result.answer.state, result.sure, len(seen)) == (State.SYNC, True, 9)


def test_nothing_shown_anywhere_is_not_sure():
    result, _ = sampled([State.UNKNOWN])
    assert (result.answer.state, result.sure) == (State.UNKNOWN, False)


def test_every_suspect_is_looked_at_before_it_is_called_in_sync():
    _, seen = sampled([State.SYNC], survey_of(40_000, suspects=[200.0, 400.0, 600.0, 800.0, 1000.0, 1200.0]))
    assert len(seen) == 10


def test_an_interruption_ends_it():
    result = sample(survey_of(20_000), stretches(1000, 20, []), lambda *_: False)
    assert (result.looked, result.sure) == (1, False)


def test_tallies_of_parts_add_up():
    whole, parts = Tally(), [Tally(), Tally()]
    for number, part in enumerate(parts):
        for frame in range(20):
            verdict = said(State.ASYNC if number else State.SYNC, 20 * number + frame)
            whole.add(verdict)
            part.add(verdict)
    together = Tally()
    for part in parts:
        together.merge(part)
    merged, counted = together.pairs["left-right"], whole.pairs["left-right"]
    assert (merged.states, merged.lasting_async) == (counted.states, counted.lasting_async)
    assert [one.first.frame for one in merged.stretches] == [20]


def test_frames_before_a_moment_are_counted():
    survey = Survey(20.0)
    survey.at_s.extend([0.0, 0.05, 0.1, 0.2])
    assert [survey.frames_before(at_s) for at_s in (0.0, 0.06, 0.1, 9.0)] == [0, 2, 2, 4]
