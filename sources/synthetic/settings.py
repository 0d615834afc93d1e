"""The settings of the rendered rig: which scene, how it moves, and the cameras that watch it."""

from __future__ import annotations

from typing import Annotated, Literal, NamedTuple

from pydantic import Field, model_validator

from pipeline.settings import Settings

Level = Annotated[float, Field(ge=-255, le=255)]
SizePx = Annotated[int, Field(ge=32, le=8192)]
Ppm = Annotated[float, Field(ge=-100_000, le=100_000)]
Metres = Annotated[float, Field(ge=-1000, le=1000)]
Degrees = Annotated[float, Field(ge=-180, le=180)]


class ClockSettings(Settings):
    """How a camera's own clock differs from the rig's; positive `drift_ppm` runs fast."""

    offset_ms: float = 0.0
    drift_ppm: Ppm = 0.0
    jitter_ms: float = Field(default=0.0, ge=0)

    @property
    def is_own(self) -> bool:
        return bool(self.offset_ms or self.drift_ppm or self.jitter_ms)


class CameraSettings(Settings):
    """One camera of the rig; what is left out is filled in from the rig.

    position_m:   x right, y down, z forward. Default: `baseline_m` to the right of the camera before.
    rotation_deg: roll, pitch, yaw. Positive turns the camera clockwise, up, to the right.
    offset_ms:    positive exposes later than the trigger, so that the picture shows a later moment.
    rate_ppm:     the camera runs free; positive takes more frames a second, so that each comes earlier.
    gain, offset_level, noise_sigma: a pixel reads gain * scene + offset_level + noise, in grey levels.
    exposure_ms:  motion blur; the exposure is centred on the moment. Left out: infinitely short.
    """

    name: str | None = Field(default=None, pattern="^[a-z0-9_]+$")
    position_m: tuple[Metres, Metres, Metres] | None = None
    rotation_deg: tuple[Degrees, Degrees, Degrees] = (0.0, 0.0, 0.0)
    offset_ms: float = Field(default=0.0, ge=-3_600_000, le=3_600_000)
    rate_ppm: Ppm = 0.0
    clock: ClockSettings = ClockSettings()
    gain: float = Field(default=1.0, ge=0, le=100)
    offset_level: Level = 0.0
    noise_sigma: float = Field(default=2.0, ge=0, le=100)
    exposure_ms: float | None = Field(default=None, gt=0, le=10_000)
    focal_px: float | None = Field(default=None, gt=0, le=100_000)
    width: SizePx | None = None
    height: SizePx | None = None


class DriveSettings(Settings):
    """How the rig drives: `speed_variation` 0.3 swings its speed by up to 30 %, `pitch_deg` shakes it up and down."""

    speed_m_s: float = Field(default=10.0, gt=0, le=100)
    speed_variation: float = Field(default=0.2, ge=0, le=0.95)
    pitch_deg: float = Field(default=0.0, ge=0, le=10)


class RigCamera(NamedTuple):
    """A camera with nothing left open."""

    name: str
    position_m: tuple[float, float, float]
    focal_px: float
    width: int
    height: int
    settings: CameraSettings


class SyntheticSettings(Settings):
    """A rendered scene, seen by two or more cameras.

    seed:      default: the seed of the run.
    speed:     1.0 paces frames in real time, "max" renders as fast as frames are read.
    scene:     auto takes the street for `motion: drive` and the room for everything else.
    motion:    what moves: the rig carried by hand, driven, panned; or objects before still cameras; or nothing.
    amplitude: scales handheld, pan and objects.
    cameras:   a list, or how many.
    """

    type: Literal["synthetic"] = "synthetic"
    seed: int | None = Field(default=None, ge=0)
    duration_s: float = Field(default=20.0, gt=0, le=1_000_000)
    fps: float = Field(default=30.0, ge=0.001, le=10_000)
    width: SizePx = 640
    height: SizePx = 480
    colour: bool = False
    speed: Annotated[float, Field(gt=0)] | Literal["max"] = "max"
    scene: Literal["auto", "room", "street"] = "auto"
    motion: Literal["handheld", "drive", "pan", "objects", "still"] = "handheld"
    amplitude: float = Field(default=1.0, ge=0, le=3)
    drive: DriveSettings = DriveSettings()
    baseline_m: float = Field(default=0.12, ge=0, le=100)
    cameras: int | tuple[CameraSettings, ...] = 2

    @property
    def place(self) -> Literal["room", "street"]:
        if self.scene == "auto":
            return "street" if self.motion == "drive" else "room"
        return self.scene

    @property
    def rig(self) -> tuple[RigCamera, ...]:
        """The cameras, complete."""
        cameras = (CameraSettings(),) * self.cameras if isinstance(self.cameras, int) else self.cameras
        names = ("left", "right") if len(cameras) == 2 else tuple(f"cam{i}" for i in range(len(cameras)))
        return tuple(
            RigCamera(
                name=camera.name or names[i],
                position_m=camera.position_m or (i * self.baseline_m, 0.0, 0.0),
                focal_px=camera.focal_px or 0.8 * (camera.width or self.width),
                width=camera.width or self.width,
                height=camera.height or self.height,
                settings=camera,
            )
            for i, camera in enumerate(cameras)
        )

    @property
    def camera_names(self) -> tuple[str, ...]:
        return tuple(camera.name for camera in self.rig)

    @model_validator(mode="after")
    def _fits_together(self) -> SyntheticSettings:
        count = self.cameras if isinstance(self.cameras, int) else len(self.cameras)
        if not 2 <= count <= 64:
            raise ValueError(f"a rig needs 2 to 64 cameras, not {count}")
        names = self.camera_names
        twice = sorted({name for name in names if names.count(name) > 1})
        if twice:
            raise ValueError(f"two cameras are named {', '.join(twice)}; every camera needs a name of its own")
        if (self.motion == "drive") != (self.place == "street") and self.motion in ("drive", "objects"):
            raise ValueError(f"motion {self.motion} does not fit scene {self.scene}; leave scene out or set it to auto")
        return self
