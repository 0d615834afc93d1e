"""The recipes by which failures of the field are reproduced, and what the three witnesses then show."""

from __future__ import annotations

import io
import os
from itertools import pairwise
from pathlib import Path
from statistics import mean, pstdev

import pytest

from pipeline.assemble import KINDS, assemble, build_source
from pipeline.cli.recording import RecordingOptions, parse_fault, recording_plan
from pipeline.configtext.document import load_text
from pipeline.errors import InputError
from pipeline.plan import make_plan
from pipeline.run import Run
from pipeline.verdict import Verdict
from tests.pipeline.faults.streams import delivered, periods, seconds
from tests.programs import inside, lines_of, write_folders

RECIPES = {
    "seq_offset": ["seq_offset:ids=1"],
    "content_shift": ["content_shift:frames=-1"],
    "slip": ["slip:frames=1"],
    "start_race": ["slip:frames=-1,start_s=0"],
    "free_run": ["free_run:ppm=417"],
    "stamp_drift": ["stamp_drift:ppm=100"],
    "progressive_lag": ["free_run:ppm=2000,renumber=true"],
    "step": ["slip:frames=1,start_s=2"],
    "interleaved": ["content_shift:frames=0.5"],
    "epoch": ["stamp_offset:ms=37000"],
    "arrival_stamp": ["stamp_jitter:bias_ms=20,sigma_ms=8"],
    "copied_stamp": ["content_shift:frames=-1", "copy_stamp:of=left"],
    "duplicate_stamp": ["stamp_repeat:every=50"],
    "duplicate_frame": ["frame_repeat:every=50"],
    "frozen": ["frozen:"],
    "drop": ["drop:probability=0.05"],
    "silent_drop": ["drop:every=40,renumber=true"],
    "stale_buffer": ["slip:frames=-1,start_s=2,stop_s=5"],
    "trigger_lost": ["free_run:ppm=3000,start_s=5"],
    "stamp_reference": ["stamp_offset:ms=4"],
    "counter_wrap": ["seq_wrap:bits=16"],
    "half_frame_jitter": ["slip:frames=0.5", "stamp_jitter:sigma_ms=2"],
    "swapped": ["swap:"],
    "unequal_counts": ["truncate:frames=20"],
    "knocked": ["knock:roll_deg=0.5"],
    "dark": ["dark:"],
    "one_side_dead": ["dead:"],
}
RENDERED_ONLY = {"interleaved", "half_frame_jitter"}
LENGTH_S = 10
COUNT = 30 * LENGTH_S


class Offsets:
    """The right camera's frames against the left's, by slot: in frames of stamps and pictures, and in ids."""

    def __init__(self, name, *, rendered=True) -> None:
        faults = [parse_fault(text) for text in RECIPES[name]]
        self.frames = delivered(*faults, source=seconds(LENGTH_S, rendered=rendered))
        left = {item.group - 100: item for item in self.frames if item.camera == "left"}
        self.right = {item.group - 100: item for item in self.frames if item.camera == "right"}
        self.stamps = {n: periods(item.captured_ns - left[n].captured_ns) for n, item in self.right.items()}
        self.ids = {n: item.sequence - left[n].sequence for n, item in self.right.items()}
        self.pictures = {n: periods(item.truth.shown_ns - left[n].truth.shown_ns) for n, item in self.right.items()}

    def expect(self, **values):
        for witness, value in values.items():
            told = getattr(self, witness)
            wrong = {n: is_ for n, is_ in told.items() if abs(is_ - (value(n) if callable(value) else value)) > 1e-3}
            assert not wrong, witness


def ramp(ppm, start_s=0.0):
    """A fast clock takes frame n earlier."""
    return lambda n: -max(n - 30 * start_s, 0) * ppm / (1e6 + ppm)


def between(value, start, stop=COUNT):
    return lambda n: value if start <= n < stop else 0


