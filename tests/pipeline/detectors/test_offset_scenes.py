"""Scenes that must not mislead the offset detector: it may be silent, but never confidently wrong."""

from __future__ import annotations

from collections.abc import Callable

import cv2
import numpy as np
import pytest

from pipeline.verdict import State
from tests.observe import observed, pictures, rendered

FPS = 30
COUNT = 70
STEADY = 30
Manipulation = Callable[[np.ndarray, int, bool], np.ndarray]


@pytest.fixture(scope="module")
def walk():
    return pictures(rendered(motion="handheld", duration_s=COUNT / FPS + 0.1), COUNT)


def wrong(evidence, shift):
    """Evidence that is confidently wrong: the wrong state, or an offset out of its error bar by a tenth of a frame."""
    found = []
    for item in evidence:
        if item.state is State.UNKNOWN:
            continue
        error = abs(item.offset_frames - shift)
        if (item.state is State.ASYNC) != (shift != 0) or (error > 0.1 and error > 2 * item.sigma_frames):
            found.append((item.state, item.offset_frames, item.sigma_frames))
    return found


def moved(left, right, shift):
    return (left, right) if shift == 0 else (left[:-shift], right[shift:])


def exposed_differently(image, index, second):
    return cv2.convertScaleAbs(image, alpha=0.6, beta=20) if second else image


def with_common_steps_of_brightness(image, index, second):
    return cv2.add(image, 40) if (index // 7) % 2 else image


def with_black_frames(image, index, second):
    return np.zeros_like(image) if index % 17 == 5 else image


def compressed(image, index, second):
    quality = 15 + 10 * ((index + second) % 3)
    return cv2.imdecode(cv2.imencode(".jpg", image, [cv2.IMWRITE_JPEG_QUALITY, quality])[1], cv2.IMREAD_GRAYSCALE)


def half_covered(image, index, second):
    covered = image.copy()
    covered[:, : image.shape[1] // 2] = STATIC[: image.shape[0], : image.shape[1] // 2]
    return covered


def with_somebody_crossing(image, index, second):
    crossed = image.copy()
    at = 4 * index - 60 + (0 if second else 18)
    from_px, to_px = max(at, 0), min(at + 70, image.shape[1])
    if to_px > from_px:
        bob = 6 + int(4 * np.sin(index / 3))
        crossed[40 + bob : 220 + bob, from_px:to_px] = STATIC[:180, from_px - at : to_px - at]
    return crossed


def portrait(image, index, second):
    return image[:, 60:240]


def odd(image, index, second):
    return cv2.resize(image, (217, 163), interpolation=cv2.INTER_AREA)


def in_colour(image, index, second):
    return cv2.cvtColor(image, cv2.COLOR_GRAY2BGR)


STATIC = cv2.GaussianBlur(np.random.default_rng(9).integers(0, 256, (240, 320), np.uint8), (0, 0), 2)
SCENES = [
    exposed_differently, with_common_steps_of_brightness, with_black_frames, compressed, half_covered,
    with_somebody_crossing, portrait, odd, in_colour,
]  # fmt: skip


@pytest.mark.parametrize("shift", [0, 1])
@pytest.mark.parametrize("scene", SCENES)
def test_what_happens_to_a_walk_never_misleads(walk, scene: Manipulation, shift):
    sides = [[scene(image, n, second) for n, image in enumerate(side)] for second, side in enumerate(walk)]
    assert wrong(observed(*moved(*sides, shift), FPS)[STEADY:], shift) == []


@pytest.mark.parametrize("scene", [exposed_differently, compressed, portrait, odd, in_colour])
def test_what_leaves_the_motion_visible_leaves_it_decided(walk, scene: Manipulation):
    sides = [[scene(image, n, second) for n, image in enumerate(side)] for second, side in enumerate(walk)]
    late = observed(*sides, FPS)[STEADY:]
    assert sum(item.state is State.SYNC for item in late) >= 0.8 * len(late)


def stripes(t, second):
    """Repeated texture that shakes across the rows."""
    y, x = np.mgrid[0:240, 0:320].astype(np.float32)
    shake = 3 * np.sin(t / 2.5) + 2 * np.sin(t / 1.7)
    wave = np.sin((x + (12 if second else 0)) * 0.35) * np.sin((y - shake) * 0.3)
    return (128 + 90 * wave).astype(np.uint8)


def nearly_textureless(t, second):
    rng = np.random.default_rng(1000 * t + second)
    picture = (120 + rng.normal(0, 2, (240, 320))).clip(0, 255).astype(np.uint8)
    for at in ((60, 60), (160, 200), (250, 100)):
        cv2.rectangle(picture, at, (at[0] + 6, at[1] + 6), 200, -1)
    return picture


@pytest.mark.parametrize("scene", [stripes, nearly_textureless])
@pytest.mark.parametrize("shift", [0, 1])
def test_poor_texture_never_misleads(scene, shift):
    sides = [[scene(t, second) for t in range(COUNT)] for second in (0, 1)]
    assert wrong(observed(*moved(*sides, shift), FPS)[STEADY:], shift) == []


@pytest.mark.parametrize("shift", [0, 1])
def test_driving_at_constant_speed_never_misleads(shift):
    source = rendered(motion="drive", drive={"speed_variation": 0, "pitch_deg": 0}, duration_s=COUNT / FPS + 0.1)
    assert wrong(observed(*moved(*pictures(source, COUNT), shift), FPS)[STEADY:], shift) == []


def test_every_second_window_is_enough_to_find_a_shift(walk):
    late = observed(*moved(*walk, 1), FPS, every=2)[STEADY::2]
    assert {item.state for item in late} == {State.ASYNC}
