"""The report's Algorithm 2."""

from __future__ import annotations

import pytest

from pipeline.detectors.timestamp import TimestampDetector, TimestampSettings
from pipeline.frame import Camera, Pair, Rig, StampOrigin
from pipeline.verdict import Evidence, State
from tests.frames import PERIOD_NS, RIG, frame, window


def detector(*, classic: bool = False, rig: Rig = RIG, **settings: object) -> TimestampDetector:
    return TimestampDetector(TimestampSettings.model_validate(settings), name="timestamp", rig=rig, classic=classic)


def said(right_ns: int, *, ids: tuple[int | None, int | None] = (5, 5), **options: object) -> Evidence:
    test = detector(**options)  # type: ignore[arg-type]
    (evidence,) = test.observe(window(left=frame("left", 0, ids[0]), right=frame("right", right_ns, ids[1])))
    return evidence


@pytest.mark.parametrize(
    ("right_ns", "state"),
    [(0, State.SYNC), (PERIOD_NS // 2, State.SYNC), (PERIOD_NS // 2 + 1, State.ASYNC), (-PERIOD_NS, State.ASYNC)],
)
def test_stamps_half_a_period_apart_are_the_limit(right_ns, state):
    assert said(right_ns).state is state


def test_the_offset_is_the_second_stamp_against_the_first():
    evidence = said(-PERIOD_NS)
    assert (evidence.offset_ns, evidence.offset_frames) == (-PERIOD_NS, -1.0)


def test_unequal_ids_are_async_under_the_classic_rule():
    evidence = said(0, ids=(5, 6), classic=True)
    assert evidence.state is State.ASYNC
    assert evidence.reason == "frame ids differ by 1 (5 and 6)"


def test_a_constant_difference_of_ids_is_learned_outside_the_classic_rule():
    evidence = said(0, ids=(5, 6))
    assert (evidence.state, evidence.notes) == (State.SYNC, ("sequence_offset",))


def test_a_sudden_difference_of_ids_is_async_until_it_has_become_usual():
    test = detector(ids="learn")
    states = []
    for number in range(60):
        right = frame("right", 0, number + (number >= 20))
        (evidence,) = test.observe(window(left=frame("left", 0, number), right=right))
        states.append(evidence.state)
    assert states[:20] == [State.SYNC] * 20
    assert states[20:30] == [State.ASYNC] * 10
    assert states[-10:] == [State.SYNC] * 10


def test_missing_ids_leave_the_stamps_to_decide():
    assert said(0, ids=(5, None), classic=True).state is State.SYNC


def test_ids_can_be_ignored():
    frames = window(left=frame("left", 0, 5), right=frame("right", 0, 9))
    assert detector(classic=True, ids="ignore").observe(frames)[0].state is State.SYNC


def test_the_threshold_can_be_set():
    assert said(2_000_001, threshold_ms=2.0).state is State.ASYNC


def test_a_staggered_trigger_is_no_fault():
    rig = Rig("bench", RIG.cameras, (Pair("left", "right", expected_offset_ns=PERIOD_NS),))
    assert said(PERIOD_NS, rig=rig).state is State.SYNC


def test_a_missing_partner_is_unknown():
    (evidence,) = detector().observe(window(left=frame("left", 0, 5), right=None))
    assert (evidence.state, evidence.reason) == (State.UNKNOWN, "no frame of right")


def test_synthesised_stamps_are_told_apart():
    made_up = frame("right", 0, 5, stamp_origin=StampOrigin.SYNTHESISED)
    (evidence,) = detector().observe(window(left=frame("left", 0, 5), right=made_up))
    assert evidence.synthesised


@pytest.mark.parametrize(("classic", "state"), [(False, State.UNKNOWN), (True, State.ASYNC)])
def test_stamps_of_different_clocks_are_compared_by_the_classic_rule_alone(classic, state):
    frames = window(left=frame("left", 0, 5), right=frame("right", 37 * PERIOD_NS, 5, clock="right"))
    assert detector(classic=classic).observe(frames)[0].state is state


def test_every_pair_of_a_rig_gets_its_evidence():
    cameras = tuple(Camera(name, 10) for name in "abc")
    rig = Rig("bench", cameras, (Pair("a", "b"), Pair("a", "c")))
    frames = {name: frame(name, stamp, 0) for name, stamp in (("a", 0), ("b", 0), ("c", PERIOD_NS))}
    evidence = detector(rig=rig).observe(window(**frames))
    assert [(item.pair, item.state) for item in evidence] == [("a-b", State.SYNC), ("a-c", State.ASYNC)]
