"""The table of rigs: what it says of each, by a clock that the test sets."""

from __future__ import annotations

import pytest

from pipeline.fleet.messages import HeardEvent, HeardStatus, HeardVerdict, read
from pipeline.fleet.table import MAX_EVENTS, MAX_PARTS, MAX_RIGS, Fleet, Presence
from pipeline.frame import NS_PER_S
from tests.pipeline.fleet.said import event, status, verdict


class Clock:
    def __init__(self) -> None:
        self.now_s = 1000.0

    def __call__(self) -> int:
        return round(self.now_s * NS_PER_S)


@pytest.fixture
def clock() -> Clock:
    return Clock()


@pytest.fixture
def fleet(clock) -> Fleet:
    made = Fleet(clock)
    made.connected = True
    return made


def test_a_rig_is_alive_while_statuses_come_and_stale_after_five_seconds_without(fleet, clock):
    fleet.hear_alive("cart", here=True)
    fleet.hear_status("cart", status())
    clock.now_s += 5
    assert fleet.rig("cart").presence is Presence.ALIVE
    clock.now_s += 0.1
    assert fleet.rig("cart").presence is Presence.STALE
    fleet.hear_status("cart", status())
    assert fleet.rig("cart").presence is Presence.ALIVE


def test_a_monitor_that_never_says_how_it_stands_is_stale(fleet, clock):
    fleet.hear_alive("cart", here=True)
    assert fleet.rig("cart").presence is Presence.ALIVE
    clock.now_s += 6
    assert fleet.rig("cart").presence is Presence.STALE


def test_a_rig_is_gone_when_its_token_vanishes_and_keeps_what_it_said_last(fleet):
    fleet.hear_alive("cart", here=True)
    fleet.hear_status("cart", status(level="error"))
    fleet.hear_alive("cart", here=False)
    seen = fleet.rig("cart")
    assert seen.presence is Presence.GONE
    assert seen.status.level.value == "error"


def test_a_rig_that_comes_back_is_alive_at_once(fleet, clock):
    fleet.hear_alive("cart", here=True)
    fleet.hear_alive("cart", here=False)
    clock.now_s += 3600
    fleet.hear_alive("cart", here=True)
    assert fleet.rig("cart").presence is Presence.ALIVE


def test_a_rig_that_has_been_gone_for_a_day_is_forgotten(fleet, clock):
    for name in ("cart", "tram"):
        fleet.hear_alive(name, here=True)
    fleet.hear_alive("cart", here=False)
    clock.now_s += 24 * 3600
    assert [rig.name for rig in fleet.rigs()] == ["cart", "tram"]
    clock.now_s += 1
    assert [rig.name for rig in fleet.rigs()] == ["tram"]


def test_nothing_is_known_of_anybody_while_the_listener_is_cut_off(fleet):
    fleet.hear_status("cart", status())
    fleet.connected = False
    assert fleet.rig("cart").presence is Presence.UNHEARD


def test_the_end_of_a_token_that_was_never_seen_makes_no_rig(fleet):
    fleet.hear_alive("cart", here=False)
    assert fleet.rigs() == ()


@pytest.mark.parametrize("phases", [("onset", "end"), ("end", "onset"), ("onset", "end", "onset", "end")])
def test_onset_and_end_make_one_incident_in_whichever_order_they_come(fleet, phases):
    for phase in phases:
        fleet.hear_event("cart", event(1, phase))
    (incident,) = fleet.rig("cart").incidents
    assert (incident.text, incident.end_text, incident.open) == ("onset 1", "end 1", False)
    assert (incident.since_ns, incident.until_ns) == (1, 2)


def test_incidents_are_in_order_of_time_and_the_oldest_give_way(fleet):
    for number in (*range(MAX_EVENTS, 2 * MAX_EVENTS), *range(MAX_EVENTS)):
        fleet.hear_event("cart", event(number))
    assert [i.since_ns for i in fleet.rig("cart").incidents] == list(range(MAX_EVENTS, 2 * MAX_EVENTS))


def test_what_a_dead_monitor_left_open_is_closed_when_another_one_starts(fleet):
    fleet.hear_status("cart", status(at_s=100, uptime_s=50))
    fleet.hear_event("cart", event(1, since_ns=90 * NS_PER_S))
    fleet.hear_status("cart", status(at_s=200, uptime_s=1))
    fleet.hear_event("cart", event(2, since_ns=200 * NS_PER_S))
    old, new = fleet.rig("cart").incidents
    assert (old.open, new.open) == (False, True)
    assert old.until_ns is None
    assert "started anew" in old.end_text


def test_offsets_keep_two_points_a_second_with_what_was_said_last_and_the_extremes(fleet, clock):
    for offset_ms in (1.0, 30.0, -2.0, 3.0):
        fleet.hear_verdict("cart", "a-b", verdict(offset_ms))
        clock.now_s += 0.1
    clock.now_s += 0.1
    fleet.hear_verdict("cart", "a-b", verdict(None, "unknown"))
    first, second = fleet.offsets("cart")["a-b"]
    assert (first.offset_ms, first.low_ms, first.high_ms) == (3.0, -2.0, 30.0)
    assert (second.offset_ms, second.state.value) == (None, "unknown")
    assert fleet.offsets("cart", since_ns=second.at_ns) == {"a-b": (second,)}


