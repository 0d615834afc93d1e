import itertools
import threading
import time

import numpy as np
import pytest

from pipeline.errors import InputError
from pipeline.frame import NS_PER_S, StampOrigin, StampReference
from sources.synthetic.settings import SyntheticSettings
from sources.synthetic.source import START_NS, SyntheticSource

SMALL = {"width": 160, "height": 120, "duration_s": 0.4, "fps": 10}
CLEAN = {"noise_sigma": 0}
PERIOD_NS = 100_000_000


def opened(*, seed=1, clock_ns=lambda: 0, wait=None, **values):
    source = SyntheticSource(SyntheticSettings(**{**SMALL, **values}), seed=seed, clock_ns=clock_ns, wait=wait)
    source.open()
    return source


def by_camera(source):
    frames = {camera.name: [] for camera in source.cameras}
    for frame in source.frames():
        frames[frame.camera].append(frame)
    return frames


@pytest.mark.parametrize("motion", ["handheld", "drive", "pan", "objects", "still"])
def test_the_same_seed_gives_the_same_pictures_and_another_seed_others(motion):
    first, again, other = (
        [frame.image for frame in opened(motion=motion, seed=seed, duration_s=0.2).frames()] for seed in (1, 1, 2)
    )

    assert all(np.array_equal(a, b) for a, b in zip(first, again, strict=True))
    assert all(np.abs(a.astype(int) - b).mean() > 5 for a, b in zip(first, other, strict=True))


def test_the_seed_of_the_settings_wins_over_the_seed_of_the_run():
    fixed = [next(iter_frames(SyntheticSource(SyntheticSettings(seed=7, **SMALL), seed=run))).image for run in (1, 2)]

    assert np.array_equal(*fixed)
    assert not np.array_equal(next(opened(seed=1).frames()).image, fixed[0])


def iter_frames(source):
    source.open()
    return source.frames()


def test_a_picture_does_not_depend_on_what_was_rendered_before():
    source = opened(motion="drive", duration_s=3)
    in_turn = by_camera(source)["right"][25]

    assert np.array_equal(opened(motion="drive").picture_at("right", in_turn.truth.shown_ns), in_turn.image)


def test_frames_say_when_and_by_whom_they_were_taken():
    frames = list(opened(clock_ns=lambda: 77, cameras=[{}, {"offset_ms": 2.5, "exposure_ms": 8}]).frames())

    assert [(frame.group, frame.camera) for frame in frames] == [
        (number, camera) for number in range(4) for camera in ("left", "right")
    ]
    for frame in frames:
        moment_ns = START_NS + frame.group * PERIOD_NS + (2_500_000 if frame.camera == "right" else 0)
        assert (frame.sequence, frame.captured_ns, frame.clock) == (frame.group, moment_ns, "rig")
        assert (frame.truth.shown_ns, frame.truth.faults) == (moment_ns, ())
        assert (frame.stamp_reference, frame.stamp_origin) == (StampReference.MIDDLE, StampOrigin.DEVICE)
        assert (frame.arrived_ns, frame.epoch) == (77, 0)
        assert frame.exposure_ns == (8_000_000 if frame.camera == "right" else None)
        assert not frame.image.flags.writeable


def test_the_number_of_frames_is_known_beforehand():
    source = opened(fps=30, duration_s=0.5)

    assert source.frame_count == 15
    assert len(by_camera(source)["left"]) == 15


def test_an_offset_of_whole_frames_shows_the_later_frames():
    frames = by_camera(opened(baseline_m=0, cameras=[CLEAN, {**CLEAN, "offset_ms": 200}]))

    for left, right in zip(frames["left"][2:], frames["right"], strict=False):
        assert np.array_equal(left.image, right.image)
    assert not np.array_equal(frames["left"][0].image, frames["right"][0].image)


