"""The ROS 2 sink, decoded by hand: no ROS and no library of the sink's own stands on this side."""

from __future__ import annotations

import struct
import uuid
from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Any

import pytest
import zenoh
from pydantic import ValidationError

from pipeline.errors import RunError
from pipeline.verdict import Basis, CameraStatus, Cause, Level, PairStatus, State, Status, Verdict
from pipeline.zenoh_network import NetworkSettings, session_config
from sinks.ros2.sink import Ros2Settings, Ros2Sink, node_name
from tests.network import free_endpoint, router, wait_for

TYPE = "diagnostic_msgs::msg::dds_::DiagnosticArray_"
HASH = "RIHS01_5a8a36efb05fb25070fa0fb3810290c0e6cd4862b54a8fb975a1ee8dc55a333e"
AT_NS = 1_790_000_000_123_456_789

OK, WARN, ERROR, STALE = 0, 1, 2, 3

PAIR = PairStatus(State.ASYNC, Cause.SLIP, 5, 33_300_000, 600_000, 0.98)
CAMERA = CameraStatus(fps=30.0, expected_fps=30, frames=900, drops=0)
STATUS = Status(
    rig="kärnt-7", at_ns=AT_NS, level=Level.ERROR, reasons=("left-right: late", "und grün"),
    pairs={"left-right": PAIR, "left-top": replace(PAIR, state=State.SYNC, cause=None)},
    cameras={"left": CAMERA, "right": replace(CAMERA, conditions=("jitter",)),
             "top": replace(CAMERA, conditions=("dark", "frozen"))},
    version="0.1.0", uptime_s=30.5, dropped_windows=0,
)  # fmt: skip


class Cdr:
    """Reads little-endian CDR (XCDR1): every primitive is aligned to its size, counted from after the header."""

    def __init__(self, data: bytes) -> None:
        assert data[:4] == bytes([0, 1, 0, 0])
        self._data = data[4:]
        self._at = 0

    def number(self, code: str) -> int:
        size = struct.calcsize(code)
        self._at += -self._at % size
        (value,) = struct.unpack_from(f"<{code}", self._data, self._at)
        self._at += size
        return value

    def text(self) -> str:
        length = self.number("I")
        raw = self._data[self._at : self._at + length]
        assert raw[-1] == 0
        self._at += length
        return raw[:-1].decode("utf-8")

    def left(self) -> int:
        return len(self._data) - self._at


@dataclass
class Heard:
    stamp: tuple[int, int]
    frame_id: str
    statuses: list[tuple[int, str, str, str, dict[str, str]]]


def array(data: bytes) -> Heard:
    cdr = Cdr(data)
    stamp = (cdr.number("i"), cdr.number("I"))
    frame_id = cdr.text()
    statuses = []
    for _ in range(cdr.number("I")):
        level, name, message, hardware_id = cdr.number("B"), cdr.text(), cdr.text(), cdr.text()
        statuses.append((level, name, message, hardware_id, {cdr.text(): cdr.text() for _ in range(cdr.number("I"))}))
    assert cdr.left() == 0
    return Heard(stamp, frame_id, statuses)


@dataclass
class Wire:
    """A subscriber such as a ROS node has, and all tokens, polled for."""

    subscriber: Any
    tokens: Any
    _samples: list[Any]

    def samples(self) -> list[Any]:
        while (sample := self.subscriber.try_recv()) is not None:
            self._samples.append(sample)
        return self._samples


@pytest.fixture(scope="module")
def endpoint() -> Iterator[str]:
    """A router such as rmw_zenohd is."""
    at = free_endpoint()
    with router(at):
        yield at


@pytest.fixture
def domain() -> int:
    return uuid.uuid4().int % 233


@pytest.fixture
def wire(endpoint, domain) -> Iterator[Wire]:
    with zenoh.open(session_config(NetworkSettings(mode="client", connect=[endpoint]))) as session:
        tokens = session.liveliness().declare_subscriber(f"@ros2_lv/{domain}/**", history=True)
        yield Wire(session.declare_subscriber(f"{domain}/diagnostics/{TYPE}/{HASH}"), tokens, [])


