"""A source that renders its own pictures, and so knows exactly which moment each of them shows."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Iterator
from statistics import NormalDist
from typing import TYPE_CHECKING, cast

import cv2
import numpy as np

from pipeline.errors import InputError
from pipeline.frame import NS_PER_MS, NS_PER_S, Camera, Frame, StampOrigin, StampReference, Truth
from sources.synthetic.motion import Pose, rig_motion, rotation
from sources.synthetic.room import Room
from sources.synthetic.scene import Workshop
from sources.synthetic.street import Street
from sources.synthetic.surface import View, render

if TYPE_CHECKING:
    from pipeline.frame import Picture
    from sources.synthetic.scene import Scene
    from sources.synthetic.settings import RigCamera, SyntheticSettings

START_NS = 1_000_000_000_000
"""The moment of the first trigger on the rig's clock."""

BACKGROUND_LEVEL = 128
BLUR_STEPS = 5
NOISE_ZERO, NOISE_STEP = 128, 32  # levels of the noise table: its mean, and a standard deviation

_BELL = np.array([NormalDist().inv_cdf((i + 0.5) / 256) for i in range(256)])
NOISE_TABLE = (NOISE_ZERO + NOISE_STEP * _BELL / _BELL.std()).round().astype(np.uint8)
"""Turns evenly spread bytes into normally distributed ones."""


