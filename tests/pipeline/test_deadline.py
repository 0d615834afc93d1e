"""Work that is given up, and the program that ends nevertheless."""

from __future__ import annotations

import subprocess
import sys
import threading

from pipeline.deadline import done_within, leave
from tests.programs import ROOT

CLOSING = """
import sys, threading
import zenoh
from pipeline.deadline import done_within, leave
from pipeline.zenoh_network import NetworkSettings, session_config

session = zenoh.open(session_config(NetworkSettings()))
asked = threading.Event()

def close():
    asked.set()
    while True:
        session.close()

print("said", done_within(0.05, close, "close"), flush=False)
asked.wait()
sys.exit(leave(3))
"""


def test_work_that_is_done_in_time_changes_nothing():
    assert done_within(10, lambda: None, "quick")
    assert leave(3) == 3


def test_a_program_ends_with_its_status_and_its_output_while_a_session_is_being_closed():
    done = subprocess.run(
        [sys.executable, "-c", CLOSING], cwd=ROOT, capture_output=True, text=True, timeout=30, check=False
    )
    assert (done.returncode, done.stdout, done.stderr) == (3, "said False\n", "")


def test_work_that_is_done_late_is_not_left():
    held = threading.Event()
    assert not done_within(0.01, held.wait, "late")
    held.set()
    for thread in threading.enumerate():
        if thread.name == "late":
            thread.join(10)
    assert leave(0) == 0
