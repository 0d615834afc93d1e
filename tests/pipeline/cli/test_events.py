"""`syncwatch events`, of files and of rigs."""

from __future__ import annotations

import json
import uuid

import pytest
from click.testing import CliRunner, Result

from pipeline.cli.app import app
from pipeline.errors import InputError
from pipeline.verdict import Cause, Event
from sinks.zenoh import ZenohSettings, ZenohSink
from tests.schemas import check

AT_NS = 1_790_000_000_000_000_000


def told(number: int, phase: str = "onset", rig: str = "cart") -> Event:
    since_ns = AT_NS + number * 10**9
    until_ns = since_ns + 4 * 10**8 if phase == "end" else None
    worst = {"offset_ms": 33.3}
    return Event(
        rig, f"x-{number}", "async", phase, "a-b", "b", Cause.SLIP, since_ns, until_ns, worst, f"{phase} {number}"
    )


def events(*arguments: object) -> Result:
    return CliRunner().invoke(app, ["events", *map(str, arguments)], standalone_mode=False, env={"TZ": "UTC"})


@pytest.fixture
def file(tmp_path):
    written = tmp_path / "cart.events.jsonl"
    told_of = [told(1), told(2, rig="drone"), told(1, "end"), told(3)]
    written.write_text("".join(json.dumps(one.to_message()) + "\n" for one in told_of))
    return written


def test_onset_and_end_are_one_line(file):
    result = events(file)
    lines = [" ".join(line.split()[2:]) for line in result.stdout.splitlines()]
    assert lines == [
        "cart a-b async slip 0.4 s onset 1",
        "drone a-b async slip no end onset 2",
        "cart a-b async slip no end onset 3",
    ]
    assert result.return_value == 0


def test_a_file_without_events_says_so(tmp_path):
    (tmp_path / "verdicts.jsonl").write_text('{"schema": "syncwatch.verdict.v1"}\n')
    result = events(tmp_path / "verdicts.jsonl")
    assert (result.return_value, result.stdout) == (0, "")
    assert result.stderr == f"syncwatch: warning: {tmp_path / 'verdicts.jsonl'}: no event is in it\n"


def test_json_is_one_incident_a_line(file):
    lines = [json.loads(line) for line in events(file, "--json").stdout.splitlines()]
    for line in lines:
        check(line, "incident")
    assert [(line["rig"], line["id"], line["until_ns"]) for line in lines] == [
        ("cart", "x-1", AT_NS + 14 * 10**8),
        ("drone", "x-2", None),
        ("cart", "x-3", None),
    ]
    assert lines[0]["worst"] == {"offset_ms": 33.3}


def test_the_last_ones_are_listed(file):
    assert [json.loads(line)["id"] for line in events(file, "--last", "1", "--json").stdout.splitlines()] == ["x-3"]


def test_what_was_turned_away_is_listed_as_well(file):
    file.rename(f"{file}.1")
    assert len(events(file).stdout.splitlines()) == 3


def test_an_empty_file_has_no_events(tmp_path):
    (tmp_path / "a.jsonl").write_text("")
    result = events(tmp_path / "a.jsonl")
    assert (result.stdout, result.return_value) == ("", 0)


def test_a_line_that_is_only_half_an_event_is_left_out(file):
    with file.open("a") as stream:
        stream.write('{"schema": "syncwatch.event.v1", "id": 3}\n')
    assert len(events(file).stdout.splitlines()) == 3


def test_a_file_that_is_not_there_is_said():
    assert str(events("nowhere.jsonl").exception) == "nowhere.jsonl: there is no such file"
    assert isinstance(events("nowhere.jsonl").exception, InputError)


def test_a_file_is_not_connected_to(file):
    assert "is a file" in str(events(file, "--connect", "tcp/127.0.0.1:1").exception)


def test_events_of_rigs_are_heard():
    prefix = f"test/{uuid.uuid4().hex[:8]}"
    sink = ZenohSink(ZenohSettings(prefix=prefix), rig="cart")
    sink.start()
    for one in (told(1), told(1, "end"), told(2)):
        sink.take(one)
    result = events(prefix, "--json")
    sink.stop()
    lines = [json.loads(line) for line in result.stdout.splitlines()]
    assert [(line["rig"], line["id"], line["until_ns"] is None) for line in lines] == [
        ("cart", "x-1", False),
        ("cart", "x-2", True),
    ]
    assert result.return_value == 0


def test_no_rig_is_status_3(caplog):
    result = events(f"test/{uuid.uuid4().hex[:8]}", "--for", "300ms")
    assert (result.return_value, result.stdout) == (3, "")
