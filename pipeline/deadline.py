"""Work that may hang, given up after a while."""

from __future__ import annotations

import logging
import os
import sys
import threading
from collections.abc import Callable
from contextlib import suppress

_given_up: list[threading.Thread] = []


def done_within(seconds: float, work: Callable[[], object], name: str) -> bool:
    """Does the work on a thread of its own, which keeps no program from ending; whether it was done in time."""
    thread = threading.Thread(target=work, name=name, daemon=True)
    thread.start()
    return ended_within(seconds, thread)


def ended_within(seconds: float, thread: threading.Thread) -> bool:
    """Waits for a daemon thread, and gives it up if it takes longer; whether it has ended."""
    thread.join(seconds)
    if thread.is_alive():
        _given_up.append(thread)
    return not thread.is_alive()


def leave(status: int) -> int:
    """Returns the exit status of the program, or ends it here where work that was given up is still under way.

    A thread that is inside a library while the interpreter is taken down can abort the process, or keep it for ever:
    closing a Zenoh session does.
    """
    if not any(thread.is_alive() for thread in _given_up):
        return status
    logging.shutdown()
    for stream in (sys.stdout, sys.stderr):
        with suppress(OSError, ValueError):
            stream.flush()
    os._exit(status)
