"""What can be set about the content offset detector."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field

from pipeline.settings import Settings


class OffsetSettings(Settings):
    """Content offset: how far apart in time two cameras are, from their pictures alone.

    max_lag_frames: the largest whole-frame offset that is searched for; more remembers more pictures.
    working_width_px: pictures are reduced to this width before anything is measured; never enlarged.
    calibration: a file that says how the cameras stand to one another, as a start: OpenCV, Kalibr or KITTI.
    rig: a file for what is learned of a rig: read at the start if it is there, written at the end of a run that was in
    sync.
    cpu_percent: look at fewer windows when a window costs more than this share of one core; 100 is a whole core.
    every: look at every n-th window only, to save CPU; the others get unknown.
    points: how many corners are followed in the first camera of a pair; CPU grows with it.
    halves: also measure by halves of the points (odd and even, up and down, slow and fast, near and far); costs CPU.
    tolerance_ms: offsets within it are sync; auto is what the judge has (5 ms, but 3 to 10 % of a period).
    """

    type: Literal["offset"] = "offset"
    max_lag_frames: int = Field(default=10, ge=1, le=60)
    working_width_px: int = Field(default=640, ge=160, le=4096)
    every: int = Field(default=1, ge=1, le=100)
    cpu_percent: float = Field(default=100.0, gt=0, le=100)
    calibration: Annotated[str, Field(min_length=1)] | None = None
    rig: Annotated[str, Field(min_length=1)] | None = None
    points: int = Field(default=100, ge=40, le=1000)
    halves: bool = False
    tolerance_ms: float | Literal["auto"] = "auto"
