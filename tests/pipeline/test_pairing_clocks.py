"""Pairing without groups: clocks that are learned late, step, are shared, or lie far apart."""

from __future__ import annotations

import pytest

from pipeline.frame import Camera
from pipeline.pairing import Pairer
from tests.frames import PERIOD_NS, frame
from tests.pipeline.deliveries import (
    MS,
    RIG,
    STEPS_NS,
    THREE,
    camera,
    delivered_in_order,
    live,
    paired,
    recorded,
    step_at,
    whole,
)

# --- cameras that are heard late


@pytest.mark.parametrize("ahead_ns", [3_000 * MS, -37_000 * MS, 149 * MS, 10**15])
@pytest.mark.parametrize("start", [5, 30, 300])
def test_the_clock_of_a_camera_that_starts_late_is_learned_when_it_is_heard(ahead_ns: int, start: int):
    late = camera("b", range(start, start + 40), ahead=lambda n: ahead_ns, clock="own")
    pairer, slots = paired(live(camera("a", range(start + 40)), late))
    assert whole(slots) == [(n, n) for n in range(start, start + 40)]
    assert pairer.counters.late == {"a": 0, "b": 0}


@pytest.mark.parametrize("away", [50, 3000])
def test_the_clock_of_a_camera_that_comes_back_is_learned_again(away: int):
    """Its clock drifts by 300 ppm, which comes to nearly a period over a long absence."""
    numbers = [*range(40), *range(40 + away, 80 + away)]
    back = camera("b", numbers, ahead=lambda n: 900 * MS + n * PERIOD_NS * 300 // 10**6, clock="own")
    _, slots = paired(live(camera("a", range(80 + away)), back))
    assert whole(slots) == [(n, n) for n in numbers]


def test_a_camera_that_starts_late_on_a_clock_already_heard_keeps_its_stamps():
    """Its frames are delivered 0.4 s late: arrival would pair them with frames taken after them.

    The partners of the first ones are gone by then: nobody waited for a camera that had never been heard.
    """
    lanes = camera("a", range(80)), camera("b", range(40, 80), latency=lambda n: 400 * MS)
    assert whole(paired(live(*lanes))[1]) == [(n, n) for n in range(43, 80)]


def test_two_cameras_of_one_other_clock_are_learned_alike():
    b = camera("b", range(80), ahead=lambda n: 5_000 * MS, clock="other")
    c = camera("c", range(40, 80), ahead=lambda n: 5_000 * MS, clock="other", latency=lambda n: 300 * MS)
    assert whole(paired(live(camera("a", range(80)), b, c), THREE)[1]) == [(n, n, n) for n in range(42, 80)]


def test_a_camera_that_delivers_what_it_held_back_is_not_learned_anew():
    """0.7 s without a frame, then all of them at once."""
    late = camera(
        "b",
        range(80),
        ahead=lambda n: 900 * MS,
        clock="own",
        latency=lambda n: (47 - n) * 100 * MS if 40 <= n < 47 else 5 * MS,
    )
    slots = whole(paired(live(camera("a", range(80)), late))[1])
    assert all(first == second for first, second in slots)
    assert len(slots) >= 78


def test_a_camera_that_ends_while_its_clock_is_learned_is_paired():
    brief = camera("b", range(40, 43), ahead=lambda n: 900 * MS, clock="own")
    assert whole(paired(live(camera("a", range(80)), brief))[1]) == [(n, n) for n in range(40, 43)]


def test_a_late_camera_without_groups_makes_the_rig_pair_by_time():
    grouped = [frame("a", n * PERIOD_NS, n, group=1000 + n, exposure_ns=n) for n in range(60)]
    late = [frame("b", n * PERIOD_NS + 2 * MS, n, exposure_ns=n) for n in range(30, 60)]
    _, slots = paired(live(grouped, late))
    assert whole(slots)[-25:] == [(n, n) for n in range(35, 60)]


def test_a_late_camera_whose_stamps_stand_still_is_paired_by_arrival():
    late = [frame("b", 5, n, arrived_ns=10**12 + n * PERIOD_NS + 20 * MS, exposure_ns=n) for n in range(40, 80)]
    assert whole(paired(live(camera("a", range(80)), late))[1]) == [(n, n) for n in range(40, 80)]


# --- clocks that step


@pytest.mark.parametrize("size_ns", STEPS_NS)
@pytest.mark.parametrize("ids", [True, False])
@pytest.mark.parametrize("clock", ["rig", "own"])
@pytest.mark.parametrize("seed", [None, 1])
def test_frames_after_a_step_of_one_clock_are_paired_again_within_a_second(size_ns, ids, clock, seed):
    lanes = (
        camera("a", range(100), seed=seed),
        camera("b", range(100), ahead=step_at(50, size_ns), clock=clock, ids=ids, seed=seed and 2),
    )
    _, slots = paired(live(*lanes))
    assert all(first == second for first, second in whole(slots))
    assert {(n, n) for n in range(100) if not 50 <= n < 60} <= set(slots)


@pytest.mark.parametrize("size_ns", STEPS_NS)
@pytest.mark.parametrize("name", ["a", "b"])
def test_a_step_back_again_is_followed_too(size_ns: int, name: str):
    lanes = [camera(one, range(120), ahead=step_at(40, size_ns * (one == name), 80)) for one in "ab"]
    _, slots = paired(live(*lanes))
    assert all(first == second for first, second in whole(slots))
    assert {(n, n) for n in range(120) if not (40 <= n < 50 or 80 <= n < 90)} <= set(slots)


@pytest.mark.parametrize("size_ns", STEPS_NS)
def test_a_step_while_one_of_three_cameras_is_late(size_ns: int):
    lanes = [
        camera(
            name,
            range(100),
            ahead=step_at(50, size_ns * (name == "b")),
            latency=lambda n, name=name: 250 * MS * (name == "c"),
        )
        for name in "abc"
    ]
    _, slots = paired(live(*lanes), THREE)
    assert all(len(set(slot)) == 1 for slot in whole(slots))
    assert {(n, n, n) for n in range(100) if not 50 <= n < 60} <= set(slots)


@pytest.mark.parametrize("size_ns", [37_000 * MS, -37_000 * MS, -500 * MS])
@pytest.mark.parametrize("clocks", ["rr", "ro"])
def test_a_step_of_all_clocks_at_once_loses_no_frame(size_ns: int, clocks: str):
    lanes = [
        camera(name, range(100), ahead=step_at(50, size_ns), clock=clock)
        for name, clock in zip("ab", clocks, strict=True)
    ]
    assert whole(paired(live(*lanes))[1]) == [(n, n) for n in range(100)]


def test_a_step_by_less_than_half_a_period_is_left_for_the_judge():
    pairer = Pairer(RIG)
    lanes = camera("a", range(100)), camera("b", range(100), ahead=step_at(50, 40 * MS))
    slots = [slot for item in live(*lanes) for slot in pairer.push(item)]
    gaps = [(slot["b"].captured_ns - slot["a"].captured_ns) // MS for slot in slots if slot["a"] and slot["b"]]
    assert gaps[:50] == [0] * 50
    assert set(gaps[50:]) == {40}


@pytest.mark.parametrize("frames", range(-5, 6))
@pytest.mark.parametrize("order", [live, recorded])
def test_a_constant_offset_between_cameras_of_one_clock_is_not_learned_away(frames: int, order):
    """Stamps say which frames are nearest, however far apart these arrive."""
    lanes = camera("a", range(80)), camera("b", range(80), ahead=lambda n: frames * PERIOD_NS)
    slots = whole(paired(order(*lanes))[1])
    assert {first - second for first, second in slots} == {frames}
    assert len(slots) >= 75


def test_a_single_wild_stamp_keeps_its_place():
    lanes = (
        camera("a", range(60)),
        camera("b", range(60), ahead=lambda n: 37_000 * MS * (n == 30) - 900 * MS * (n == 40)),
    )
    assert paired(live(*lanes))[1] == [(n, n) for n in range(60)]


def test_a_stamp_that_repeats_under_a_new_id_keeps_its_place():
    lanes = camera("a", range(60)), camera("b", range(60), ahead=lambda n: -PERIOD_NS * (n % 20 == 19))
    assert paired(live(*lanes))[1] == [(n, n) for n in range(60)]
    assert paired(recorded(*lanes))[1] == [(n, n) for n in range(60)]


@pytest.mark.parametrize("ids", [True, False])
def test_lost_frames_are_no_step(ids: bool):
    numbers = [*range(40), *range(52, 100)]
    lanes = camera("a", range(100)), camera("b", numbers, ids=ids)
    for order in (live, recorded):
        assert whole(paired(order(*lanes))[1]) == [(n, n) for n in numbers]


@pytest.mark.parametrize("ids", [True, False])
def test_a_camera_that_throws_its_backlog_away_has_not_stepped(ids: bool):
    """It is 0.4 s late until it drops four frames; only then what it delivers is fresh."""
    b = camera("b", [*range(50), *range(54, 100)], latency=lambda n: 400 * MS if n < 50 else 5 * MS, ids=ids)
    assert whole(paired(live(camera("a", range(100)), b))[1]) == [(n, n) for n in range(100) if not 50 <= n < 54]


def test_a_stall_of_the_host_is_no_step():
    """Nobody is delivered for 2 s, and meanwhile frames are lost."""
    numbers = [*range(50), *range(70, 120)]
    lanes = [camera(name, numbers, ids=False) for name in "ab"]
    assert whole(paired(live(*lanes))[1]) == [(n, n) for n in numbers]


def test_a_slow_reader_of_a_recording_is_no_step():
    """Judging stops for 5 s, just where a frame of one camera is missing."""
    frames = recorded(camera("a", range(80)), camera("b", [*range(40), *range(46, 80)], ids=False))
    held_up = [
        item
        if index < 90
        else frame(item.camera, item.captured_ns, arrived_ns=item.arrived_ns + 5_000 * MS, exposure_ns=item.exposure_ns)
        for index, item in enumerate(frames)
    ]
    assert whole(paired(held_up)[1]) == [(n, n) for n in range(80) if not 40 <= n < 46]


def test_frames_that_one_camera_loses_while_the_other_is_silent_are_no_step():
    """What is heard then is far ahead of the silent camera's last frame, but so much time has passed."""
    a = camera("a", [n for n in range(100) if not 40 <= n < 49])
    b = camera("b", [n for n in range(100) if not 40 <= n < 44], ids=False)
    assert whole(paired(live(a, b))[1]) == [(n, n) for n in range(100) if not 40 <= n < 49]


def test_a_reader_of_a_recording_that_becomes_faster_is_no_step():
    """Just there frames of one camera are missing, which its ids do not tell."""
    frames = recorded(camera("a", [*range(40), *range(46, 80)]), camera("b", range(80)))
    count = iter(range(80))
    read = [
        frame(
            item.camera,
            item.captured_ns,
            next(count) if item.camera == "a" else item.sequence,
            arrived_ns=min(index, 80) * 300 * MS + index,
            exposure_ns=item.exposure_ns,
        )
        for index, item in enumerate(frames)
    ]
    assert whole(paired(read)[1]) == [(n, n) for n in range(80) if not 40 <= n < 46]


@pytest.mark.parametrize("size_ns", STEPS_NS)
def test_a_step_is_exact_although_delivery_jitters(size_ns: int):
    """At 30 fps frames are up to two periods late; the stamps themselves tell the size of the step."""
    late = [5 * MS, 60 * MS, 20 * MS, 70 * MS, 40 * MS]
    lanes = [
        camera(
            name,
            range(200),
            ahead=step_at(100, size_ns * (name == "b")),
            latency=lambda n, name=name: late[(n * (2 + (name == "b"))) % 5],
            period_ns=33_333_333,
        )
        for name in "ab"
    ]
    _, slots = paired(delivered_in_order(lanes), (Camera("a", 30), Camera("b", 30)))
    assert slots == [(n, n) for n in range(200)]


def test_errors_of_steps_hardly_add_up():
    """A jump is as noisy as two stamps, 4 ms here; the frames beside it tell more. Few pairs suffer from three."""
    right = 0
    for seed in range(20):
        lanes = [
            camera("a", range(320), period_ns=33_333_333, seed=seed),
            camera(
                "b", range(320), period_ns=33_333_333, seed=seed + 99, ahead=lambda n: min(n // 80, 3) % 2 * 37_000 * MS
            ),
        ]
        _, slots = paired(delivered_in_order(lanes), (Camera("a", 30), Camera("b", 30)))
        right += len({(n, n) for n in range(240, 320)} & set(slots))
    assert right > 0.96 * 1600


# --- recordings that overlap partly


@pytest.mark.parametrize("start", [4, 12, 60])
@pytest.mark.parametrize("order", [live, recorded])
def test_recordings_that_overlap_partly_pair_where_they_overlap(start: int, order):
    lanes = camera("a", range(80)), camera("b", range(start, start + 80))
    pairer, slots = paired(order(*lanes))
    assert slots == [(n if n < 80 else None, n if n >= start else None) for n in range(start + 80)]
    assert sum(pairer.counters.late.values()) == 0


@pytest.mark.parametrize("part", [0.55, 0.8, 1.3, 2.4, -0.7])
def test_cameras_of_one_clock_pair_with_the_nearest_stamps(part: float):
    lanes = camera("a", range(80)), camera("b", range(80), ahead=lambda n: round(part * PERIOD_NS), seed=3)
    for order in (live, recorded):
        slots = whole(paired(order(*lanes))[1])
        assert {first - second for first, second in slots} == {round(part)}


def test_a_pause_of_a_recording_stays_a_gap():
    numbers = [*range(40), *range(400, 440)]
    _, slots = paired(recorded(camera("a", numbers), camera("b", numbers, ids=False)))
    assert slots == [*((n, n) for n in range(40)), (None, None), *((n, n) for n in range(400, 440))]


# --- latency and rates


@pytest.mark.parametrize(
    ("fps", "expected"), [(0.5, 4), (1, 4), (5, 6), (10, 8), (30, 18), (60, 33), (120, 63), (500, 64)]
)
def test_a_camera_is_waited_for_half_a_second_and_three_periods(fps: float, expected: int):
    """One frame more than are waited for gives the silent camera up."""
    pairer = Pairer((Camera("a", fps), Camera("b", fps)))
    period_ns = round(1e9 / fps)
    first = next(n for n in range(100) if list(pairer.push(frame("a", n * period_ns, n, group=n))))
    assert first == expected


@pytest.mark.parametrize("group", [True, False])
@pytest.mark.parametrize("fps", [10, 30, 60, 120])
def test_a_constant_latency_of_half_a_second_is_bridged(group: bool, fps: int):
    period_ns = round(1e9 / fps)
    made = []
    for name, latency_ns in (("a", 5 * MS), ("b", 500 * MS)):
        made += camera(name, range(4 * fps), latency=lambda n, late=latency_ns: late, period_ns=period_ns)
    if group:
        made = [
            frame(
                f.camera,
                f.captured_ns,
                f.sequence,
                arrived_ns=f.arrived_ns,
                group=f.sequence,
                exposure_ns=f.exposure_ns,
            )
            for f in made
        ]
    _, slots = paired(live(made), (Camera("a", fps), Camera("b", fps)))
    assert slots == [(n, n) for n in range(4 * fps)]


@pytest.mark.parametrize(("fast", "slow"), [(30, 10), (30, 1), (60, 7.5), (20, 10)])
@pytest.mark.parametrize("first", ["a", "b"])
@pytest.mark.parametrize("latency_ns", [5 * MS, 90 * MS])
def test_a_slower_camera_is_paired_with_every_nth_frame(fast: float, slow: float, first: str, latency_ns: int):
    each = round(fast / slow)
    a = camera("a", range(40 * each), period_ns=round(1e9 / fast))
    b = camera("b", range(40), period_ns=each * round(1e9 / fast), latency=lambda n: latency_ns)
    rates = {"a": fast, "b": slow}
    cameras = [Camera(name, rates[name]) for name in sorted(rates, reverse=first == "b")]
    _, slots = paired(live(a, b), cameras)
    said = [(slot if first == "a" else slot[::-1]) for slot in slots]
    assert whole(said) == [(n * each, n) for n in range(40)]
    assert len(said) == 40 * each


@pytest.mark.parametrize("lost", [20, 21])
def test_a_tolerance_of_one_period_does_not_shift_pairs_after_a_drop(lost: int):
    numbers = [n for n in range(60) if n != lost]
    for seed in (None, 5):
        lanes = camera("a", range(60), seed=seed), camera("b", numbers, seed=seed and 6)
        for order in (live, recorded):
            assert whole(paired(order(*lanes), tolerance_ns=PERIOD_NS)[1]) == [(n, n) for n in numbers]
