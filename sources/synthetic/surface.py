"""Flat textured surfaces in space, and drawing them as a pinhole camera sees them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, TypeAlias, cast

import cv2
import numpy as np
import numpy.typing as npt

from sources.synthetic.texture import MARGIN

if TYPE_CHECKING:
    from pipeline.frame import Picture
    from sources.synthetic.motion import Array, Pose
    from sources.synthetic.texture import Texture

NEAR_M = 0.05
CLEAR = (0, 0, 0, 255)
CORNERS = np.array([[1, 0, 0], [1, 1, 0], [1, 1, 1], [1, 0, 1]])
"""What of a rectangle's corner, right and down edge adds up to each of its corners, in turn."""

Flags: TypeAlias = npt.NDArray[np.bool_]

Polygon: TypeAlias = Sequence[Sequence[float]]
"""A polygon in homogeneous image coordinates."""


@dataclass(frozen=True, slots=True)
class Surface:
    """A rectangle: rows of `quad_m` are its upper left corner and its edges to the right and down, read from its front.

    A distant surface is so far away that only directions count: moving does not bring it nearer.
    """

    quad_m: Array
    texture: Texture
    opacity: float = 1.0
    distant: bool = False

    def moved(self, pose: Pose) -> Surface:
        quad_m = self.quad_m @ pose.rotation.T
        quad_m[0] += pose.position_m
        return Surface(quad_m, self.texture)


@dataclass(frozen=True, slots=True)
class View:
    """A camera at a moment. `projection` @ (point - centre_m) is the point's homogeneous pixel.

    All cameras of a rig share the vantage point and so choose the same level of detail.
    """

    projection: Array
    centre_m: Array
    vantage_m: Array
    focal_px: float
    width: int
    height: int

    @classmethod
    def of(cls, rig: Pose, mount: Pose, focal_px: float, width: int, height: int) -> View:
        lens = np.array([[focal_px, 0, (width - 1) / 2], [0, focal_px, (height - 1) / 2], [0, 0, 1]])
        turned = rig.rotation @ mount.rotation
        centre_m = rig.rotation @ mount.position_m + rig.position_m
        return cls(lens @ turned.T, centre_m, rig.position_m, focal_px, width, height)


def extents_px(quads_m: Array, focal_px: float) -> Array:
    """How many pixels the edges of rectangles span when a camera at the origin looks straight at their centres."""
    edges_m = quads_m[:, 1:]
    centres_m = quads_m[:, 0] + edges_m.sum(axis=1) / 2
    distances_m = np.maximum(np.sqrt((centres_m**2).sum(axis=1)), NEAR_M)
    along_m = np.einsum("nij,nj->ni", edges_m, centres_m) / distances_m[:, None]
    across_m = np.sqrt(np.maximum((edges_m**2).sum(axis=2) - along_m**2, 0))
    return np.asarray(across_m * (focal_px / distances_m[:, None]), np.float64)


def render(canvas: Picture, view: View, surfaces: Sequence[Surface]) -> None:
    """Draws the surfaces, each over those before it. Backs do not show."""
    quads_m = np.array([surface.quad_m for surface in surfaces])
    near = np.array([not surface.distant for surface in surfaces])
    quads_m[near, 0] -= view.vantage_m
    sizes_px = extents_px(quads_m, view.focal_px)
    quads_m[near, 0] -= view.centre_m - view.vantage_m
    quads_px = quads_m @ view.projection.T

    shown = np.flatnonzero((np.linalg.det(quads_m) > 0) & _in_sight(quads_px, view))
    textures = [surfaces[i].texture.level(*size) for i, size in zip(shown, sizes_px[shown].tolist(), strict=True)]
    shapes = [texels.shape[1::-1] for texels in textures]
    to_image, corners = _laid_out(quads_px[shown], np.array(shapes).reshape(-1, 2))
    boxes = _boxes(corners, view)
    to_image[:, :2] -= boxes[:, :2, None] * to_image[:, 2:]
    crossing = corners[:, :, 2].min(axis=1) < NEAR_M
    for i, texels, to_box, box, crosses in zip(shown, textures, to_image, boxes.tolist(), crossing, strict=True):
        _draw(canvas, texels, to_box, box, crosses=crosses, opacity=surfaces[i].opacity)


def _in_sight(quads_px: Array, view: View) -> Flags:
    """Which rectangles may show: those that are not all beyond one border of the picture."""
    slack_px = 8
    borders = _borders(-slack_px, -slack_px, view.width + slack_px, view.height + slack_px)
    beyond = CORNERS @ quads_px @ np.array(borders).T < 0
    return np.asarray(~np.any(np.all(beyond, axis=1), axis=1))


