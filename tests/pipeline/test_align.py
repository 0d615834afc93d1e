"""Frames paired anew: one to one, in order, and with the moment they were taken at as near as whole frames allow."""

from __future__ import annotations

import math
import weakref
from collections.abc import Callable, Collection, Iterable, Sequence

import pytest
from hypothesis import given
from hypothesis import strategies as st

from pipeline.align import Aligner, AlignSettings
from pipeline.buffer import BufferSettings, WindowBuffer
from pipeline.frame import Camera, Pair, Rig, Truth, Window
from pipeline.verdict import AlignedPair, Basis, State, Verdict
from tests.frames import PERIOD_NS, RIG, frame

STEADY = 3
"""Verdicts until a shift is found, if each is right."""


def rig(*fps: float, expected_offset_ns: int = 0) -> Rig:
    names = ("left", "right", "third")[: len(fps)]
    cameras = tuple(map(Camera, names, fps))
    return Rig("bench", cameras, (Pair("left", "right", expected_offset_ns),))


def windows(
    offsets: Sequence[float],
    *,
    of: Rig = RIG,
    lost: Collection[tuple[str, int]] = (),
    lost_by_all: Collection[int] = (),
) -> Iterable[Window]:
    """Slots whose right picture shows what is `offset` frames (100 ms) later, while its stamp is the slot's own."""
    buffer = WindowBuffer(of.cameras, BufferSettings())
    ticks = math.lcm(*(round(camera.fps) for camera in of.cameras))
    numbers = dict.fromkeys((camera.name for camera in of.cameras), 0)
    for slot, offset in enumerate(offsets):
        at_ns = round(slot * 1e9 / ticks)
        for camera in of.cameras:
            if slot * camera.fps % ticks or (camera.name, slot) in lost or slot in lost_by_all:
                continue
            shown_ns = at_ns + round(offset * PERIOD_NS) * (camera.name == "right")
            yield from buffer.push(frame(camera.name, at_ns, numbers[camera.name], truth=Truth(shown_ns)))
            numbers[camera.name] += 1
    yield from buffer.flush()


def judged(window: Window) -> list[Verdict]:
    """The truth; unknown without partner."""
    left, right = window.cameras["left"], window.cameras["right"]
    if left.current is None:
        return []
    if right.current is None:
        return [Verdict("bench", "left-right", left.number, State.UNKNOWN, Basis.NONE)]
    offset_ns = (shown_ns(right.current) or 0) - (shown_ns(left.current) or 0)
    state = State.ASYNC if offset_ns else State.SYNC
    return [Verdict("bench", "left-right", left.number, state, Basis.CONTENT, offset_ns=offset_ns, sigma_ns=1000)]


def silent(window: Window) -> list[Verdict]:
    return [Verdict("bench", "left-right", window.cameras["left"].number, State.UNKNOWN, Basis.NONE)]


def shown_ns(one) -> int:
    assert one.truth is not None
    return one.truth.shown_ns


def left_ns(pair: AlignedPair) -> int:
    """What is truly left between the frames of a pair."""
    return shown_ns(pair.frames[1]) - shown_ns(pair.frames[0])


def aligned(
    offsets: Sequence[float],
    *,
    of: Rig = RIG,
    most: int = 5,
    says: Callable[[Window], list[Verdict]] = judged,
    skip: Collection[int] = (),
    **lost: Collection[int] | Collection[tuple[str, int]],
) -> list[AlignedPair]:
    aligner = Aligner(AlignSettings(max_frames=most), of)
    made: list[AlignedPair] = []
    for window in windows(offsets, of=of, **lost):
        if window.index not in skip:
            made += aligner.take(window, says(window))
    return made


@pytest.mark.parametrize("slip", [-5, -2, -1, 0, 1, 3, 5])
def test_a_rig_that_slipped_by_whole_frames_is_put_right(slip):
    made = [pair for pair in aligned([float(slip)] * 40) if pair.first >= STEADY]
    assert len(made) >= 40 - STEADY - 2 * abs(slip)
    for pair in made:
        left, right = pair.frames
        assert left_ns(pair) == 0
        assert (pair.first, pair.second) == (left.sequence, right.sequence)
        assert (pair.shift_frames, pair.residual_ns, pair.sigma_ns) == (slip, 0, 1000)


