"""Properties of pairing, whatever happens to the clocks and the delivery of cameras."""

from __future__ import annotations

from typing import NamedTuple

from hypothesis import given
from hypothesis import strategies as st

from pipeline.frame import Frame
from pipeline.pairing import Pairer
from tests.frames import PERIOD_NS, frame
from tests.pipeline.deliveries import MS, STEPS_NS, THREE, camera, delivered_in_order, paired, recorded, step_at

moments = st.integers(1, 60)
sizes = st.sampled_from([*STEPS_NS, 0, 40 * MS, 100 * MS, -100 * MS, 10**14])


class Lane(NamedTuple):
    """What happens to a camera; shown when a property does not hold."""

    name: str
    lost: set[int]
    start: int
    onset: int
    size_ns: int
    late: list[int]
    clock: str
    ids: bool
    seed: int

    def frames(self, clock: str | None = None) -> list[Frame]:
        return camera(
            self.name,
            [n for n in range(self.start, 60) if n not in self.lost] or [0],
            ahead=step_at(self.onset, self.size_ns),
            latency=lambda n: self.late[n % len(self.late)],
            clock=clock or self.clock,
            ids=self.ids,
            seed=self.seed,
        )


@st.composite
def rigs(draw, *, steps: bool = True, latest_start: int = 40, losses: int = 20):
    return [
        Lane(
            name,
            draw(st.sets(moments, max_size=losses)),
            draw(st.integers(0, latest_start)),
            draw(moments),
            draw(sizes) * steps,
            draw(st.lists(st.integers(0, 400 * MS), min_size=1, max_size=5)),
            draw(st.sampled_from(["rig", name])),
            draw(st.booleans()),
            draw(st.integers(0, 99)),
        )
        for name in "abc"[: draw(st.integers(2, 3))]
    ]


@given(rigs(), st.one_of(st.none(), st.integers(4, 20)))
def test_frames_are_paired_one_to_one_or_counted(rig, max_pending):
    made = [lane.frames() for lane in rig]
    for order in (recorded, lambda *given: delivered_in_order(given)):
        frames = order(*made)
        pairer, slots = paired(frames, THREE[: len(made)], max_pending=max_pending)
        for index, lane in enumerate(made):
            numbers = [slot[index] for slot in slots if slot[index] is not None]
            assert len(numbers) == len(set(numbers))
            name = lane[0].camera
            left_out = pairer.counters.late[name] + pairer.counters.duplicates[name]
            assert len(numbers) + left_out == len(lane) == pairer.counters.frames[name]
            holes = sum(slot[index] is None for slot in slots if any(item is not None for item in slot))
            assert holes == pairer.counters.holes[name]


@given(rigs(), st.integers(10 * MS, PERIOD_NS), st.booleans())
def test_nothing_is_paired_beyond_the_tolerance(rig, tolerance_ns, live_like):
    """A constant of half a period at most is learned beside it."""
    made = [lane.frames("rig") for lane in rig if lane.size_ns == 0]
    frames = delivered_in_order(made) if live_like else recorded(*made)
    pairer = Pairer(THREE, tolerance_ns=tolerance_ns)
    for slot in [slot for item in frames for slot in pairer.push(item)] + list(pairer.flush()):
        stamps = [item.captured_ns for item in slot.values() if item]
        assert max(stamps, default=0) - min(stamps, default=0) <= tolerance_ns + PERIOD_NS // 2


@given(rigs(), st.integers(4, 20))
def test_memory_is_bounded(rig, max_pending):
    """What waits and what is held for learning."""
    cameras = THREE[: len(rig)]
    pairer = Pairer(cameras, max_pending=max_pending)
    given_out = 0
    for given_in, item in enumerate(delivered_in_order([lane.frames() for lane in rig]), 1):
        given_out += sum(one is not None for slot in pairer.push(item) for one in slot.values())
        counted = sum(pairer.counters.late.values()) + sum(pairer.counters.duplicates.values())
        assert given_in - given_out - counted <= 2 * len(cameras) * (max_pending + 1)


@given(rigs(steps=False, latest_start=4, losses=4))
def test_live_frames_are_paired_as_the_recording_of_them(rig):
    """As long as no camera is given up: they start within 4 frames, are 4 late at most, and 4 of each are lost."""
    made = [lane.frames("rig") for lane in rig]
    cameras = THREE[: len(made)]
    live_like = paired(delivered_in_order(made), cameras, max_pending=16)
    assert live_like[1] == paired(recorded(*made), cameras, max_pending=16)[1]


anything = st.integers(-(10**10), 10**10)


@given(st.lists(st.tuples(st.sampled_from("abc"), anything, anything, st.integers(-1, 50), st.integers(-20, 5))))
def test_whatever_a_camera_says_every_frame_is_in_a_slot_or_counted(said):
    """Stamps, arrivals, ids and groups without any sense; -1 and less: none."""
    pairer = Pairer(THREE, max_pending=5)
    frames = [
        frame(name, stamp, None if n < 0 else n, arrived_ns=arrived, group=None if group < 0 else group)
        for name, stamp, arrived, n, group in said
    ]
    slots = [slot for item in frames for slot in pairer.push(item)] + list(pairer.flush())
    left_out = sum(pairer.counters.late.values()) + sum(pairer.counters.duplicates.values())
    assert sum(item is not None for slot in slots for item in slot.values()) + left_out == len(frames)