def test_an_offset_of_half_a_frame_shows_the_moment_between():
    source = opened(baseline_m=0, cameras=[CLEAN, {**CLEAN, "offset_ms": 50}])
    frames = by_camera(source)

    between = source.picture_at("left", frames["left"][1].truth.shown_ns + PERIOD_NS // 2)
    assert np.array_equal(frames["right"][1].image, between)


def test_a_free_running_camera_gains_on_the_trigger():
    frames = by_camera(opened(duration_s=1, cameras=[{}, {"rate_ppm": 1000}]))
    lead_ns = frames["left"][9].truth.shown_ns - frames["right"][9].truth.shown_ns

    assert lead_ns == pytest.approx(9 * PERIOD_NS * 1000e-6, rel=0.01)
    assert frames["right"][9].captured_ns == frames["right"][9].truth.shown_ns
    assert frames["right"][9].clock == "right"


def test_a_clock_of_its_own_stamps_off_but_shows_the_same_moment():
    frames = by_camera(opened(duration_s=1, cameras=[{}, {"clock": {"offset_ms": 40, "drift_ppm": 500}}]))

    for left, right in zip(frames["left"], frames["right"], strict=True):
        assert right.truth.shown_ns == left.truth.shown_ns
        elapsed_ns = left.captured_ns - START_NS
        assert right.captured_ns - left.captured_ns == pytest.approx(40_000_000 + 500e-6 * elapsed_ns, abs=1)
        assert (left.clock, right.clock) == ("rig", "right")


def test_clock_jitter_has_the_spread_asked_for_and_repeats_with_the_seed():
    settings = {"width": 32, "height": 32, "duration_s": 30, "motion": "still"}
    cameras = [{}, {"clock": {"jitter_ms": 2}}]
    errors_ms = [
        [(f.captured_ns - f.truth.shown_ns) / 1e6 for f in by_camera(opened(cameras=cameras, **settings))["right"]]
        for _ in range(2)
    ]

    assert errors_ms[0] == errors_ms[1]
    assert np.std(errors_ms[0]) == pytest.approx(2, rel=0.15)
    assert abs(np.mean(errors_ms[0])) < 0.4


def test_nothing_but_noise_differs_between_frames_of_a_still_scene():
    clean = by_camera(opened(motion="still", cameras=[CLEAN, {}]))

    assert all(np.array_equal(a.image, b.image) for a, b in itertools.pairwise(clean["left"]))
    assert not any(np.array_equal(a.image, b.image) for a, b in itertools.pairwise(clean["right"]))


@pytest.mark.parametrize("colour", [False, True])
def test_noise_has_the_spread_asked_for_and_is_fresh_in_every_frame(colour):
    cameras = [CLEAN, {"noise_sigma": 4}]
    source = opened(motion="still", baseline_m=0, colour=colour, cameras=cameras, width=320, height=240)
    clean, first, second = (
        source.picture_at(name, START_NS + ns).astype(float) for name, ns in (("left", 0), ("right", 0), ("right", 1))
    )

    assert first.shape == ((240, 320, 3) if colour else (240, 320))
    assert np.std(first - clean) == pytest.approx(4, rel=0.03)
    assert abs(np.mean(first - clean)) < 0.1
    assert abs(np.corrcoef((first - clean).ravel(), (second - clean).ravel())[0, 1]) < 0.02
    assert not np.allclose(first, second)


def test_noise_of_two_cameras_is_independent():
    source = opened(motion="still", baseline_m=0, cameras=[{"noise_sigma": 0, "name": "clean"}, {}, {}])
    clean, a, b = (source.picture_at(camera.name, START_NS).astype(float) for camera in source.cameras)

    assert abs(np.corrcoef((a - clean).ravel(), (b - clean).ravel())[0, 1]) < 0.03


def test_gain_and_offset_level_change_grey_levels_and_saturate():
    cameras = [CLEAN, {**CLEAN, "gain": 1.5, "offset_level": -40}, {**CLEAN, "offset_level": 20}]
    source = opened(baseline_m=0, cameras=cameras)
    plain, contrasty, bright = (source.picture_at(c.name, START_NS).astype(float) for c in source.cameras)

    assert np.array_equal(bright, np.clip(plain + 20, 0, 255))
    assert np.abs(contrasty - np.clip(1.5 * plain - 40, 0, 255)).max() <= 0.5
    assert (contrasty == 0).any()


def test_exposure_blurs_what_moves_about_the_middle_of_the_exposure():
    cameras = [{**CLEAN, "exposure_ms": 120}, CLEAN]
    source = opened(motion="pan", baseline_m=0, width=320, height=240, cameras=cameras)
    blurred = source.picture_at("left", START_NS + NS_PER_S).astype(float)

    def difference(late_ms):
        return np.abs(blurred - source.picture_at("right", START_NS + NS_PER_S + late_ms * 1_000_000)).mean()

    sharp = source.picture_at("right", START_NS + NS_PER_S).astype(float)
    assert np.abs(np.diff(blurred)).mean() < 0.75 * np.abs(np.diff(sharp)).mean()
    assert difference(0) < 0.8 * min(difference(-60), difference(60))


def test_a_still_scene_is_as_sharp_with_a_long_exposure():
    source = opened(motion="still", baseline_m=0, cameras=[{**CLEAN, "exposure_ms": 60}, CLEAN])

    assert np.array_equal(source.picture_at("left", START_NS), source.picture_at("right", START_NS))


def test_cameras_may_be_many_and_of_different_sizes():
    source = opened(cameras=[{}, {"width": 64, "height": 48}, {"width": 200}], duration_s=0.1)

    assert [camera.name for camera in source.cameras] == ["cam0", "cam1", "cam2"]
    assert [frame.image.shape for frame in source.frames()] == [(120, 160), (48, 64), (120, 200)]


def test_cameras_looking_anywhere_see_a_scene():
    turns = [{"rotation_deg": (0, 0, yaw), **CLEAN} for yaw in range(0, 360, 45) if yaw <= 180]
    turns += [{"rotation_deg": (0, pitch, 0), **CLEAN} for pitch in (-90, 90)]
    source = opened(cameras=turns)

    for camera in source.cameras:
        picture = source.picture_at(camera.name, START_NS)
        assert (picture == 128).mean() < 0.05, f"{camera.name} sees the bare background"
        assert picture.std() > 10


def test_an_unknown_camera_is_named_together_with_the_known_ones():
    with pytest.raises(InputError, match="'top'; this rig has left, right"):
        opened().picture_at("top", START_NS)


def test_no_frame_is_lost_to_a_slow_detector_even_when_paced():
    assert not opened(speed=2.0).live


def test_stop_ends_iteration_at_once_and_may_come_first():
    source = opened(duration_s=1000)
    frames = source.frames()
    next(frames)
    source.stop()
    source.stop()

    assert list(frames) == []
    assert list(source.frames()) == []


def test_stop_wakes_a_paced_source():
    source = opened(duration_s=1000, fps=0.01, speed=1.0, clock_ns=time.monotonic_ns)
    frames = source.frames()
    next(frames), next(frames)
    threading.Timer(0.05, source.stop).start()

    assert list(frames) == []


@pytest.mark.parametrize(("speed", "spacing_ns"), [(1.0, PERIOD_NS), (4.0, PERIOD_NS // 4)])
def test_pacing_follows_the_clock(speed, spacing_ns):
    clock = Clock()
    source = opened(speed=speed, clock_ns=clock.now_ns, wait=clock.wait, cameras=[{}, {"offset_ms": 40}])
    arrivals = by_camera(source)

    assert np.diff([f.arrived_ns for f in arrivals["left"]]) == pytest.approx([spacing_ns] * 3, abs=10)
    assert arrivals["right"][2].arrived_ns - arrivals["left"][2].arrived_ns == pytest.approx(0.4 * spacing_ns, abs=10)


def test_full_speed_never_waits():
    clock = Clock()
    list(opened(clock_ns=clock.now_ns, wait=clock.wait).frames())

    assert clock.now_ns() == Clock().now_ns()


class Clock:
    """Time that passes only by waiting."""

    def __init__(self) -> None:
        self._ns = 5 * NS_PER_S

    def now_ns(self):
        return self._ns

    def wait(self, seconds):
        self._ns += round(seconds * NS_PER_S) + 1
        return False
