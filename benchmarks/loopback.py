"""Where programs of a benchmark meet on this machine."""

from __future__ import annotations

import socket


def free_endpoint() -> str:
    """An endpoint of Zenoh on a port that nobody has now."""
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return f"tcp/127.0.0.1:{probe.getsockname()[1]}"
