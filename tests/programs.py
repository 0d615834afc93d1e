"""Runs the program as a user does, and makes small recordings for it."""

from __future__ import annotations

import io
import json
import logging
import os
import subprocess
import sys
from contextlib import redirect_stderr, redirect_stdout
from pathlib import Path
from typing import Any

import cv2

from pipeline.cli.app import main
from tests.frames import texture

ROOT = Path(__file__).resolve().parent.parent
WAIT_S = 110


def syncwatch(*arguments: str | Path, cwd: Path, **environment: str) -> subprocess.CompletedProcess[str]:
    """Runs `syncwatch` to its end in `cwd`."""
    command = [sys.executable, "-m", "syncwatch", *map(str, arguments)]
    env = {**os.environ, "PYTHONWARNINGS": "error", **environment}
    return subprocess.run(command, cwd=cwd, env=env, capture_output=True, text=True, timeout=WAIT_S, check=False)


def inside(*arguments: str | Path, cwd: Path) -> subprocess.CompletedProcess[str]:
    """The same within this process, which is much quicker."""
    command = ["syncwatch", *map(str, arguments)]
    out, err = io.StringIO(), io.StringIO()
    before, argv, logger = Path.cwd(), sys.argv, logging.getLogger("syncwatch")
    handlers, level, propagate = logger.handlers, logger.level, logger.propagate
    os.chdir(cwd)
    sys.argv = command
    try:
        with redirect_stdout(out), redirect_stderr(err):
            status = main()
    finally:
        os.chdir(before)
        sys.argv = argv
        logger.handlers, logger.propagate = handlers, propagate
        logger.setLevel(level)
    return subprocess.CompletedProcess(command, status, out.getvalue(), err.getvalue())


def lines_of(text: str) -> list[dict[str, Any]]:
    return [json.loads(line) for line in text.splitlines()]


def write_folders(folder: Path, count: int = 40, sides: tuple[str, ...] = ("left", "right")) -> Path:
    """Two folders of pictures that pan over a texture, both seeing the same."""
    scene = texture(1, 400, 120)
    for side in sides:
        (folder / side).mkdir(parents=True)
        for number in range(count):
            shake = 40 + (number * number * 7) % 31
            view = scene[number % 20 : number % 20 + 80, shake : shake + 96]
            cv2.imwrite(str(folder / side / f"{side}{number}.png"), view)
    return folder
