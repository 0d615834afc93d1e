"""Processes that work for a command and end with it."""

from __future__ import annotations

import logging
import os
import signal
import threading
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context, parent_process

import cv2


def workers(jobs: int) -> ProcessPoolExecutor:
    """A pool whose processes use one thread of OpenCV's each, say nothing but errors, and end with this process."""
    return ProcessPoolExecutor(jobs, mp_context=get_context("spawn"), initializer=_become_worker)


def _become_worker() -> None:
    signal.signal(signal.SIGINT, signal.SIG_DFL)
    threading.Thread(target=_end_with_parent, daemon=True).start()
    logging.getLogger("syncwatch").setLevel(logging.ERROR)
    cv2.setNumThreads(1)


def _end_with_parent() -> None:
    """A worker of a pool would wait for work for ever once the main process has been killed."""
    parent = parent_process()
    assert parent is not None
    parent.join()
    os._exit(1)
