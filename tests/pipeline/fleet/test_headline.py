"""How a rig stands, in words."""

from __future__ import annotations

import pytest

from pipeline.fleet.headline import Tone, ago, headline
from pipeline.fleet.table import Presence, RigView
from pipeline.frame import NS_PER_S
from tests.pipeline.fleet.said import status

UNKNOWN = {"left-right": {"state": "unknown", "since_ns": 0}}


def view(presence=Presence.ALIVE, said=None, silent_s=0) -> RigView:
    return RigView("cart", presence, said, silent_s * NS_PER_S, (), {}, ())


@pytest.mark.parametrize(
    ("rig", "tone", "word"),
    [
        (view(said=status()), Tone.GOOD, "In sync"),
        (view(said=status(pairs=UNKNOWN)), Tone.UNSURE, "Cannot tell"),
        (view(said=status(pairs={})), Tone.UNSURE, "Cannot tell"),
        (view(), Tone.UNSURE, "Starting"),
        (view(said=status("warn", reasons=["left sees nothing"])), Tone.WARN, "Warning"),
        (view(said=status("error", reasons=["left-right: late"])), Tone.BAD, "Out of sync"),
        (view(said=status("stale", reasons=["no frames for 6 s"])), Tone.BAD, "No frames"),
        (view(Presence.GONE, status()), Tone.AWAY, "Monitor gone"),
        (view(Presence.STALE, status()), Tone.AWAY, "Stale"),
        (view(Presence.UNHEARD, status()), Tone.AWAY, "Cut off"),
    ],
)
def test_a_rig_stands_as_its_monitor_says_and_as_its_monitor_is_there(rig, tone, word):
    said = headline(rig)
    assert (said.tone, said.word) == (tone, word)


def test_what_was_heard_last_is_said_of_a_monitor_that_is_gone():
    said = headline(view(Presence.GONE, status("error"), silent_s=200))
    assert said.detail.endswith("last heard 3 min ago: out of sync")


def test_of_a_monitor_that_never_said_anything_nothing_is_made_up():
    assert headline(view(Presence.GONE)).detail.endswith("nothing was ever heard of it")


@pytest.mark.parametrize(
    ("seconds", "text"), [(0, "0 s"), (119, "119 s"), (120, "2 min"), (7200, "2 h"), (7 * 86400, "7 days")]
)
def test_ages_are_told_in_fitting_units(seconds, text):
    assert ago(seconds * NS_PER_S) == text
