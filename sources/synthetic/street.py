"""An endless street between house fronts, with vans and signs at its sides, hills ahead and the sky above."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import replace
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from sources.synthetic.surface import Surface
from sources.synthetic.texture import Material

if TYPE_CHECKING:
    from sources.synthetic.scene import Workshop

GROUND_M = 1.5
SIDE_M = 7.0
VISIBLE_M = 62.0
HAZE_M = 18.0
TUCK_M = 0.05
"""How far a stretch reaches under the nearer one, which is drawn over it, so that no gap shines through the edges."""

ROAD = Material("road", (35, 30, 30), (225, 230, 230), 120, 36)
HOUSE = Material("facade", (50, 60, 80), (200, 220, 245), 120, 46)
VAN = Material("shapes", (90, 50, 30), (250, 240, 235), 140, 48)
SIGN = Material("shapes", (30, 30, 150), (230, 250, 255), 130, 52, disc=True)
SKY = Material("clouds", (200, 160, 120), (255, 252, 250), 200, 14)
HILLS = Material("shapes", (70, 90, 60), (190, 205, 180), 115, 30)
PLAIN = Material("clouds", (60, 65, 60), (210, 215, 215), 120, 10)


class Row(NamedTuple):
    """Surfaces that come again every `every_m`, in turn; each stands at its place in the stretch that starts at 0."""

    every_m: float
    turns: tuple[tuple[Surface, ...], ...]

    def seen_from(self, z_m: float) -> Iterator[Surface]:
        """The farthest first; those that come into sight come out of the haze."""
        first, last = math.floor(z_m / self.every_m) - 1, math.floor((z_m + VISIBLE_M) / self.every_m)
        for index in range(last, first - 1, -1):
            ahead_m = index * self.every_m - z_m
            opacity = _smooth((VISIBLE_M - ahead_m) / HAZE_M)
            if opacity > 0:
                away_m = np.zeros((3, 3))
                away_m[0, 2] = index * self.every_m
                for surface in self.turns[index % len(self.turns)]:
                    yield Surface(surface.quad_m + away_m, surface.texture, opacity)


class Street:
    def __init__(self, workshop: Workshop) -> None:
        self._distant = _distance(workshop)
        # The ground hides nothing, and the fronts hide nothing that stands before them.
        self._rows = (_ground(workshop), *_fronts(workshop), _vans_and_signs(workshop))

    def surfaces(self, t_s: float, z_m: float) -> Iterator[Surface]:  # noqa: ARG002 - nothing moves but the rig
        yield from self._distant
        for row in self._rows:
            yield from row.seen_from(z_m)


def _distance(make: Workshop) -> list[Surface]:
    sky = make.surface(SKY, (-3, -3, 1), (6, 0, 0), (0, 3.05, 0))
    plain = make.surface(PLAIN, (-3, 0, 1), (6, 0, 0), (0, 1.5, 0))
    hills = make.surface(HILLS, (-0.5, -0.09, 1), (1.0, 0, 0), (0, 0.13, 0))
    tower = make.surface(HOUSE, (0.02, -0.16, 1), (0.06, 0, 0), (0, 0.165, 0))
    return [replace(surface, distant=True) for surface in (sky, plain, hills, tower)]


def _ground(make: Workshop) -> Row:
    every = 5.0
    edges = (2 * SIDE_M, 0.0, 0.0), (0.0, 0.0, -every - TUCK_M)
    textures = [make.texture(ROAD, *edges, (0.0, GROUND_M, 6.0)) for _ in range(7)]
    quad_m = np.array([(-SIDE_M, GROUND_M, every), *edges])
    return Row(every, tuple((Surface(quad_m, texture),) for texture in textures))


def _fronts(make: Workshop) -> tuple[Row, Row]:
    every = 9.0
    heights = (8.0, 6.2, 9.0, 7.0, 8.5, 6.6, 7.6)

    def row(side: int) -> Row:
        turns = []
        for height in heights[::side]:
            right, down = (0.0, 0.0, -side * (every + TUCK_M)), (0.0, height, 0.0)
            texture = make.texture(HOUSE, right, down, (side * SIDE_M, GROUND_M - height / 2, 8.0))
            corner = (side * SIDE_M, GROUND_M - height, every if side > 0 else -TUCK_M)
            turns.append((Surface(np.array([corner, right, down]), texture),))
        return Row(every, tuple(turns))

    return row(-1), row(1)


def _vans_and_signs(make: Workshop) -> Row:
    turns = []
    for side in (-1, 1, 1, -1, 1, -1, -1):
        base = (side * 4.3, GROUND_M, 8.0)
        van = make.crate(VAN, base, (1.8, 2.0, 3.6), 0)
        sign = make.board(SIGN, (-side * 4.2, -0.9, 6.0), 0.9, 0.9, 0)
        post = make.board(VAN, (-side * 4.2, 0.5, 6.01), 0.09, 2.0, 0)
        turns.append((*van, post, sign))
    return Row(10.0, tuple(turns))


def _smooth(x: float) -> float:
    """Rises from 0 to 1 without a kink in slope or curvature."""
    x = min(max(x, 0.0), 1.0)
    return x * x * x * (10 - 15 * x + 6 * x * x)
