"""What faults do to the pictures themselves."""

from __future__ import annotations

from dataclasses import replace

import cv2
import numpy as np
import pytest

from pipeline.faults.source import FaultedSource
from sources.synthetic.settings import SyntheticSettings
from sources.synthetic.source import SyntheticSource
from tests.frames import texture
from tests.pipeline.faults.streams import Rendered, Scripted, delivered

CLEAN = {"noise_sigma": 0}


class Textured(Scripted):
    """One picture a camera."""

    colour = False

    def frames(self):
        for item in super().frames():
            grey = texture(item.camera == "right", 64, 48)
            yield replace(item, image=np.dstack([grey] * 3) if self.colour else grey)


class Coloured(Textured):
    colour = True


def seen(fault, source=Textured, camera="right", **options):
    return [item.image for item in delivered(fault, source=source(count=4), camera=camera, **options)]


def rendered(*, faults=(), rotation_deg=(0, 0, 0)):
    """The right picture of a rig that stands still, turned one way or the other."""
    cameras = ({**CLEAN}, {**CLEAN, "rotation_deg": rotation_deg})
    settings = SyntheticSettings(motion="still", width=320, height=240, duration_s=0.05, cameras=cameras)
    return delivered(*faults, source=SyntheticSource(settings, seed=3), camera="right")[0].image


@pytest.mark.parametrize(
    ("turn", "rotation_deg"),
    [({"roll_deg": 5}, (5, 0, 0)), ({"pitch_deg": -4}, (0, -4, 0)), ({"yaw_deg": 4}, (0, 0, 4))],
)
def test_a_knocked_camera_sees_what_a_turned_one_sees(turn, rotation_deg):
    knock = {"type": "knock", "focal_px": 0.8 * 320, **turn}
    inner = (slice(40, 200), slice(50, 270))
    knocked, turned = rendered(faults=[knock])[inner], rendered(rotation_deg=rotation_deg)[inner]
    straight = rendered()[inner]
    assert np.mean(cv2.absdiff(knocked, turned)) < 0.2 * np.mean(cv2.absdiff(straight, turned))


def test_a_roll_leaves_the_middle_of_the_picture_where_it_is():
    upside_down = seen({"type": "knock", "roll_deg": 180})[0]
    assert np.abs(upside_down.astype(int) - texture(True, 64, 48)[::-1, ::-1]).max() <= 1


def test_a_knock_that_is_not_described_is_a_roll_of_half_a_degree():
    assert np.array_equal(seen({"type": "knock"})[0], seen({"type": "knock", "roll_deg": 0.5})[0])
    assert not np.array_equal(seen({"type": "knock", "yaw_deg": 1})[0], seen({"type": "knock", "yaw_deg": 0})[0])
    assert np.array_equal(seen({"type": "knock", "yaw_deg": 0})[0], texture(True, 64, 48))


@pytest.mark.parametrize("source", [Textured, Coloured])
@pytest.mark.parametrize("kind", ["knock", "dark", "swap", "frozen"])
def test_pictures_keep_their_shape_and_cannot_be_written_to(kind, source):
    for image in seen({"type": kind}, source):
        assert image.shape == ((48, 64, 3) if source is Coloured else (48, 64))
        assert image.dtype == np.uint8
        with pytest.raises(ValueError, match="read-only"):
            image[0, 0] = 1


def test_in_the_dark_there_is_nothing_but_noise_of_a_level():
    images = np.array(seen({"type": "dark"}), float)
    assert images.max() <= 8
    assert 0.5 < np.diff(images, axis=0).std() < 2, "which is another for every frame"


def test_swapped_cameras_show_each_others_pictures():
    assert np.array_equal(seen({"type": "swap"})[0], texture(False, 64, 48))
    assert np.array_equal(seen({"type": "swap"}, camera="left")[0], texture(True, 64, 48))


def test_what_happened_to_a_picture_before_the_swap_goes_with_it():
    stale = {"type": "content_shift", "frames": -1, "camera": "right"}
    frames = delivered(stale, {"type": "swap"}, camera="left")
    assert [int(item.image[0, 0]) for item in frames] == list(range(9))
    assert [item.truth.shown_ns for item in frames] == [n * 100_000_000 for n in range(9)]
    assert {item.truth.faults for item in frames} == {("content_shift", "swap")}


def test_a_frame_without_a_counterpart_goes_over_to_the_other_camera():
    frames = delivered({"type": "drop", "camera": "left", "every": 2}, {"type": "swap"})
    groups = {camera: [item.group for item in frames if item.camera == camera] for camera in ("left", "right")}
    assert groups == {"left": list(range(100, 110)), "right": list(range(100, 110, 2))}


def test_a_rig_of_three_swaps_the_two_that_are_named():
    class Three(Scripted):
        def __init__(self) -> None:
            super().__init__(count=1)
            self.cameras = (*self.cameras, replace(self.cameras[0], name="top"))

        def frames(self):
            names = [camera.name for camera in self.cameras]
            for item in super().frames():
                yield replace(item, image=np.full((2, 2), names.index(item.camera), np.uint8))

    def order(fault):
        return {item.camera: int(item.image[0, 0]) for item in delivered(fault, source=Three())}

    assert order({"type": "swap", "camera": "top", "partner": "right"}) == {"left": 0, "right": 2, "top": 1}
    assert order({"type": "swap"}) == {"left": 1, "right": 0, "top": 2}


def test_nothing_of_the_means_to_render_leaves_with_the_frames():
    source = FaultedSource(
        SyntheticSource(SyntheticSettings(width=32, height=32, duration_s=0.1), seed=0), lambda _: []
    )
    source.open()
    assert {type(item).__name__ for item in source.frames()} == {"Frame"}


def test_a_frozen_picture_stands_still_however_it_is_rendered_anew():
    free_run = {"type": "free_run", "ppm": -100_000}
    for later in (free_run, {"type": "slip", "frames": 0.5}, {"type": "content_shift", "frames": -0.5}):
        frames = delivered({"type": "frozen", "start_s": 0.3}, later, source=Rendered(), camera="right")
        assert {(int(item.image[0, 0]), item.truth.shown_ns) for item in frames[3:]} == {(30, 300_000_000)}


def test_faults_of_the_stamps_are_still_noted_where_the_picture_comes_from_elsewhere():
    offset = {"type": "stamp_offset", "start_s": 0.5}
    frames = delivered(offset, {"type": "content_shift", "frames": -1}, camera="right")
    first = next(item for item in frames if item.group == 105)
    assert set(first.truth.faults) == {"stamp_offset", "content_shift"}
