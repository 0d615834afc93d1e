"""Smooth motion in closed form: where the rig or an object is at any moment, exactly."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, TypeAlias

import numpy as np
import numpy.typing as npt

if TYPE_CHECKING:
    from sources.synthetic.settings import SyntheticSettings

Array: TypeAlias = npt.NDArray[np.float64]
Terms: TypeAlias = tuple[tuple[float, float], ...]
"""Pairs of amplitude and frequency in Hz."""


class Wave:
    """A sum of sinusoids with random phases, and frequencies detuned a little so that nothing repeats."""

    def __init__(self, rng: np.random.Generator, terms: Terms, scale: float = 1.0) -> None:
        self._terms = tuple(
            (amplitude * scale, 2 * math.pi * hz * rng.uniform(0.9, 1.1), rng.uniform(0, 2 * math.pi))
            for amplitude, hz in terms
        )

    def at(self, t_s: float) -> float:
        return sum(a * math.sin(w * t_s + phase) for a, w, phase in self._terms)

    def integral(self, t_s: float) -> float:
        """The area under the wave from time 0."""
        return sum(a / w * (math.cos(phase) - math.cos(w * t_s + phase)) for a, w, phase in self._terms)


@dataclass(frozen=True, slots=True)
class Pose:
    """Where a body is and how it is turned: world = rotation @ body + position_m. x right, y down, z forward."""

    rotation: Array
    position_m: Array


Motion: TypeAlias = Callable[[float], Pose]
"""The pose at a time in seconds from the start."""


def rotation(roll_deg: float, pitch_deg: float, yaw_deg: float) -> Array:
    """Turns clockwise (roll), then up (pitch), then to the right (yaw), as seen by the camera that is turned."""
    (sr, cr), (sp, cp), (sy, cy) = (
        (math.sin(a), math.cos(a)) for a in map(math.radians, (roll_deg, pitch_deg, yaw_deg))
    )
    roll = np.array([[cr, -sr, 0], [sr, cr, 0], [0, 0, 1]])
    pitch = np.array([[1, 0, 0], [0, cp, -sp], [0, sp, cp]])
    yaw = np.array([[cy, 0, sy], [0, 1, 0], [-sy, 0, cy]])
    return np.asarray(yaw @ pitch @ roll, dtype=np.float64)


def rig_motion(settings: SyntheticSettings, rng: np.random.Generator) -> Motion:
    """How the whole rig moves, in the kind of motion that was asked for."""
    if settings.motion == "handheld":
        return _handheld(rng, settings.amplitude)
    if settings.motion == "pan":
        return _pan(rng, settings.amplitude)
    if settings.motion == "drive":
        return _drive(rng, settings)
    still = Pose(np.eye(3), np.zeros(3))
    return lambda _: still


def _handheld(rng: np.random.Generator, scale: float) -> Motion:
    # Rotation makes most of the picture's motion: at 512 px focal length a degree is 9 px.
    roll = Wave(rng, ((1.2, 0.35), (0.5, 0.9), (0.2, 1.9)), scale)
    pitch = Wave(rng, ((2.2, 0.4), (1.0, 1.1), (0.35, 2.3)), scale)
    yaw = Wave(rng, ((3.5, 0.3), (1.2, 0.8), (0.3, 2.0)), scale)
    aside = Wave(rng, ((0.05, 0.35), (0.015, 1.0)), scale)
    down = Wave(rng, ((0.02, 0.6), (0.015, 1.8)), scale)
    forward = Wave(rng, ((0.06, 0.3), (0.01, 1.2)), scale)

    def pose(t_s: float) -> Pose:
        turned = rotation(roll.at(t_s), pitch.at(t_s), yaw.at(t_s))
        return Pose(turned, np.array([aside.at(t_s), down.at(t_s), forward.at(t_s)]))

    return pose


def _pan(rng: np.random.Generator, scale: float) -> Motion:
    yaw = Wave(rng, ((14.0, 0.17), (4.0, 0.45), (1.0, 1.1)), scale)
    return lambda t_s: Pose(rotation(0, 0, yaw.at(t_s)), np.zeros(3))


def _drive(rng: np.random.Generator, settings: SyntheticSettings) -> Motion:
    drive = settings.drive
    # Amplitudes add up to one, so that the speed never leaves its bounds and never turns negative.
    swing = Wave(rng, ((0.6, 0.12), (0.4, 0.31)), drive.speed_variation)
    pitch = Wave(rng, ((0.6, 1.3), (0.4, 2.9)), drive.pitch_deg)

    def pose(t_s: float) -> Pose:
        driven_m = drive.speed_m_s * (t_s + swing.integral(t_s))
        return Pose(rotation(0, pitch.at(t_s), 0), np.array([0.0, 0.0, driven_m]))

    return pose


def hovering(rng: np.random.Generator, home_m: tuple[float, float, float], scale: float) -> Motion:
    """The path of an object that drifts about its home and sways, never showing its back."""
    aside = Wave(rng, ((0.35, 0.23), (0.08, 0.7)), scale)
    down = Wave(rng, ((0.22, 0.31), (0.06, 0.9)), scale)
    forward = Wave(rng, ((0.15, 0.19), (0.04, 0.6)), scale)
    roll, yaw = Wave(rng, ((14.0, 0.27),), scale), Wave(rng, ((18.0, 0.2),), scale)

    def pose(t_s: float) -> Pose:
        away = np.array([aside.at(t_s), down.at(t_s), forward.at(t_s)])
        return Pose(rotation(roll.at(t_s), 0, yaw.at(t_s)), np.array(home_m) + away)

    return pose
