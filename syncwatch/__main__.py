"""Runs the command line: `python -m syncwatch`."""

import sys

from pipeline.cli import app
from pipeline.deadline import leave


def main() -> int:
    """Runs one command; returns its exit status, or ends the program with it where something cannot be ended."""
    return leave(app.main())


if __name__ == "__main__":
    sys.exit(main())
