"""From evidence to a verdict."""

from __future__ import annotations

import pytest

from pipeline.frame import Camera, Pair, Rig, Truth
from pipeline.judge import Judge, JudgeSettings
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
    )  # fmt: skip


def verdict(
    *evidence: Evidence, right: bool = True, rig: Rig = RIG, trust: bool = False, **settings: object
) -> Verdict:
    judge = Judge(JudgeSettings.model_validate(settings), rig, trust_stamps=trust)
    second = frame("right", 40, 7) if right else None
    (said,) = judge.judge(window(3, left=frame("left", 100, 6), right=second), evidence)
    return said


@pytest.mark.parametrize(
    ("evidence", "state", "cause", "basis"),
    [
        ((stamps(0), content(0)), SYNC, None, Basis.CONTENT),
        ((stamps(1), content(1)), ASYNC, Cause.SLIP, Basis.CONTENT),
        ((stamps(0), content(-1)), ASYNC, Cause.STAMPS_LIE, Basis.CONTENT),
        ((stamps(1), content(0)), SYNC, None, Basis.CONTENT),
        ((stamps(0, synthesised=True), content(-1)), ASYNC, Cause.SLIP, Basis.CONTENT),
        ((stamps(0.5), content(0.5)), ASYNC, Cause.PHASE, Basis.CONTENT),
        ((stamps(0.04), content(None)), SYNC, None, Basis.TIMESTAMPS),
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


def test_synthesised_stamps_count_where_they_are_trusted():
    assert verdict(stamps(1, synthesised=True), trust=True).state is ASYNC


def test_a_frame_without_partner_is_unpaired():
    said = verdict(stamps(0), content(0), right=False)
    assert (said.state, said.reason, said.frame) == (UNKNOWN, Reason.UNPAIRED, 3)
    assert said.to_message()["sequence"] == {"left": 6, "right": None}


def test_a_hole_of_the_first_camera_gets_no_verdict():
    assert Judge(JudgeSettings(), RIG).judge(window(left=None, right=frame("right", 0)), []) == []


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
        "schema", "rig", "pair", "frame", "state", "cause", "reason", "basis", "offset_ms", "offset_sigma_ms",
        "offset_frames", "tolerance_ms", "content", "evidence", "sequence", "captured_ns", "interval_ms", "notes",
    ]  # fmt: skip
    assert message["schema"] == "syncwatch.verdict.v1"
    assert message["offset_sigma_ms"] is None
    assert message["content"] == {
        "detector": "spatial", "state": "async", "offset_frames": 1.0, "sigma_frames": None, "motion_px": None,
        "reason": "picture",
    }  # fmt: skip
    assert message["evidence"]["timestamp"]["offset_ms"] == 100.0
    assert message["interval_ms"] == 0.0


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
