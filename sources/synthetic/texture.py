"""Paints textures: natural, never repeating, and with no detail finer than a pixel can show."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from typing import TYPE_CHECKING, Any, Literal, TypeAlias, cast

import cv2
import numpy as np
import numpy.typing as npt

from sources.synthetic.patterns import PATTERNS

if TYPE_CHECKING:
    from pipeline.frame import Picture

MAX_TEXELS = 2048
MARGIN = 2
"""Transparent texels around every texture: they make a surface's edge fade over one pixel, centred on the edge."""

Colour: TypeAlias = tuple[int, int, int]
"""Blue, green, red."""


@dataclass(frozen=True, slots=True)
class Material:
    """What a surface is made of; its greys run from `dark` to `light`, as colours too."""

    pattern: Literal["bricks", "planks", "shapes", "facade", "road", "clouds"]
    dark: Colour = (0, 0, 0)
    light: Colour = (255, 255, 255)
    mean_level: float = 120
    contrast: float = 42
    disc: bool = False


class Texture:
    """A painted rectangle of texels, and coarser ones for when it is seen from further away, made when first needed.

    Texels hold blue, green, red (or three times grey) and how much of what lies behind shows through.
    """

    def __init__(self, columns: float, rows: float, paint: Callable[[int, int], Picture]) -> None:
        self._columns, self._rows = (min(max(round(n), 8), MAX_TEXELS) for n in (columns, rows))
        self._paint = cache(lambda: paint(self._columns, self._rows))
        self._levels: dict[tuple[int, int], Picture] = {}

    def level(self, columns: float, rows: float) -> Picture:
        """The texture at about the size wanted, never finer than painted.

        Steps are half an octave, and filtering is symmetric: going from one to the next moves nothing.
        """
        key = _steps_down(self._columns, columns), _steps_down(self._rows, rows)
        if key not in self._levels:
            self._levels[key] = self._reduced(*key)
        return self._levels[key]

    def _reduced(self, steps_x: int, steps_y: int) -> Picture:
        paint = self._paint()
        if steps_x or steps_y:
            size = max(4, round(self._columns / 2 ** (steps_x / 2))), max(4, round(self._rows / 2 ** (steps_y / 2)))
            paint = cast("Picture", cv2.resize(paint, size, interpolation=cv2.INTER_AREA))
            paint = cast("Picture", cv2.GaussianBlur(paint, (0, 0), 0.6))
        edge = (MARGIN,) * 4
        return cast("Picture", cv2.copyMakeBorder(paint, *edge, cv2.BORDER_CONSTANT, value=(0, 0, 0, 255)))


def _steps_down(painted: int, wanted: float) -> int:
    # The slack of 0.25 keeps a surface that hovers about its usual distance at its finest level.
    return max(0, math.floor(2 * math.log2(painted / max(wanted, 4)) + 0.25))


def painted(rng: np.random.Generator, material: Material, width: int, height: int, *, colour: bool) -> Picture:
    """Texels of the material."""
    canvas = cv2.GaussianBlur(PATTERNS[material.pattern](rng, width, height), (0, 0), 1.0)
    mean, spread = float(canvas.mean()), float(canvas.std())
    levels = (canvas - mean) * (material.contrast / max(spread, 1e-3)) + material.mean_level
    grey = np.clip(levels, 8, 247).astype(np.uint8)
    channels: list[npt.NDArray[Any]] = [grey] * 3
    if colour:
        ends = zip(material.dark, material.light, strict=True)
        channels = [cv2.LUT(grey, np.linspace(dark, light, 256).astype(np.uint8)) for dark, light in ends]
    see_through = np.zeros((height, width), np.uint8)
    if material.disc:
        see_through[:] = 255
        cv2.ellipse(
            see_through, (width // 2, height // 2), (width // 2 - 1, height // 2 - 1), 0, 0, 360, 0, -1, cv2.LINE_AA
        )
        channels = [cv2.multiply(channel, cv2.bitwise_not(see_through), scale=1 / 255) for channel in channels]
    return cast("Picture", cv2.merge([*channels, see_through]))
