"""The sink that keeps events, and what is left of them after restarts, crashes and harm to the file."""

from __future__ import annotations

import json
import uuid
from dataclasses import replace
from pathlib import Path

import pytest
import zenoh
from pydantic import ValidationError

from pipeline.assemble import KINDS, assemble
from pipeline.cli.common import open_source
from pipeline.configtext.document import load_text
from pipeline.errors import InputError, RunError
from pipeline.event_log import read_events
from pipeline.fleet.listener import FleetListener
from pipeline.plan import make_plan
from pipeline.verdict import Basis, Cause, Event, State, Verdict
from pipeline.zenoh_network import session_config
from sinks.events import EventsSettings, EventsSink
from sinks.zenoh import ZenohSettings, ZenohSink
from tests.network import wait_for
from tests.programs import syncwatch
from tests.schemas import check

FILE = "cart.events.jsonl"


def event(number: int, phase: str = "onset", run: str = "a") -> Event:
    return Event("cart", f"{run}-{number}", "async", phase, "a-b", "b", Cause.SLIP, number, None, {}, f"event {number}")


def kept(folder: Path, *events: Event, **settings) -> list[str]:
    """Ids that are kept after a run that told of these events."""
    sink = EventsSink(EventsSettings(**settings), base=folder, rig="cart")
    sink.start()
    for one in events:
        sink.take(one)
    sink.stop()
    return ids(folder)


def ids(folder: Path, last: int = 10**6) -> list[str]:
    return [message["id"] for message in read_events(folder / FILE, last)]


def test_events_are_there_after_a_restart_and_nothing_else_is_written(tmp_path):
    sink = EventsSink(EventsSettings(), base=tmp_path, rig="cart")
    sink.start()
    sink.take(event(1))
    sink.take(Verdict("cart", "a-b", 0, State.SYNC, Basis.NONE))
    assert ids(tmp_path) == ["a-1"]  # at once, not only when it ends
    sink.stop()
    assert kept(tmp_path, event(1, run="b")) == ["a-1", "b-1"]
    for message in read_events(tmp_path / FILE, 10):
        check(message, "event")


def test_at_least_so_many_are_kept_and_at_most_twice_as_many(tmp_path):
    for number in range(100):
        there = kept(tmp_path, event(number), keep=10)
        assert 10 <= len(there) <= 20 or len(there) == number + 1
        assert there == [f"a-{n}" for n in range(number + 1 - len(there), number + 1)]
    assert sorted(path.name for path in tmp_path.iterdir()) == [FILE, f"{FILE}.1"]
    assert ids(tmp_path, last=5) == [f"a-{n}" for n in range(95, 100)]


def test_a_line_that_a_power_cut_has_torn_costs_that_event_only(tmp_path, caplog):
    kept(tmp_path, event(1), event(2))
    file = tmp_path / FILE
    file.write_bytes(file.read_bytes()[:-20])
    assert kept(tmp_path, event(3)) == ["a-1", "a-3"]
    assert caplog.messages == [f"{file}: 1 lines that are no messages were left out"]


def test_what_else_stands_in_the_file_is_left_out(tmp_path):
    file = tmp_path / FILE
    line = json.dumps(event(1).to_message())
    file.write_bytes(
        b'\xff\xfe\n[1]\nnull\n"x"\n{"schema": "other"}\n\n' + line.encode() + b"\n" + b"x" * 300_000 + b"\n"
    )
    assert kept(tmp_path, event(2)) == ["a-1", "a-2"]


def test_a_place_that_cannot_be_written_is_named(tmp_path):
    with pytest.raises(InputError, match="cannot be written: there is no folder"):
        EventsSink(EventsSettings(path="no/such/folder.jsonl"), base=tmp_path, rig="cart")
    with pytest.raises(InputError, match="cannot be written: Is a directory"):
        EventsSink(EventsSettings(path="."), base=tmp_path, rig="cart").start()


def test_a_full_disk_is_an_error_of_the_sink():
    sink = EventsSink(EventsSettings(path="/dev/full"), base=Path(), rig="cart")
    sink.start()
    with pytest.raises(RunError, match="/dev/full: cannot be written any more: No space left on device"):
        sink.take(event(1))
    sink.stop()


