"""What a scene is, and the workshop in which surfaces are cut and painted."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Protocol, TypeAlias

import numpy as np

from sources.synthetic.motion import Array, rotation
from sources.synthetic.surface import Surface, extents_px
from sources.synthetic.texture import Material, Texture, painted

Vector: TypeAlias = "tuple[float, float, float] | Array"


class Scene(Protocol):
    def surfaces(self, t_s: float, z_m: float) -> Iterator[Surface]:
        """Everything to be drawn at time `t_s` for a rig that has come `z_m` forward, the farthest first."""
        ...


class Workshop:
    """Makes surfaces, painted with one texel a pixel where the rig's sharpest camera sees them from the start."""

    def __init__(self, seed: int, focal_px: float, *, colour: bool) -> None:
        self._seed = seed
        self._focal_px = focal_px
        self._colour = colour
        self._made = 0

    def texture(self, material: Material, right_m: Vector, down_m: Vector, centre_m: Vector) -> Texture:
        """A texture for a rectangle with these edges about this place."""
        self._made += 1
        rng, colour = np.random.default_rng([self._seed, 1, self._made]), self._colour
        quad_m = _quad(np.subtract(centre_m, np.add(right_m, down_m) / 2), right_m, down_m)
        columns, rows = extents_px(quad_m[None], self._focal_px)[0].tolist()
        return Texture(columns, rows, lambda width, height: painted(rng, material, width, height, colour=colour))

    def surface(self, material: Material, corner_m: Vector, right_m: Vector, down_m: Vector) -> Surface:
        centre_m = np.add(corner_m, np.add(right_m, down_m) / 2)
        return Surface(_quad(corner_m, right_m, down_m), self.texture(material, right_m, down_m, centre_m))

    def board(self, material: Material, centre_m: Vector, width_m: float, height_m: float, yaw_deg: float) -> Surface:
        """An upright rectangle; at yaw 0 it faces the rig."""
        right, down = rotation(0, 0, yaw_deg) @ (width_m, 0, 0), np.array([0, height_m, 0])
        return self.surface(material, np.subtract(centre_m, (right + down) / 2), right, down)

    def crate(self, material: Material, base_m: Vector, size_m: Vector, yaw_deg: float) -> list[Surface]:
        """A box standing on the middle of its base: lid, left, right and front; nothing else shows."""
        x, y, z = np.diag(size_m) @ rotation(0, 0, yaw_deg).T
        front, back = base_m - y - z / 2, base_m - y + z / 2
        return [
            self.surface(material, back - x / 2, x, -z),
            self.surface(material, back - x / 2, -z, y),
            self.surface(material, front + x / 2, z, y),
            self.surface(material, front - x / 2, x, y),
        ]


def _quad(corner_m: Vector, right_m: Vector, down_m: Vector) -> Array:
    return np.array([corner_m, right_m, down_m], np.float64)
