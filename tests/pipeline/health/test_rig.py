"""What pictures tell of cameras, alone and beside each other."""

from __future__ import annotations

import pickle
from dataclasses import replace

import cv2
import numpy as np
import pytest

from pipeline.frame import NS_PER_MS, NS_PER_S, Camera
from pipeline.health.rig import RigHealth
from pipeline.notes import Note
from sources.synthetic.settings import SyntheticSettings
from sources.synthetic.source import SyntheticSource
from tests.frames import frame, texture
from tests.pipeline.faults.streams import Scripted, delivered

FPS = 30
RIG = (Camera("left", FPS), Camera("right", FPS))
GREY = np.full((2, 2), 128, np.uint8)
SMALL = {"width": 160, "height": 120, "fps": FPS}


def followed(frames, cameras=RIG):
    """The health of a rig after these frames, and the notes of each camera's frames in turn."""
    rig = RigHealth(cameras)
    notes = {camera.name: [] for camera in cameras}
    for item in frames:
        notes[item.camera].append(rig.see(item))
    return rig, notes


def rendered(*faults, duration_s=4.0, **scene):
    return delivered(
        *faults, source=SyntheticSource(SyntheticSettings(**SMALL, duration_s=duration_s, **scene), seed=1)
    )


def places(notes, note):
    return [n for n, told in enumerate(notes) if note in told]


