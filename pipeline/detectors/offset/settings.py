"""What can be set about the content offset detector."""

from __future__ import annotations

from typing import Literal

from pydantic import Field

from pipeline.settings import Settings


class OffsetSettings(Settings):
    """Content offset: how far apart in time two cameras are, from their pictures alone.

    max_lag_frames: the largest whole-frame offset that is searched for; more remembers more pictures.
    working_width_px: pictures are reduced to this width before anything is measured; never enlarged.
    every: look at every n-th window only, to save CPU; the others get unknown.
    points: how many corners are followed in the first camera of a pair; CPU grows with it.
    halves: also measure by halves of the points (odd and even, up and down, slow and fast, near and far); costs CPU.
    tolerance_ms: offsets within it are sync; auto is 5 ms, but 3 to 10 % of a period.
    """

    type: Literal["offset"] = "offset"
    max_lag_frames: int = Field(default=10, ge=1, le=60)
    working_width_px: int = Field(default=640, ge=160, le=4096)
    every: int = Field(default=1, ge=1, le=100)
    points: int = Field(default=100, ge=40, le=1000)
    halves: bool = False
    tolerance_ms: float | Literal["auto"] = "auto"