@pytest.mark.parametrize(
    ("name", "stamps", "ids", "pictures"),
    [
        ("seq_offset", 0, 1, 0),
        ("content_shift", 0, 0, -1),
        ("slip", 1, 0, 1),
        ("start_race", -1, 0, -1),
        ("stamp_drift", lambda n: n * 1e-4, 0, 0),
        ("step", between(1, 60), 0, between(1, 60)),
        ("interleaved", 0, 0, 0.5),
        ("epoch", 37_000 * 0.03, 0, 0),
        ("copied_stamp", 0, 0, -1),
        ("duplicate_stamp", lambda n: -1 if n % 50 == 49 else 0, 0, 0),
        ("duplicate_frame", 0, 0, 0),
        ("drop", 0, 0, 0),
        ("silent_drop", 0, lambda n: -(n // 40), 0),
        ("stale_buffer", between(-1, 60, 150), 0, between(-1, 60, 150)),
        ("stamp_reference", 0.12, 0, 0),
        ("counter_wrap", 0, lambda n: 65_506 if n < 30 else -30, 0),
        ("swapped", 0, 0, 0),
        ("unequal_counts", 0, 0, 0),
        ("knocked", 0, 0, 0),
        ("dark", 0, 0, 0),
        ("frozen", 0, 0, lambda n: -n),
    ],
)
def test_the_witnesses_show_what_the_table_of_failures_says(name, stamps, ids, pictures):
    Offsets(name).expect(stamps=stamps, ids=ids, pictures=pictures)
    if name not in RENDERED_ONLY:
        Offsets(name, rendered=False).expect(stamps=stamps, ids=ids, pictures=pictures)


@pytest.mark.parametrize(
    ("name", "shape"),
    [("free_run", ramp(417)), ("progressive_lag", ramp(2000)), ("trigger_lost", ramp(3000, start_s=5))],
)
@pytest.mark.parametrize("rendered", [True, False])
def test_stamps_and_pictures_of_a_free_running_camera_ramp(name, shape, rendered):
    seen = Offsets(name, rendered=rendered)
    seen.expect(stamps=shape, ids=0 if name == "progressive_lag" else lambda n: round(shape(n)))
    seen.expect(pictures=shape if rendered else lambda n: round(shape(n)))
    assert len(seen.right) == COUNT


def test_stamps_of_arrival_are_late_and_noisy():
    late = list(Offsets("arrival_stamp").stamps.values())
    assert mean(late) == pytest.approx(0.6, abs=0.05)
    assert pstdev(late) == pytest.approx(0.24, abs=0.03)


def test_half_a_frame_of_jitter():
    seen = Offsets("half_frame_jitter")
    seen.expect(pictures=0.5)
    assert mean(seen.stamps.values()) == pytest.approx(0.5, abs=0.02)
    assert pstdev(seen.stamps.values()) == pytest.approx(0.06, abs=0.01)


def test_frames_that_are_missing():
    everything = set(range(COUNT))
    assert everything - set(Offsets("silent_drop").right) == {39, 79, 119, 159, 199, 239, 279}
    assert 5 <= len(everything - set(Offsets("drop").right)) <= 25
    assert everything - set(Offsets("unequal_counts").right) == set(range(COUNT - 20, COUNT))
    assert not Offsets("one_side_dead").right


def test_frames_that_come_twice_are_the_same_frame():
    frames = [item for item in Offsets("duplicate_frame").frames if item.camera == "right"]
    twice = [second.group - 100 for first, second in pairwise(frames) if first == second]
    assert twice == [49, 99, 149, 199, 249, 299]
    assert len(frames) == COUNT + 6


@pytest.fixture(scope="module")
def recording(tmp_path_factory):
    return write_folders(tmp_path_factory.mktemp("recording"))


@pytest.mark.parametrize("name", RECIPES)
def test_every_recipe_runs_in_a_replay(name, recording):
    plan = recording_plan([str(recording)], RecordingOptions(fps=10), faults=RECIPES[name], detectors="timestamp")
    if name in RENDERED_ONLY:
        with pytest.raises(InputError, match="only rendered pictures") as refused:
            build_source(plan).open()
        assert "\n" not in str(refused.value)
    else:
        assert frames_judged(plan) == list(range(40))


@pytest.mark.parametrize("name", RECIPES)
def test_every_recipe_runs_on_a_rendered_scene(name):
    text = f"""
        source: {{type: synthetic, width: 48, height: 32, duration_s: 1, fps: 10}}
        faults: {[parse_fault(text) for text in RECIPES[name]]}
        detectors: {{timestamp: }}
    """
    assert frames_judged(make_plan(load_text(text, "here", os.environ), KINDS, Path.cwd())) == list(range(10))


def test_recipes_are_composed_on_the_command_line(recording):
    faults = ["--fault", "frozen:", "--fault", "dark:", "--fault", "swap:start_s=2", "--fault", "dead:start_s=3"]
    done = inside(
        "replay", recording, "--fps", "10", *faults, "--detectors", "timestamp", "--jsonl", "-", cwd=recording
    )
    assert done.returncode == 0, done.stderr
    lines = [line for line in lines_of(done.stdout) if line["schema"] == "syncwatch.verdict.v1"]
    assert [line["sequence"]["right"] is None for line in lines] == [False] * 30 + [True] * 10


@pytest.mark.parametrize(
    ("fault", "message"),
    [
        ("free_run:ppm=.nan", "faults[0].ppm"),
        ("truncate:frames=-20", "faults[0].frames"),
        ("copy_stamp:of=top", "faults[0].of: no camera 'top': this rig has left, right"),
        ("swap:partner=top", "faults[0].partner: no camera 'top': this rig has left, right"),
        ("dead:camera=top", "faults[0].camera: no camera 'top': this rig has left, right"),
        ("swap:partner=right", "fault swap: partner: 'right' is the camera itself"),
        ("slip:frames=0.5", "only rendered pictures"),
    ],
)
def test_bad_recipes_are_refused(fault, message, recording):
    with pytest.raises(InputError) as refused:
        build_source(recording_plan([str(recording)], faults=[fault])).open()
    assert message in str(refused.value)


def frames_judged(plan):
    source = build_source(plan)
    source.open()
    said = []
    Run(assemble(plan, source, console=io.StringIO(), on_report=said.append)).execute()
    return [report.frame for report in said if isinstance(report, Verdict)]
