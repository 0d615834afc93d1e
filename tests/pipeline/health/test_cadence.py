"""What ids and stamps tell of a camera: losses, repeats, jitter, wraps and resets."""

from __future__ import annotations

import random
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pipeline.frame import NS_PER_MS, NS_PER_S, Camera, StampOrigin
from pipeline.health.camera import CameraHealth
from pipeline.notes import Note
from tests.frames import frame
from tests.pipeline.faults.streams import Scripted, delivered

FPS = 30
PERIOD_NS = round(NS_PER_S / FPS)
GREY = np.full((2, 2), 128, np.uint8)

MINUTE = 60 * FPS


def at(n: float, fps: float = FPS) -> int:
    return round(n * NS_PER_S / fps)


def seen(frames, fps: float = FPS):
    """The health of a camera after these frames, each another grey, and the notes by the place of the frame."""
    health = CameraHealth(Camera("right", fps))
    greys = [np.full((2, 2), 100 + level, np.uint8) for level in range(97)]
    notes = [health.see(replace(item, image=greys[item.captured_ns // NS_PER_MS % 97])) for item in frames]
    return health.report(), {n: told for n, told in enumerate(notes) if told}


def stream(numbers, *, fps: float = FPS, sequence=lambda n: n, off_ns=lambda n: 0, **fields):
    return [frame("right", at(n, fps) + round(off_ns(n)), sequence(n), **fields) for n in numbers]


def faulted(*faults, count: int = MINUTE):
    return seen(delivered(*faults, source=Scripted(count=count, fps=FPS), camera="right"))


def noise(sigma_ms: float, seed: int = 0):
    chance = random.Random(seed)
    return lambda _: chance.gauss(0, sigma_ms * NS_PER_MS)


def losses(kept, count: int = MINUTE) -> int:
    return max(kept) + 1 - len(kept)


def lossy(probability: float, seed: int = 0, count: int = MINUTE):
    """Frames 0 to `count`, first and last ones kept, some lost."""
    chance = random.Random(seed)
    return [n for n in range(count) if n < 40 or n > count - 20 or chance.random() >= probability]


def test_a_camera_in_order_has_nothing_to_note():
    report, notes = faulted()
    assert notes == {}
    assert (report.frames, report.drops, report.duplicates) == (MINUTE, 0, 0)
    assert report.fps == pytest.approx(FPS, rel=1e-3)
    assert report.rate_error == pytest.approx(0, abs=1e-3)
    assert report.jitter_p99_ns < 10


def test_lost_frames_are_counted_by_their_ids_and_noted_at_once():
    report, notes = seen(stream([n for n in range(200) if n not in (100, 150, 151)]))
    assert (report.drops_by_sequence, report.drops_by_time) == (3, 0)
    assert notes == {100: (Note.DROP,), 149: (Note.DROP,)}


def test_frames_lost_behind_gapless_ids_are_found_from_time():
    report, notes = faulted({"type": "drop", "every": 40, "renumber": True})
    assert report.drops_by_sequence == 0
    assert report.drops_by_time == MINUTE // 40 - 1, "the last one ends the recording"
    assert set(notes.values()) == {(Note.DROP,)}
    assert min(notes) <= 41


@pytest.mark.parametrize("ids", ["gap", "no gap", "none"])
@pytest.mark.parametrize(("probability", "within"), [(0.05, 0.02), (0.3, 0.15)])
def test_random_losses_are_counted_with_and_without_ids(ids, probability, within):
    kept = lossy(probability)
    place = {n: i for i, n in enumerate(kept)}
    sequence = {"gap": lambda n: n, "no gap": place.get, "none": lambda _: None}[ids]
    report, _ = seen(stream(kept, sequence=sequence))
    assert report.drops == pytest.approx(losses(kept), rel=0 if ids == "gap" else within)
    assert report.fps == pytest.approx(FPS, rel=0.02), "lost frames are no slower rate"


@pytest.mark.parametrize("seed", [1, 2])
@pytest.mark.parametrize("sequence", [lambda n: n, lambda _: None])
def test_jitter_is_no_loss(sequence, seed):
    """Stamps of arrival: 20 ms late, 8 ms of noise at 30 fps."""
    jitter = noise(8, seed)
    report, notes = seen(stream(range(2 * MINUTE), sequence=sequence, off_ns=lambda n: 20 * NS_PER_MS + jitter(n)))
    assert report.drops == 0
    assert Note.JITTER in notes[2 * MINUTE - 1]
    assert report.fps == pytest.approx(FPS, rel=0.05)


def test_losses_are_found_from_time_even_under_the_jitter_of_arrival():
    jitter = noise(8)
    kept = [n for n in range(MINUTE) if n % 60 != 59]
    report, _ = seen(stream(kept, sequence=lambda _: None, off_ns=jitter))
    assert report.drops_by_time == pytest.approx(losses(kept), abs=3)


def test_jitter_is_measured_and_noted_only_when_it_is_large():
    report, notes = seen(stream(range(MINUTE), off_ns=noise(0.5)))
    assert notes == {}
    assert report.jitter_p50_ns == pytest.approx(0.674 * 0.5 * 2**0.5 * NS_PER_MS, rel=0.1)
    assert report.jitter_p99_ns == pytest.approx(2.576 * 0.5 * 2**0.5 * NS_PER_MS, rel=0.15)


@pytest.mark.parametrize("fps", [1, 10, 15, 25, 60])
def test_another_frame_rate_than_expected_is_stated_and_is_no_loss(fps):
    report, notes = seen(stream(range(300), fps=fps, off_ns=noise(0.2)))
    assert report.drops == 0
    assert report.rate_error == pytest.approx(fps / FPS - 1, abs=0.01)
    assert notes == {}


@pytest.mark.parametrize("slower", [15, 25, 28, 20])
def test_a_rate_that_falls_on_the_way_is_no_loss(slower):
    """A camera that exposes for longer in the dark."""
    frames = stream(range(300))
    later = [replace(item, captured_ns=item.captured_ns + at(300)) for item in stream(range(300), fps=slower)]
    renumbered = [replace(item, sequence=n + 300) for n, item in enumerate(later)]
    report, notes = seen([*frames, *renumbered])
    assert (report.drops, notes) == (0, {})
    assert report.fps == pytest.approx(slower, rel=0.01)


def test_every_second_frame_lost_is_seen_in_the_ids_and_in_the_rate():
    report, _ = seen(stream(range(0, 400, 2)))
    assert report.drops_by_sequence == 199
    assert report.rate_error == pytest.approx(0, abs=0.01), "the period behind the ids is that of the sensor"


def test_a_counter_that_steps_by_two_loses_nothing():
    report, notes = seen(stream(range(300), sequence=lambda n: 2 * n))
    assert (report.drops, notes) == (0, {})


@pytest.mark.parametrize("bits", [8, 16, 32])
def test_a_wrap_is_noted_and_no_loss_even_where_a_frame_is_lost_in_it(bits):
    size = 1 << bits
    numbers = [n for n in range(400) if n not in (199, 200, 201)]
    report, notes = seen(stream(numbers, sequence=lambda n: (n - 200) % size))
    assert report.drops == 3
    assert report.counter_resets >= 1
    assert set(notes[199]) == {Note.COUNTER_RESET, Note.DROP}


@given(bits=st.integers(1, 64), before=st.integers(10, 60), lost=st.integers(0, 2))
@settings(max_examples=25, deadline=None)
def test_a_counter_may_wrap_at_any_width(bits, before, lost):
    numbers = [n for n in range(120) if not before <= n < before + lost]
    report, _ = seen(stream(numbers, sequence=lambda n: (n - before) % (1 << bits)))
    assert report.drops == lost
    assert report.counter_resets >= (1 if bits > 1 else 0)


def test_the_recipe_of_a_wrap():
    report, notes = faulted({"type": "seq_wrap", "bits": 16, "start_s": 5}, count=300)
    assert report.drops == 0
    assert notes == {150: (Note.COUNTER_RESET,), 180: (Note.COUNTER_RESET,)}, "set to near its end, then wrapped"


@pytest.mark.parametrize(("start", "at_frame"), [(0, 1000), (70_000, 97), (200, 33)])
def test_a_counter_that_starts_again_is_reset_and_loses_nothing(start, at_frame):
    report, notes = seen(stream(range(1100), sequence=lambda n: start + n if n < at_frame else n - at_frame))
    assert report.drops == 0
    assert notes == {at_frame: (Note.COUNTER_RESET,)}


def test_ids_that_jump_while_time_does_not_are_a_reset():
    report, notes = faulted({"type": "seq_offset", "ids": 1, "start_s": 5}, count=300)
    assert (report.drops, notes) == (0, {150: (Note.COUNTER_RESET,)})


def test_an_epoch_starts_counters_and_stamps_anew():
    frames = stream(range(100)) + stream(range(100), epoch=1)
    report, notes = seen(frames)
    assert (report.restarts, report.drops, notes) == (1, 0, {100: (Note.RESTARTED,)})
    late, _ = seen([*frames, replace(frames[99])])
    assert late.out_of_order == 1


def test_a_frame_delivered_twice_is_a_duplicate_and_nothing_else():
    report, notes = faulted({"type": "frame_repeat", "every": 50}, count=300)
    assert (report.duplicates, report.drops, report.duplicate_timestamps) == (6, 0, 0)
    assert set(notes.values()) == {(Note.DUPLICATE_FRAME,)}
    assert list(notes) == [50 + 51 * n for n in range(6)]


def test_without_ids_a_frame_with_the_same_stamp_and_picture_is_a_duplicate():
    items = stream(range(100), sequence=lambda _: None)
    report, _ = seen([*items[:50], items[49], *items[50:]])
    assert report.duplicates == 1


def test_a_stamp_that_comes_again_with_another_frame_is_a_repeated_stamp():
    report, notes = faulted({"type": "stamp_repeat", "every": 50}, count=300)
    assert (report.duplicate_timestamps, report.duplicates, report.drops) == (6, 0, 0)
    assert set(notes.values()) == {(Note.DUPLICATE_TIMESTAMP,)}


def test_a_counter_that_never_moves_says_nothing():
    kept = [n for n in range(300) if n != 200]
    report, notes = seen(stream(kept, sequence=lambda _: 0))
    assert (report.duplicates, report.drops_by_time) == (0, 1)
    assert list(notes.values()) == [(Note.DROP,)]


def test_stamps_that_step_back_are_noted():
    report, notes = seen(stream(range(200), off_ns=lambda n: -3 * PERIOD_NS if n >= 100 else 0))
    assert report.backward_timestamps == 1
    assert notes == {100: (Note.BACKWARD_TIMESTAMP,)}
    assert report.drops == 0


def test_a_frame_that_was_overtaken_is_out_of_order_and_disturbs_nothing():
    items = stream(range(200))
    items.insert(105, items.pop(100))
    report, _ = seen(items)
    assert (report.out_of_order, report.counter_resets, report.backward_timestamps) == (1, 0, 1)


def test_a_clock_that_is_set_forward_has_not_lost_a_thousand_frames():
    report, _ = seen(stream(range(200), sequence=lambda _: None, off_ns=lambda n: 37 * NS_PER_S * (n >= 100)))
    assert report.drops == 0


def test_synthesised_stamps_show_no_gap_and_no_rate():
    kept = [n for n in range(300) if n not in (100, 101)]
    fields = {"stamp_origin": StampOrigin.SYNTHESISED}
    report, notes = seen(stream(kept, sequence=lambda _: None, **fields))
    assert (report.drops, report.fps, notes) == (0, None, {})
    numbered, _ = seen(stream(kept, **fields))
    assert numbered.drops_by_sequence == 2


@pytest.mark.parametrize(
    ("silent_ms", "note"), [(90, None), (110, Note.STALLED), (560, Note.STALLED), (610, Note.MISSING)]
)
def test_silence_is_a_stall_then_the_camera_is_missing(silent_ms, note):
    health = CameraHealth(Camera("right", FPS))
    for item in stream(range(100), image=GREY):
        health.see(item)
    assert health.tick(at(99) + silent_ms * NS_PER_MS) == (() if note is None else (note,))
    assert health.see(frame("right", at(120), 120, image=GREY)) == (Note.DROP,)
    assert health.tick(at(121)) == ()


def test_a_camera_never_heard_is_missing_from_the_first_tick_on():
    health = CameraHealth(Camera("right", FPS))
    assert health.tick(5 * NS_PER_S) == ()
    assert health.tick(5 * NS_PER_S + 601 * NS_PER_MS) == (Note.MISSING,)
