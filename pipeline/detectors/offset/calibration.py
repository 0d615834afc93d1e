"""What a calibration of two cameras says of the geometry that the offset detector would otherwise have to learn."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Literal, TypeAlias

import cv2
import numpy as np

from pipeline.detectors.offset.arrays import Floats, Mask
from pipeline.detectors.offset.geometry import PRIOR, TERMS, design
from pipeline.errors import InputError

Model: TypeAlias = Literal["radtan", "equidistant", "none"]
Size: TypeAlias = tuple[int, int]
"""Width and height, px."""

ROTATION_RAD = np.radians(0.05)
BASELINE = 0.002
FOCAL = 0.001
LENS = 0.005
"""How far a rig is from its calibration, standard deviations: what good calibrations of one rig differ by, and what
warming up bends. Rotations between the cameras (a mount bends by some hundredths of a degree); direction of the
baseline (a tenth of a degree); ratio of the focal lengths (a quarter of a pixel at the upper edge of VGA); distortion
(half a pixel in its corners, where a target is seldom held). All are far tighter than `PRIOR`, and none is zero: the
rig can still be learned."""

ASPECT = 0.01
"""Pictures whose aspect ratio differs by more were cropped: rounding of a 160 x 120 picture's height makes 0.8 %."""

GRID = (16, 12)
DEPTHS = 6
NEAREST = 0.25
"""The nearest points looked at are displaced by a quarter of the width; nearer ones are seldom in both pictures."""

FEWEST = 3 * TERMS
"""Of the 1152 points of the grid, so many must be in both pictures; fewer lie in a corner and fix no term."""

NEWTON_ROUNDS = 30
AGREES = 1e-6
"""Rays are found to this part of the focal length, a thousandth of a pixel; where they are not, the lens model
folds."""

SETTLED_PX = 0.001
"""A tenth of what Lucas-Kanade resolves, and less."""


@dataclass(frozen=True, slots=True, eq=False)
class Lens:
    """One camera.

    matrix: 3 x 3, px, pixel centres at whole numbers. coefficients: of the distortion `model`, in OpenCV's order:
    radtan 4, 5, 8, 12 or 14, equidistant 4 (its fisheye), none 0. size: the calibrated picture's, None if not known.
    """

    matrix: Floats
    coefficients: Floats
    model: Model
    size: Size | None


@dataclass(frozen=True, slots=True, eq=False)
class StereoCalibration:
    """Two cameras. A point X1 of the first one's coordinates (x right, y down, z ahead) is R X1 + T in the second's.

    rotation: R, 3 x 3. translation: T, 3, in any unit. rectified: the calibration is of rectified pictures.
    label: where it was read from, for messages.
    """

    label: str
    first: Lens
    second: Lens
    rotation: Floats
    translation: Floats
    rectified: bool


@dataclass(frozen=True, slots=True, eq=False)
class GeometryStart:
    """What is known of the terms of `geometry.design` before any picture is seen.

    terms: 8, picture widths. information: 8 x 8, their inverse covariance, in place of `PRIOR`'s. misfit_px: rms of
    what the calibration says beyond those terms, in pixels of the size asked for; infinite without common view.
    """

    terms: Floats
    information: Floats
    misfit_px: float


def for_pictures(calibration: StereoCalibration, first: Size, second: Size) -> StereoCalibration:
    """The calibration with its sizes checked against those of the recorded pictures, and filled in where not known.

    Pictures may be scaled. Raises InputError for those that were cropped or turned, which no calibration survives.
    """
    lenses = []
    for which, lens, size in (("first", calibration.first, first), ("second", calibration.second, second)):
        width, height = known = lens.size or size
        if abs(width * size[1] / (height * size[0]) - 1) > ASPECT:
            raise InputError(
                f"{calibration.label}: the {which} camera was calibrated with pictures of {width} x {height}, those "
                f"given are {size[0]} x {size[1]}: the aspect ratio may differ by {ASPECT:.0%}, as cropped pictures "
                "cannot be used - give uncropped pictures or their own calibration"
            )
        cx, cy = lens.matrix[0, 2], lens.matrix[1, 2]
        if not (0 <= cx <= width and 0 <= cy <= height):
            raise InputError(
                f"{calibration.label}: the principal point of the {which} camera, ({cx:g}, {cy:g}) px, lies outside "
                f"its picture of {width} x {height} - give the size of the calibrated pictures in the file"
            )
        lenses.append(replace(lens, size=known))
    return replace(calibration, first=lenses[0], second=lenses[1])


def epipolar_angle(calibration: StereoCalibration) -> float:
    """Degrees, 0 to 90, between the rows of the first picture and the way to the second camera.

    0: side by side; 90: one above the other, and displacements along the rows say nothing of depth.
    """
    way = calibration.first.matrix[:2, :2] @ (calibration.rotation.T @ calibration.translation)[:2]
    return float(np.degrees(np.arctan2(abs(way[1]), abs(way[0]))))


