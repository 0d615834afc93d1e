"""The settings of V4L2 cameras: which they are, and what is asked of each."""

from __future__ import annotations

from typing import Annotated, Any, Literal

from pydantic import BeforeValidator, Field

from pipeline.settings import Settings
from sources.v4l2.formats import FORMATS

ALIASES = {
    "MJPG": "MJPEG",
    "GRAY": "GREY",
    "Y8": "GREY",
    "BGR": "BGR3",
    "RGB": "RGB3",
    "BGR24": "BGR3",
    "RGB24": "RGB3",
}

Name = Annotated[str, Field(pattern="^[a-z0-9_]+$")]
Pixels = Annotated[int, Field(ge=16, le=65_536)]


def _known(value: Any) -> Any:
    """A pixel format as we write it, however the user does."""
    if not isinstance(value, str):
        return value
    name = ALIASES.get(value.upper(), value.upper())
    if name not in FORMATS:
        raise ValueError(f"no pixel format '{value}' is read here: take one of {', '.join(FORMATS)}")
    return name


class V4l2CameraSettings(Settings):
    """One camera. What is left out stays as the driver has it.

    device:   a path (/dev/video0), a name that stays (/dev/v4l/by-id/..., /dev/v4l/by-path/...), a serial number, or
              the bus as `syncwatch cameras` tells it.
    size:     width and height in pixels.
    format:   YUYV, GREY, NV12, Y16, MJPEG, ...: colour and Bayer pictures are judged as grey.
    fps:      frame rate in Hz.
    buffers:  how many pictures the driver may hold; more bridge longer pauses of this machine.
    controls: values by the control's name as `v4l2-ctl --list-ctrls` writes it, set in this order.
    """

    device: Annotated[str, Field(min_length=1)]
    size: tuple[Pixels, Pixels] | None = None
    format: Annotated[str | None, BeforeValidator(_known)] = None
    fps: float | None = Field(default=None, ge=0.001, le=100_000)
    buffers: int = Field(default=4, ge=2, le=32)
    controls: dict[str, bool | int | str] = Field(default_factory=dict)


class V4l2Settings(Settings):
    """The cameras of a rig on this machine.

    wait:           a camera that is not there at the start is waited for; else that is an error.
    silent_after_s: a camera without pictures for so long, and ten periods, is opened anew; null: never, for cameras
                    that wait for a trigger which may pause.
    """

    type: Literal["v4l2"] = "v4l2"
    cameras: Annotated[dict[Name, V4l2CameraSettings], Field(min_length=1)]
    wait: bool = False
    silent_after_s: float | None = Field(default=2.0, ge=0.1, le=3600)