@pytest.fixture
def sink(endpoint, domain, wire) -> Iterator[Ros2Sink]:
    made = Ros2Sink(Ros2Settings(connect=[endpoint], domain_id=domain), rig="kärnt-7")
    made.start()
    yield made
    made.stop()


def heard(sink, wire) -> Heard:
    wait_for(lambda: sink.take(STATUS) or wire.samples())
    return array(wire.samples()[-1].payload.to_bytes())


def test_the_array_is_decoded_byte_by_byte_under_the_key_that_ros_subscribes_to(sink, wire, domain):
    told = heard(sink, wire)
    assert str(wire.samples()[-1].key_expr) == f"{domain}/diagnostics/{TYPE}/{HASH}"
    assert told.stamp == (1_790_000_000, 123_456_789)
    assert told.frame_id == ""
    assert [(level, name, message) for level, name, message, *_ in told.statuses] == [
        (ERROR, "syncwatch: kärnt-7", "left-right: late; und grün"),
        (ERROR, "syncwatch: kärnt-7/left-right", "out of sync (slip)"),
        (OK, "syncwatch: kärnt-7/left-top", "in sync"),
        (OK, "syncwatch: kärnt-7/left", "ok"),
        (WARN, "syncwatch: kärnt-7/right", "jitter"),
        (ERROR, "syncwatch: kärnt-7/top", "dark, frozen"),
    ]
    assert {hardware_id for *_, hardware_id, _ in told.statuses} == {"kärnt-7"}


def test_values_are_text_and_what_is_unknown_is_left_out(sink, wire):
    rig, pair, _, left, _, top = (values for *_, values in heard(sink, wire).statuses)
    assert (rig["version"], rig["uptime_s"]) == ("0.1.0", "30.5")
    assert "memory_bytes" not in rig
    assert (pair["offset_ms"], pair["offset_sigma_ms"], pair["coverage"]) == ("33.3", "0.6", "0.98")
    assert "drift.stamps_ppm" not in pair
    assert (left["frames"], left["frozen"]) == ("900", "false")
    assert "conditions" not in left
    assert top["conditions"] == "dark, frozen"


def test_the_attachment_has_33_bytes_with_a_counter_the_time_and_an_unchanging_gid(sink, wire):
    wait_for(lambda: sink.take(STATUS) or len(wire.samples()) >= 3)
    seen = []
    for sample in wire.samples():
        attachment = sample.attachment.to_bytes()
        assert len(attachment) == 33
        sequence, at_ns, length, gid = struct.unpack("<qqB16s", attachment)
        assert (at_ns, length) == (AT_NS, 16)
        seen.append((sequence, gid))
    sequences = [sequence for sequence, _ in seen]
    assert sequences == list(range(sequences[0], sequences[0] + len(seen)))
    assert len({gid for _, gid in seen}) == 1
    assert seen[0][1] != bytes(16)


def test_the_node_and_its_publisher_appear_in_the_graph_and_vanish_with_the_sink(endpoint, domain, wire):
    sink = Ros2Sink(Ros2Settings(connect=[endpoint], domain_id=domain), rig="kärnt-7")
    sink.start()
    keys = {str(wait_for(wire.tokens.try_recv).key_expr) for _ in range(2)}
    session = next(iter(keys)).split("/")[2]
    assert int(session, 16) > 0
    assert session == session.lower().lstrip("0")
    node = "syncwatch_k_rnt_7"
    assert keys == {
        f"@ros2_lv/{domain}/{session}/0/0/NN/%/%/{node}",
        f"@ros2_lv/{domain}/{session}/0/1/MP/%/%/{node}/%diagnostics/{TYPE}/{HASH}/::,10:,:,:,,",
    }
    sink.stop()
    gone = [wait_for(wire.tokens.try_recv) for _ in range(2)]
    assert {str(sample.key_expr) for sample in gone} == keys
    assert all(sample.kind == zenoh.SampleKind.DELETE for sample in gone)