def test_offsets_forget_what_is_older_than_five_minutes(fleet, clock):
    for _ in range(3000):
        fleet.hear_verdict("cart", "a-b", verdict(1.0))
        clock.now_s += 0.25
    points = fleet.offsets("cart")["a-b"]
    assert 598 <= len(points) <= 600
    clock.now_s += 400
    assert fleet.offsets("cart") == {"a-b": ()}


def test_without_verdicts_the_statuses_tell_the_offset(fleet, clock):
    for _ in range(3):
        fleet.hear_status("cart", status(offset_ms=7.0))
        clock.now_s += 1
    assert [point.offset_ms for point in fleet.offsets("cart")["left-right"]] == [7.0, 7.0, 7.0]


def test_statuses_do_not_write_over_verdicts(fleet, clock):
    fleet.hear_verdict("cart", "left-right", verdict(1.0))
    fleet.hear_status("cart", status(offset_ms=7.0))
    clock.now_s += 0.5
    fleet.hear_status("cart", status(offset_ms=7.0))
    assert [point.offset_ms for point in fleet.offsets("cart")["left-right"]] == [1.0]


def test_the_trail_keeps_the_worst_state_of_every_five_seconds_and_shows_silence(fleet, clock):
    for state in ("sync", "unknown", "async", "sync"):
        pair = {"state": state, "since_ns": 0}
        fleet.hear_status("cart", status(pairs={"a-b": pair, "a-c": {"state": "sync", "since_ns": 0}}))
        clock.now_s += 2.5
    clock.now_s += 5
    fleet.hear_status("cart", status())
    trail = [state and state.value for state in fleet.rig("cart").trail]
    assert trail == [None] * 56 + ["unknown", "async", None, "sync"]


def test_previews_are_numbered_and_only_the_latest_is_kept(fleet):
    fleet.hear_preview("cart", "left", b"one")
    fleet.hear_preview("cart", "left", b"two")
    assert fleet.rig("cart").previews == {"left": 2}
    assert fleet.preview("cart", "left").jpeg == b"two"
    assert fleet.preview("cart", "right") is None
    assert fleet.preview("tram", "left") is None


def test_however_many_pairs_and_cameras_a_rig_claims_to_have_few_are_kept(fleet):
    for number in range(2 * MAX_PARTS):
        fleet.hear_verdict("cart", f"a-b{number}", verdict(1.0))
        fleet.hear_preview("cart", f"c{number}", b"x")
        fleet.hear_status("cart", status(pairs={f"c-d{number}": {"state": "sync", "since_ns": 0}}))
    assert len(fleet.offsets("cart")) == len(fleet.rig("cart").previews) == MAX_PARTS


def test_when_the_table_is_full_the_rig_that_has_been_gone_longest_gives_way(fleet, clock):
    for number in range(MAX_RIGS):
        fleet.hear_alive(f"rig{number}", here=True)
    fleet.hear_status("one-too-many", status())
    assert fleet.rig("one-too-many") is None
    assert fleet.left_out == 1
    for number in (7, 3):
        clock.now_s += 1
        fleet.hear_alive(f"rig{number}", here=False)
    fleet.hear_status("new", status())
    assert fleet.rig("new") is not None
    assert (fleet.rig("rig7"), fleet.rig("rig3").presence) == (None, Presence.GONE)


@pytest.mark.parametrize(
    ("payload", "kind"),
    [
        (b"", HeardStatus),
        (b"\xff\xd8\xff", HeardStatus),
        (b"[]", HeardEvent),
        (b'{"schema": "syncwatch.status.v1"}', HeardStatus),
        (b'{"schema": "syncwatch.verdict.v1", "state": "perhaps"}', HeardVerdict),
        (b'{"schema": "syncwatch.verdict.v2", "state": "sync"}', HeardVerdict),
        (b'{"schema": "syncwatch.verdict.v1", "state": "sync", "offset_ms": NaN}', HeardVerdict),
        (b" " * 300_000, HeardVerdict),
    ],
)
def test_a_message_that_is_not_what_it_should_be_is_refused(payload, kind):
    with pytest.raises(ValueError):
        read(payload, kind)


def test_members_of_a_newer_monitor_are_left_out():
    said = read(b'{"schema": "syncwatch.verdict.v1", "state": "sync", "mood": "good"}', HeardVerdict)
    assert said.offset_ms is None


def test_what_a_terminal_would_obey_is_spelled_out():
    said = status(reasons=["\x1b[2Jgone \u202e"], pairs={"a\n-b": {"state": "sync", "since_ns": 0, "cause": "\x07"}})
    assert said.reasons == (r"\x1b[2Jgone \u202e",)
    assert [(name, pair.cause) for name, pair in said.pairs.items()] == [(r"a\n-b", r"\x07")]
