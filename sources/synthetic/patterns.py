"""Draws grey patterns in texels, with edges and corners at many sizes and nothing that repeats."""

from __future__ import annotations

from collections.abc import Callable
from typing import TypeAlias

import cv2
import numpy as np
import numpy.typing as npt

Canvas: TypeAlias = npt.NDArray[np.float32]
Pattern: TypeAlias = Callable[[np.random.Generator, int, int], Canvas]


def clouds(rng: np.random.Generator, width: int, height: int) -> Canvas:
    """Soft noise of several octaves."""
    total = np.zeros((height, width), np.float32)
    for cell, strength in ((96, 1.0), (40, 0.8), (16, 0.5), (7, 0.35)):
        coarse = rng.standard_normal((height // cell + 3, width // cell + 3), np.float32)
        fine = cv2.resize(coarse, (coarse.shape[1] * cell, coarse.shape[0] * cell), interpolation=cv2.INTER_LINEAR)
        total += np.float32(strength) * fine[cell : cell + height, cell : cell + width]
    return np.asarray(128 + 30 * total, np.float32)


def shapes(rng: np.random.Generator, width: int, height: int) -> Canvas:
    """Polygons and ellipses heaped on one another, large ones below."""
    canvas = clouds(rng, width, height)
    _scatter(canvas, rng, width * height // 260, 4, 26, 95)
    return canvas


def bricks(rng: np.random.Generator, width: int, height: int) -> Canvas:
    """Courses of stones of unequal length, weathered."""
    canvas = clouds(rng, width, height) * 0.3
    canvas += _courses(rng, width, height, 17, (18, 46), 34)
    _scatter(canvas, rng, width * height // 1500, 2, 6, 60)
    return canvas


def planks(rng: np.random.Generator, width: int, height: int) -> Canvas:
    """Long boards with knots."""
    canvas = clouds(rng, width, height) * 0.4
    canvas += _courses(rng, width, height, 13, (50, 150), 26)
    _scatter(canvas, rng, width * height // 700, 2, 6, 70)
    return canvas


def facade(rng: np.random.Generator, width: int, height: int) -> Canvas:
    """A house front: plaster or bricks, and rows of windows, no two alike."""
    canvas = bricks(rng, width, height) * 0.6 + 70
    storeys, bays = max(2, height // 110), max(2, width // 90)
    for storey in range(storeys):
        for bay in range(bays):
            w, h = rng.uniform(0.4, 0.6) * width / bays, rng.uniform(0.5, 0.65) * height / storeys
            x = (bay + 0.5 + rng.uniform(-0.08, 0.08)) * width / bays - w / 2
            y = (storey + 0.5 + rng.uniform(-0.05, 0.05)) * height / storeys - h / 2
            _box(canvas, x - 4, y - 4, w + 8, h + 8, 225)
            for pane in range(4):
                _box(canvas, x + pane % 2 * w / 2, y + pane // 2 * h / 2, w / 2 - 3, h / 2 - 3, rng.uniform(20, 95))
    return canvas


def road(rng: np.random.Generator, width: int, height: int) -> Canvas:
    """A stretch of road from house to house: pavement, patched asphalt, a dash of the centre line, pavement."""
    canvas = clouds(rng, width, height) * 0.5 + 30
    _scatter(canvas, rng, width * height // 420, 3, 22, 28)
    slabs = _courses(rng, width, height, 21, (30, 60), 30) + 40
    kerb = round(0.2 * width)
    canvas[:, :kerb], canvas[:, width - kerb :] = slabs[:, :kerb], slabs[:, width - kerb :]
    _box(canvas, 0.49 * width, 0.15 * height, 0.02 * width, 0.5 * height, 235)
    return canvas


def _courses(
    rng: np.random.Generator, width: int, height: int, course: int, lengths: tuple[int, int], spread: float
) -> Canvas:
    canvas = np.full((height, width), 170, np.float32)
    for y in range(0, height, course):
        x = -int(rng.integers(lengths[1]))
        while x < width:
            length = int(rng.integers(*lengths))
            _box(canvas, x + 2, y + 2, length - 2, course - 2, 100 + spread * rng.standard_normal())
            x += length
    return canvas


def _box(canvas: Canvas, x: float, y: float, width: float, height: float, level: float) -> None:
    left, top = max(round(x), 0), max(round(y), 0)
    canvas[top : max(round(y + height), 0), left : max(round(x + width), 0)] = level


def _scatter(
    canvas: Canvas, rng: np.random.Generator, count: int, smallest: float, largest: float, spread: float
) -> None:
    height, width = canvas.shape
    sizes = np.sort(smallest + (largest - smallest) * rng.random(count) ** 4)[::-1]
    centres = rng.uniform(0, (width, height), (count, 2))
    turns = np.sort(rng.uniform(0, 2 * np.pi, (count, 5)))
    spokes = np.stack([np.cos(turns), np.sin(turns)], axis=2) * sizes[:, None, None]
    polygons = (centres[:, None] + spokes).round().astype(np.int32)
    levels = (128 + spread * rng.uniform(-1, 1, count)).tolist()
    for i, (polygon, level) in enumerate(zip(polygons, levels, strict=True)):
        if i % 4:
            cv2.fillConvexPoly(canvas, polygon[: 3 + i % 3], level)
        else:
            (x, y), size = centres[i].round().astype(int).tolist(), round(sizes[i])
            cv2.ellipse(canvas, (x, y), (size + 1, size * (i % 3 + 2) // 4 + 1), i % 180, 0, 360, level, -1)


PATTERNS: dict[str, Pattern] = {
    "bricks": bricks,
    "clouds": clouds,
    "facade": facade,
    "planks": planks,
    "road": road,
    "shapes": shapes,
}
