"""What travels from a camera to a detector: frames, windows of frames, and the rig they belong to."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from enum import Enum
from typing import TYPE_CHECKING, Protocol, TypeAlias, runtime_checkable

import numpy as np
import numpy.typing as npt

if TYPE_CHECKING:
    from pipeline.verdict import Evidence

Picture: TypeAlias = npt.NDArray[np.uint8]
"""H x W (grey) or H x W x 3 (blue, green, red), uint8."""

CAMERA_NAME = re.compile(r"[a-z0-9_]+")
NS_PER_S = 1_000_000_000
NS_PER_MS = 1_000_000


class StampReference(str, Enum):
    """Which moment of the exposure `captured_ns` marks."""

    START = "start"
    MIDDLE = "middle"
    END = "end"
    UNKNOWN = "unknown"


class StampOrigin(str, Enum):
    """Who made `captured_ns`; synthesised stamps and those of arrival are no evidence of when a picture was taken."""

    DEVICE = "device"
    DRIVER = "driver"
    ARRIVAL = "arrival"
    SYNTHESISED = "synthesised"


@dataclass(frozen=True, slots=True)
class Truth:
    """What is known about a frame because it was rendered or tampered with on purpose.

    `shown_ns` is the moment the picture really shows, on one clock common to all cameras of the rig;
    `faults` names the injected faults that are acting on the frame. `assumed`: the source did not know; the recording
    is taken to have been in sync before the faults.
    """

    shown_ns: int
    faults: tuple[str, ...] = ()
    assumed: bool = False


@dataclass(frozen=True, slots=True)
class Frame:
    """One picture of one camera, with everything its device said about it.

    captured_ns: the camera's own stamp, on the clock named `clock`.
    arrived_ns:  host monotonic time of arrival.
    sequence:    the device's counter, or None where there is none.
    group:       the slot in which the source delivered the frame, or None; equal groups belong together.
    epoch:       rises when the device or its clock restarts: counters and stamps are not compared across.
    image:       H x W or H x W x 3 uint8; the frame holds a read-only view, anyone may keep it.

    Raises ValueError when the image has another shape or dtype.
    """

    camera: str
    sequence: int | None
    captured_ns: int
    clock: str
    arrived_ns: int
    image: Picture
    group: int | None = None
    epoch: int = 0
    exposure_ns: int | None = None
    stamp_reference: StampReference = StampReference.UNKNOWN
    stamp_origin: StampOrigin = StampOrigin.DEVICE
    truth: Truth | None = None

    def __post_init__(self) -> None:
        shape = self.image.shape
        if self.image.dtype != np.uint8 or not (len(shape) == 2 or (len(shape) == 3 and shape[2] == 3)):
            raise ValueError(f"{self.camera}: image must be uint8, H x W or H x W x 3, not {self.image.dtype} {shape}")
        if self.image.flags.writeable:
            image = self.image.view()
            image.flags.writeable = False
            object.__setattr__(self, "image", image)


@dataclass(frozen=True, slots=True)
class Triple:
    """One camera's frames at t-1, t and t+1; None marks a hole or the end of the stream.

    `number` counts the camera's frames from 0 and is None where the frame at t is a hole.
    """

    previous: Frame | None
    current: Frame | None
    following: Frame | None
    number: int | None


@dataclass(frozen=True, slots=True)
class Window:
    """Frames t-1, t, t+1 of every camera of the rig, paired over cameras. `index` counts windows from 0."""

    index: int
    cameras: Mapping[str, Triple]


@dataclass(frozen=True, slots=True)
class Camera:
    """A camera of a rig. `fps` is its nominal frame rate in Hz."""

    name: str
    fps: float

    def __post_init__(self) -> None:
        if not CAMERA_NAME.fullmatch(self.name):
            raise ValueError(f"camera name {self.name!r}: only a-z, 0-9 and _ are allowed")
        if not self.fps > 0:
            raise ValueError(f"camera {self.name}: fps must be positive, not {self.fps}")

    @property
    def period_ns(self) -> int:
        return round(NS_PER_S / self.fps)


@dataclass(frozen=True, slots=True)
class Pair:
    """Two cameras that are compared. Offsets are the second camera's against the first's."""

    first: str
    second: str
    expected_offset_ns: int = 0

    @property
    def name(self) -> str:
        return f"{self.first}-{self.second}"


@dataclass(frozen=True, slots=True)
class Rig:
    """A named set of cameras in order, and the pairs among them that get verdicts."""

    name: str
    cameras: tuple[Camera, ...]
    pairs: tuple[Pair, ...]

    def camera(self, name: str) -> Camera:
        return next(camera for camera in self.cameras if camera.name == name)


class Source(Protocol):
    """Delivers the frames of one or more cameras.

    `open` is called once, from the main thread, before anything else; it raises InputError for input that cannot be
    used and fills `cameras`. `frames` is then iterated once, on the source's own thread, and may block. Frames of one
    camera come in order of capture; cameras interleave freely. `stop` may be called from any thread, any number of
    times, before or while iterating; iteration then ends promptly and without an exception. `close` is called last,
    exactly once after `open`, when no thread iterates any more.

    `live` sources cannot wait: when detection is slow, windows are dropped. Others are read as fast as they are judged.
    `frame_count` is the number of frames of the first camera when that is known, for progress. A source of recordings
    may have a property `ended`: the cameras of which the recording holds no more frames, which is no fault of theirs;
    and `pairs`: the cameras that belong together, where it tells. A live one may have `dropped`: by camera, how many of
    its frames gave way to newer ones because nobody took them in time.
    """

    @property
    def cameras(self) -> Sequence[Camera]: ...

    @property
    def live(self) -> bool: ...

    @property
    def frame_count(self) -> int | None: ...

    def open(self) -> None: ...

    def frames(self) -> Iterator[Frame]: ...

    def stop(self) -> None: ...

    def close(self) -> None: ...


@runtime_checkable
class Renderer(Protocol):
    """A source that can show any moment, not only those of its frames (rendered scenes)."""

    def picture_at(self, camera: str, shown_ns: int) -> Picture:
        """What `camera` sees at `shown_ns`, with the camera's noise and gain."""
        ...


class Detector(Protocol):
    """Turns a window into evidence, one piece a pair of the rig.

    Called from the detection thread only, once a window, in order of time; windows may be missing under load (their
    `index` tells). It may keep its own bounded history. It abstains (state unknown, reason in words) rather than guess.
    If it has a method `close()`, that is called after the last window.
    """

    def observe(self, window: Window) -> Sequence[Evidence]: ...
