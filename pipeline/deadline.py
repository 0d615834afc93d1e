"""Work that may hang, given up after a while."""

from __future__ import annotations

import threading
from collections.abc import Callable


def done_within(seconds: float, work: Callable[[], object], name: str) -> bool:
    """Does the work on a thread of its own, which keeps no program from ending; whether it was done in time."""
    thread = threading.Thread(target=work, name=name, daemon=True)
    thread.start()
    thread.join(seconds)
    return not thread.is_alive()
