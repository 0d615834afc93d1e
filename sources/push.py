"""A source whose frames another part of the same program hands over."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Mapping
from typing import Literal

import numpy as np
from pydantic import Field

from pipeline.errors import InputError
from pipeline.frame import Camera, Frame, Picture, StampOrigin, StampReference
from pipeline.settings import Settings
from sources.live import ARRIVAL_CLOCK, FRAMES_AHEAD, CameraName, Fps, FramesAhead, Inbox


class PushSettings(Settings):
    """Frames that a program hands over through `syncwatch.Monitor`.

    cameras:      their names, in order, and frame rates in Hz.
    frames_ahead: frames of a camera that may wait; then its oldest gives way.
    """

    type: Literal["push"] = "push"
    cameras: dict[CameraName, Fps] = Field(min_length=1)
    frames_ahead: FramesAhead = FRAMES_AHEAD


class PushSource:
    """Implements Source. `push` may be called from any thread, from before `open` on.

    Somebody has to announce with `attach` that frames will come: else `frames` raises InputError.
    """

    live = True
    frame_count = None

    def __init__(self, settings: PushSettings, *, clock_ns: Callable[[], int] = time.monotonic_ns) -> None:
        self._settings = settings
        self._clock_ns = clock_ns
        self._inbox: Inbox[Frame] = Inbox(settings.cameras, frames_ahead=settings.frames_ahead)
        self._sizes: dict[str, tuple[int, tuple[int, ...]]] = {}
        self._attached = False

    @property
    def cameras(self) -> tuple[Camera, ...]:
        return tuple(Camera(name, fps) for name, fps in self._settings.cameras.items())

    @property
    def dropped(self) -> Mapping[str, int]:
        """Frames that were pushed faster than they could be taken, by camera."""
        return self._inbox.dropped

    def attach(self) -> None:
        self._attached = True

    def open(self) -> None:
        pass

    def frames(self) -> Iterator[Frame]:
        if not self._attached:
            raise InputError("source push: a program has to hand over the frames: see syncwatch.Monitor")
        yield from self._inbox.read()

    def push(
        self,
        camera: str,
        image: Picture,
        *,
        captured_ns: int | None = None,
        sequence: int | None = None,
        exposure_ns: int | None = None,
        clock: str = "rig",
        epoch: int = 0,
        stamp_reference: StampReference = StampReference.UNKNOWN,
        copy: bool = True,
    ) -> bool:
        """Hands over a frame without waiting; whether it was accepted: after the end none is.

        captured_ns: None stamps the frame with its arrival, which is no evidence of when it was taken.
        copy: False declares that nobody writes to `image` any more. Raises InputError for a camera that does not exist
        and for a picture that is not H x W or H x W x 3 of 8 bits or not of the size of those of this epoch.
        """
        arrived_ns = self._clock_ns()
        self._check(camera, image, int(epoch))
        given = captured_ns is not None
        return self._inbox.put(
            Frame(
                camera=camera,
                sequence=None if sequence is None else int(sequence),
                captured_ns=arrived_ns if captured_ns is None else int(captured_ns),
                clock=clock if given else ARRIVAL_CLOCK,
                arrived_ns=arrived_ns,
                image=image.copy() if copy else image,
                epoch=int(epoch),
                exposure_ns=None if exposure_ns is None else int(exposure_ns),
                stamp_reference=stamp_reference,
                stamp_origin=StampOrigin.DEVICE if given else StampOrigin.ARRIVAL,
            )
        )

    def finish(self) -> None:
        """Nothing more will be pushed; what was is still judged."""
        self._inbox.end()

    def stop(self) -> None:
        self._inbox.stop()

    def close(self) -> None:
        self._inbox.stop()
        self._inbox.say_what_was_dropped()

    def _check(self, camera: str, image: Picture, epoch: int) -> None:
        if camera not in self._settings.cameras:
            raise InputError(f"no camera '{camera}': this rig has {', '.join(self._settings.cameras)}")
        array = np.asarray(image)
        if array.dtype != np.uint8 or not (array.ndim == 2 or (array.ndim == 3 and array.shape[2] == 3)):
            found = f"{array.dtype} {array.shape}"
            raise InputError(f"{camera}: a picture must be uint8, H x W or H x W x 3, not {found}: convert it first")
        of_epoch, usual = self._sizes.get(camera, (epoch, array.shape[:2]))
        if epoch > of_epoch:
            usual = array.shape[:2]
        self._sizes[camera] = (max(epoch, of_epoch), usual)
        if array.shape[:2] != usual:
            (height, width), (usual_height, usual_width) = array.shape[:2], usual
            raise InputError(
                f"{camera}: {width}x{height} pixels, but the pictures before had {usual_width}x{usual_height}: "
                "a camera that was started anew with another size has a higher epoch"
            )
