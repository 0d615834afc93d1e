"""What an offset in time does to a range measured by stereo."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np
from pydantic import Field

from pipeline.detectors.offset.calibration_file import read_calibration
from pipeline.errors import InputError
from pipeline.frame import NS_PER_S, Pair
from pipeline.settings import Settings
from pipeline.verdict import Message


class RangeSettings(Settings):
    """The rig, and the case it is asked about.

    baseline_m: distance of the cameras. focal_px: focal length; left out, disparity is not told.
    calibration: a file, as the detector `offset` reads them, for the one or the other that is left out; in metres.
    depth_m: how far away the object is. speed_m_s: how fast it moves sideways against the rig, or the rig against it.
    """

    baseline_m: float | None = Field(default=None, gt=0, le=1000)
    focal_px: float | None = Field(default=None, gt=0, le=100_000)
    depth_m: float = Field(default=5.0, gt=0, le=100_000)
    speed_m_s: float = Field(default=1.0, gt=0, le=10_000)
    calibration: str | None = None


@dataclass(frozen=True, slots=True)
class RangeCase:
    """The same with the geometry of one pair, metres and pixels, known."""

    baseline_m: float
    focal_px: float | None
    depth_m: float
    speed_m_s: float


def range_case(settings: RangeSettings, base: Path, pair: Pair, cameras: Sequence[str]) -> RangeCase:
    """The case of one pair. base: the folder that the path of the calibration counts from. Raises InputError."""
    baseline_m, focal_px = settings.baseline_m, settings.focal_px
    if settings.calibration is not None and (baseline_m is None or focal_px is None):
        stereo = read_calibration(base / settings.calibration, pair.first, pair.second, cameras)
        baseline_m = baseline_m or float(np.linalg.norm(stereo.translation))
        focal_px = focal_px or float(stereo.first.matrix[0, 0])
    if baseline_m is None:
        raise InputError("judge.range: the distance of the cameras is needed: set baseline_m, or calibration to a file")
    return RangeCase(baseline_m, focal_px, settings.depth_m, settings.speed_m_s)


@dataclass(frozen=True, slots=True)
class RangeError:
    """Between which ranges an object is seen, by the direction in which it moves.

    high_m, high_percent: None where it moves as far as the baseline or farther meanwhile: no range is too large then.
    disparity_px: by how much the disparity is off either way, None without a focal length.
    """

    depth_m: float
    speed_m_s: float
    low_m: float
    low_percent: float
    high_m: float | None
    high_percent: float | None
    disparity_px: float | None

    def to_json(self) -> Message:
        return {name: None if value is None else round(value, 3) for name, value in asdict(self).items()}


def range_error(case: RangeCase, offset_ns: int) -> RangeError:
    """The range at which an object at `depth_m` is seen when the second camera looks `offset_ns` later or earlier.

    Range is R = f B / d for focal length f, baseline B and disparity d. Meanwhile the object moves sideways by V dt,
    which looks like a disparity that is f V dt / R too large or too small: observed is R B / (B +- V dt).
    """
    moved_m = case.speed_m_s * abs(offset_ns) / NS_PER_S
    baseline_m, depth_m = case.baseline_m, case.depth_m
    low = baseline_m / (baseline_m + moved_m)
    high = baseline_m / (baseline_m - moved_m) if moved_m < baseline_m else None
    return RangeError(
        depth_m=depth_m,
        speed_m_s=case.speed_m_s,
        low_m=low * depth_m,
        low_percent=100 * (low - 1),
        high_m=None if high is None else high * depth_m,
        high_percent=None if high is None else 100 * (high - 1),
        disparity_px=None if case.focal_px is None else case.focal_px * moved_m / depth_m,
    )
