"""`syncwatch run` on two cameras of a real kernel for a minute."""

from __future__ import annotations

import re
import time

import pytest

from tests.guest.machine import PERIOD_NS, configuration, gaps_agree, running

SECONDS = 60
SETTLED_S = 15
STARTING_S = 150
FLAT_KB = 6 * 1024


@pytest.mark.timeout(400)
def test_a_minute_of_two_cameras_leaves_no_trace_and_ends_in_order(vivid, tmp_path):
    with running(configuration(), tmp_path) as program:
        program.until(lambda lines: len(lines) > 5, within_s=STARTING_S)
        time.sleep(SETTLED_S)
        memory_kb = [program.memory_kb()]
        while len(memory_kb) * 5 < SECONDS - SETTLED_S:
            time.sleep(5)
            memory_kb.append(program.memory_kb())
        asked_s = time.monotonic()
        output, log = program.terminate()
        took_s = time.monotonic() - asked_s
        lines, judged = program.lines(), program.judged()
    print(f"memory {memory_kb} KB; ended after {took_s:.1f} s; {len(lines)} verdicts, {len(judged)} on frames; {log}")  # noqa: T201
    assert took_s < 10
    assert max(memory_kb) - min(memory_kb) < FLAT_KB
    assert program.file.read_text().endswith("}\n")
    assert f"left-right: {len(lines)} frames" in output
    assert [line["frame"] for line in judged] == sorted({line["frame"] for line in judged})
    for camera in ("left", "right"):
        stamps = [(line["sequence"][camera], line["captured_ns"][camera]) for line in judged]
        known = [stamp for stamp in stamps if None not in stamp]
        assert len(known) > SECONDS * 3
        gaps_agree(known, PERIOD_NS)
    assert not re.search("error|Traceback", log)
