"""A room with brick walls, a boarded floor, pictures, crates and screens, and things that may hover in it."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

import numpy as np

from sources.synthetic.motion import Motion, hovering
from sources.synthetic.surface import Surface
from sources.synthetic.texture import Material

if TYPE_CHECKING:
    from sources.synthetic.scene import Workshop

SIDE_M, FLOOR_M, CEILING_M, FRONT_M, BACK_M = 2.4, 1.2, -1.3, 5.2, -2.0
TUCK_M = 0.05
"""How far a wall reaches under the one that is drawn over it, so that no gap shines through their edges."""

BRICKS = Material("bricks", (40, 60, 90), (190, 215, 235), 125, 34)
BOARDS = Material("planks", (20, 45, 80), (120, 175, 225), 105, 34)
PLASTER = Material("shapes", (130, 135, 140), (240, 245, 245), 165, 24)
DOOR = Material("planks", (30, 50, 40), (110, 150, 120), 80, 34)
PICTURE = Material("shapes", (110, 40, 20), (200, 240, 255), 130, 52)
POSTER = Material("shapes", (60, 20, 90), (180, 255, 230), 140, 50)
CRATE = Material("planks", (30, 60, 100), (140, 200, 240), 135, 46)
SCREEN = Material("shapes", (80, 60, 20), (240, 230, 190), 115, 44)
KITE = Material("shapes", (20, 30, 160), (180, 240, 255), 135, 52)
DISC = Material("shapes", (150, 60, 10), (255, 240, 170), 135, 52, disc=True)


class Room:
    """Still by itself; with `floating` objects, each keeps to a depth of its own so that none passes another."""

    def __init__(self, workshop: Workshop, rng: np.random.Generator, *, floating: bool, amplitude: float) -> None:
        self._still = [*_walls(workshop), *_furniture(workshop)]
        self._floating = _objects(workshop, rng, amplitude) if floating else []

    def surfaces(self, t_s: float, z_m: float) -> Iterator[Surface]:  # noqa: ARG002 - all of a room is in sight
        yield from self._still
        for body, motion in self._floating:
            yield body.moved(motion(t_s))


def _walls(make: Workshop) -> Iterator[Surface]:
    height = FLOOR_M - CEILING_M
    left, width = -SIDE_M - TUCK_M, 2 * (SIDE_M + TUCK_M)
    yield make.surface(BRICKS, (left, CEILING_M, FRONT_M), (width, 0, 0), (0, height, 0))
    yield make.surface(BRICKS, (-left, CEILING_M, BACK_M), (-width, 0, 0), (0, height, 0))
    # Long walls come in lengths, each painted as finely as its distance asks.
    for near, far in ((BACK_M, 0.5), (0.5, 2.2), (2.2, 3.6), (3.6, FRONT_M)):
        length = far + TUCK_M - near
        yield make.surface(PLASTER, (left, CEILING_M, near), (width, 0, 0), (0, 0, length))
        yield make.surface(BOARDS, (left, FLOOR_M, near + length), (width, 0, 0), (0, 0, -length))
        yield make.surface(BRICKS, (-SIDE_M, CEILING_M, near), (0, 0, length), (0, height, 0))
        yield make.surface(BRICKS, (SIDE_M, CEILING_M, near + length), (0, 0, -length), (0, height, 0))


def _furniture(make: Workshop) -> Iterator[Surface]:
    yield make.board(DOOR, (1.35, 0.22, FRONT_M - 0.02), 0.85, 1.95, 0)
    yield make.board(PICTURE, (-0.9, -0.3, FRONT_M - 0.02), 1.3, 0.9, 0)
    yield make.board(POSTER, (0.4, -0.55, FRONT_M - 0.02), 0.55, 0.75, 0)
    yield make.board(POSTER, (-SIDE_M + 0.02, -0.2, 4.2), 1.1, 0.8, -90)
    yield make.board(PICTURE, (SIDE_M - 0.02, -0.25, 4.2), 0.9, 1.2, 90)
    yield from make.crate(CRATE, (-0.35, FLOOR_M, 4.3), (0.6, 0.6, 0.6), 12)
    yield make.board(SCREEN, (1.45, 0.45, 3.6), 0.75, 1.5, 38)
    yield from make.crate(CRATE, (-1.25, FLOOR_M, 3.3), (0.8, 0.75, 0.7), -25)
    yield from make.crate(CRATE, (-1.2, FLOOR_M - 0.75, 3.3), (0.45, 0.4, 0.4), 20)
    yield from make.crate(CRATE, (0.65, FLOOR_M, 2.7), (0.5, 0.5, 0.5), 30)


def _objects(make: Workshop, rng: np.random.Generator, amplitude: float) -> list[tuple[Surface, Motion]]:
    homes = (
        (KITE, (-1.1, -0.35, 3.2), 0.75, 0.6),
        (DISC, (0.95, -0.2, 2.75), 0.65, 0.65),
        (SCREEN, (0.15, 0.45, 2.3), 0.6, 0.45),
        (DISC, (-0.5, 0.1, 1.85), 0.4, 0.4),
        (KITE, (0.45, -0.25, 1.4), 0.3, 0.3),
    )
    bodies: list[tuple[Surface, Motion]] = []
    for material, home_m, width_m, height_m in homes:
        right, down = (width_m, 0.0, 0.0), (0.0, height_m, 0.0)
        quad_m = np.array([(-width_m / 2, -height_m / 2, 0.0), right, down])
        # Paths are shorter nearer to the rig, so that all cross about as much of the picture.
        path = hovering(rng, home_m, amplitude * home_m[2] / 3.2)
        bodies.append((Surface(quad_m, make.texture(material, right, down, home_m)), path))
    return bodies