@pytest.mark.parametrize("slip", [-3, -1, 1, 4])
def test_a_slip_that_begins_and_ends_costs_a_few_frames_each_time(slip):
    made = aligned([0.0] * 20 + [float(slip)] * 30 + [0.0] * 20)
    wrong = [pair.first for pair in made if left_ns(pair) != 0]
    assert len(wrong) <= 2 * (STEADY + abs(slip))
    assert all(20 - abs(slip) <= n < 20 + STEADY or 50 - abs(slip) <= n < 50 + STEADY + abs(slip) for n in wrong)
    assert made[-1].shift_frames == 0


def test_residuals_are_true_of_the_very_frames_also_while_a_slip_begins_and_ends():
    for slip in (-2, -1, 1, 3):
        for pair in aligned([0.0] * 20 + [float(slip)] * 30 + [0.0] * 20):
            assert pair.residual_ns == left_ns(pair)


def test_a_slip_beyond_what_may_be_moved_is_moved_as_far_as_that():
    made = [pair for pair in aligned([4.0] * 20, most=2) if pair.first >= STEADY]
    assert {(pair.shift_frames, pair.residual_ns) for pair in made} == {(2, 2 * PERIOD_NS)}


def test_half_a_frame_does_not_flap():
    offsets = [0.45 if n % 12 < 6 else 0.55 for n in range(60)]
    assert len({pair.shift_frames for pair in aligned(offsets)}) == 1


def test_what_is_expected_is_left_alone():
    made = aligned([1.0] * 20, of=rig(10, 10, expected_offset_ns=PERIOD_NS))
    assert {(pair.shift_frames, pair.residual_ns) for pair in made} == {(0, 0)}


def test_while_nothing_is_known_the_last_shift_holds():
    made = aligned([1.0] * 20, says=lambda window: (judged if window.index < 10 else silent)(window))
    assert (made[-1].first, made[-1].shift_frames) == (19, 1)
    assert (made[-1].residual_ns, made[-1].sigma_ns) == (None, None)


def test_one_wrong_verdict_moves_nothing():
    for wrong in (-3.0, 1.0, 3.0):
        made = aligned([0.0] * 10 + [wrong] + [0.0] * 10)
        assert [(pair.second, pair.shift_frames) for pair in made] == [(n, 0) for n in range(21)]


