"""Derived pictures that several detectors and pairs need, made once a frame."""

from __future__ import annotations

from collections.abc import Callable
from typing import Generic, TypeVar

import cv2
import numpy as np
import numpy.typing as npt

from pipeline.frame import Frame, Picture, Window

Derived = TypeVar("Derived")


class Memo(Generic[Derived]):
    """Remembers what was made of each frame of the current window; frames that have left it are forgotten."""

    def __init__(self, make: Callable[[Frame], Derived]) -> None:
        self._make = make
        self._made: dict[int, tuple[Frame, Derived]] = {}

    def enter(self, window: Window) -> None:
        """Forgets the frames that are not in `window`."""
        frames = (f for t in window.cameras.values() for f in (t.previous, t.current, t.following))
        kept = {id(frame) for frame in frames if frame is not None}
        self._made = {key: entry for key, entry in self._made.items() if key in kept}

    def __getitem__(self, frame: Frame) -> Derived:
        entry = self._made.get(id(frame))
        if entry is None:
            entry = self._made[id(frame)] = (frame, self._make(frame))
        return entry[1]


def grey(image: Picture) -> Picture:
    """H x W uint8 of a grey or colour picture (Rec. 601 luma, as OpenCV weighs it)."""
    if image.ndim == 2:
        return image
    return np.asarray(cv2.cvtColor(image, cv2.COLOR_BGR2GRAY), np.uint8)


def reduced(image: Picture, width_px: int) -> Picture:
    """The picture at no more than this width, by area averaging; grey or colour."""
    height, width = image.shape[:2]
    if width <= width_px:
        return image
    size = (width_px, max(1, round(height * width_px / width)))
    return np.asarray(cv2.resize(image, size, interpolation=cv2.INTER_AREA), np.uint8)


def gradient_magnitude(image: Picture) -> npt.NDArray[np.float32]:
    """H x W float32: the L2 norm of the 3 x 3 Sobel derivatives in x and y (the report, section 3.1.2)."""
    flat = grey(image)
    return np.asarray(
        cv2.magnitude(cv2.Sobel(flat, cv2.CV_32F, 1, 0, ksize=3), cv2.Sobel(flat, cv2.CV_32F, 0, 1, ksize=3)),
        np.float32,
    )
