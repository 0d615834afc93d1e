"""Runs the command line: `python -m syncwatch`."""

import sys

from pipeline.cli.app import main

if __name__ == "__main__":
    sys.exit(main())
