"""All rigs at one moment, for programs and for people."""

from __future__ import annotations

from dataclasses import replace

import pytest
from rich.console import Console

from pipeline.fleet.overview import all_well, counted, fleet_message, fleet_table
from pipeline.fleet.table import Incident, Presence, RigView
from pipeline.frame import NS_PER_S
from tests.pipeline.fleet.said import status
from tests.schemas import check

SINCE_NS = 20 * NS_PER_S
PAIRS = {
    "left-right": {
        "state": "async",
        "cause": "slip",
        "since_ns": SINCE_NS,
        "offset_ms": 33.34,
        "offset_sigma_ms": 0.61,
        "coverage": 0.9,
    },
    "left-top": {"state": "sync", "since_ns": SINCE_NS, "offset_ms": -0.04},
}
WRONG = status("error", pairs=PAIRS, reasons=["left-right: late"], at_s=50)
WELL = RigView("cart", Presence.ALIVE, status(), 0, (), {}, ())
BAD = replace(WELL, name="drone", status=WRONG, silent_ns=2 * NS_PER_S)
GONE = replace(WELL, name="gone", presence=Presence.GONE, silent_ns=600 * NS_PER_S)
STALE = replace(WELL, name="stale", presence=Presence.STALE, silent_ns=7 * NS_PER_S)
NEW = replace(WELL, name="new", status=None)


def message(*rigs, **values):
    made = fleet_message("site/a", rigs, **{"at_ns": 1, "problem": None, **values})
    check(made, "fleet")
    return made


def screen(*rigs, width=120, lines=None) -> list[str]:
    console = Console(width=width, no_color=True)
    with console.capture() as captured:
        console.print(fleet_table(rigs, width=width, lines=lines)[0])
    return [" ".join(line.split()) for line in captured.get().splitlines()]


@pytest.mark.parametrize(
    ("rigs", "well"),
    [
        ((WELL,), True),
        ((WELL, BAD), False),
        ((WELL, GONE), False),
        ((WELL, STALE), False),
        ((NEW,), False),
        ((replace(WELL, presence=Presence.UNHEARD),), False),
        ((replace(WELL, status=status(pairs={"a-b": {"state": "unknown", "since_ns": 0}})),), True),
        ((), False),
    ],
)
def test_all_is_well_when_every_rig_was_heard_just_now_and_says_so(rigs, well):
    assert all_well(rigs) is well
    assert message(*rigs)["ok"] is well


def test_stale_and_gone_are_told_apart():
    rigs = message(STALE, GONE)["rigs"]
    assert {name: (rig["presence"], rig["headline"]) for name, rig in rigs.items()} == {
        "stale": ("stale", "Stale"),
        "gone": ("gone", "Monitor gone"),
    }
    assert screen(STALE, GONE)[1:] == [
        "stale Stale, 7 s left-right sync +0.1 ± 0.2 ms 57 s",
        "gone Monitor gone, 10 min left-right sync +0.1 ± 0.2 ms 10 min",
    ]


def test_pairs_are_told_with_offset_cause_and_since():
    pair = message(BAD)["rigs"]["drone"]["pairs"]["left-right"]
    assert (pair["state"], pair["cause"], pair["offset_ms"], pair["since_ns"]) == ("async", "slip", 33.34, SINCE_NS)
    assert screen(BAD)[1:] == [
        "drone Out of sync left-right async +33.3 ± 0.6 ms slip 32 s",
        "left-top sync +0.0 ms 32 s",
    ]


def test_a_rig_that_has_said_nothing_yet_is_a_row():
    assert screen(NEW)[1:] == ["new Starting"]
    assert message(NEW)["rigs"]["new"]["level"] is None


def test_only_conditions_that_have_not_ended_are_open():
    begun = Incident("x-1", "async", "left-right", "right", "slip", 5, None, {}, "late", None)
    ended = replace(begun, id="x-2", until_ns=6, end_text="in sync again")
    rig = message(replace(BAD, incidents=(begun, ended)))["rigs"]["drone"]
    assert [incident["id"] for incident in rig["open"]] == ["x-1"]


def test_markup_in_a_name_is_text():
    assert screen(replace(WELL, name="[red]a"))[1].startswith("[red]a In sync")


def test_the_worst_rigs_come_first_and_those_that_have_no_room_are_counted():
    assert [line.split()[0] for line in screen(WELL, NEW, GONE, BAD)[1:]] == [
        "drone",
        "left-top",
        "gone",
        "new",
        "cart",
    ]
    table, left = fleet_table((WELL, NEW, GONE, BAD), lines=4)
    assert (table.row_count, [rig.name for rig in left]) == (3, ["new", "cart"])
    assert counted(left).plain == "1 unsure, 1 in sync"
    assert fleet_table((WELL, BAD), lines=1)[1] == [BAD, WELL]


@pytest.mark.parametrize("width", [48, 72, 80, 120])
def test_a_long_name_gives_way_to_what_is_said_of_the_rig(width):
    long = replace(BAD, name="a_name_that_goes_on_and_on_and_on_and_on_and_on_and_on_and_on")
    row = screen(long, GONE, width=width)[1]
    assert row.startswith("a_name_")
    assert "… Out of sync " in row
    assert "+33.3 ± 0.6 ms" in row
