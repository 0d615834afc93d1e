"""Small pictures of the cameras, now and then, for people who look at a rig from afar."""

from __future__ import annotations

import cv2
from pydantic import Field

from pipeline.frame import NS_PER_S, Frame
from pipeline.settings import Settings

JPEG_QUALITY = 70
"""A picture 320 wide has about 10 KB."""


class PreviewSettings(Settings):
    """How often a picture of each camera is published, and how wide it is at most, in pixels."""

    every_s: float = Field(default=1.0, ge=0.1)
    width: int = Field(default=320, ge=16, le=1920)


class Previews:
    """Makes a small JPEG of a camera's frame whenever one is due."""

    def __init__(self, settings: PreviewSettings) -> None:
        self._settings = settings
        self._due_ns: dict[str, int] = {}

    def take(self, frame: Frame, now_ns: int) -> bytes | None:
        """A JPEG, or None while none is due. now_ns: of a clock that never steps."""
        if now_ns < self._due_ns.get(frame.camera, now_ns):
            return None
        self._due_ns[frame.camera] = now_ns + round(self._settings.every_s * NS_PER_S)
        height, width = frame.image.shape[:2]
        scale = min(self._settings.width / width, 1.0)
        size = (max(round(width * scale), 1), max(round(height * scale), 1))
        small = cv2.resize(frame.image, size, interpolation=cv2.INTER_AREA)
        return cv2.imencode(".jpg", small, [cv2.IMWRITE_JPEG_QUALITY, JPEG_QUALITY])[1].tobytes()
