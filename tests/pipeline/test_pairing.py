"""Pairing: one to one, in any interleaving, with bounded memory."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import pytest
from hypothesis import given
from hypothesis import strategies as st

from pipeline.frame import Camera, Frame
from pipeline.pairing import Pairer, Slot
from tests.frames import PERIOD_NS, frame

RIG = (Camera("a", 10), Camera("b", 10))
THREE = (*RIG, Camera("c", 10))


def slots_of(frames: Iterable[Frame], cameras: Sequence[Camera] = RIG, **options: int) -> tuple[Pairer, list[Slot]]:
    pairer = Pairer(cameras, **options)
    slots = [slot for item in frames for slot in pairer.push(item)]
    return pairer, slots + list(pairer.flush())


def told(slots: Iterable[Slot]) -> list[tuple[int | None, ...]]:
    """The slots as tuples of sequence numbers, by camera."""
    return [tuple(item.sequence if item else None for item in slot.values()) for slot in slots]


def streams(*stamps_of_camera: Sequence[int], **fields: object) -> list[list[Frame]]:
    return [
        [frame(name, stamp, number, **fields) for number, stamp in enumerate(stamps)]
        for name, stamps in zip("abc", stamps_of_camera, strict=False)
    ]


def in_turn(lanes: Sequence[Sequence[Frame]]) -> list[Frame]:
    """All frames in order of their stamps, as cameras deliver them."""
    return sorted((item for lane in lanes for item in lane), key=lambda item: (item.captured_ns, item.camera))


def test_frames_of_one_group_share_a_slot_whatever_their_stamps_say():
    frames = [frame(name, 7_000 * number * (name == "a"), number, group=number) for number in range(4) for name in "ab"]
    assert told(slots_of(frames)[1]) == [(0, 0), (1, 1), (2, 2), (3, 3)]


def test_a_group_that_one_camera_lacks_leaves_a_hole():
    frames = [frame(name, number, number, group=number) for number in range(4) for name in "ab"]
    del frames[3]
    pairer, slots = slots_of(frames)
    assert told(slots) == [(0, 0), (1, None), (2, 2), (3, 3)]
    assert pairer.counters.holes == {"a": 0, "b": 1}


def test_groups_that_nobody_has_leave_one_empty_slot():
    frames = [frame(name, number, number, group=number) for number in (0, 1, 5, 6) for name in "ab"]
    assert told(slots_of(frames)[1]) == [(0, 0), (1, 1), (None, None), (5, 5), (6, 6)]


def test_a_repeated_frame_is_counted_and_not_paired_twice():
    frames = [frame(name, number, number, group=number) for number in range(3) for name in "ab"]
    pairer, slots = slots_of([*frames[:2], frames[1], *frames[2:]])
    assert told(slots) == [(0, 0), (1, 1), (2, 2)]
    assert pairer.counters.duplicates == {"a": 0, "b": 1}


def test_a_frame_that_comes_after_its_slot_has_gone_is_counted_as_late():
    frames = [frame(name, number, number, group=number) for number in range(4) for name in "ab"]
    late = frames.pop(3)
    pairer, slots = slots_of([*frames, late])
    assert (1, None) in told(slots)
    assert pairer.counters.late == {"a": 0, "b": 1}


@pytest.mark.parametrize("offset_ns", [0, 49_000_000, -49_000_000, 3_000_000_000, -37_000_000_000])
def test_a_constant_clock_offset_is_learned(offset_ns: int):
    stamps = [number * PERIOD_NS for number in range(30)]
    lanes = streams(stamps, [stamp + offset_ns for stamp in stamps])
    lanes[1] = [
        frame("b", item.captured_ns, item.sequence, arrived_ns=item.captured_ns - offset_ns) for item in lanes[1]
    ]
    interleaved = [item for pair in zip(*lanes, strict=True) for item in pair]
    assert told(slots_of(interleaved)[1]) == [(number, number) for number in range(30)]


def test_stamps_that_do_not_rise_give_way_to_arrival():
    frames = [
        frame(name, 5, number, arrived_ns=number * PERIOD_NS + (name == "b") * 3_000_000)
        for number in range(20)
        for name in "ab"
    ]
    assert told(slots_of(frames)[1]) == [(number, number) for number in range(20)]


def test_frames_further_apart_than_the_tolerance_stay_alone():
    lanes = streams([0, PERIOD_NS, 2 * PERIOD_NS], [0, PERIOD_NS + 30_000_000, 2 * PERIOD_NS])
    _, slots = slots_of(in_turn(lanes), tolerance_ns=20_000_000)
    assert told(slots) == [(0, 0), (1, None), (None, 1), (2, 2)]


def test_a_gap_in_time_on_all_cameras_leaves_one_empty_slot():
    stamps = [number * PERIOD_NS for number in (0, 1, 2, 7, 8, 9, 10, 11, 12)]
    slots = told(slots_of(in_turn(streams(stamps, stamps)))[1])
    assert slots[2:5] == [(2, 2), (None, None), (3, 3)]


def test_a_dead_camera_holds_the_others_up_only_until_the_bound():
    pairer = Pairer(RIG, max_pending=4)
    delivered = [sum(1 for _ in pairer.push(frame("a", n, n, group=n))) for n in range(10)]
    assert sum(delivered[:4]) == 0
    assert delivered[5:] == [1, 1, 1, 1, 1]


def test_a_camera_that_comes_back_is_paired_again():
    frames = [frame("a", n, n, group=n) for n in range(20)]
    frames += [frame(name, n, n, group=n) for n in range(20, 24) for name in "ab"]
    assert told(slots_of(frames, max_pending=4)[1])[-5:] == [(19, None), *((n, n) for n in range(20, 24))]


def test_a_new_epoch_starts_afresh_behind_a_gap():
    before = [frame(name, n, n, group=n) for n in range(100, 103) for name in "ab"]
    after = [frame(name, n, n, group=n, epoch=1) for n in range(3) for name in "ab"]
    _, slots = slots_of([*before, *after])
    assert told(slots) == [(100, 100), (101, 101), (102, 102), (None, None), (0, 0), (1, 1), (2, 2)]


# The properties hold for any cameras that stamp in order: jitter below a quarter period, frames lost at random.

jitter = st.integers(-24_000_000, 24_000_000)
stamp_lists = st.lists(st.tuples(st.booleans(), jitter), min_size=1, max_size=40).map(
    lambda items: [n * PERIOD_NS + wobble for n, (kept, wobble) in enumerate(items) if kept or n == 0]
)


@given(st.lists(stamp_lists, min_size=3, max_size=3), st.randoms(use_true_random=False))
def test_the_interleaving_of_cameras_does_not_matter(stamps, random):
    lanes = streams(*stamps)
    options = {"max_pending": 1000}
    expected = told(slots_of(in_turn(lanes), THREE, **options)[1])
    shuffled, waiting = [], [list(lane) for lane in lanes if lane]
    while waiting:
        lane = random.choice(waiting)
        shuffled.append(lane.pop(0))
        waiting = [lane for lane in waiting if lane]
    assert told(slots_of(shuffled, THREE, **options)[1]) == expected


@given(st.lists(stamp_lists, min_size=2, max_size=3), st.integers(2, 20))
def test_every_frame_is_in_exactly_one_slot_or_counted(stamps, max_pending):
    lanes = streams(*stamps)
    pairer, slots = slots_of(in_turn(lanes), THREE[: len(lanes)], max_pending=max_pending)
    kept = [(item.camera, item.sequence) for slot in slots for item in slot.values() if item]
    lost = sum(pairer.counters.late.values()) + sum(pairer.counters.duplicates.values())
    assert len(kept) == len(set(kept))
    assert len(kept) + lost == sum(len(lane) for lane in lanes)


@given(st.lists(stamp_lists, min_size=2, max_size=3))
def test_slots_are_in_order_of_time_for_every_camera(stamps):
    lanes = streams(*stamps)
    _, slots = slots_of(in_turn(lanes), THREE[: len(lanes)])
    for index in range(len(lanes)):
        numbers = [row[index] for row in told(slots) if row[index] is not None]
        assert numbers == sorted(numbers)


@given(stamp_lists, stamp_lists)
def test_two_frames_share_a_slot_only_within_the_tolerance(first, second):
    pairer, slots = slots_of(in_turn(streams(first, second)), tolerance_ns=PERIOD_NS // 2)
    for slot in slots:
        stamps = [item.captured_ns for item in slot.values() if item]
        assert max(stamps, default=0) - min(stamps, default=0) <= PERIOD_NS  # tolerance + learned constant
    assert pairer.counters.frames == {"a": len(first), "b": len(second)}


@given(st.integers(2, 30), st.integers(50, 200))
def test_memory_is_bounded_whatever_one_camera_does(max_pending, count):
    pairer = Pairer(RIG, max_pending=max_pending)
    emitted = 0
    for number in range(count):
        emitted += sum(1 for _ in pairer.push(frame("a", number * PERIOD_NS, number)))
        assert number + 1 - emitted <= max_pending + 1


@pytest.mark.parametrize("offset_ns", [100_000_000, 150_000_000, 1_000_000_000, -700_000_000])
def test_stamps_of_another_clock_are_aligned_by_arrival_however_close_they_seem(offset_ns: int):
    stamps = [number * PERIOD_NS for number in range(30)]
    first = [frame("a", stamp, n, clock="a", arrived_ns=stamp + 5_000_000) for n, stamp in enumerate(stamps)]
    second = [
        frame("b", stamp + offset_ns, n, clock="b", arrived_ns=stamp + 6_000_000) for n, stamp in enumerate(stamps)
    ]
    interleaved = [item for pair in zip(first, second, strict=True) for item in pair]
    assert told(slots_of(interleaved)[1]) == [(number, number) for number in range(30)]


@pytest.mark.parametrize("ppm", [-1000, 50, 1000])
@pytest.mark.parametrize("drifting", ["a", "b"])
def test_the_drift_of_another_clock_is_followed(ppm: int, drifting: str):
    count = 3000
    frames = []
    for n in range(count):
        for name in ("a", "b"):
            stamp = n * PERIOD_NS + (n * PERIOD_NS * ppm // 1_000_000 if name == drifting else 0)
            frames.append(frame(name, stamp, n, clock=name, arrived_ns=n * PERIOD_NS))
    assert told(slots_of(frames)[1]) == [(number, number) for number in range(count)]


def test_a_camera_that_runs_away_on_the_same_clock_is_not_followed():
    """It slips by a whole period in 1000 frames: then the frames that are nearest belong together."""
    lanes = streams([n * PERIOD_NS for n in range(1000)], [n * (PERIOD_NS + PERIOD_NS // 1000) for n in range(1000)])
    pairs = [pair for pair in told(slots_of(in_turn(lanes))[1]) if None not in pair]
    assert pairs[100] == (100, 100)
    assert pairs[-1][0] - pairs[-1][1] == 1


def test_a_frame_of_an_old_epoch_is_late_and_disturbs_nothing():
    frames = [frame(name, n, n, group=n, epoch=1) for n in range(6) for name in "ab"]
    frames.insert(7, frame("a", 99, 99, group=99, epoch=0))
    pairer, slots = slots_of(frames)
    assert told(slots) == [(number, number) for number in range(6)]
    assert pairer.counters.late == {"a": 1, "b": 0}
