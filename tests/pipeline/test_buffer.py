"""Windows t-1, t, t+1."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from pipeline.buffer import BufferSettings, WindowBuffer
from pipeline.errors import InputError
from pipeline.frame import Camera, Frame, Triple, Window
from tests.frames import frame

RIG = (Camera("a", 10), Camera("b", 10))


def windows_of(groups: dict[str, list[int]]) -> list[Window]:
    buffer = WindowBuffer(RIG, BufferSettings())
    frames = [frame(name, n, n, group=n) for name, numbers in groups.items() for n in numbers]
    frames.sort(key=lambda item: (item.group, item.camera))
    return [made for item in frames for made in buffer.push(item)] + list(buffer.flush())


def ids(triple: Triple) -> tuple[int | None, int | None, int | None, int | None]:
    def number(item: Frame | None) -> int | None:
        return None if item is None else item.sequence

    return number(triple.previous), number(triple.current), number(triple.following), triple.number


def test_each_window_shows_a_frame_and_its_neighbours():
    windows = windows_of({"a": [0, 1, 2], "b": [0, 1, 2]})
    assert [ids(item.cameras["a"]) for item in windows] == [(None, 0, 1, 0), (0, 1, 2, 1), (1, 2, None, 2)]
    assert [item.index for item in windows] == [0, 1, 2]


def test_a_hole_is_marked_and_never_skipped():
    windows = windows_of({"a": [0, 1, 2, 3], "b": [0, 1, 3]})
    assert [ids(item.cameras["b"])[:3] for item in windows] == [
        (None, 0, 1),
        (0, 1, None),
        (1, None, 3),
        (None, 3, None),
    ]


def test_numbers_count_a_cameras_own_frames():
    windows = windows_of({"a": [0, 2, 3], "b": [0, 1, 2, 3]})
    assert [item.cameras["a"].number for item in windows] == [0, None, 1, 2]


def test_frames_across_a_gap_are_no_neighbours():
    windows = windows_of({"a": [0, 1, 7, 8], "b": [0, 1, 7, 8]})
    assert [ids(item.cameras["a"])[:3] for item in windows] == [(None, 0, 1), (0, 1, None), (None, 7, 8), (7, 8, None)]


def test_a_window_comes_one_slot_late():
    buffer = WindowBuffer(RIG, BufferSettings())
    made = [len(list(buffer.push(frame(name, n, n, group=n)))) for n in range(3) for name in "ab"]
    assert made == [0, 0, 0, 1, 0, 1]


def test_a_tolerance_that_reaches_beyond_the_next_frame_is_refused():
    with pytest.raises(InputError, match=r"pairing_tolerance_ms: 101 is more than a period \(100 ms\)"):
        WindowBuffer(RIG, BufferSettings(pairing_tolerance_ms=101))


def test_a_tolerance_of_one_period_is_the_widest():
    buffer = WindowBuffer(RIG, BufferSettings(pairing_tolerance_ms=100))
    lanes = {"a": range(20), "b": [n for n in range(20) if n != 10]}
    frames = [frame(name, n * 100_000_000, n) for name, numbers in lanes.items() for n in numbers]
    frames.sort(key=lambda item: (item.captured_ns, item.camera))
    windows = [made for item in frames for made in buffer.push(item)] + list(buffer.flush())
    assert [ids(item.cameras["b"])[1] for item in windows] == [None if n == 10 else n for n in range(20)]


@pytest.mark.parametrize(("setting", "waits"), [({}, 8), ({"max_pending": "auto"}, 8), ({"max_pending": 3}, 3)])
def test_how_many_frames_wait_can_be_set(setting, waits):
    """The windows come one slot late, and the last slot while a camera is away."""
    buffer = WindowBuffer(RIG, BufferSettings.model_validate(setting))
    assert next(n for n in range(99) if list(buffer.push(frame("a", n, n, group=n)))) == waits


@pytest.mark.parametrize("value", [1, 1001, "none", -5, 2.5])
def test_a_number_of_waiting_frames_that_makes_no_sense_is_refused(value):
    with pytest.raises(ValueError, match="max_pending"):
        BufferSettings(max_pending=value)


def test_a_slower_camera_has_holes_between_its_frames():
    """Its own neighbours are three slots away: detectors tell time by the slot."""
    cameras = (Camera("a", 30), Camera("b", 10))
    buffer = WindowBuffer(cameras, BufferSettings())
    frames = [frame(name, n * 33_000_000, n) for n in range(10) for name in "ab" if name == "a" or n % 3 == 0]
    windows = [made for item in frames for made in buffer.push(item)] + list(buffer.flush())
    assert [ids(item.cameras["b"])[:3] for item in windows[2:5]] == [(None, None, 3), (None, 3, None), (3, None, None)]
    assert [ids(item.cameras["a"])[:3] for item in windows[2:5]] == [(1, 2, 3), (2, 3, 4), (3, 4, 5)]


def test_an_empty_stream_has_no_windows():
    assert windows_of({"a": [], "b": []}) == []


@given(st.sets(st.integers(0, 40)), st.sets(st.integers(0, 40)))
def test_every_frame_is_current_exactly_once(first, second):
    windows = windows_of({"a": sorted(first), "b": sorted(second)})
    for name, numbers in (("a", first), ("b", second)):
        currents = [item.cameras[name].current for item in windows]
        assert [item.sequence for item in currents if item] == sorted(numbers)