@pytest.mark.parametrize("keep", [0, -1, 2_000_000])
def test_bounds_are_kept(keep):
    with pytest.raises(ValidationError):
        EventsSettings(keep=keep)


def test_who_comes_late_gets_the_events_of_former_runs_and_who_was_there_knows_them_by_their_ids():
    prefix = f"test/{uuid.uuid4().hex[:8]}"
    former = [event(number, run="a").to_message() for number in range(40)]
    everything = [f"a-{n}" for n in range(40)] + ["b-100", "b-101"]
    with FleetListener(ZenohSettings(prefix=prefix)) as early:
        wait_for(lambda: early.problem is None)
        sink = ZenohSink(ZenohSettings(prefix=prefix), rig="cart", history=former)
        sink.start()
        sink.take(event(100, run="b"))
        with FleetListener(ZenohSettings(prefix=prefix)) as late:
            wait_for(lambda: len(seen(late)) == 41)
            sink.take(event(101, run="b"))
            wait_for(lambda: seen(late) == everything)
        wait_for(lambda: seen(early) == everything)
        sink.stop()


def test_a_plain_subscriber_is_told_nothing_of_former_runs():
    prefix = f"test/{uuid.uuid4().hex[:8]}"
    with zenoh.open(session_config(ZenohSettings())) as session:
        heard = session.declare_subscriber(f"{prefix}/cart/event")
        sink = ZenohSink(ZenohSettings(prefix=prefix), rig="cart", history=[event(1).to_message()])
        sink.start()
        numbers = iter(range(2, 1000))
        sample = wait_for(lambda: sink.take(event(next(numbers))) or heard.try_recv())
        assert json.loads(sample.payload.to_string())["id"] != "a-1"
        sink.stop()


def seen(listener: FleetListener) -> list[str]:
    rig = listener.fleet.rig("cart")
    return [] if rig is None else [incident.id for incident in rig.incidents]


def test_get_answers_the_last_event_of_the_former_run_until_there_is_a_new_one():
    prefix = f"test/{uuid.uuid4().hex[:8]}"
    sink = ZenohSink(ZenohSettings(prefix=prefix), rig="cart", history=[event(7).to_message()])
    sink.start()
    with zenoh.open(session_config(ZenohSettings())) as session:

        def answer() -> str | None:
            replies = [reply.ok for reply in session.get(f"{prefix}/cart/event", timeout=1.0)]
            return json.loads(replies[0].payload.to_string())["id"] if replies and replies[0] else None

        assert wait_for(answer) == "a-7"
        sink.take(event(8))
        wait_for(lambda: answer() == "a-8")
    sink.stop()


CONFIG = """
rig: cart
source: {type: synthetic, width: 64, height: 48, fps: 20, duration_s: 3, speed: max}
faults: [{type: slip, camera: right, start_s: 1, stop_s: 2}]
detectors: {timestamp: }
sinks: {events: {keep: 3}}
"""


def test_a_monitor_that_is_run_again_goes_on_with_its_file_and_a_publisher_beside_it_gets_it(tmp_path):
    (tmp_path / "c.yaml").write_text(CONFIG)
    for count in (2, 4, 3 + 3):
        done = syncwatch("run", "c.yaml", cwd=tmp_path)
        assert (done.returncode, done.stderr) == (0, "")
        there = read_events(tmp_path / FILE, 100)
        assert len(there) == count
        assert [message["phase"] for message in there[-2:]] == ["onset", "end"]
    assert len({message["id"] for message in there}) == 3


def test_only_events_of_this_rig_are_handed_on(tmp_path):
    file = tmp_path / "shared.jsonl"
    messages = [event(1).to_message(), replace(event(2), rig="drone").to_message()]
    file.write_text("".join(json.dumps(message) + "\n" for message in messages))
    text = CONFIG.replace("{keep: 3}", "{path: shared.jsonl}, zenoh: {prefix: test/unused}")
    plan = make_plan(load_text(text, "c.yaml", {}, ()), KINDS, tmp_path)
    source = open_source(plan)
    sink = assemble(plan, source, console=None).sinks["zenoh"]
    source.close()
    assert [message["id"] for message in sink._history] == ["a-1"]