@pytest.mark.parametrize(
    ("level", "expected"), [(Level.OK, OK), (Level.WARN, WARN), (Level.ERROR, ERROR), (Level.STALE, STALE)]
)
def test_levels_map_one_to_one_and_a_stale_rig_has_nothing_fresh(sink, wire, level, expected):
    def last_level() -> int | None:
        sink.take(replace(STATUS, level=level, reasons=()))
        return wire.samples() and array(wire.samples()[-1].payload.to_bytes()).statuses[0][0] == expected

    wait_for(last_level)
    statuses = array(wire.samples()[-1].payload.to_bytes()).statuses
    assert statuses[0][2] == level.value
    if level is Level.STALE:
        assert {status[0] for status in statuses} == {STALE}


def test_being_unable_to_tell_is_no_fault(sink, wire):
    unsure = replace(STATUS, level=Level.OK, reasons=(), pairs={"a-b": replace(PAIR, state=State.UNKNOWN, cause=None)})
    wait_for(lambda: sink.take(unsure) or wire.samples())
    assert array(wire.samples()[-1].payload.to_bytes()).statuses[1][:3] == (
        OK, "syncwatch: kärnt-7/a-b", "cannot tell"
    )  # fmt: skip


def test_nodes_of_humble_hear_it_under_their_key(endpoint, domain):
    sink = Ros2Sink(Ros2Settings(connect=[endpoint], domain_id=domain, humble=True), rig="cart")
    with zenoh.open(session_config(NetworkSettings(mode="client", connect=[endpoint]))) as session:
        subscriber = session.declare_subscriber(f"{domain}/diagnostics/{TYPE}/TypeHashNotSupported")
        sink.start()
        sample = wait_for(lambda: sink.take(STATUS) or subscriber.try_recv())
        assert array(sample.payload.to_bytes()).statuses[0][0] == ERROR
        sink.stop()


def test_only_statuses_are_told(sink, wire):
    heard(sink, wire)
    sink.take(Verdict("kärnt-7", "left-right", 0, State.SYNC, Basis.CONTENT))
    sink.take(replace(STATUS, at_ns=1))
    wait_for(lambda: array(wire.samples()[-1].payload.to_bytes()).stamp == (0, 1))
    first, *_, last = (struct.unpack_from("<q", sample.attachment.to_bytes())[0] for sample in wire.samples())
    assert last - first == len(wire.samples()) - 1
    assert {array(sample.payload.to_bytes()).stamp[0] for sample in wire.samples()} == {AT_NS // 10**9, 0}


def test_a_router_that_comes_late_gets_the_latest_status(domain, caplog):
    at = free_endpoint()
    sink = Ros2Sink(Ros2Settings(connect=[at], domain_id=domain), rig="cart")
    sink.start()
    assert [message.split(" (")[0] for message in caplog.messages] == [f"ros2: cannot reach {at} yet, trying on"]
    sink.take(replace(STATUS, at_ns=1))
    sink.take(replace(STATUS, at_ns=2))
    with router(at), zenoh.open(session_config(NetworkSettings(mode="client", connect=[at]))) as session:
        subscriber = session.declare_subscriber(f"{domain}/**")
        sample = wait_for(lambda: subscriber.try_recv() or sink.take(replace(STATUS, at_ns=3)))
        assert array(sample.payload.to_bytes()).stamp[1] in {2, 3}
        sink.stop()


def test_a_required_router_that_is_absent_is_an_error(domain):
    at = free_endpoint()
    with pytest.raises(RunError, match=f"ros2: cannot reach {at}: "):
        Ros2Sink(Ros2Settings(connect=[at], domain_id=domain, required=True), rig="cart").start()


@pytest.mark.parametrize(
    ("settings", "said"),
    [
        ({"domain_id": 233}, "less than or equal to 232"),
        ({"node": "a-b"}, "should match pattern"),
        ({"node": "7up"}, "should match pattern"),
        ({"connect": []}, "mode: client needs a router"),
    ],
)
def test_settings_that_cannot_work_are_refused(settings, said):
    with pytest.raises(ValidationError, match=said):
        Ros2Settings.model_validate(settings)


@pytest.mark.parametrize(
    ("rig", "name"), [("bench", "syncwatch_bench"), ("cart-7.b", "syncwatch_cart_7_b"), ("ü", "syncwatch__")]
)
def test_a_rigs_name_becomes_one_that_ros_allows(rig, name):
    assert node_name(rig) == name
