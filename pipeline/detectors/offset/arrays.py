"""The array types of this package."""

from __future__ import annotations

from typing import TypeAlias

import numpy as np
import numpy.typing as npt

Floats: TypeAlias = npt.NDArray[np.float64]
Floats32: TypeAlias = npt.NDArray[np.float32]
Points: TypeAlias = npt.NDArray[np.float32]
"""n x 2 image positions in working pixels, x then y (float32, as OpenCV wants them)."""

Ints: TypeAlias = npt.NDArray[np.int64]
Mask: TypeAlias = npt.NDArray[np.bool_]


def median(values: Floats | Points) -> float:
    """The upper median of one or more values, several times as fast as numpy's for some hundred of them."""
    middle = values.size // 2
    return float(np.partition(values.ravel(), middle)[middle])
