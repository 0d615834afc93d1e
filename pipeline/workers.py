"""Processes that work for a command and end with it."""

from __future__ import annotations

import logging
import os
import signal
import threading
from collections.abc import Callable, Iterator
from concurrent.futures import ProcessPoolExecutor
from contextlib import contextmanager
from multiprocessing import parent_process, resource_tracker
from multiprocessing.context import SpawnContext, SpawnProcess
from typing import Any

import cv2


@contextmanager
def workers(jobs: int, set_up: Callable[..., None] | None = None, *arguments: Any) -> Iterator[ProcessPoolExecutor]:
    """A pool whose processes use one thread of OpenCV's each, say nothing but errors, and end with this process.

    Leaving it by an exception, Ctrl-C included, ends what is running at once. set_up: called in each process with the
    arguments, which may be shared memory of a `spawn` context.
    """
    context = _Workers()
    before = {child.pid for child in context.active_children()}
    pool = ProcessPoolExecutor(jobs, mp_context=context, initializer=_become_worker, initargs=(set_up, arguments))
    try:
        yield pool
    except BaseException:
        for child in context.active_children():
            if child.pid not in before:
                child.terminate()
        pool.shutdown(cancel_futures=True)
        raise
    pool.shutdown()


class _Worker(SpawnProcess):
    """Never hears of Ctrl-C, which goes to every process of a terminal: it is the main process that ends the others."""

    def start(self) -> None:
        resource_tracker.ensure_running()  # starting it would end the blocking
        before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
        try:
            super().start()
        finally:
            signal.pthread_sigmask(signal.SIG_SETMASK, before)


class _Workers(SpawnContext):
    Process = _Worker


def _become_worker(set_up: Callable[..., None] | None, arguments: tuple[Any, ...]) -> None:
    threading.Thread(target=_end_with_parent, daemon=True).start()
    logging.getLogger("syncwatch").setLevel(logging.ERROR)
    cv2.setNumThreads(1)
    if set_up is not None:
        set_up(*arguments)


def _end_with_parent() -> None:
    """A worker of a pool would wait for work for ever once the main process has been killed."""
    parent = parent_process()
    assert parent is not None
    parent.join()
    os._exit(1)
