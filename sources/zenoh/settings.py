"""The settings of pictures taken from a Zenoh network."""

from __future__ import annotations

from itertools import permutations
from typing import Annotated, Literal

import zenoh
from pydantic import AfterValidator, Field, model_validator

from pipeline.settings import Settings
from pipeline.zenoh_network import NetworkSettings
from pipeline.zenoh_reach import first_words
from sources.live import FRAMES_AHEAD, CameraName, Fps, FramesAhead


def _key(value: str) -> str:
    try:
        zenoh.KeyExpr(value)
    except zenoh.ZError as error:
        raise ValueError(f"{first_words(error)}; write it like 0/cam0/image_raw/**") from None
    return value


class ZenohCameraSettings(Settings):
    """One camera. key: where its pictures are published, wildcards allowed. fps: its frame rate in Hz."""

    key: Annotated[str, AfterValidator(_key)]
    fps: Fps


class ZenohSourceSettings(NetworkSettings):
    """Pictures that others publish: ROS 2 images, JPEG, PNG, or raw with an attachment (docs/zenoh-pictures.md).

    mode, connect, listen, tls, user, ...: how others are found (docs/zenoh.md).
    cameras:      by name, in order.
    frames_ahead: pictures of a camera that may wait; then its oldest gives way.
    """

    type: Literal["zenoh"] = "zenoh"
    cameras: dict[CameraName, ZenohCameraSettings] = Field(min_length=1)
    frames_ahead: FramesAhead = FRAMES_AHEAD

    @model_validator(mode="after")
    def _each_hears_its_own(self) -> ZenohSourceSettings:
        keys = {name: zenoh.KeyExpr(camera.key) for name, camera in self.cameras.items()}
        for one, other in permutations(keys, 2):
            if keys[one].includes(keys[other]):
                raise ValueError(f"{one} ({keys[one]}) would hear all pictures of {other} ({keys[other]})")
        return self
