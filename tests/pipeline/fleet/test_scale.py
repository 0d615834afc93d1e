"""The benchmark of many rigs, small: through real routers that read examples/fleet, with verdicts that they thin."""

from __future__ import annotations

import subprocess
import sys
from contextlib import ExitStack

import pytest

from benchmarks import fleet_page
from benchmarks.fleet import Bench, Measured
from benchmarks.fleet_heard import delivery
from tests.programs import ROOT, inside

RIGS = 6
SECONDS = 3


@pytest.fixture(scope="module")
def measured() -> Measured:
    made = Measured(RIGS, processes=2)
    with ExitStack() as opened:
        bench = Bench(made, opened)
        bench.watch(verdict_hz=10)
        bench.steady("all are looked at", SECONDS, verdict_hz=10, look=True)
    return made


def test_every_status_and_every_event_arrives_once_and_in_order(measured):
    assert (measured.parts[-1].statuses.sent, measured.parts[-1].events.sent) == (SECONDS * RIGS, RIGS)
    for part in measured.parts:
        assert part.statuses.sent == part.statuses.arrived >= 3 * RIGS
        assert part.events.sent == part.events.arrived >= RIGS
        assert part.statuses.disordered + part.events.disordered + part.events.twice == 0


def test_verdicts_cross_the_routers_only_where_somebody_looks_and_the_site_router_thins_those_of_every_rig(measured):
    unseen, seen = measured.parts
    assert (unseen.verdicts_sent > 0, seen.verdicts_sent) == (True, 10 * SECONDS * RIGS)
    assert unseen.verdicts_arrived == {}
    assert len(seen.verdicts_arrived) == RIGS
    assert all(1 <= arrived <= SECONDS + 1 for arrived in seen.verdicts_arrived.values())


def test_watch_hears_all_of_them_at_once(measured):
    assert (measured.watched.heard, measured.watched.status) == (RIGS, 0)


def test_the_page_says_what_was_measured_and_keeps_what_is_around_it(measured):
    section = fleet_page.section(measured)
    assert f"| all are looked at | {SECONDS * RIGS} of {SECONDS * RIGS} (100.00 %) |" in section
    assert f"heard {RIGS} of {RIGS} rigs" in section
    page = (ROOT / "docs/fleet.md").read_text(encoding="utf-8")
    once = fleet_page.put_in(page, section)
    assert fleet_page.put_in(once, section) == once
    assert once.partition(fleet_page.BEGIN)[0] == page.partition(fleet_page.BEGIN)[0]
    assert once.partition(fleet_page.END)[2] == page.partition(fleet_page.END)[2]
    with pytest.raises(ValueError, match="measured: begin"):
        fleet_page.put_in("no marks", section)


def test_what_is_lost_doubled_or_out_of_order_is_counted():
    heard = [("a", 2), ("a", 4), ("a", 3), ("a", 4), ("b", 1)]  # a's 2 is of before
    told = delivery(heard, {"a": [2], "b": [0]}, {"a": [5], "b": [1]}, 0)
    assert (told.sent, told.arrived, told.twice, told.disordered) == (4, 3, 1, 1)


def test_the_rig_of_the_example_is_a_valid_one(tmp_path):
    done = inside("validate", ROOT / "examples/fleet/rig.yaml", "--no-environment", cwd=tmp_path)
    assert done.returncode == 0, done.stderr


def test_a_configuration_that_is_not_there_is_one_line():
    command = [sys.executable, str(ROOT / "examples/router.py"), "--config", "none.json5"]
    done = subprocess.run(command, capture_output=True, text=True, timeout=20, check=False)
    assert (done.returncode, len(done.stderr.splitlines())) == (1, 1), done.stderr