def _laid_out(quads_px: Array, texels: npt.NDArray[np.int64]) -> tuple[Array, Array]:
    """For each surface the homography from its texels to pixels, and the homogeneous pixels of its corner texels."""
    steps = quads_px[:, 1:] / (texels - 2 * MARGIN)[:, :, None]
    firsts = quads_px[:, :1] + (0.5 - MARGIN) * steps.sum(axis=1, keepdims=True)
    spans = np.concatenate([firsts, steps * (texels - 1)[:, :, None]], axis=1)
    return np.concatenate([steps, firsts], axis=1).transpose(0, 2, 1), CORNERS @ spans


def _boxes(corners: Array, view: View) -> npt.NDArray[np.int64]:
    """The left, top, right and bottom of the part of the picture that each surface touches."""
    with np.errstate(divide="ignore", invalid="ignore"):
        flat = corners[:, :, :2] / corners[:, :, 2:]
    bounds = np.concatenate([flat.min(axis=1), flat.max(axis=1)], axis=1)
    for i in np.flatnonzero(corners[:, :, 2].min(axis=1) < NEAR_M):
        part = np.array(clipped(corners[i].tolist(), view)).reshape(-1, 3)
        flat_part = part[:, :2] / part[:, 2:]
        bounds[i] = (*flat_part.min(axis=0), *flat_part.max(axis=0)) if len(part) else 0
    lowest, highest = np.zeros(4), np.array([view.width, view.height] * 2)
    boxes = np.clip(np.concatenate([np.floor(bounds[:, :2]), np.ceil(bounds[:, 2:]) + 1], axis=1), lowest, highest)
    # The warp is half as fast where a row ends within its stride of 16 pixels.
    boxes[:, 2] = np.minimum(boxes[:, 0] + np.ceil((boxes[:, 2] - boxes[:, 0]) / 16) * 16, view.width)
    return np.asarray(boxes, np.int64)


def _draw(
    canvas: Picture, texels: Picture, to_box: Array, box: Sequence[int], *, crosses: bool, opacity: float
) -> None:
    left, top, right, bottom = box
    if right <= left or bottom <= top:
        return
    patch = cv2.warpPerspective(texels, to_box, (right - left, bottom - top), flags=cv2.INTER_LINEAR, borderValue=CLEAR)
    if crosses:
        _hide_what_is_behind(patch, to_box)
    _blend(canvas[top:bottom, left:right], cast("Picture", patch), opacity)


def _borders(left: float, top: float, right: float, bottom: float) -> list[tuple[float, float, float]]:
    """Half-planes, each a row that gives no less than 0 for the homogeneous pixels on its good side."""
    return [(0, 0, 1), (1, 0, -left), (-1, 0, right), (0, 1, -top), (0, -1, bottom)]


def clipped(corners: Polygon, view: View) -> Polygon:
    """The part of a polygon that is before the camera and inside the picture."""
    for (a, b, c), d in zip(
        _borders(-0.5, -0.5, view.width - 0.5, view.height - 0.5), (-NEAR_M, 0, 0, 0, 0), strict=True
    ):
        kept: list[Sequence[float]] = []
        for p, q in zip(corners, [*corners[1:], *corners[:1]], strict=True):
            at_p = a * p[0] + b * p[1] + c * p[2] + d
            at_q = a * q[0] + b * q[1] + c * q[2] + d
            if at_p >= 0:
                kept.append(p)
            if (at_p >= 0) != (at_q >= 0):
                s = at_p / (at_p - at_q)
                kept.append((p[0] + s * (q[0] - p[0]), p[1] + s * (q[1] - p[1]), p[2] + s * (q[2] - p[2])))
        corners = kept
    return corners


def _hide_what_is_behind(patch: npt.NDArray[Any], to_box: Array) -> None:
    """Clears the pixels whose line of sight meets the plane behind the camera: there it shows upside down."""
    a, b, c = np.linalg.inv(to_box)[2]
    y, x = np.ogrid[: patch.shape[0], : patch.shape[1]]
    patch[a * x + b * y + c <= 0] = CLEAR


def _blend(canvas: Picture, patch: Picture, opacity: float) -> None:
    if opacity < 1:
        clear = np.full_like(patch, CLEAR)
        patch = cast("Picture", cv2.addWeighted(patch, opacity, clear, 1 - opacity, 0))
    see_through = cv2.extractChannel(patch, 3)
    if canvas.ndim == 3:
        see_through, paint = cv2.cvtColor(see_through, cv2.COLOR_GRAY2BGR), cv2.cvtColor(patch, cv2.COLOR_BGRA2BGR)
    else:
        paint = cv2.extractChannel(patch, 0)
    cv2.multiply(canvas, see_through, dst=canvas, scale=1 / 255)
    cv2.add(canvas, paint, dst=canvas)
