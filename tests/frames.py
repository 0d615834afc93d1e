"""Small frames and windows for tests, about which everything can be said."""

from __future__ import annotations

from typing import Any

import cv2
import numpy as np

from pipeline.frame import Camera, Frame, Pair, Picture, Rig, Triple, Window

PERIOD_NS = 100_000_000
RIG = Rig("bench", (Camera("left", 10), Camera("right", 10)), (Pair("left", "right"),))


def frame(camera: str, captured_ns: int, sequence: int | None = None, **fields: Any) -> Frame:
    """A grey 2 x 2 frame that arrives when it is captured, unless told otherwise."""
    values = {"clock": "rig", "arrived_ns": captured_ns, "image": np.full((2, 2), 128, np.uint8), **fields}
    return Frame(camera=camera, sequence=sequence, captured_ns=captured_ns, **values)


def window(index: int = 0, **cameras: Frame | tuple[Frame | None, Frame | None, Frame | None] | None) -> Window:
    """A window; a camera given as one frame has no neighbours."""
    triples = {}
    for name, given in cameras.items():
        previous, current, following = given if isinstance(given, tuple) else (None, given, None)
        triples[name] = Triple(previous, current, following, None if current is None else index)
    return Window(index, triples)


def texture(seed: int, width: int = 64, height: int = 48) -> Picture:
    """Random blobs: something to correlate."""
    noise = np.random.default_rng(seed).integers(0, 256, (height, width), np.uint8)
    return np.asarray(cv2.GaussianBlur(noise, (0, 0), 1.5), np.uint8)
