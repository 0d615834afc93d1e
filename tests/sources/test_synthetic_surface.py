"""Measures single surfaces before a camera and compares with the pinhole equations."""

import cv2
import numpy as np
import pytest

from sources.synthetic.motion import Pose, rotation
from sources.synthetic.surface import Surface, View, render
from sources.synthetic.texture import Texture

WIDTH, HEIGHT, FOCAL_PX = 640, 480, 512.0
CENTRE_PX = (WIDTH - 1) / 2, (HEIGHT - 1) / 2
DOTS = [(u, v) for u in range(20, 200, 40) for v in range(20, 160, 40)]
DOT_SIGMA = 2.2


def dotted(width, height):
    y, x = np.mgrid[:height, :width]
    level = sum(200 * np.exp(-((x - u) ** 2 + (y - v) ** 2) / (2 * DOT_SIGMA**2)) for u, v in DOTS)
    grey = np.round(level).astype(np.uint8)
    return cv2.merge([grey, grey, grey, np.zeros_like(grey)])


@pytest.mark.parametrize("slant_deg", [0, 35, -50])
@pytest.mark.parametrize("mount", [(0, 0, 0), (7, -3, 5)])
def test_points_of_a_surface_appear_where_the_pinhole_equations_say(slant_deg, mount):
    turn = rotation(10, 4, slant_deg)
    quad_m = np.array([[-0.55, -0.4, 0], [1.1, 0, 0], [0, 0.8, 0]]) @ turn.T
    quad_m[0] += (0.1, 0.05, 2.5)
    texture = Texture(220, 160, dotted)
    rig = Pose(rotation(1, 2, -3), np.array([0.03, -0.02, 0.1]))
    view = View.of(rig, Pose(rotation(*mount), np.array([0.12, 0, 0])), FOCAL_PX, WIDTH, HEIGHT)
    canvas = np.zeros((HEIGHT, WIDTH), np.uint8)
    render(canvas, view, [Surface(quad_m, texture)])

    lens = np.array([[FOCAL_PX, 0, CENTRE_PX[0]], [0, FOCAL_PX, CENTRE_PX[1]], [0, 0, 1]])
    to_camera = (rig.rotation @ rotation(*mount)).T
    centre_m = rig.rotation @ (0.12, 0, 0) + rig.position_m
    spread = np.arange(-8, 9)
    du, dv = (offsets.ravel() for offsets in np.meshgrid(spread, spread))
    errors_px = []
    for u, v in DOTS:
        points_m = quad_m[0] + np.outer((u + du + 0.5) / 220, quad_m[1]) + np.outer((v + dv + 0.5) / 160, quad_m[2])
        x, y, w = lens @ to_camera @ (points_m - centre_m).T
        # A tilted dot's nearer half covers more of the picture: area goes with the cube of nearness.
        weights = np.exp(-(du**2 + dv**2) / (2 * DOT_SIGMA**2)) / w**3
        expected = np.array([(x / w * weights).sum(), (y / w * weights).sum()]) / weights.sum()
        errors_px.append(centroid(canvas, *expected) - expected)
    assert np.median(np.hypot(*np.transpose(errors_px))) < 0.03
    assert np.abs(np.mean(errors_px, axis=0)).max() < 0.01


def centroid(canvas, x, y, radius=12):
    left, top = round(x) - radius, round(y) - radius
    patch = canvas[top : top + 2 * radius + 1, left : left + 2 * radius + 1].astype(float)
    rows, columns = np.mgrid[: patch.shape[0], : patch.shape[1]]
    return np.array([left + (columns * patch).sum() / patch.sum(), top + (rows * patch).sum() / patch.sum()])


def white(size):
    return Texture(size, size, lambda width, height: np.full((height, width, 4), (200, 200, 200, 0), np.uint8))


def rendered(quad_m):
    """A white surface before a camera whose pixels are a hundredth wide at distance 1."""
    here = Pose(np.eye(3), np.zeros(3))
    canvas = np.zeros((101, 101), np.uint8)
    render(canvas, View.of(here, here, 100.0, 101, 101), [Surface(np.array(quad_m, float), white(40))])
    return canvas


@pytest.mark.parametrize("shift_px", np.arange(0, 2, 0.25))
def test_an_edge_falls_between_pixels_where_it_should(shift_px):
    canvas = rendered([[-0.2 + shift_px / 100, -0.2, 1], [0.4, 0, 0], [0, 0.4, 0]])

    left_edge_px = 50.5 - canvas[50, :51].sum() / 200
    assert left_edge_px == pytest.approx(30 + shift_px, abs=0.01)


def test_a_surface_that_reaches_behind_the_camera_shows_its_front_part_only():
    canvas = rendered([[-50, 1, 100], [100, 0, 0], [0, 0, -150]])

    assert (canvas[:50] == 0).all()
    assert (canvas[54:] == 200).all()


def test_what_lies_behind_the_camera_does_not_show_upside_down():
    tilted_floor_m = np.array([[-50, 1, 100], [100, 0, 0], [0, 0, -150]]) @ rotation(30, 0, 0).T
    canvas = rendered(tilted_floor_m)

    y, x = np.mgrid[-50:51, -50:51]
    below_horizon_px = y * np.cos(np.radians(30)) - x * np.sin(np.radians(30))
    assert (canvas[below_horizon_px < 0] == 0).all()
    assert (canvas[below_horizon_px > 4] == 200).all()


def test_the_back_of_a_surface_does_not_show():
    quad_m = [[-0.2, -0.2, 1], [0.4, 0, 0], [0, 0.4, 0]]
    turned_m = [[0.2, -0.2, 1], [-0.4, 0, 0], [0, 0.4, 0]]

    assert rendered(quad_m).any()
    assert not rendered(turned_m).any()