def geometry_start(calibration: StereoCalibration, size: Size) -> GeometryStart:
    """The terms that pictures reduced to `size` will show, and how far to trust them.

    Points all over the first picture, from infinity to `NEAREST`, are projected into both cameras; the terms are those
    that fit their displacement across the rows best (least squares). Their covariance adds up what `trust` grants any
    calibration and the misfit: what the eight terms cannot say, as of strong distortion, widens them, but never beyond
    `PRIOR`.

    The sizes of the calibration must be known (`for_pictures`), else ValueError.
    """
    focal = _focal(calibration)
    u, v, d, across = displacements(calibration, size)
    prior = np.diag(PRIOR**-2)
    if len(u) < FEWEST:
        return GeometryStart(np.zeros(TERMS), prior, float("inf"))
    columns = design(u, v, d)
    # Scaled by PRIOR, so that terms no point can tell apart stay small.
    terms = np.linalg.lstsq(columns * PRIOR, across, rcond=1e-9)[0] * PRIOR
    misfit = float(np.sqrt(np.mean((columns @ terms - across) ** 2)))
    # Of what the terms cannot say, any one direction of them may take up as much as the whole misfit.
    told = columns.T @ columns / len(u) + 1e-9 * prior
    covariance = np.diag(trust(focal) ** 2) + misfit**2 * _inverse(told)
    return GeometryStart(np.asarray(terms, np.float64), _inverse(covariance) + prior, misfit * size[0])


def trust(focal: float) -> Floats:
    """8: standard deviations of the terms of a calibrated rig; `focal` in picture widths.

    A small pitch a of the second camera displaces by f a (1 + v^2 / f^2), roll by a u, yaw by a u v / f, a camera
    ahead by a share s of the baseline by s v d / f (Hartley and Zisserman 2004, 9.2).
    """
    turn = ROTATION_RAD
    return np.array(
        [turn * focal, turn, FOCAL, BASELINE, turn / focal, turn / focal, BASELINE / focal, LENS], np.float64
    )


def aged(information: Floats, focal: float = 1.0) -> Floats:
    """8 x 8: what is left of something learned or calibrated, after a rig was warmed, carried and cooled again."""
    return _inverse(_inverse(information) + np.diag(trust(focal) ** 2))


def displacements(calibration: StereoCalibration, size: Size) -> tuple[Floats, Floats, Floats, Floats]:
    """N points seen by both cameras: u, v, displacement along and across the rows, as `design` has them.

    They lie on a grid of the first picture, at infinity and at distances that halve down to the nearest.
    """
    lenses = [reduced(lens, size) for lens in (calibration.first, calibration.second)]
    columns, rows = ((np.arange(n) + 0.5) / n for n in GRID)
    pixels = np.stack(np.meshgrid(columns * size[0], rows * size[1]), axis=-1).reshape(-1, 2) - 0.5
    rays, good = undistort(lenses[0], pixels)
    pixels, rays = pixels[good], rays[good]
    nearest = NEAREST * size[0] / lenses[0].matrix[0, 0]
    inverse_depths = np.repeat(np.concatenate([[0.0], nearest / 2.0 ** np.arange(DEPTHS - 1)]), len(rays))
    here = np.tile(pixels, (DEPTHS, 1))
    seen = _cross(calibration, np.tile(rays, (DEPTHS, 1)), inverse_depths)
    front = np.isfinite(seen[:, 0])
    here, seen = here[front], seen[front]
    there, good = _see(lenses[1], seen, size)
    step = (there[good] - here[good]) / size[0]
    u, v = ((here[good] - np.array(size) / 2) / size[0]).T
    return u, v, step[:, 0], step[:, 1]


class Epipolar:
    """The displacement across the rows that a calibration predicts for points of pictures reduced to `size`.

    Exact, distortion and all, where the eight terms only approximate: subtracted from what is measured, it leaves the
    terms of `unbiased_start`, whose misfit is none.
    """

    def __init__(self, calibration: StereoCalibration, size: Size) -> None:
        self._calibration = calibration
        self._first, self._second = (reduced(lens, size) for lens in (calibration.first, calibration.second))

    def across(self, at: Floats, along: Floats) -> tuple[Floats, Floats, Mask]:
        """N positions in the first picture (N x 2, px) and displacements along the rows (N, px), at equal times.

        Returns displacements across the rows (N, px), their change with that along (N, px per px), and which of the
        points the calibration can place (N); the others are 0. Newton's method on the inverse depth.
        """
        rays, good = undistort(self._first, np.asarray(at, np.float64))
        depth = np.zeros(len(rays))
        target = at[:, 0] + along
        slope = np.zeros_like(rays)
        there = np.full_like(rays, np.nan)
        with np.errstate(invalid="ignore", divide="ignore"):
            for _ in range(NEWTON_ROUNDS):
                there = self._there(rays, depth)
                slope = (self._there(rays, depth + 1e-6) - there) / 1e-6
                miss = there[:, 0] - target
                if not np.any(np.abs(miss) > SETTLED_PX):
                    break
                depth = depth - np.nan_to_num(miss / slope[:, 0], posinf=0, neginf=0).clip(-0.5, 0.5)
            known = good & (np.abs(there[:, 0] - target) <= SETTLED_PX)
            down, rate = there[:, 1] - at[:, 1], slope[:, 1] / slope[:, 0]
        return np.where(known, down, 0.0), np.where(known, rate, 0.0), known

    def _there(self, rays: Floats, inverse_depths: Floats) -> Floats:
        return project(self._second, _cross(self._calibration, rays, inverse_depths))


