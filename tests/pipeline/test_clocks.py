"""What two cameras' stamps tell of their clocks."""

from __future__ import annotations

import random
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import Phase, given, settings
from hypothesis import strategies as st

from pipeline.clocks import PairClock, middle_of_exposure_ns, start_of_exposure_ns
from pipeline.drift import Drift, DriftEstimator, tell_drift
from pipeline.frame import NS_PER_MS, NS_PER_S, StampOrigin, StampReference
from pipeline.notes import Note
from pipeline.verdict import Cause
from tests.frames import frame
from tests.pipeline.faults.streams import Scripted, delivered

FPS = 30
PERIOD_NS = round(NS_PER_S / FPS)
SECOND = FPS


def at(n: int) -> int:
    return round(n * NS_PER_S / FPS)


def followed(offset_ns, count: int = 60 * SECOND, *, clock: PairClock | None = None, **second):
    """The readings of pairs whose second stamp is off by `offset_ns(n)`."""
    clock = clock or PairClock(PERIOD_NS, PERIOD_NS)
    return [
        clock.see(frame("left", at(n)), frame("right", at(n) + round(offset_ns(n)), **second)) for n in range(count)
    ]


def noise(sigma_ms: float, seed: int = 0):
    chance = random.Random(seed)
    return lambda _: chance.gauss(0, sigma_ms * NS_PER_MS)


def read_faulted(fault, count: int = 60 * SECOND):
    clock = PairClock(PERIOD_NS, PERIOD_NS)
    frames = delivered(fault, source=Scripted(count=count, fps=FPS))
    slots: dict[int, dict[str, object]] = {}
    for item in frames:
        slots.setdefault(item.group, {})[item.camera] = item
    return [clock.see(slot["left"], slot["right"]) for slot in slots.values() if len(slot) == 2]


@pytest.mark.parametrize(("ppm", "jitter_ms"), [(417, 0), (417, 1), (100, 1), (-100, 0.5)])
def test_drift_is_within_a_tenth_after_a_minute(ppm, jitter_ms):
    jitter = noise(jitter_ms)
    drift = followed(lambda n: at(n) * ppm * 1e-6 + jitter(n))[-1].drift
    assert drift.ppm == pytest.approx(ppm, rel=0.1)
    assert drift.sure
    assert abs(drift.ppm - ppm) <= 4 * drift.sigma_ppm + 0.01


def test_the_drift_of_a_faulted_camera_is_found_and_noted():
    last = read_faulted({"type": "stamp_drift", "ppm": 100})[-1]
    assert last.drift.ppm == pytest.approx(100, abs=0.1)
    assert last.notes == (Note.CLOCK_DRIFT,)
    free = read_faulted({"type": "free_run", "ppm": 417, "renumber": True})[-1]
    assert free.drift.ppm == pytest.approx(-417, rel=0.01), "a fast camera takes each frame earlier"


def test_small_drift_under_jitter_is_met_within_its_error_and_sure_after_two_minutes():
    jitter = noise(2)
    readings = followed(lambda n: at(n) * 12e-6 + jitter(n), 120 * SECOND)
    minute, two = readings[60 * SECOND - 1].drift, readings[-1].drift
    assert 2 < minute.sigma_ppm < 4, "a least-squares line would have 2.7"
    assert abs(minute.ppm - 12) < 3 * minute.sigma_ppm
    assert two.sigma_ppm < 1.6
    assert two.sure
    assert two.ppm == pytest.approx(12, abs=4)


def drifts_of_noise(correlation_s: float, count: int, span_s: int = 60):
    keep = np.exp(-1 / FPS / correlation_s) if correlation_s else 0.0
    for seed in range(count):
        fresh = np.random.default_rng(seed).standard_normal(span_s * FPS) * 2 * NS_PER_MS * np.sqrt(1 - keep**2)
        estimator, value = DriftEstimator(), fresh[0] / np.sqrt(1 - keep**2)
        for n, new in enumerate(fresh):
            value = keep * value + new
            estimator.add(at(n), value)
        yield estimator.drift


@pytest.mark.parametrize("correlation_s", [0, 1, 5])
def test_the_error_of_a_drift_is_honest_for_noise_that_remembers(correlation_s):
    normalised = [drift.ppm / drift.sigma_ppm for drift in drifts_of_noise(correlation_s, 12)]
    assert 0.5 < np.sqrt(np.mean(np.square(normalised))) < 1.5
    assert not any(abs(each) > 4 for each in normalised)


def test_stamps_of_arrival_are_jitter_and_neither_drift_nor_steps():
    readings = read_faulted({"type": "stamp_jitter", "bias_ms": 20, "sigma_ms": 8})
    last = readings[-1]
    assert last.notes == (Note.JITTER,)
    assert last.jitter_ns == pytest.approx(8 * NS_PER_MS, rel=0.3)
    assert abs(last.offset_ns - 20 * NS_PER_MS) < 3 * last.offset_sigma_ns
    assert not any(reading.step or Note.CLOCK_DRIFT in reading.notes for reading in readings)


