"""Lines of JSON."""

from __future__ import annotations

import json

import pytest

from pipeline.errors import InputError
from pipeline.verdict import Basis, Event, Level, State, Status, Verdict
from sinks.jsonl import JsonlSettings, JsonlSink

VERDICT = Verdict("bench", "left-right", 3, State.SYNC, Basis.NONE)
EVENT = Event("bench", "a-1", "async", "onset", "left-right", "right", None, 1, None, {}, "late")
STATUS = Status("bench", 1, Level.OK, (), {}, {}, "0", 1.0, 0)


def written(folder, **settings) -> list[str]:
    sink = JsonlSink(JsonlSettings(path="out.jsonl", **settings), base=folder)
    sink.start()
    for report in (VERDICT, EVENT, STATUS):
        sink.take(report)
    sink.stop()
    return [json.loads(line)["schema"] for line in (folder / "out.jsonl").read_text().splitlines()]


def test_verdicts_are_written_unless_more_is_asked_for(tmp_path):
    assert written(tmp_path) == ["syncwatch.verdict.v1"]
    assert written(tmp_path, what=["event", "status"]) == ["syncwatch.event.v1", "syncwatch.status.v1"]


def test_a_line_is_there_as_soon_as_it_is_taken(tmp_path):
    sink = JsonlSink(JsonlSettings(path="out.jsonl"), base=tmp_path)
    sink.start()
    sink.take(VERDICT)
    assert (tmp_path / "out.jsonl").read_text().endswith("}\n")
    sink.stop()


def test_numbers_are_numbers_and_missing_values_are_null(tmp_path):
    written(tmp_path)
    line = json.loads((tmp_path / "out.jsonl").read_text())
    assert line["frame"] == 3
    assert line["offset_ms"] is None


def test_a_place_that_cannot_be_written_is_named(tmp_path):
    with pytest.raises(InputError, match=r"no/such/folder/out.jsonl: cannot be written: there is no folder"):
        JsonlSink(JsonlSettings(path="no/such/folder/out.jsonl"), base=tmp_path)
    sink = JsonlSink(JsonlSettings(path="."), base=tmp_path)
    with pytest.raises(InputError, match=r"cannot be written: Is a directory"):
        sink.start()
