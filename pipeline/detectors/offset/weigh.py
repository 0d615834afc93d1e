"""Weighs what points and the motion of whole pictures say of an offset, and says which spoke or why neither."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from pipeline.detectors.offset.motion_signal import SignalFit
from pipeline.detectors.offset.pair import Estimate
from pipeline.detectors.offset.silence import Silence
from pipeline.verdict import Reason

MOST_NOISE = 0.5
"""When half of the apparent motion is tracking noise, nothing is said."""

WIDEST = 0.15
"""Frames of standard error beyond which nothing is said: three of them are nearly half a frame."""

SIGNAL_WIDEST = 0.2
"""The same for whole pictures, which are only asked where points are silent: three of them are still below a frame."""

CLEAR = 10.0
"""Log likelihood by which every other offset must be worse: odds of twenty thousand to one."""

LEAST_MOVING, LEAST_REGIONS = 8, 2
"""Points that must move across the rows, and cells of the picture they must be in: fewer may all be false together."""

STILL_PX = 0.1
"""Motion a frame that tracking noise may pretend in every point."""

EXPLAINED = 0.2
"""When geometry leaves less than this of the motion across the rows, it is motion like that of a steady drive."""

STEADY_DRIVE = "driving at constant speed: the rig's geometry may explain this motion as well as time"

AGREEING = 3.0
"""Joint standard errors within which points and whole pictures speak of the same offset."""


@dataclass(frozen=True, slots=True)
class Finding:
    """An offset and its standard error in frames, or None with why; `spoke` says what it rests on."""

    tau: float | None
    sigma: float | None
    why: str
    spoke: str = ""
    motion_px: float | None = None
    numbers: Mapping[str, float] = field(default_factory=dict)

    @property
    def known(self) -> bool:
        return bool(self.spoke)


def weigh(points: Estimate | Silence, signal: SignalFit | None) -> Finding:
    """Points alone, whole pictures alone, or both by their errors where they agree; where not, points."""
    found = Finding(None, None, points) if isinstance(points, Silence) else of_points(points)
    if signal is None or signal.sigma > SIGNAL_WIDEST:
        return found
    numbers = {
        **found.numbers,
        "signal_frames": signal.tau,
        "signal_sigma_frames": signal.sigma,
        "signal_correlation": signal.correlation,
    }
    if not found.known or found.tau is None or found.sigma is None:
        spoke = "the motion of the whole pictures"
        return Finding(signal.tau, signal.sigma, "", spoke, found.motion_px, numbers)
    joint = (found.sigma**2 + signal.sigma**2) ** 0.5
    if abs(found.tau - signal.tau) > AGREEING * joint:
        return Finding(found.tau, found.sigma, "", found.spoke, found.motion_px, numbers)
    share = signal.sigma**2 / joint**2
    tau = share * found.tau + (1 - share) * signal.tau
    sigma = found.sigma * signal.sigma / joint
    return Finding(tau, sigma, "", f"{found.spoke} and whole pictures", found.motion_px, numbers)


def of_points(estimate: Estimate) -> Finding:
    fit, sigma = estimate.fit, estimate.sigma
    numbers = {
        "sigma_random_frames": fit.sigma,
        "sigma_systematic_frames": float(max(sigma**2 - fit.sigma**2, 0.0) ** 0.5),
        "matches": fit.matches / estimate.blocks,
        "moving_points": fit.moving,
        "regions": fit.regions,
        "noise_share": fit.noise_share,
        "residual_px": fit.steady_px,
        "lag": estimate.lag,
        "margin": estimate.margin,
        "uncalibrated": float(not estimate.calibrated),
        **estimate.halves,
    }
    why = _silence(estimate)
    return Finding(fit.tau, sigma, why, "" if why else "points in both views", fit.motion_px, numbers)


def _silence(estimate: Estimate) -> str:
    """Why points do not tell, or nothing."""
    fit, sigma = estimate.fit, estimate.sigma
    faint = (
        fit.motion_px < fit.steady_px
        or fit.noise_share > MOST_NOISE
        or fit.moving < LEAST_MOVING
        or fit.regions < LEAST_REGIONS
    )
    if faint or sigma > WIDEST:
        if fit.across_px < STILL_PX:
            why = "nothing moves" if fit.along_px < STILL_PX else "no motion across the rows"
            return Silence(why, Reason.NO_MOTION)
        if fit.motion_px < EXPLAINED * fit.across_px:
            return Silence(STEADY_DRIVE, Reason.NO_MOTION)
        if faint:
            return Silence("no motion across the rows beyond noise", Reason.NO_MOTION)
        return Silence(f"error too large: {sigma:.2f} frames", Reason.WIDE_ERROR)
    return Silence("another offset fits as well", Reason.WIDE_ERROR) if estimate.margin < CLEAR else ""
