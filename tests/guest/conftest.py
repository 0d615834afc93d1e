"""Tests with the kernel's virtual cameras: they run inside the virtual machine that `make test-guest` boots."""

from __future__ import annotations

import os
import subprocess
import time
from pathlib import Path

import pytest

from tests.guest.machine import LEFT, RIGHT, control, unplug_and_replug

collect_ignore_glob = [] if os.environ.get("SYNCWATCH_GUEST") else ["test_*.py"]

VIVID = ["n_devs=2", "node_types=0x1,0x1", "num_inputs=1,1", "input_types=0,0", "vid_cap_nr=0,2"]
QUIET = {
    "percentage_of_dropped_buffers": 0,
    "wrap_sequence_number": False,
    "timestamp_source": 0,
    "osd_text_mode": 2,
    "horizontal_movement": "Move Right Slow",
}
"""Moving pictures without the text that costs an emulated machine most of its time."""


PLUGGED_TIMES = 10


def load(module: str, *parameters: str) -> None:
    command = ["modprobe", "-d", os.environ["GUEST_MODULES"], module, *parameters]
    subprocess.run(command, check=True, timeout=60)


@pytest.fixture(scope="session")
def _vivid_driver():
    load("vivid", *VIVID)


@pytest.fixture
def vivid(_vivid_driver):
    """Two virtual cameras without faults, under their first numbers: a test that unplugs them may have moved them."""
    for _ in range(PLUGGED_TIMES):
        if all(Path(device).exists() for device in (LEFT, RIGHT)):
            break
        unplug_and_replug()
        time.sleep(1)
    for device in (LEFT, RIGHT):
        control(device, **QUIET)


@pytest.fixture(scope="session")
def loopback():
    """Two cameras that show what is written to them."""
    load("v4l2loopback", "devices=2", "video_nr=10,11", "exclusive_caps=0,0", "card_label=left,right")
    return "/dev/video10", "/dev/video11"
