"""Evidence that accumulates."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from pipeline.belief import MOST_PICTURES, MOST_STAMPS, SURE, Belief, support
from pipeline.verdict import State

SUPPORTS = st.lists(st.floats(-100, 100), max_size=60)


def test_support_is_none_at_the_tolerance_and_grows_both_ways():
    assert support(100, 10, 100) == 0
    assert support(130, 10, 100) == pytest.approx(4.5)
    assert support(-130, 10, 100) == pytest.approx(4.5)
    assert support(70, 10, 100) == pytest.approx(-4.5)
    assert support(0, 0, 100) < -1000


@given(SUPPORTS, st.sampled_from([MOST_PICTURES, MOST_STAMPS]))
def test_no_single_frame_turns_one_belief_into_the_other(supports, most):
    belief = Belief()
    before = belief.state
    for one in supports:
        after = belief.add(one, most)
        if {before, after} == {State.SYNC, State.ASYNC}:
            assert abs(one) > 0
            assert belief.add(-100, most) is not State.SYNC or after is State.SYNC
            return
        before = after


@given(SUPPORTS)
def test_belief_turns_within_a_few_convincing_frames_whatever_came_before(supports):
    belief = Belief()
    for one in supports:
        belief.add(one, MOST_STAMPS)
    for _ in range(4):
        belief.add(SURE, MOST_STAMPS)
    assert belief.state is State.ASYNC


@given(SUPPORTS)
def test_it_is_symmetric(supports):
    one, other = Belief(), Belief()
    turned = {State.SYNC: State.ASYNC, State.ASYNC: State.SYNC, State.UNKNOWN: State.UNKNOWN}
    for each in supports:
        assert one.add(each, MOST_STAMPS) is turned[other.add(-each, MOST_STAMPS)]
