"""The settings of a replayed recording: where it is, how its frames pair, and how fast it runs."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field, ValidationInfo, field_validator

from pipeline.settings import Settings

PathText = Annotated[str, Field(min_length=1)]
Name = Annotated[str, Field(pattern="^[a-z0-9_]+$")]


FormatName = Literal[
    "auto",
    "syncwatch",
    "mcap",
    "rosbag1",
    "rosbag2",
    "euroc",
    "tumvi",
    "kitti",
    "caliscope",
    "depthai",
    "folders",
    "videos",
    "halves",
]


class ReplaySettings(Settings):
    """A recording, as one folder, or as one folder of pictures or one video a camera.

    path:         relative paths count from the configuration's folder, or from the current one on the command line.
    format:       `auto` recognises it by content.
    fps:          frame rate in Hz; left out: the recording's own, 30 when it has none.
    speed:        1.0 is real time, 2.0 twice as fast, `max` as fast as it is judged.
    cameras:      names in the order of the streams (natural order in one folder, else the order of `path`).
    pair_by:      `number` (last digits of the file name), `index` (place in natural order) or `time` (timestamps).
    trust_stamps: judge by timestamps that were made up from `fps`, too.
    topics:       of a recording of messages: topics by camera names, or in the order of the cameras.
    stamps:       of a recording of messages: `header` (when pictures were taken) or `log` (when they were recorded).
    layout:       of a single video: `side_by_side` or `top_bottom`, first camera first; `auto` recognises two views.
    from_s, to_s: the part of the recording that is replayed, in seconds from its start.
    """

    type: Literal["replay"] = "replay"
    path: PathText | Annotated[list[PathText], Field(min_length=1)]
    format: FormatName = "auto"
    fps: float | None = Field(default=None, ge=0.001, le=100_000)
    speed: Annotated[float, Field(gt=0)] | Literal["max"] = "max"
    loop: bool = False
    cameras: list[Name] | None = None
    pair_by: Literal["auto", "number", "index", "time"] = "auto"
    trust_stamps: bool = False
    topics: dict[Name, PathText] | Annotated[list[PathText], Field(min_length=2)] | None = None
    stamps: Literal["auto", "header", "log"] = "auto"
    layout: Literal["auto", "side_by_side", "top_bottom"] = "auto"
    from_s: float | None = Field(default=None, ge=0, le=1e9)
    to_s: float | None = Field(default=None, gt=0, le=1e9)

    @field_validator("cameras")
    @classmethod
    def _unique(cls, names: list[str] | None) -> list[str] | None:
        repeated = sorted({name for name in names or [] if (names or []).count(name) > 1})
        if repeated:
            raise ValueError(f"camera names must differ: '{repeated[0]}' is given twice")
        return names

    @field_validator("to_s")
    @classmethod
    def _after_the_start(cls, to_s: float | None, info: ValidationInfo) -> float | None:
        from_s = info.data.get("from_s")
        if to_s is not None and from_s is not None and to_s <= from_s:
            raise ValueError(f"must be more than from_s, which is {from_s:g}")
        return to_s

    @property
    def paths(self) -> list[str]:
        return [self.path] if isinstance(self.path, str) else list(self.path)
