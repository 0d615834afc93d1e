"""From numbers in file names to slots, and from names to their natural order: what holds for all of them."""

from __future__ import annotations

from itertools import pairwise

import pytest
from hypothesis import given
from hypothesis import strategies as st

from sources.replay.names import last_number, natural
from sources.replay.numbers import slots

NUMBERS = st.lists(st.integers(0, 10**25), min_size=1, max_size=20, unique=True)


@given(st.lists(NUMBERS, min_size=2, max_size=4))
def test_slots_keep_the_order_and_never_put_two_numbers_together(cameras):
    slot_of = slots(cameras)

    numbers = sorted(slot_of)
    assert numbers == sorted({number for own in cameras for number in own})
    assert slot_of[numbers[0]] == 0
    assert all(slot_of[before] < slot_of[after] for before, after in pairwise(numbers))


@given(st.integers(0, 10**18), st.integers(1, 10**6), st.sets(st.integers(1, 50)))
def test_slots_of_every_nth_number_count_by_one(start, step, lost):
    kept = [0, 1, 2, *sorted(lost)]
    numbers = sorted({start + step * place for place in kept})

    slot_of = slots([numbers, [start, start + step, start + 2 * step]])

    smallest = min(after - before for before, after in pairwise(numbers))
    assert smallest == step
    assert [slot_of[number] for number in numbers] == sorted(set(kept))


def test_a_shift_of_a_few_numbers_between_cameras_is_kept():
    assert slots([[0, 10, 20], [0, 10, 24]]) == {0: 0, 10: 5, 20: 10, 24: 12}


@pytest.mark.parametrize(
    ("stem", "number"),
    [("000051", 51), ("left12", 12), ("cam0_frame_0007", 7), ("000000_10", 10), ("left", None), ("7b", 7)],
)
def test_the_number_of_a_file_is_its_last_run_of_digits(stem, number):
    assert last_number(stem) == number


def test_natural_order_counts():
    names = ["left10", "left2", "Left1", "left", "cam2", "cam10", "10", "9"]

    assert sorted(names, key=natural) == ["9", "10", "cam2", "cam10", "left", "Left1", "left2", "left10"]


@given(st.lists(st.text(), unique=True), st.randoms())
def test_any_names_can_be_sorted_the_same_way_from_any_start(names, chance):
    shuffled = chance.sample(names, len(names))

    assert sorted(names, key=natural) == sorted(shuffled, key=natural)
