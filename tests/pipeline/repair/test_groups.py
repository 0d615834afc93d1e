"""Frames that are put together anew, window by window."""

from __future__ import annotations

import pytest

from pipeline.frame import NS_PER_MS, Camera, Pair, Rig, StampOrigin
from pipeline.repair.groups import Regrouper
from pipeline.repair.measured import Measured
from pipeline.verdict import AlignedPair, Basis, Cause, State, Verdict
from tests.frames import PERIOD_NS, RIG, frame, window

THREE = Rig("bench", tuple(Camera(name, 10) for name in ("a", "b", "c")), (Pair("a", "b"), Pair("a", "c")))


def windows(rig, count, holes=(), gap=None):
    """Windows 0 to count; `holes` are (index, camera); nothing is known of what is before `gap`."""
    names = [camera.name for camera in rig.cameras]
    numbers = dict.fromkeys(names, 0)
    made = []
    for index in range(count):
        slot = {name: None if (index, name) in holes else frame(name, index * PERIOD_NS, index) for name in names}
        before = {
            name: None if index in {0, gap} or (index - 1, name) in holes else frame(name, (index - 1) * PERIOD_NS)
            for name in names
        }
        one = window(index, **{name: (before[name], slot[name], None) for name in names})
        for name in names:
            if slot[name] is not None:
                object.__setattr__(one.cameras[name], "number", numbers[name])
                numbers[name] += 1
        made.append(one)
    return made


def verdict(pair="left-right", frame_number=0, since=None, basis=Basis.CONTENT):
    return Verdict("bench", pair, frame_number, State.ASYNC, basis, cause=Cause.SLIP, since_frame=since, offset_ns=0)


def aligned(first, shift, *, pair="left-right", residual_ns=0, error_ns=0):
    one, other = pair.split("-")
    second = frame(other, (first - shift) * PERIOD_NS + residual_ns + error_ns)
    frames = (frame(one, (first - shift) * PERIOD_NS), second)
    return AlignedPair("bench", pair, first, first - shift, shift, residual_ns, 1, frames)


def measured(*shifts, rig=RIG, pair="left-right", error_ns=0):
    """Measured pairs; shifts: (from frame, to frame, shift, since when the judge says that it is so)."""
    result = Measured(rig)
    for start, end, shift, since in shifts:
        for number in range(start, end):
            result.take(verdict(pair, number, since))
            result.take(aligned(number, shift, pair=pair, error_ns=error_ns))
    return result


def regrouped(rig, given, known, *, restamp=False):
    """(first camera's slot, second's, ...) of every group, None for a hole; and what made them."""
    regrouper = Regrouper(rig, known.pairs, restamp=restamp)
    groups = [group for one in given for group in regrouper.take(one)]
    groups += list(regrouper.finish())
    names = [camera.name for camera in rig.cameras]
    told = []
    for number, group in enumerate(groups):
        assert {item.group for item in group} == {number}
        slots = {item.camera: item.sequence for item in group}
        told.append(tuple(slots.get(name) for name in names))
    return told, regrouper


@pytest.mark.parametrize("shift", [-3, -1, 0, 1, 3])
def test_a_constant_shift_pairs_each_frame_with_its_own_once(shift):
    told, regrouper = regrouped(RIG, windows(RIG, 20), measured((0, 20, shift, None)))
    assert told == [(n, n - shift) for n in range(20) if 0 <= n - shift < 20]
    assert regrouper.left_out == {"left": abs(shift), "right": abs(shift)}


def test_a_shift_counts_from_when_it_came_and_not_from_when_it_was_noticed():
    known = measured((0, 14, 0, None), (14, 20, 1, 10))
    told, _ = regrouped(RIG, windows(RIG, 20), known)
    assert told == [(n, n) for n in range(10)] + [(n, n - 1) for n in range(11, 20)]


def test_one_that_was_there_from_the_start_is_moved_from_the_start():
    told, _ = regrouped(RIG, windows(RIG, 20), measured((0, 7, 0, None), (7, 20, -2, 0)))
    assert told == [(n, n + 2) for n in range(18)]


def test_what_the_judge_said_before_the_last_change_does_not_count_for_it():
    known = measured((0, 5, 0, None), (5, 10, 2, 5), (10, 20, 1, 5))
    assert [known.pairs["left-right"].shift(n) for n in (4, 5, 12)] == [0, 1, 1]


def test_holes_stay_holes_and_numbers_do_not_slide():
    holes = {(4, "left"), (8, "right")}
    told, regrouper = regrouped(RIG, windows(RIG, 12, holes), measured((0, 11, 1, None)))
    assert told == [(n, n - 1) for n in range(1, 12) if n not in {4, 9}]
    assert regrouper.left_out == {"left": 2, "right": 2}


def test_nothing_is_paired_across_a_gap():
    told, _ = regrouped(RIG, windows(RIG, 10, gap=5), measured((0, 10, 1, None)))
    assert told == [(1, 0), (2, 1), (3, 2), (4, 3), (6, 5), (7, 6), (8, 7), (9, 8)]


def test_each_camera_of_a_larger_rig_is_moved_by_its_own():
    known = measured((0, 10, 1, None), rig=THREE, pair="a-b")
    for number in range(10):
        known.take(aligned(number, -2, pair="a-c"))
    told, _ = regrouped(THREE, windows(THREE, 10), known)
    assert told == [(n, n - 1 if n >= 1 else None, n + 2 if n + 2 < 10 else None) for n in range(10)]


def test_without_anything_known_all_stays_as_it_was():
    known = Measured(RIG)
    told, regrouper = regrouped(RIG, windows(RIG, 5), known, restamp=True)
    assert told == [(n, n) for n in range(5)]
    assert not known.is_known
    assert regrouper.unstamped == 5


def test_stamps_are_put_on_the_first_cameras_clock():
    known = measured((0, 40, 0, None), error_ns=7 * NS_PER_MS)
    regrouper = Regrouper(RIG, known.pairs, restamp=True)
    groups = [group for one in windows(RIG, 40) for group in regrouper.take(one)]
    for left, right in groups:
        assert right.captured_ns == left.captured_ns - 7 * NS_PER_MS
        assert (left.stamp_origin, right.stamp_origin) == (StampOrigin.DEVICE, StampOrigin.SYNTHESISED)


def test_what_stamps_say_of_themselves_corrects_none():
    known = Measured(RIG)
    for number in range(10):
        known.take(verdict(frame_number=number, basis=Basis.TIMESTAMPS))
        known.take(aligned(number, 0, error_ns=5))
    assert known.is_known
    assert known.pairs["left-right"].error_ns(3) is None


def test_an_error_that_changes_with_the_shift_is_not_smeared_over_it():
    known = measured((0, 20, 0, None), (20, 40, 1, 17))
    for number in range(40, 60):
        known.take(verdict(frame_number=number, since=17))
        known.take(aligned(number, 1, error_ns=9))
    repair = known.pairs["left-right"]
    assert [repair.error_ns(n) for n in (0, 16, 55)] == [0, 0, 9]