class SyntheticSource:
    """Implements Source and Renderer. The same settings and seed give the same pictures, bit for bit.

    `clock_ns` stamps arrivals and paces. `wait` sleeps for some seconds and says whether to stop; the default is woken
    by `stop`. It is never `live`: a rendered frame can always wait.
    """

    live = False

    def __init__(
        self,
        settings: SyntheticSettings,
        *,
        seed: int,
        clock_ns: Callable[[], int] = time.monotonic_ns,
        wait: Callable[[float], bool] | None = None,
    ) -> None:
        self._settings = settings
        self._rig = {camera.name: camera for camera in settings.rig}
        self._seed = abs(seed if settings.seed is None else settings.seed)
        self._stopped = threading.Event()
        self._clock_ns = clock_ns
        self._wait = wait or self._stopped.wait
        self._motion = rig_motion(settings, np.random.default_rng([self._seed, 2]))
        self._mounts = {c.name: Pose(rotation(*c.settings.rotation_deg), np.array(c.position_m)) for c in settings.rig}
        self._scene: Scene | None = None

    @property
    def cameras(self) -> tuple[Camera, ...]:
        return tuple(Camera(name, self._settings.fps) for name in self._rig)

    @property
    def frame_count(self) -> int:
        return max(1, round(self._settings.duration_s * self._settings.fps))

    def open(self) -> None:
        """Paints the scene."""
        workshop = Workshop(self._seed, max(c.focal_px for c in self._rig.values()), colour=self._settings.colour)
        if self._settings.place == "street":
            self._scene = Street(workshop)
        else:
            rng = np.random.default_rng([self._seed, 3])
            floating = self._settings.motion == "objects"
            self._scene = Room(workshop, rng, floating=floating, amplitude=self._settings.amplitude)

    def frames(self) -> Iterator[Frame]:
        started_ns = self._clock_ns()
        for number in range(self.frame_count):
            for camera in self._rig.values():
                if self._stopped.is_set():
                    return
                shown_ns = self._shown_ns(camera, number)
                image = self.picture_at(camera.name, shown_ns)
                if self._stops_before(started_ns, shown_ns):
                    return
                yield self._frame(camera, number, shown_ns, image)

    def stop(self) -> None:
        self._stopped.set()

    def close(self) -> None:
        self._scene = None

    def picture_at(self, camera: str, shown_ns: int) -> Picture:
        """What `camera` sees at `shown_ns` on the rig's clock, with its blur, gain and noise; always the same."""
        if camera not in self._rig:
            raise InputError(f"no camera is named {camera!r}; this rig has {', '.join(self._rig)}")
        rig_camera = self._rig[camera]
        settings = rig_camera.settings
        if settings.exposure_ms is None:
            scene = self._sharp(rig_camera, shown_ns)
        else:
            steps = (np.arange(BLUR_STEPS) + 0.5) / BLUR_STEPS - 0.5
            moments_ns = shown_ns + (steps * settings.exposure_ms * NS_PER_MS).round().astype(int)
            exposed = np.mean([self._sharp(rig_camera, int(ns)) for ns in moments_ns], axis=0)
            scene = cast("Picture", exposed.round().astype(np.uint8))
        return self._developed(rig_camera, shown_ns, scene)

    def _shown_ns(self, camera: RigCamera, number: int) -> int:
        settings = camera.settings
        elapsed_ns = number * NS_PER_S / (self._settings.fps * (1 + settings.rate_ppm * 1e-6))
        return START_NS + round(elapsed_ns + settings.offset_ms * NS_PER_MS)

    def _stops_before(self, started_ns: int, shown_ns: int) -> bool:
        if self._settings.speed == "max":
            return False
        due_ns = started_ns + round((shown_ns - START_NS) / self._settings.speed)
        while (early_ns := due_ns - self._clock_ns()) > 0:
            if self._wait(early_ns / NS_PER_S):
                return True
        return False

    def _frame(self, camera: RigCamera, number: int, shown_ns: int, image: Picture) -> Frame:
        settings = camera.settings
        has_own_clock = settings.clock.is_own or settings.rate_ppm != 0
        return Frame(
            camera=camera.name,
            sequence=number,
            captured_ns=self._stamp_ns(camera, number, shown_ns),
            clock=camera.name if has_own_clock else "rig",
            arrived_ns=self._clock_ns(),
            image=image,
            group=number,
            exposure_ns=None if settings.exposure_ms is None else round(settings.exposure_ms * NS_PER_MS),
            stamp_reference=StampReference.MIDDLE,
            stamp_origin=StampOrigin.DEVICE,
            truth=Truth(shown_ns=shown_ns),
        )

    def _stamp_ns(self, camera: RigCamera, number: int, shown_ns: int) -> int:
        clock = camera.settings.clock
        jitter_ms = clock.jitter_ms * self._rng(camera, 4, number).standard_normal() if clock.jitter_ms else 0.0
        gained_ns = (shown_ns - START_NS) * clock.drift_ppm * 1e-6
        return shown_ns + round(gained_ns + (clock.offset_ms + jitter_ms) * NS_PER_MS)

    def _sharp(self, camera: RigCamera, shown_ns: int) -> Picture:
        assert self._scene is not None, "open comes first"
        t_s = (shown_ns - START_NS) / NS_PER_S
        rig = self._motion(t_s)
        view = View.of(rig, self._mounts[camera.name], camera.focal_px, camera.width, camera.height)
        shape = (camera.height, camera.width, 3) if self._settings.colour else (camera.height, camera.width)
        canvas = np.full(shape, BACKGROUND_LEVEL, np.uint8)
        render(canvas, view, list(self._scene.surfaces(t_s, float(rig.position_m[2]))))
        return canvas

    def _developed(self, camera: RigCamera, shown_ns: int, scene: Picture) -> Picture:
        settings = camera.settings
        if settings.noise_sigma:
            evenly = np.frombuffer(self._rng(camera, 5, shown_ns).bytes(scene.size), np.uint8).reshape(scene.shape)
            noise, strength = cv2.LUT(evenly, NOISE_TABLE), settings.noise_sigma / NOISE_STEP
        else:
            noise, strength = scene, 0.0
        level = settings.offset_level - NOISE_ZERO * strength
        return cast("Picture", cv2.addWeighted(scene, settings.gain, noise, strength, level))

    def _rng(self, camera: RigCamera, purpose: int, moment: int) -> np.random.Generator:
        """Chance that depends on nothing but the camera, the purpose and the moment."""
        return np.random.default_rng([self._seed, purpose, *camera.name.encode(), moment & (1 << 64) - 1])
