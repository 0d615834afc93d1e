"""The table of an audit, on terminals of any width."""

from __future__ import annotations

from io import StringIO

import pytest
from rich.console import Console

from pipeline.audit.table import reasons, table
from pipeline.audit.task import Task
from pipeline.terms import Cause, State

ENDED = "/a/hall2/left.bag: damaged or truncated (EOFError): it is read up to there"


def record(name, **said):
    return Task(f"/a/{name}", "rosbag1", "f", "s", 1).record(cameras=["left", "right"], **said)


RECORDS = [
    record("hall1/monday_1", frames=18000, duration_s=1200.0, coverage=0.981, state=State.SYNC),
    record("hall1/b", frames=90, state=State.ASYNC, cause=Cause.STAMPS_LIE, offset_ms=-133.3, coverage=1.0),
    record("hall2/left.bag", frames=60, state=State.SYNC, coverage=1.0, warnings=["no frame rate known", ENDED]),
    record("hall2/pictures", frames=7, coverage=0.5, error="/a/hall2/pictures/left/3.png: is truncated"),
]


def shown(width):
    made = StringIO()
    Console(file=made, width=width).print(table(RECORDS, width))
    return made.getvalue().splitlines()


@pytest.mark.parametrize("width", [80, 120, 200])
def test_a_recording_is_a_line_that_fits(width):
    lines = shown(width)
    assert max(map(len, lines)) <= width
    for name, answer in zip(
        ("monday_1", "b", "left.bag", "pictures"),
        ("in sync", "OUT OF SYNC", "in sync", "broken"),
        strict=True,
    ):
        (line,) = [line for line in lines if f"/{name} " in line]
        assert answer in line
    (wrong,) = [line for line in lines if "OUT OF SYNC" in line]
    assert "stamps_lie" in wrong
    assert "-133.3 ms" in wrong


def test_what_is_wrong_with_a_file_is_told_beside_it_or_below():
    why = ["damaged or truncated (EOFError): it is read up to there", "left/3.png: is truncated"]
    wide = "\n".join(shown(200))
    assert all(text in wide for text in why)
    assert reasons(RECORDS, 200) == []
    assert reasons(RECORDS, 80) == [f"hall2/left.bag: {why[0]}", f"hall2/pictures: {why[1]}"]
