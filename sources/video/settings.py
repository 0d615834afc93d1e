"""The settings of cameras that are read by URL."""

from __future__ import annotations

import re
from collections import Counter
from typing import Annotated, Any, Literal

from pydantic import BeforeValidator, Field, SecretStr, field_validator, model_validator

from pipeline.settings import Settings
from sources.live import FRAMES_AHEAD, CameraName, Fps, FramesAhead

OPTION = re.compile(r"[^;|]+")
"""What stands between the signs that OpenCV takes options apart by."""


class VideoCameraSettings(Settings):
    """One camera.

    url:     rtsp://, http://, ... or a file; a relative one counts from the configuration. Never printed as it is.
    fps:     frame rate in Hz; left out: as the stream tells it, which MJPEG over HTTP does not.
    options: of FFmpeg, by name; `rtsp_transport` is tcp unless told otherwise.
    """

    url: Annotated[SecretStr, Field(min_length=1)]
    fps: Fps | None = None
    options: dict[str, str | int | float] = Field(default_factory=dict)

    @field_validator("options")
    @classmethod
    def _can_be_told(cls, value: dict[str, str | int | float]) -> dict[str, str | int | float]:
        for part in (*value, *value.values()):
            if not OPTION.fullmatch(str(part)):
                raise ValueError(f"'{part}' cannot be told to FFmpeg: no ; and no | may be in it")
        return value


def _short_form(value: Any) -> Any:
    """`left: rtsp://...` is short for `left: {url: rtsp://...}`."""
    return {"url": value} if isinstance(value, str) else value


class VideoSettings(Settings):
    """Cameras by URL; their stamps are those of arrival, so that verdicts rest on pictures.

    cameras:        by name, in order, each a URL or its settings.
    wait:           a camera that cannot be opened at the start is waited for; else that is an error.
    open_within_s:  how long opening may take.
    silent_after_s: a stream without pictures for so long, and ten periods, is opened anew.
    frames_ahead:   pictures of a camera that may wait; then its oldest gives way.
    """

    type: Literal["video"] = "video"
    cameras: dict[
        CameraName,
        Annotated[VideoCameraSettings, BeforeValidator(_short_form, json_schema_input_type=str | VideoCameraSettings)],
    ] = Field(min_length=1)
    wait: bool = False
    open_within_s: float = Field(default=5.0, ge=0.5, le=600)
    silent_after_s: float = Field(default=2.0, ge=0.1, le=3600)
    frames_ahead: FramesAhead = FRAMES_AHEAD

    @model_validator(mode="after")
    def _each_is_one(self) -> VideoSettings:
        urls = Counter(camera.url.get_secret_value() for camera in self.cameras.values())
        for name, camera in self.cameras.items():
            if urls[camera.url.get_secret_value()] > 1:
                raise ValueError(f"{name} and another camera have the same url: one stream cannot be two cameras")
        return self