@pytest.mark.parametrize("jitter_ms", [0, 1, 8])
def test_a_step_of_one_frame_is_a_step_and_no_drift(jitter_ms):
    jitter = noise(jitter_ms, seed=3)
    readings = followed(lambda n: PERIOD_NS * (n >= 700) + jitter(n), 40 * SECOND)
    steps = [(n, reading.step) for n, reading in enumerate(readings) if reading.step]
    assert len(steps) == 1
    ((told_at, step),) = steps
    assert abs(step.pair - 700) <= (0 if jitter_ms < 8 else 4)
    assert told_at - 700 < 24
    assert step.size_ns == pytest.approx(PERIOD_NS, abs=3 * jitter_ms * NS_PER_MS + 1)
    assert not any(reading.drift and reading.drift.sure for reading in readings)
    assert readings[-1].offset_ns == pytest.approx(PERIOD_NS, abs=1.5 * jitter_ms * NS_PER_MS + 1)


def test_drift_goes_on_across_the_steps_of_pairing():
    """A camera that runs free is paired anew whenever it is half a period off."""
    jitter = noise(1)
    ramp = [at(n) * 2000e-6 for n in range(60 * SECOND)]
    readings = followed(lambda n: (ramp[n] + PERIOD_NS / 2) % PERIOD_NS - PERIOD_NS / 2 + jitter(n))
    steps = [reading.step for reading in readings if reading.step]
    assert [round(step.size_ns / PERIOD_NS, 1) for step in steps] == pytest.approx([-1.0] * 4, abs=0.1)
    assert readings[-1].drift.ppm == pytest.approx(2000, rel=0.02)


def test_a_trigger_lost_on_the_way_is_a_drift_from_then_on():
    jitter = noise(0.2)
    readings = followed(lambda n: max(0, at(n) - 20 * NS_PER_S) * 3000e-6 + jitter(n), 31 * SECOND)
    assert not readings[20 * SECOND - 1].drift.sure
    assert readings[30 * SECOND].drift.ppm == pytest.approx(3000, rel=0.1)
    assert not any(reading.step for reading in readings)


@pytest.mark.parametrize("offset_ns", [37 * NS_PER_S, -18 * NS_PER_S, 1_700_000_000 * NS_PER_S])
def test_of_clocks_of_other_epochs_only_changes_count(offset_ns):
    jitter = noise(0.1)
    readings = followed(lambda n: offset_ns + PERIOD_NS * (n >= 700) + jitter(n), 40 * SECOND)
    before, after = readings[600], readings[-1]
    assert before.notes == (Note.CLOCK_EPOCH,)
    assert before.epoch_ns == pytest.approx(offset_ns, abs=NS_PER_MS)
    assert abs(before.offset_ns) < NS_PER_MS
    assert after.offset_ns == pytest.approx(PERIOD_NS, abs=NS_PER_MS)
    assert [reading.step.pair for reading in readings if reading.step] == [700]


def test_cameras_with_clocks_of_their_own_are_only_compared_by_changes():
    clock = PairClock(PERIOD_NS, PERIOD_NS)
    for n in range(100):
        last = clock.see(frame("left", at(n)), frame("right", at(n) + 20 * NS_PER_MS, clock="own"))
    assert (last.offset_ns, last.epoch_ns) == (0, 20 * NS_PER_MS)


def test_a_clock_that_is_set_gets_a_new_epoch_at_its_frame():
    readings = followed(lambda n: 37 * NS_PER_S * (n >= 300), 20 * SECOND)
    (step,) = (reading.step for reading in readings if reading.step)
    assert (step.pair, step.size_ns) == (300, 37 * NS_PER_S)
    assert readings[299].notes == ()
    assert readings[-1].notes == (Note.CLOCK_EPOCH,)
    assert readings[-1].offset_ns == 0


@pytest.mark.parametrize(
    ("reference", "middle_ms", "start_ms"),
    [("start", 15, 10), ("middle", 10, 5), ("end", 5, 0), ("unknown", None, None)],
)
def test_stamps_are_moved_to_the_middle_and_to_the_start_of_the_exposure(reference, middle_ms, start_ms):
    item = frame("left", 10 * NS_PER_MS, exposure_ns=10 * NS_PER_MS, stamp_reference=StampReference(reference))
    assert middle_of_exposure_ns(item) == (None if middle_ms is None else middle_ms * NS_PER_MS)
    assert start_of_exposure_ns(item) == (None if start_ms is None else start_ms * NS_PER_MS)


def test_without_an_exposure_only_the_stamp_itself_is_known():
    item = frame("left", 10, stamp_reference=StampReference.MIDDLE)
    assert middle_of_exposure_ns(item) == 10
    assert start_of_exposure_ns(item) is None
    assert middle_of_exposure_ns(replace(item, stamp_reference=StampReference.END)) is None
    assert middle_of_exposure_ns(replace(item, stamp_origin=StampOrigin.ARRIVAL)) is None


