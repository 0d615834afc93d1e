"""A camera that was knocked out of its place and now looks elsewhere."""

from __future__ import annotations

from typing import Literal, cast

import cv2
import numpy as np
import numpy.typing as npt
from pydantic import Field

from pipeline.faults.base import FaultSettings, FrameFault
from pipeline.faults.moment import repainted
from pipeline.frame import Camera, Frame, Picture

FOCAL_PER_WIDTH = 0.7
"""Focal length in image widths where none is given: a field of view of 71 degrees across, as wide as common stereo
modules see. It scales pitch and yaw only; a roll about the middle of the picture does not depend on it."""


class KnockSettings(FaultSettings):
    """roll_deg, pitch_deg, yaw_deg: positive turns the camera clockwise, up, to the right.

    Pitch and yaw are small, for what they bring into view was never seen: it is mirrored at the edge of the picture.
    Where none is given, the camera rolls by half a degree. focal_px: default: 0.7 image widths.
    """

    type: Literal["knock"] = "knock"
    roll_deg: float | None = Field(default=None, ge=-180, le=180)
    pitch_deg: float | None = Field(default=None, ge=-10, le=10)
    yaw_deg: float | None = Field(default=None, ge=-10, le=10)
    focal_px: float | None = Field(default=None, gt=0, le=100_000)

    @property
    def turn_deg(self) -> tuple[float, float, float]:
        """Roll, pitch and yaw, complete."""
        given = (self.roll_deg, self.pitch_deg, self.yaw_deg)
        if given == (None, None, None):
            return 0.5, 0.0, 0.0
        return self.roll_deg or 0.0, self.pitch_deg or 0.0, self.yaw_deg or 0.0


class Knock(FrameFault):
    """Pictures are turned, as a camera that rotates in place sees them; stamps and ids know nothing of it.

    Signature: stamps 0, ids equal, pictures 0 but epipolar lines off. No report: it happens to every rig that is
    dropped. The homography of a pure rotation is K R K^-1 (R. Hartley and A. Zisserman, Multiple View Geometry in
    Computer Vision, 2nd ed. 2004, section 8.4.2).
    """

    def __init__(self, settings: KnockSettings, cameras: tuple[Camera, ...], seed: int) -> None:
        super().__init__(settings.type, settings, cameras, seed)
        self._focal_px = settings.focal_px
        roll_deg, pitch_deg, yaw_deg = settings.turn_deg
        self._rotation = _turn(1, yaw_deg) @ _turn(0, pitch_deg) @ _turn(2, roll_deg)

    def bend(self, frame: Frame) -> Frame:
        return repainted(frame, self._turned)

    def _turned(self, image: Picture) -> Picture:
        height, width = image.shape[:2]
        focal_px = self._focal_px or FOCAL_PER_WIDTH * width
        k = np.array([[focal_px, 0, (width - 1) / 2], [0, focal_px, (height - 1) / 2], [0, 0, 1]])
        to_former = k @ self._rotation @ np.linalg.inv(k)
        flags = cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
        turned = cv2.warpPerspective(image, to_former, (width, height), flags=flags, borderMode=cv2.BORDER_REFLECT_101)
        return cast("Picture", turned)


def _turn(axis: int, degrees: float) -> npt.NDArray[np.float64]:
    """From the axes after the turn (x right, y down, z forward) to those before."""
    vector = np.zeros(3)
    vector[axis] = np.radians(degrees)
    return np.asarray(cv2.Rodrigues(vector)[0], np.float64)
