"""A Zenoh router for trying things out.

    python examples/router.py [--listen tcp/127.0.0.1:7447]
    python examples/router.py --config examples/fleet/site-router.json5 --connect tcp/127.0.0.1:7447

    --config FILE        a configuration as zenohd reads it; plugins of zenohd are not there
    --listen, --connect  endpoints, in place of those of the configuration; may be repeated

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
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--config", help="a JSON5 file")
    parser.add_argument("--listen", action="append")
    parser.add_argument("--connect", action="append")
    given = parser.parse_args()
    stop = threading.Event()
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda *_: stop.set())
    made = configuration(given.config, given.listen, given.connect)
    with zenoh.open(made):
        print(f"router at {', '.join(json.loads(made.get_json('listen/endpoints')))}", flush=True)
        stop.wait()


def configuration(file: str | None, listen: list[str] | None, connect: list[str] | None) -> zenoh.Config:
    """Raises ZError for a file that cannot be read or is no configuration."""
    made: zenoh.Config = zenoh.Config.from_file(file) if file else zenoh.Config()
    made.insert_json5("mode", '"router"')
    if listen or not file:
        made.insert_json5("listen/endpoints", json.dumps(listen or ["tcp/127.0.0.1:7447"]))
    if connect:
        made.insert_json5("connect/endpoints", json.dumps(connect))
    if not file:
        made.insert_json5("scouting/multicast/enabled", "false")
    return made


if __name__ == "__main__":
    try:
        main()
    except zenoh.ZError as error:
        sys.exit(f"cannot open a Zenoh session: {error}")
