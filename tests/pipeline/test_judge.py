"""From evidence to a verdict."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import pytest

from pipeline.frame import Camera, Pair, Rig, StampOrigin, StampReference, Truth
from pipeline.health.observer import Observation
from pipeline.judge import Judge, JudgeSettings
from pipeline.notes import Note
from pipeline.verdict import Basis, Cause, Evidence, Reason, State, Verdict
from tests.frames import PERIOD_NS, RIG, frame, window

SYNC, ASYNC, UNKNOWN = State.SYNC, State.ASYNC, State.UNKNOWN


def stamps(offset_frames: float, *, synthesised: bool = False) -> Evidence:
    state = SYNC if abs(offset_frames) <= 0.5 else ASYNC
    return Evidence(
        "left-right", "timestamp", Basis.TIMESTAMPS, state, "stamps",
        offset_ns=round(offset_frames * PERIOD_NS), offset_frames=offset_frames, synthesised=synthesised,
    )  # fmt: skip


def content(offset_frames: float | None, sigma_frames: float | None = None) -> Evidence:
    if offset_frames is None:
        return Evidence("left-right", "spatial", Basis.CONTENT, UNKNOWN, "no edges")
    return Evidence(
        "left-right", "spatial", Basis.CONTENT, ASYNC if offset_frames else SYNC, "picture",
        offset_ns=round(offset_frames * PERIOD_NS), offset_frames=offset_frames, sigma_frames=sigma_frames,
        sigma_ns=None if sigma_frames is None else round(sigma_frames * PERIOD_NS),
    )  # fmt: skip


def judged(
    stream: Sequence[tuple[Evidence, ...] | None],
    *,
    rig: Rig = RIG,
    trust: bool = False,
    seen: Sequence[Observation] = (),
    **settings: object,
) -> list[Verdict]:
    """A verdict a frame, of what detectors said of it; None: the second camera's frame is missing.

    Stamps are those that evidence speaks of.
    """
    judge = Judge(JudgeSettings.model_validate(settings), rig, trust_stamps=trust)
    said = []
    for n, evidence in enumerate(stream):
        stamped = [item for item in evidence or () if item.basis is Basis.TIMESTAMPS]
        off_ns = stamped[0].offset_ns or 0 if stamped else 0
        origin = StampOrigin.SYNTHESISED if stamped and stamped[0].synthesised else StampOrigin.DEVICE
        first = frame("left", n * PERIOD_NS, n, stamp_origin=origin)
        second = None if evidence is None else frame("right", n * PERIOD_NS + off_ns, n, stamp_origin=origin)
        said += judge.judge(window(n, left=first, right=second), evidence or (), seen[n] if seen else None)
    return said


def verdict(*evidence: Evidence, **given: Any) -> Verdict:
    """The last verdict when the same was said of ten frames."""
    return judged([evidence] * 10, **given)[-1]


@pytest.mark.parametrize(
    ("evidence", "state", "cause", "basis"),
    [
        ((stamps(0), content(0)), SYNC, None, Basis.CONTENT),
        ((stamps(1), content(1)), ASYNC, Cause.SLIP, Basis.CONTENT),
        ((stamps(0), content(-1)), ASYNC, Cause.STAMPS_LIE, Basis.CONTENT),
        ((stamps(1), content(0)), SYNC, None, Basis.CONTENT),
        ((stamps(0, synthesised=True), content(-1)), ASYNC, Cause.SLIP, Basis.CONTENT),
        ((stamps(0.5), content(0.5)), ASYNC, Cause.PHASE, Basis.CONTENT),
        ((stamps(0.5), content(0.5, 0.02)), ASYNC, Cause.PHASE, Basis.CONTENT),
        ((stamps(0), content(0.5, 0.02)), ASYNC, Cause.STAMPS_LIE, Basis.CONTENT),
        ((stamps(0.02), content(0.2, 0.02)), ASYNC, Cause.STAMPS_LIE, Basis.CONTENT),
        ((stamps(1), content(0.85, 0.1)), ASYNC, Cause.SLIP, Basis.CONTENT),
        ((stamps(0.03), content(None)), SYNC, None, Basis.TIMESTAMPS),
        ((stamps(0.3), content(None)), ASYNC, Cause.PHASE, Basis.TIMESTAMPS),
        ((stamps(-1),), ASYNC, Cause.SLIP, Basis.TIMESTAMPS),
        ((content(1),), ASYNC, Cause.SLIP, Basis.CONTENT),
    ],
)
def test_pictures_outrank_stamps_and_the_cause_is_named(evidence, state, cause, basis):
    said = verdict(*evidence)
    assert (said.state, said.cause, said.basis, said.reason) == (state, cause, basis, None)


@pytest.mark.parametrize("evidence", [(), (content(None),), (stamps(1, synthesised=True), content(None))])
def test_without_evidence_that_counts_it_cannot_tell(evidence):
    said = verdict(*evidence)
    assert (said.state, said.reason, said.basis) == (UNKNOWN, Reason.NO_EVIDENCE, Basis.NONE)


def test_it_says_why_pictures_do_not_tell():
    silent = replace(content(None), silence=Reason.NO_MOTION)
    assert verdict(stamps(1, synthesised=True), silent).reason is Reason.NO_MOTION


def states(said: Sequence[Verdict]) -> str:
    return "".join(one.state.value[0] for one in said)


GOOD, BAD = (stamps(0), content(0, 0.01)), (stamps(0), content(1, 0.01))


def test_the_first_convincing_frame_is_enough_and_a_change_takes_two_of_pictures_and_four_of_stamps():
    assert states(judged([GOOD] * 5 + [BAD] * 5)) == "ssssss" + "aaaa"
    assert states(judged([(stamps(0),)] * 25 + [(stamps(1),)] * 6)) == "s" * 28 + "aaa"


@pytest.mark.parametrize("outlier", [BAD, (stamps(1), content(None))])
def test_one_outlier_changes_nothing_however_often_it_comes(outlier):
    usual = GOOD if outlier is BAD else (stamps(0), content(None))
    assert set(states(judged([*[usual] * 29, outlier] * 8))) == {"s"}


def test_a_frame_that_is_not_believed_yet_does_not_lend_its_offset():
    said = judged([(stamps(0),)] * 25 + [(stamps(1),)] * 6 + [(stamps(0),)] * 6)
    told = [(one.state.value[0], round(one.offset_frames or 0)) for one in said]
    assert told == [("s", 0)] * 28 + [("a", 1)] * 6 + [("s", 0)] * 3


def test_it_says_since_when():
    said = judged([(stamps(0),)] * 25 + [(stamps(1),)] * 6 + [(stamps(0),)] * 6)
    assert [one.since_frame for one in said] == [0] * 28 + [25] * 6 + [31] * 3


def test_unconvincing_evidence_accumulates():
    assert states(judged([GOOD] * 5 + [(content(0.1, 0.02),)] * 10)) == "s" * 10 + "aaaaa"


def test_what_was_found_is_still_believed_after_a_while_without_evidence():
    blind = (content(None),)
    assert states(judged([BAD] * 5 + [blind] * 30 + [BAD, GOOD, GOOD])) == "aaaaa" + "u" * 30 + "aas"


def test_stamps_that_pictures_have_disproved_do_not_speak_for_them():
    lying = [(stamps(0), content(-1, 0.02))] * 40
    said = judged([*lying, *[(stamps(0), content(None))] * 20])
    assert {(one.state, one.reason) for one in said[40:]} == {(UNKNOWN, Reason.STAMPS_DISPROVED)}
    truthful = judged([*[GOOD] * 40, *[(stamps(0), content(None))] * 20])
    assert states(truthful) == "s" * 60


def test_noisy_stamps_decide_nothing_by_themselves():
    noisy = [(stamps(0.2 + 0.25 * math.sin(n * n)), content(None)) for n in range(80)]
    assert set(states(judged(noisy)[30:])) == {"u"}


def test_a_drift_of_the_camera_is_told_from_one_of_its_clock():
    free = judged([(stamps(0.002 * n), content(0.002 * n, 0.01)) for n in range(200)])
    assert free[-1].cause is Cause.FREE_RUN
    assert free[-1].drift.stamps_ppm == pytest.approx(2000, rel=0.02)
    assert "clock_drift" not in free[-1].notes
    clock = judged([(stamps(0.002 * n), content(0, 0.01)) for n in range(200)])
    assert set(states(clock)) == {"s"}
    assert "clock_drift" in clock[-1].notes


def test_a_slip_is_named_so_also_where_a_clock_drifts_a_little():
    slow = 20e-6
    stream = [(stamps(slow * n + (n > 300)), content(slow * n + (n > 300), 0.01)) for n in range(340)]
    assert {one.cause for one in judged(stream)[304:]} == {Cause.SLIP}


DEAD_RIGHT = Observation(lasting={"left": (), "right": (Note.MISSING,)})
DEAD_LEFT = Observation(lasting={"left": (Note.MISSING,), "right": ()})


def test_a_frame_without_partner_is_unpaired():
    said = judged([GOOD, None])[-1]
    assert (said.state, said.reason, said.frame, said.notes) == (UNKNOWN, Reason.UNPAIRED, 1, ("unpaired",))
    assert said.to_message()["sequence"] == {"left": 1, "right": None}


def test_a_partner_that_is_missing_is_out_of_sync():
    said = judged([GOOD, None], seen=[Observation(), DEAD_RIGHT])[-1]
    assert (said.state, said.cause, said.camera, said.frame) == (ASYNC, Cause.MISSING, "right", 1)


def test_a_first_camera_that_is_missing_is_told_at_once_and_once_a_second():
    judge = Judge(JudgeSettings(), RIG)
    holes = [window(n, left=None, right=frame("right", n * PERIOD_NS)) for n in range(25)]
    assert [judge.judge(hole, []) for hole in holes[:3]] == [[], [], []]
    said = [(n, one) for n, hole in enumerate(holes) for one in judge.judge(hole, [], DEAD_LEFT)]
    assert [n for n, _ in said] == [0, 10, 20]
    assert {(one.frame, one.state, one.cause, one.camera) for _, one in said} == {(None, ASYNC, Cause.MISSING, "left")}
    (silent,) = judge.silence(DEAD_LEFT)
    assert silent.cause is Cause.MISSING


def test_a_second_camera_that_is_missing_is_told_once_before_the_frames_that_waited_for_it():
    judge = Judge(JudgeSettings(), RIG)
    assert judge.silence(Observation()) == []
    (silent,) = judge.silence(DEAD_RIGHT)
    assert (silent.frame, silent.state, silent.cause, silent.camera) == (None, ASYNC, Cause.MISSING, "right")
    assert judge.silence(DEAD_RIGHT) == []
    judge.judge(window(left=frame("left", 0), right=frame("right", 0)), [])
    assert len(judge.silence(DEAD_RIGHT)) == 1


@pytest.mark.parametrize("camera", ["left", "right"])
def test_a_frozen_camera_is_out_of_sync_and_named(camera):
    seen = Observation(lasting={"left": (), "right": (), camera: (Note.FROZEN,)})
    said = judged([GOOD] * 3, seen=[seen] * 3)[-1]
    assert (said.state, said.cause, said.camera, said.basis) == (ASYNC, Cause.FROZEN, camera, Basis.CONTENT)
    assert "frozen" in said.notes


def test_in_the_dark_stamps_decide_else_nothing():
    seen = Observation(lasting={"left": (), "right": (Note.DARK,)})
    assert {one.basis for one in judged([GOOD] * 3, seen=[seen] * 3)} == {Basis.TIMESTAMPS}
    blind = judged([(content(1, 0.02),)] * 3, seen=[seen] * 3)[-1]
    assert (blind.state, blind.reason) == (UNKNOWN, Reason.DARK)


def test_the_classic_rule_regards_no_health():
    seen = Observation(lasting={"left": (), "right": (Note.FROZEN,)})
    assert judged([GOOD] * 3, seen=[seen] * 3, combine="classic")[-1].state is SYNC


def test_start_and_middle_of_exposures_are_told_apart_and_the_middle_counts():
    judge = Judge(JudgeSettings(), RIG)
    exposed = {"stamp_reference": StampReference.START, "sequence": 1}
    for n in range(10):
        left = frame("left", n * PERIOD_NS, exposure_ns=2_000_000, **exposed)
        right = frame("right", n * PERIOD_NS - 4_000_000, exposure_ns=10_000_000, **exposed)
        (said,) = judge.judge(window(n, left=left, right=right), [stamps(-0.04)])
    assert said.to_message()["exposure"] == {"start_ms": -4.0, "middle_ms": 0.0}
    assert (said.state, said.offset_ns) == (SYNC, 0)
    assert "stamp_reference" in said.notes


def test_synthesised_stamps_count_where_they_are_trusted():
    assert verdict(stamps(1, synthesised=True), trust=True).state is ASYNC


@pytest.mark.parametrize(
    ("evidence", "state"),
    [
        ((stamps(0), content(0)), SYNC),
        ((stamps(1), content(0)), ASYNC),
        ((stamps(0), content(-1)), ASYNC),
        ((stamps(1, synthesised=True), content(0)), ASYNC),
        ((stamps(0), content(None)), UNKNOWN),
        ((stamps(1), content(None)), ASYNC),
    ],
)
def test_the_classic_rule_is_sync_only_if_all_say_so(evidence, state):
    assert verdict(*evidence, combine="classic").state is state


def test_the_more_certain_content_evidence_wins():
    assert verdict(content(1, 0.5), content(0, 0.02)).state is SYNC


@pytest.mark.parametrize(("fps", "tolerance_ms"), [(30, 10 / 3), (120, 10 / 12), (1, 30.0), (10, 5.0), (60, 10 / 6)])
def test_the_tolerance_follows_the_frame_rate(fps, tolerance_ms):
    rig = Rig("bench", (Camera("left", fps), Camera("right", fps)), (Pair("left", "right"),))
    assert Judge(JudgeSettings(), rig).tolerance_ns(rig.pairs[0]) == pytest.approx(tolerance_ms * 1e6, abs=1)


def test_a_staggered_pair_is_judged_around_its_expected_offset():
    rig = Rig("bench", RIG.cameras, (Pair("left", "right", PERIOD_NS // 4),))
    assert verdict(stamps(0.25), rig=rig).state is SYNC
    assert verdict(stamps(0), rig=rig).state is ASYNC


def test_the_truth_of_tampered_frames_is_carried_along():
    judge = Judge(JudgeSettings(), RIG)
    first = frame("left", 0, truth=Truth(0))
    second = frame("right", 0, truth=Truth(-PERIOD_NS, ("content_shift",)))
    (said,) = judge.judge(window(left=first, right=second), [content(-1)])
    assert said.truth is not None
    assert (said.truth.offset_ns, said.truth.state, said.truth.faults) == (-PERIOD_NS, ASYNC, ("content_shift",))


def test_the_message_is_complete_and_missing_values_are_null():
    message = verdict(stamps(1), content(1)).to_message()
    assert list(message) == [
        "schema", "rig", "pair", "frame", "state", "cause", "camera", "since_frame", "reason", "basis",
        "offset_ms", "offset_sigma_ms", "offset_frames", "tolerance_ms", "drift", "content", "evidence", "sequence",
        "captured_ns", "interval_ms", "exposure", "notes",
    ]  # fmt: skip
    assert message["schema"] == "syncwatch.verdict.v1"
    assert message["offset_sigma_ms"] is None
    assert message["content"] == {
        "detector": "spatial", "state": "async", "offset_frames": 1.0, "sigma_frames": None, "motion_px": None,
        "reason": "picture",
    }  # fmt: skip
    assert message["evidence"]["timestamp"]["offset_ms"] == 100.0
    assert message["interval_ms"] == 100.0


@pytest.mark.parametrize(
    ("expected_frames", "measured_frames", "cause"),
    [
        (0.5, 1.5, Cause.SLIP),
        (0, 0.08, Cause.PHASE),
        (0, 0.5, Cause.PHASE),
        (1, 0.7, Cause.PHASE),
        (0, 2.05, Cause.SLIP),
    ],
)
def test_a_slip_is_a_whole_frame_off_what_is_expected(expected_frames, measured_frames, cause):
    rig = Rig("bench", RIG.cameras, (Pair("left", "right", round(expected_frames * PERIOD_NS)),))
    assert verdict(stamps(measured_frames), rig=rig).cause is cause


def test_trusted_stamps_can_be_caught_lying():
    assert verdict(stamps(0, synthesised=True), content(-1), trust=True).cause is Cause.STAMPS_LIE