def test_a_hole_yields_nothing():
    made = aligned([0.0] * 20, lost={("right", 7), ("left", 11)})
    assert [pair.frames[0].captured_ns // PERIOD_NS for pair in made] == [n for n in range(20) if n not in {7, 11}]


@pytest.mark.parametrize("slip", [-2, -1, 0, 1, 2])
@pytest.mark.parametrize("gap", [{30}, {30, 31}])
def test_no_frames_are_paired_across_a_gap_of_all_cameras(slip, gap):
    """
    ::

        left    27  28  29   -  31  32
        right   27  28  29   -  31  32      one frame late: 29 belongs to left's 30, which is lost
    """
    made = [pair for pair in aligned([float(slip)] * 60, lost_by_all=gap) if pair.first >= STEADY]
    assert {left_ns(pair) for pair in made} == {0}
    assert len(made) >= 60 - STEADY - len(gap) - 3 * abs(slip)


@pytest.mark.parametrize("slip", [-2, 1])
def test_no_frames_are_paired_across_windows_that_were_dropped(slip):
    made = [pair for pair in aligned([float(slip)] * 60, skip={30, 31, 40}) if pair.first >= STEADY]
    assert {left_ns(pair) for pair in made} == {0}


def test_a_gap_is_not_forgotten_when_the_windows_around_it_were_dropped():
    made = [pair for pair in aligned([3.0] * 60, lost_by_all={30}, skip={29, 30}) if pair.first >= STEADY]
    assert {left_ns(pair) for pair in made} == {0}


@pytest.mark.parametrize("slip_frames", [-2.0, -1.0, 1.0, 2.0])
@pytest.mark.parametrize("fps", [(10, 20), (20, 10), (10, 10, 20), (10, 10, 30)], ids=str)
def test_cameras_of_unequal_frame_rates_are_put_right(fps, slip_frames):
    """Slips of the right camera by whole frames of 100 ms."""
    made = aligned([slip_frames] * 4 * math.lcm(*fps), of=rig(*fps))
    settled = made[len(made) // 3 :]
    assert len(settled) >= 20, "of 40 or more in four seconds"
    assert {left_ns(pair) for pair in settled} == {0}
    assert {pair.residual_ns for pair in settled} == {0}


def test_a_rate_that_is_a_little_off_is_taken_for_what_it_nearly_is():
    nearly = rig(10, 9.99)
    aligner = Aligner(AlignSettings(), nearly)
    made = [pair for window in windows([1.0] * 40) for pair in aligner.take(window, judged(window))]
    assert {(pair.shift_frames, left_ns(pair)) for pair in made[STEADY:]} == {(1, 0)}


def test_the_slow_camera_of_a_pair_is_met_by_the_nearest_frame_of_the_fast_one():
    made = aligned([0.5] * 60, of=rig(10, 20))
    assert (made[-1].shift_frames, left_ns(made[-1]), made[-1].residual_ns) == (1, 0, 0)


@pytest.mark.parametrize("fps", [(20, 20, 30), (25, 30)], ids=str)
@pytest.mark.parametrize("slip_frames", [-2.0, 1.0])
def test_frame_rates_that_are_no_multiples_of_each_other_are_left_as_they_come(fps, slip_frames):
    made = aligned([slip_frames] * 4 * math.lcm(*fps), of=rig(*fps))
    assert len(made) >= 60
    assert {pair.shift_frames for pair in made} == {0}
    assert all(pair.residual_ns == left_ns(pair) for pair in made)


@pytest.mark.parametrize("frames_a_frame", [0.02, -0.02, 0.004])
def test_a_camera_that_runs_free_is_followed_within_half_a_frame_and_a_bit(frames_a_frame):
    made = aligned([frames_a_frame * n for n in range(240)])
    assert max(abs(left_ns(pair)) for pair in made) <= 0.7 * PERIOD_NS
    assert made[-1].shift_frames == round(frames_a_frame * 239)


@pytest.mark.parametrize("offset", [-9.0, 0.0, 9.0])
def test_it_keeps_no_more_frames_than_may_be_moved(offset):
    aligner = Aligner(AlignSettings(max_frames=5), RIG)
    pictures = []
    for window in windows([offset] * 200):
        aligner.take(window, judged(window))
        pictures += [weakref.ref(one.current.image) for one in window.cameras.values() if one.current is not None]
    assert sum(picture() is not None for picture in pictures) <= 2 * (2 * 5 + 3)


runs = st.lists(st.tuples(st.integers(-5, 5), st.integers(12, 30)), min_size=1, max_size=4)
losses = st.sets(st.tuples(st.sampled_from(["left", "right"]), st.integers(0, 119)), max_size=12)


@given(runs, losses, st.sets(st.integers(2, 119), max_size=3))
def test_where_slips_last_frames_belong_together_whatever_is_lost(runs, lost, lost_by_all):
    """Settled: a dozen slots after a change there have been three verdicts with both frames, or nothing is claimed."""
    offsets = [float(slip) for slip, length in runs for _ in range(length)]
    made = aligned(offsets, lost=lost, lost_by_all=lost_by_all)
    starts = [sum(length for _, length in runs[:n]) for n in range(len(runs) + 1)]
    for pair in made:
        if pair.residual_ns is not None and not any(
            abs(one.captured_ns // PERIOD_NS - start) <= 12 for one in pair.frames for start in starts
        ):
            assert abs(left_ns(pair)) <= PERIOD_NS / 2


@given(
    st.lists(st.one_of(st.none(), st.floats(-8, 8)), min_size=1, max_size=80),
    st.sets(st.tuples(st.sampled_from(["left", "right"]), st.integers(0, 79))),
    st.sets(st.integers(0, 79), max_size=4),
    st.integers(1, 6),
)
def test_pairs_are_one_to_one_and_in_order_whatever_is_judged(offsets, lost, skip, most):
    unknown = {n for n, offset in enumerate(offsets) if offset is None}
    made = aligned(
        [offset or 0.0 for offset in offsets],
        most=most,
        lost=lost,
        skip=skip,
        says=lambda window: (silent if window.index in unknown else judged)(window),
    )
    firsts, seconds = [pair.first for pair in made], [pair.second for pair in made]
    assert firsts == sorted(set(firsts))
    assert seconds == sorted(set(seconds))
    assert all(abs(pair.shift_frames) <= most for pair in made)


def test_the_message_names_the_frames():
    message = aligned([1.0] * 10)[-1].to_message()
    assert message["schema"] == "syncwatch.aligned.v1"
    assert (message["first"], message["second"], message["shift_frames"]) == (9, 8, 1)
    assert (message["residual_ms"], message["sequence"]) == (0.0, {"left": 9, "right": 8})
