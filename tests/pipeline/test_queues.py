"""Bounded queues."""

from __future__ import annotations

import threading
import time

import pytest

from pipeline.queues import BoundedQueue, QueueClosedError


def test_when_full_the_oldest_item_gives_way_and_is_counted():
    queue: BoundedQueue[int] = BoundedQueue(2, wait=False)
    for item in range(5):
        queue.put(item)
    assert [queue.get(), queue.get()] == [3, 4]
    assert queue.dropped == 3


def test_what_is_not_expendable_stays():
    queue: BoundedQueue[int] = BoundedQueue(3, wait=False, expendable=lambda item: item > 0)
    for item in (0, 1, 0, 2, 3):
        queue.put(item)
    assert [queue.get() for _ in range(3)] == [0, 0, 3]


def test_a_waiting_putter_goes_on_when_there_is_room():
    queue: BoundedQueue[int] = BoundedQueue(1, wait=True)
    queue.put(0)
    putter = threading.Thread(target=queue.put, args=(1,))
    putter.start()
    assert queue.get() == 0
    assert queue.get(timeout_s=5) == 1
    putter.join()


def test_closing_lets_the_getter_have_what_is_left():
    queue: BoundedQueue[int] = BoundedQueue(2, wait=True)
    queue.put(1)
    queue.close()
    assert queue.get() == 1
    with pytest.raises(QueueClosedError):
        queue.get()
    with pytest.raises(QueueClosedError):
        queue.put(2)


def test_closing_frees_a_waiting_putter():
    queue: BoundedQueue[int] = BoundedQueue(1, wait=True)
    queue.put(0)
    refused = threading.Event()

    def put() -> None:
        try:
            queue.put(1)
        except QueueClosedError:
            refused.set()

    putter = threading.Thread(target=put)
    putter.start()
    queue.close()
    putter.join(5)
    assert refused.is_set()


def test_a_putter_told_to_hurry_waits_no_longer_than_that():
    queue: BoundedQueue[int] = BoundedQueue(1, wait=True)
    queue.put(0)
    queue.hurry(0.0)
    queue.put(1)
    assert (queue.get(), queue.dropped) == (1, 1)


def test_getting_gives_up_after_its_time():
    queue: BoundedQueue[int] = BoundedQueue(1, wait=True)
    began = time.monotonic()
    with pytest.raises(TimeoutError):
        queue.get(timeout_s=0.05)
    assert time.monotonic() - began >= 0.05
