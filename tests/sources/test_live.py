"""The inbox of live sources: it never blocks who brings a frame, and loses no camera's frames for another's."""

from __future__ import annotations

import threading

import pytest
from hypothesis import given
from hypothesis import strategies as st

from pipeline.errors import RunError
from sources.live import Inbox, feed
from tests.frames import frame


def read_all(inbox):
    return [(item.camera, item.sequence) for item in inbox.read()]


@given(arrivals=st.lists(st.sampled_from(["a", "b"]), max_size=40), ahead=st.integers(1, 6))
def test_the_latest_of_each_camera_are_kept_in_order_and_the_rest_is_counted(arrivals, ahead):
    inbox = Inbox(["a", "b"], frames_ahead=ahead)
    given_ = [frame(camera, n, n) for n, camera in enumerate(arrivals)]
    assert all(inbox.put(item) for item in given_)
    inbox.end()
    left = read_all(inbox)
    assert left == sorted(left, key=lambda item: item[1])
    for camera in ("a", "b"):
        own = [(item.camera, item.sequence) for item in given_ if item.camera == camera]
        assert [item for item in left if item[0] == camera] == own[-ahead:]
        assert inbox.dropped[camera] == max(len(own) - ahead, 0)


def test_the_end_gives_what_waits_then_the_error_and_takes_no_more():
    inbox = Inbox(["a"])
    inbox.put(frame("a", 0, 0))
    inbox.end(RunError("the cable was pulled"))
    inbox.end()
    assert inbox.put(frame("a", 1, 1)) is False
    reading = inbox.read()
    assert next(reading).sequence == 0
    with pytest.raises(RunError, match="the cable was pulled"):
        next(reading)


def test_stopping_gives_up_what_waits_and_any_error():
    inbox = Inbox(["a"])
    inbox.put(frame("a", 0, 0))
    inbox.end(RunError("late"))
    inbox.stop()
    inbox.stop()
    assert read_all(inbox) == []
    assert inbox.put(frame("a", 1, 1)) is False


def test_a_reader_that_waits_is_woken_by_a_frame_and_by_the_end():
    inbox, seen = Inbox(["a"]), []
    reader = threading.Thread(target=lambda: seen.extend(read_all(inbox)))
    reader.start()
    inbox.put(frame("a", 0, 0))
    inbox.end()
    reader.join(5)
    assert seen == [("a", 0)]


def test_what_a_feeding_thread_meets_reaches_the_reader():
    def fail():
        raise ZeroDivisionError("division by zero")

    inbox = Inbox(["a"])
    feed(inbox, fail, name="failing").join(5)
    with pytest.raises(ZeroDivisionError):
        read_all(inbox)