def shown(pictures, *, camera="right"):
    return [frame(camera, n * NS_PER_S // FPS, n, image=image) for n, image in enumerate(pictures)]


def both(left, right):
    return [item for pair in zip(shown(left, camera="left"), shown(right), strict=True) for item in pair]


def noisy(picture, sigma, seed):
    off = np.random.default_rng(seed).standard_normal(picture.shape) * sigma
    return np.clip(np.rint(picture + off), 0, 255).astype(np.uint8)


def panned(count, sigma=2.0, step=2):
    wide = texture(5, 160 + step * count, 120)
    return [noisy(wide[:, step * n : step * n + 160], sigma, n) for n in range(count)]


@pytest.mark.parametrize(("motion", "within_s"), [("handheld", 1.2), ("objects", 1.5)])
def test_a_picture_that_stands_still_beside_a_moving_one_is_frozen(motion, within_s):
    _, notes = followed(rendered({"type": "frozen", "start_s": 1.5, "stop_s": 3.5}, motion=motion))
    frozen = places(notes["right"], Note.FROZEN)
    assert not places(notes["left"], Note.FROZEN)
    assert 45 + FPS - 1 <= frozen[0] <= 45 + FPS * within_s, "a second of motion after its onset"
    assert frozen == list(range(frozen[0], 105))


@pytest.mark.parametrize("scene", [{"motion": "handheld"}, {"motion": "objects"}, {"motion": "still"}])
def test_cameras_that_are_well_have_no_notes(scene):
    _, notes = followed(rendered(**scene))
    assert {note for told in notes.values() for each in told for note in each} == set()


def test_two_still_cameras_are_a_still_scene():
    _, notes = followed(rendered({"type": "frozen"}, {"type": "frozen", "camera": "left"}, motion="handheld"))
    assert not places(notes["left"], Note.FROZEN)
    assert not places(notes["right"], Note.FROZEN)


def test_a_live_camera_that_looks_elsewhere_shows_its_noise():
    still = [noisy(texture(1, 160, 120), 2, n) for n in range(200)]
    _, notes = followed(both(panned(200), still))
    assert not places(notes["right"], Note.FROZEN)


def test_a_frozen_picture_encoded_anew_is_below_the_noise_it_had():
    moving = panned(300)
    flicker = [noisy(moving[100], 0.05, n) if n % 5 == 0 else moving[100] for n in range(200)]
    _, notes = followed(both(moving, moving[:100] + flicker))
    assert 130 <= places(notes["right"], Note.FROZEN)[0] <= 140


def test_an_encoder_that_skips_what_does_not_change_is_not_frozen():
    """Every picture stands for 0.8 s, then there is a new one: longer than that, and it is frozen after all."""
    still = [noisy(texture(1, 160, 120), 2, n // 24) for n in range(240)]
    _, notes = followed(both(panned(400), still + [still[-1]] * 160))
    frozen = places(notes["right"], Note.FROZEN)
    assert frozen
    assert min(frozen) > 240


def test_dark_pictures_are_dark_and_not_frozen():
    _, notes = followed(rendered({"type": "dark", "start_s": 1, "stop_s": 2}, duration_s=3.0))
    assert places(notes["right"], Note.DARK) == list(range(30, 60))
    assert set(notes["right"][45]) == {Note.DARK}
    black = [np.zeros((120, 160), np.uint8)] * 90
    assert not places(followed(both(panned(90), black))[1]["right"], Note.FROZEN)


@pytest.mark.parametrize(("level", "dark"), [(16, True), (30, False)])
def test_dark_is_what_the_video_range_calls_black(level, dark):
    _, notes = followed(shown([np.full((48, 64), level, np.uint8)]))
    assert (Note.DARK in notes["right"][0]) is dark


@pytest.mark.parametrize(("share", "saturated"), [(0.7, True), (0.3, False)])
def test_a_picture_clipped_for_the_most_part_is_saturated(share, saturated):
    picture = np.full((100, 100, 3), 128, np.uint8)
    picture[: round(100 * share)] = 255
    _, notes = followed(shown([picture]))
    assert (Note.SATURATED in notes["right"][0]) is saturated


def blurred_from(pictures, start, sigma):
    return [cv2.GaussianBlur(each, (0, 0), sigma) if n >= start else each for n, each in enumerate(pictures)]


def test_a_camera_out_of_focus_is_blurred_against_its_own_past():
    sharp = panned(500, step=1)
    rig, notes = followed(both(sharp, blurred_from(sharp, 400, 2)))
    blurred = places(notes["right"], Note.BLURRED)
    assert 400 < blurred[0] <= 400 + FPS
    assert blurred == list(range(blurred[0], 500))
    assert rig.report()["right"].sharpness_ratio < 0.5
    assert not places(notes["left"], Note.BLURRED)


def test_a_camera_that_always_was_soft_is_not_blurred():
    sharp = panned(450, step=1)
    _, notes = followed(both(sharp, blurred_from(sharp, 0, 2)))
    assert not places(notes["right"], Note.BLURRED)


def test_less_contrast_or_a_blurred_moment_is_not_blur():
    sharp = panned(500, sigma=0, step=1)
    flat = [(100 + 0.3 * (each - 100.0)).astype(np.uint8) if n > 400 else each for n, each in enumerate(sharp)]
    shaken = [cv2.GaussianBlur(each, (0, 0), 2) if 400 < n < 400 + FPS // 2 else each for n, each in enumerate(flat)]
    _, notes = followed(both(sharp, shaken))
    assert not places(notes["right"], Note.BLURRED)


def test_when_all_cameras_lose_detail_the_scene_has_changed():
    soft = blurred_from(panned(500, step=1), 400, 2)
    _, notes = followed(both(soft, soft))
    assert len(places(notes["right"], Note.BLURRED)) <= 1
    assert not places(notes["left"], Note.BLURRED)[1:]


@pytest.mark.parametrize("start_s", [0, 3])
def test_a_camera_that_dies_is_missing_in_a_recording_read_at_any_speed(start_s):
    frames = delivered({"type": "dead", "start_s": start_s}, source=Scripted(count=200, fps=FPS))
    frames = [replace(item, arrived_ns=0, image=GREY) for item in frames]
    rig = RigHealth(RIG)
    missing = []
    for item in frames:
        rig.see(item)
        if rig.lasting()["right"] == (Note.MISSING,):
            missing.append(item.captured_ns)
    assert missing[0] == pytest.approx(start_s * NS_PER_S + 600 * NS_PER_MS, abs=70 * NS_PER_MS)
    assert missing[-1] == frames[-1].captured_ns
    assert rig.lasting()["left"] == ()


def test_a_camera_that_comes_back_is_well_again():
    frames = delivered({"type": "dead", "start_s": 2, "stop_s": 4}, source=Scripted(count=200, fps=FPS))
    rig, notes = followed(replace(item, image=GREY) for item in frames)
    assert rig.lasting()["right"] == ()
    assert rig.report()["right"].drops_by_sequence == 60
    assert len(notes["right"]) == 140


def test_cameras_that_lose_frames_or_run_at_other_rates_are_not_missing():
    cameras = (Camera("left", 30), Camera("right", 10))
    frames = [frame("left", n * NS_PER_S // 30, n, image=GREY) for n in range(600) if n % 3]
    frames += [frame("right", n * NS_PER_S // 10, n, image=GREY) for n in range(200)]
    rig = RigHealth(cameras)
    told = set()
    for item in sorted(frames, key=lambda item: item.captured_ns):
        rig.see(item)
        told |= {note for notes in rig.lasting().values() for note in notes}
    assert told == set()


def test_ticks_of_the_hosts_clock_find_a_rig_that_fell_silent():
    rig, _ = followed(replace(item, image=GREY) for item in delivered(source=Scripted(count=60, fps=FPS)))
    now_ns = 59 * NS_PER_S // FPS
    assert rig.tick(now_ns + 50 * NS_PER_MS) == {"left": (), "right": ()}
    assert rig.tick(now_ns + NS_PER_S) == {"left": (Note.MISSING,), "right": (Note.MISSING,)}


def test_a_change_of_resolution_is_no_error():
    pictures = [texture(1, 64, 48), texture(1, 320, 240), texture(1, 7, 3), np.zeros((1, 1, 3), np.uint8)] * 3
    rig, _ = followed(shown(pictures))
    assert rig.report()["right"].frames == 12


def test_memory_does_not_grow_with_the_stream():
    rig, sizes = RigHealth(RIG), []
    for n in range(12_000):
        if n % 97:
            rig.see(frame("right", n * NS_PER_S // FPS, n % 8192))
        if n in (5_000, 11_999):
            sizes.append(len(pickle.dumps(rig)))
    assert sizes[1] < 1.02 * sizes[0]
    assert sizes[1] < 100_000


def test_a_camera_that_the_rig_does_not_have_is_refused():
    with pytest.raises(KeyError, match="top"):
        RigHealth(RIG).see(frame("top", 0, 0))
