"""The page and its numbers, of verdicts made by hand: long recordings, hostile names, several pairs."""

from __future__ import annotations

import json

import numpy as np
import pytest

from pipeline.answer import answer
from pipeline.frame import Camera, Frame, Pair, Rig
from pipeline.report.numbers import to_message
from pipeline.report.page import report_page
from pipeline.report.recorder import MOST_MARKS, Recorder
from pipeline.report.series import MOST_BINS
from pipeline.verdict import Basis, Cause, Event, Evidence, Pace, Reason, State, Verdict
from tests.pipeline.report.pages import Page

RIG = Rig("bench", tuple(Camera(name, 30) for name in ("left", "right")), (Pair("left", "right"),))
NASTY = "<img src=x onerror=alert(1)>&\"'"


def verdict(number, state=State.SYNC, cause=None, pair="left-right", offset_ms=0.2, **more):
    offset_ns = round(offset_ms * 1e6)
    stamps = Evidence(pair, "timestamp", Basis.TIMESTAMPS, State.SYNC, "", offset_ns=100_000)
    pictures = Evidence(pair, "offset", Basis.CONTENT, state, "", offset_ns=offset_ns, sigma_ns=900_000)
    return Verdict(
        "bench", pair, number, state, Basis.CONTENT, cause=cause, offset_ns=offset_ns, sigma_ns=900_000,
        offset_frames=offset_ms / 33.3, tolerance_ns=3_300_000, evidence=(stamps, pictures), content=pictures, **more,
    )  # fmt: skip


def recorded(verdicts, rig=RIG):
    recorder = Recorder(rig)
    for said in verdicts:
        recorder.take(said)
    return recorder


def page_of(recorder, paths=("/my/recording",)):
    return Page(report_page(recorder, answer(recorder.tally), "0.0", paths))


@pytest.fixture(scope="module")
def long():
    """Twenty minutes at 30 fps that flicker between everything there is."""
    recorder = Recorder(RIG)
    random = np.random.default_rng(0)
    image = np.zeros((48, 64), np.uint8)
    for n in range(36_000):
        for camera in ("left", "right"):
            stamp = n * 33_333_333 + int(random.normal(0, 1e6))
            recorder.take_frame(Frame(camera, n, stamp, "rig", n, image))
        state = (State.SYNC, State.ASYNC)[n // 20 % 2]
        cause = None if state is State.SYNC else (Cause.SLIP, Cause.PHASE)[n // 40 % 2]
        drift = Pace(*random.normal(0, 9, 4))
        recorder.take(verdict(n, state, cause, offset_ms=random.normal(0, 40), drift=drift, notes=(f"note {n % 400}",)))
        if n % 20 == 0:
            recorder.take(
                Event("bench", str(n), "dark", "onset", None, "left", None, 0, None, {}, f"left is dark, {n}")
            )
    return recorder


def test_twenty_minutes_make_a_page_of_less_than_three_megabytes(long):
    text = report_page(long, answer(long.tally), "0.0", ["/my/recording"])
    assert len(text) < 3_000_000
    assert text == report_page(long, answer(long.tally), "0.0", ["/my/recording"])


def test_curves_and_lists_do_not_grow_with_the_recording(long):
    pair = to_message(long, answer(long.tally), "0.0")["pairs"]["left-right"]
    assert {len(curve) for curve in pair["series"].values()} == {len(pair["series"]["from_s"])}
    assert MOST_BINS / 2 < len(pair["series"]["from_s"]) <= MOST_BINS
    assert pair["series"]["to_s"][-1] == 1200.0
    assert len(pair["events"]) + len(pair["notes"]) == MOST_MARKS
    assert pair["events_left_out"] > 1000
    assert len(pair["moments"]) <= 3


def test_names_and_texts_from_outside_are_shown_and_never_run():
    rig = Rig("<b>&rig", RIG.cameras, RIG.pairs)
    recorder = Recorder(rig)
    recorder.take(Event(rig.name, "1", NASTY, "onset", None, NASTY, None, 0, None, {}, NASTY))
    for n in range(40):
        silent = Evidence("left-right", "timestamp", Basis.TIMESTAMPS, State.UNKNOWN, f"clocks {NASTY}")
        recorder.take(Verdict(rig.name, "left-right", n, State.UNKNOWN, Basis.NONE, reason=Reason.NO_MOTION,
                              evidence=(silent,), notes=(NASTY,)))  # fmt: skip
    page = page_of(recorder, [f"/data/{NASTY}"])
    assert page.needs == page.handlers == page.unclosed == []
    assert "img" not in page.tags
    assert page.text.count(NASTY) >= 4
    assert "<b>&rig" in page.text


def test_every_pair_has_its_section_and_the_worst_one_is_the_headline():
    rig = Rig("bench", tuple(Camera(name, 30) for name in "abc"), (Pair("a", "b"), Pair("a", "c")))
    said = [verdict(n, pair="a-b") for n in range(60)]
    said += [verdict(n, State.ASYNC, Cause.SLIP, pair="a-c", offset_ms=33.0) for n in range(60)]
    recorder = recorded(said, rig)
    page = page_of(recorder)
    assert page.text.index("OUT OF SYNC.") < page.text.index("a-b") < page.text.index("a-c")
    numbers = to_message(recorder, answer(recorder.tally), "0.0")
    assert (numbers["state"], numbers["pairs"]["a-b"]["state"], numbers["pairs"]["a-c"]["state"]) == (
        "async", "sync", "async",
    )  # fmt: skip
    assert page.tags.count("section") == 2 + 1 + 1


def test_what_to_do_follows_from_the_cause():
    for cause, word in ((Cause.SLIP, "align"), (Cause.PHASE, "Trigger"), (Cause.STAMPS_LIE, "Do not pair by these")):
        recorder = recorded([verdict(n, State.ASYNC, cause, offset_ms=20.0) for n in range(60)])
        assert word in to_message(recorder, answer(recorder.tally), "0.0")["advice"][0]
    recorder = recorded([verdict(n) for n in range(60)])
    assert to_message(recorder, answer(recorder.tally), "0.0")["advice"] == ["Nothing has to be done."]


def test_stamps_that_deny_what_the_pictures_say_are_told():
    recorder = recorded([verdict(n, State.ASYNC, Cause.STAMPS_LIE, offset_ms=33.0) for n in range(60)])
    pair = to_message(recorder, answer(recorder.tally), "0.0")["pairs"]["left-right"]
    assert pair["contradictions"] == 1.0
    assert (pair["stamps_ms"]["mean"], pair["pictures_ms"]["mean"]) == (0.1, 33.0)
    assert "contradict each other in 100 % of the frames" in page_of(recorder).text


def test_a_run_that_showed_nothing_still_makes_a_page():
    recorder = Recorder(RIG)
    page = page_of(recorder)
    assert "Cannot tell." in page.text
    assert json.loads(json.dumps(to_message(recorder, answer(recorder.tally), "0.0"), allow_nan=False))
