"""Frames paired anew: one to one, in order, and with the moment they were taken at as near as whole frames allow."""

from __future__ import annotations

from collections.abc import Sequence

import pytest
from hypothesis import given
from hypothesis import strategies as st

from pipeline.align import Aligner, AlignSettings
from pipeline.frame import Camera, Pair, Rig
from pipeline.verdict import AlignedPair, Basis, State, Verdict
from tests.frames import PERIOD_NS, RIG, frame, window


def aligned(
    offsets: Sequence[float | None], *, holes: set[int] | None = None, most: int = 5, rig: Rig = RIG
) -> list[AlignedPair]:
    """What comes of slots whose right picture is `offset` frames later; None: it was not judged."""
    aligner = Aligner(AlignSettings(max_frames=most), rig)
    made = []
    for n, offset in enumerate(offsets):
        right = None if n in (holes or ()) else frame("right", round((n + (offset or 0)) * PERIOD_NS), n)
        verdict = Verdict(
            "bench", "left-right", n, State.UNKNOWN if offset is None else State.ASYNC, Basis.CONTENT,
            offset_ns=None if offset is None else round(offset * PERIOD_NS), sigma_ns=1000,
        )  # fmt: skip
        made += aligner.take(window(n, left=frame("left", n * PERIOD_NS, n), right=right), [verdict])
    return made


@pytest.mark.parametrize("slip", [-5, -2, -1, 0, 1, 3, 5])
def test_a_rig_that_slipped_by_whole_frames_is_put_right(slip):
    made = aligned([float(slip)] * 40)[5:]
    assert len(made) >= 30 - abs(slip)
    for pair in made:
        left, right = pair.frames
        assert left.captured_ns == right.captured_ns
        assert (pair.first, pair.second) == (left.sequence, right.sequence)
        assert (pair.shift_frames, pair.residual_ns, pair.sigma_ns) == (slip, 0, 1000)


def test_a_slip_beyond_what_may_be_moved_is_moved_as_far_as_that():
    assert {pair.shift_frames for pair in aligned([4.0] * 20, most=2)[5:]} == {2}


def test_half_a_frame_does_not_flap():
    offsets = [0.5 + 0.05 * (-1) ** n for n in range(60)]
    assert len({pair.shift_frames for pair in aligned(offsets)}) == 1


def test_what_is_expected_is_left_alone():
    rig = Rig("bench", (Camera("left", 10), Camera("right", 10)), (Pair("left", "right", PERIOD_NS),))
    assert {pair.shift_frames for pair in aligned([1.0] * 20, rig=rig)} == {0}


def test_while_nothing_is_known_the_last_shift_holds():
    made = aligned([1.0] * 10 + [None] * 10)
    assert made[-1].shift_frames == 1
    assert (made[-1].residual_ns, made[-1].sigma_ns) == (None, None)


def test_one_wrong_verdict_moves_nothing():
    assert {pair.shift_frames for pair in aligned([0.0] * 10 + [3.0] + [0.0] * 10)} == {0}


def test_a_hole_yields_nothing():
    made = aligned([0.0] * 20, holes={7, 8})
    assert [pair.first for pair in made] == [n for n in range(20) if n not in {7, 8}]


def test_a_camera_that_runs_free_is_followed_within_half_a_frame_and_a_bit():
    made = aligned([0.02 * n for n in range(240)])
    left_ns = [abs(pair.frames[1].captured_ns - pair.frames[0].captured_ns) for pair in made]
    assert max(left_ns) <= 0.7 * PERIOD_NS
    assert made[-1].shift_frames == 5


@given(
    st.lists(st.one_of(st.none(), st.floats(-8, 8)), min_size=1, max_size=80),
    st.sets(st.integers(0, 79)),
    st.integers(1, 6),
)
def test_pairs_are_one_to_one_and_in_order_whatever_is_judged(offsets, holes, most):
    made = aligned(offsets, holes=holes, most=most)
    firsts, seconds = [pair.first for pair in made], [pair.second for pair in made]
    assert firsts == sorted(set(firsts))
    assert seconds == sorted(set(seconds))
    assert all(abs(pair.shift_frames) <= most for pair in made)


def test_the_message_names_the_frames():
    message = aligned([1.0] * 10)[-1].to_message()
    assert message["schema"] == "syncwatch.aligned.v1"
    assert (message["first"], message["second"], message["shift_frames"]) == (9, 8, 1)
    assert (message["residual_ms"], message["sequence"]) == (0.0, {"left": 9, "right": 8})