def test_cameras_that_stamp_other_moments_of_the_same_exposure_are_corrected():
    clock = PairClock(PERIOD_NS, PERIOD_NS)
    exposure = {"exposure_ns": 8 * NS_PER_MS}
    for n in range(60):
        first = frame("left", at(n), stamp_reference=StampReference.MIDDLE, **exposure)
        second = frame("right", at(n) + 4 * NS_PER_MS, stamp_reference=StampReference.END, **exposure)
        reading = clock.see(first, second)
    assert (reading.interval_ns, reading.middle_ns, reading.offset_ns) == (4 * NS_PER_MS, 0, 0)
    assert reading.corrected
    assert reading.notes == (Note.STAMP_REFERENCE,)


def test_unequal_exposures_after_one_trigger_start_together_and_have_their_middles_apart():
    clock = PairClock(PERIOD_NS, PERIOD_NS)
    first, second = (
        frame(name, 0, stamp_reference=StampReference.START, exposure_ns=ms * NS_PER_MS)
        for name, ms in (("left", 2), ("right", 10))
    )
    reading = clock.see(first, second)
    assert (reading.start_ns, reading.middle_ns) == (0, 4 * NS_PER_MS)


def test_other_references_without_exposures_are_noted_and_not_corrected():
    clock = PairClock(PERIOD_NS, PERIOD_NS)
    first = frame("left", 0, stamp_reference=StampReference.START)
    reading = clock.see(first, frame("right", 4 * NS_PER_MS, stamp_reference=StampReference.END))
    assert not reading.corrected
    assert reading.notes == (Note.STAMP_REFERENCE,)


def test_synthesised_stamps_are_no_evidence():
    last = followed(lambda n: at(n) * 417e-6, 20 * SECOND, stamp_origin=StampOrigin.SYNTHESISED)[-1]
    assert (last.offset_ns, last.drift, last.jitter_ns, last.notes) == (None, None, None, ())


def test_a_restart_of_a_device_begins_anew():
    clock = PairClock(PERIOD_NS, PERIOD_NS)
    followed(lambda n: at(n) * 417e-6, 20 * SECOND, clock=clock)
    reading = clock.see(frame("left", 0), frame("right", 5 * NS_PER_S, epoch=1))
    assert reading.drift is None
    assert reading.epoch_ns == 5 * NS_PER_S


@given(st.integers(0, 2**32), st.lists(st.floats(-5, 5), min_size=30, max_size=120))
@settings(max_examples=10, deadline=None, derandomize=True, phases=[Phase.explicit, Phase.generate])
def test_no_order_of_jitter_makes_a_drift(seed, jitters):
    """Any noise, shuffled and repeated in other orders, is drift-free."""
    chance = random.Random(seed)
    shuffled: list[float] = []
    while len(shuffled) < 20 * SECOND:
        shuffled += chance.sample(jitters, len(jitters))
    readings = followed(lambda n: shuffled[n] * NS_PER_MS, 20 * SECOND)
    assert not any(reading.drift and reading.drift.sure for reading in readings)


def test_memory_is_bounded_however_long_it_runs():
    estimator, held = DriftEstimator(), []
    for n in range(100_000):
        estimator.add(at(n), at(n) * 50e-6 + (n * 7919 % 1000) * 1000)
        held.append(estimator.held)
    assert max(held[50_000:]) <= max(held[:50_000])
    assert max(held) < 700
    assert estimator.drift.ppm == pytest.approx(50, abs=0.1)
    clock, sizes = PairClock(PERIOD_NS, PERIOD_NS), []
    for n in range(20 * SECOND):
        clock.see(frame("left", at(n)), frame("right", at(n)))
        sizes.append(clock.held)
    assert max(sizes) < 800


def test_a_camera_that_runs_free_is_told_from_a_clock_that_drifts():
    ramp, none, vague = Drift(417, 2, 1), Drift(0.3, 2, 1), Drift(30, 200, 1)
    assert tell_drift(ramp, Drift(400, 10, 1)) is Cause.FREE_RUN
    assert tell_drift(None, Drift(400, 10, 1)) is Cause.FREE_RUN
    assert tell_drift(ramp, none) is Note.CLOCK_DRIFT
    assert tell_drift(none, ramp) is Cause.STAMPS_LIE
    assert tell_drift(ramp, vague) is None
    assert tell_drift(ramp, None) is None
    assert tell_drift(none, none) is None


def test_the_drift_of_pictures_uses_their_errors():
    estimator, chance = DriftEstimator(), random.Random(1)
    for n in range(30 * SECOND):
        bad = n % 3 == 0
        off = chance.gauss(0, 20e6 if bad else 1e6)
        estimator.add(at(n), at(n) * 417e-6 + off, 20e6 if bad else 1e6)
    assert estimator.drift.ppm == pytest.approx(417, abs=4 * estimator.drift.sigma_ppm)
    assert estimator.drift.sigma_ppm < 10


def test_steps_are_told_once_each():
    readings = followed(lambda n: PERIOD_NS * (n // 100 % 2), 10 * SECOND)
    steps = [reading.step.pair for reading in readings if reading.step]
    assert steps == [100, 200]