def unbiased_start(calibration: StereoCalibration) -> GeometryStart:
    """What is known of the terms that remain after `Epipolar.across` is subtracted: none, give or take `trust`."""
    information = np.diag(trust(_focal(calibration)) ** -2.0) + np.diag(PRIOR**-2)
    return GeometryStart(np.zeros(TERMS), information, 0.0)


def _focal(calibration: StereoCalibration) -> float:
    """The first camera's focal length in picture widths; ValueError where the size is not known."""
    if calibration.first.size is None or calibration.second.size is None:
        raise ValueError("sizes of the calibrated pictures are not known: call for_pictures first")
    return float(calibration.first.matrix[0, 0]) / calibration.first.size[0]


def _cross(calibration: StereoCalibration, rays: Floats, inverse_depths: Floats) -> Floats:
    """N x 2 rays of the second camera; NaN behind or nearly beside it, where no lens model reaches.

    inverse_depths: N, along the first camera's axis, in units of 1 / baseline.
    """
    baseline = calibration.translation / np.linalg.norm(calibration.translation)
    ahead = np.column_stack([rays, np.ones(len(rays))])
    seen = ahead @ calibration.rotation.T + inverse_depths[:, None] * baseline
    depth = np.where(seen[:, 2:] > 0.1, seen[:, 2:], np.nan)
    return np.asarray(seen[:, :2] / depth, np.float64)


def reduced(lens: Lens, size: Size) -> Lens:
    """The lens for its pictures reduced to `size` by averaging areas, as cv2.resize does: edges stay at edges."""
    assert lens.size is not None
    across, down = size[0] / lens.size[0], size[1] / lens.size[1]
    scaling = np.array([[across, 0, (across - 1) / 2], [0, down, (down - 1) / 2], [0, 0, 1]])
    return replace(lens, matrix=np.asarray(scaling @ lens.matrix, np.float64), size=size)


def project(lens: Lens, rays: Floats) -> Floats:
    """N x 2 pixels of N x 2 rays (x / z, y / z), distorted."""
    if lens.model == "radtan":
        points = np.column_stack([rays, np.ones(len(rays))])
        still = np.zeros(3)
        bent = cv2.projectPoints(points, still, still, np.eye(3), lens.coefficients)[0]
        rays = np.asarray(bent, np.float64).reshape(-1, 2)
    elif lens.model == "equidistant":
        bent = cv2.fisheye.distortPoints(rays[:, None], np.eye(3), lens.coefficients)
        rays = np.asarray(bent, np.float64).reshape(-1, 2)
    return np.asarray(rays @ lens.matrix[:2, :2].T + lens.matrix[:2, 2], np.float64)


def undistort(lens: Lens, pixels: Floats) -> tuple[Floats, Mask]:
    """N x 2 rays whose pixels these are, and which of them were found (Newton's method on `project`)."""
    inverse = np.linalg.inv(lens.matrix[:2, :2])
    rays = (pixels - lens.matrix[:2, 2]) @ inverse.T
    if len(rays) == 0:
        return rays, np.zeros(0, bool)
    right, down = np.array([1e-6, 0]), np.array([0, 1e-6])
    determinant = np.ones(len(rays))
    miss = np.zeros_like(rays)
    for _ in range(NEWTON_ROUNDS):
        value = project(lens, rays) @ inverse.T
        miss = value - pixels @ inverse.T
        if np.abs(miss).max() < AGREES:
            break
        a, c = ((project(lens, rays + right) @ inverse.T - value) / 1e-6).T
        b, d = ((project(lens, rays + down) @ inverse.T - value) / 1e-6).T
        determinant = a * d - b * c
        safe = np.where(np.abs(determinant) < 1e-3, 1e-3, determinant)
        step = np.column_stack([d * miss[:, 0] - b * miss[:, 1], a * miss[:, 1] - c * miss[:, 0]]) / safe[:, None]
        rays = rays - np.clip(step, -0.5, 0.5)
    return rays, (np.abs(miss).max(axis=1) < AGREES) & (determinant > 0)


def _see(lens: Lens, rays: Floats, size: Size) -> tuple[Floats, Mask]:
    """N x 2 pixels, and which of them lie in the picture and are no fold of the lens model."""
    if len(rays) == 0:
        return rays, np.zeros(0, bool)
    pixels = project(lens, rays)
    inside = np.all((pixels > -0.5) & (pixels < np.array(size) - 0.5), axis=1)
    back, found = undistort(lens, np.where(inside[:, None], pixels, lens.matrix[:2, 2]))
    return pixels, inside & found & (np.abs(back - rays).max(axis=1) < 100 * AGREES)


def _inverse(matrix: Floats) -> Floats:
    """The inverse of a symmetric positive matrix, exactly symmetric."""
    inverse = np.linalg.inv(matrix)
    return np.asarray((inverse + inverse.T) / 2, np.float64)
