"""A Zenoh router for trying things out.

    python examples/router.py [--listen tcp/127.0.0.1:7447]

A real installation runs zenohd; a session in router mode routes just as well.
"""

from __future__ import annotations

import argparse
import json
import signal
import sys
import threading

import zenoh


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--listen", default="tcp/127.0.0.1:7447")
    given = parser.parse_args()
    config = zenoh.Config()
    config.insert_json5("mode", '"router"')
    config.insert_json5("listen/endpoints", json.dumps([given.listen]))
    config.insert_json5("scouting/multicast/enabled", "false")
    stop = threading.Event()
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda *_: stop.set())
    with zenoh.open(config):
        print(f"router at {given.listen}", flush=True)
        stop.wait()


if __name__ == "__main__":
    try:
        main()
    except zenoh.ZError as error:
        sys.exit(f"cannot open a Zenoh session: {error}")
