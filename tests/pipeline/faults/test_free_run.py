"""A free-running camera, frame by frame."""

from __future__ import annotations

from dataclasses import replace

import pytest

from pipeline.errors import InputError
from tests.pipeline.faults.streams import Scripted, delivered, seconds

FAST = {"type": "free_run", "ppm": 100_000}
SLOW = {"type": "free_run", "ppm": -50_000}


def right(fault, source):
    return {item.group - 100: item for item in delivered(fault, source=source, camera="right")}


def pictures(fault, source=None):
    return {n: int(item.image[0, 0]) for n, item in right(fault, source or Scripted(count=30)).items()}


def test_a_fast_camera_shows_pictures_of_a_recording_twice():
    """At a tenth too fast, slot n holds moment n / 1.1."""
    assert pictures(FAST) == {n: round(n / 1.1) for n in range(30)}


def test_a_slow_camera_leaves_pictures_out_and_ends_early():
    """At a twentieth too slow, slot n holds moment n / 0.95."""
    shown = pictures(SLOW)
    whole = {n: round(n / 0.95) for n in range(30) if n / 0.95 <= 29}
    assert shown == {**whole, **{n: 29 for n in shown if n not in whole}}
    assert max(shown) == 28, "no frame lies within a period of moment 30.5"


def test_it_runs_free_from_its_start_to_its_stop():
    shown = pictures({**FAST, "start_s": 1.0, "stop_s": 2.5})
    assert shown == {n: n if not 10 <= n < 25 else 10 + round((n - 10) / 1.1) for n in range(30)}


def test_ids_follow_by_whole_frames_unless_renumbered():
    ids = {n: item.sequence for n, item in right(FAST, Scripted(count=30)).items()}
    assert ids == {n: n + round(n / 1.1 - n) for n in range(30)}
    renumbered = right({**FAST, "renumber": True}, Scripted(count=30))
    assert {n: item.sequence for n, item in renumbered.items()} == {n: n for n in range(30)}


def test_the_nearest_frame_is_the_nearest_in_time_where_the_recording_has_a_gap():
    class Gap(Scripted):
        def frames(self):
            return (item for item in super().frames() if item.sequence not in range(5, 15))

    shown = pictures({**FAST, "start_s": 1.5}, Gap(count=30))
    assert shown == {n: n if n < 15 else round(15 + (n - 15) / 1.1) for n in shown}
    assert set(shown) == {*range(5), *range(15, 30)}


def test_a_hole_of_the_recording_stays_a_hole():
    class Hole(Scripted):
        def frames(self):
            return (item for item in super().frames() if item.camera == "left" or item.sequence != 12)

    assert set(pictures(FAST, Hole(count=30))) == {*range(12), *range(13, 30)}


def test_ids_may_be_missing():
    class NoIds(Scripted):
        def frames(self):
            return (replace(item, sequence=None) for item in super().frames())

    assert {item.sequence for item in right(FAST, NoIds(count=30)).values()} == {None}


@pytest.mark.parametrize("ppm", [90_000, -90_000])
def test_a_recording_is_not_kept_without_bound(ppm):
    with pytest.raises(InputError, match=r"^fault free_run: ppm: .* drifted past 300 frames after .* set stop_s$"):
        delivered({"type": "free_run", "ppm": ppm}, source=seconds(150, rendered=False))
    assert len(delivered({"type": "free_run", "ppm": ppm}, source=seconds(150))) == 9000, "rendered ones are not kept"
