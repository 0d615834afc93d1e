"""V4L2 cameras as one source: a thread a camera, one inbox."""

from __future__ import annotations

import logging
import threading
from collections.abc import Iterator, Mapping

from pipeline.errors import InputError, RunError
from pipeline.frame import Camera, Frame
from sources.live import Inbox
from sources.v4l2.camera import LiveCamera
from sources.v4l2.device import Host, TroubleError
from sources.v4l2.nodes import Node, here
from sources.v4l2.settings import V4l2Settings

log = logging.getLogger("syncwatch.sources.v4l2")

FRAMES_AHEAD = 8
"""Frames a camera that may wait to be read: they are taken out at once unless this machine is overloaded."""

DEFAULT_FPS = 30.0

PATIENCE_S = 5.0
"""How long a driver may take to let go of a camera."""


class V4l2Source:
    """Implements Source; always `live`."""

    live = True
    frame_count = None

    def __init__(self, settings: V4l2Settings, *, host: Host | None = None) -> None:
        self._settings = settings
        self._host = host or Host()
        self._stopped = threading.Event()
        self._inbox: Inbox[Frame] = Inbox(settings.cameras, frames_ahead=FRAMES_AHEAD)
        self._live = [
            LiveCamera(
                name,
                asked,
                host=self._host,
                silent_after_s=settings.silent_after_s,
                put=self._inbox.put,
                stopped=self._stopped,
            )
            for name, asked in settings.cameras.items()
        ]
        self._threads = [
            threading.Thread(target=self._keep, args=(camera,), name=f"v4l2-{camera.name}", daemon=True)
            for camera in self._live
        ]
        self.cameras: tuple[Camera, ...] = ()

    @property
    def dropped(self) -> Mapping[str, int]:
        return self._inbox.dropped

    def open(self) -> None:
        """Finds, opens and sets up every camera; with `wait`, those that are there."""
        try:
            for camera in self._live:
                node = self._found(camera)
                if node is not None:
                    self._open(camera, node)
        except BaseException:
            self.close()
            raise
        self.cameras = tuple(Camera(camera.name, self._fps(camera)) for camera in self._live)

    def frames(self) -> Iterator[Frame]:
        for thread in self._threads:
            thread.start()
        yield from self._inbox.read()

    def stop(self) -> None:
        self._stopped.set()
        self._inbox.end()

    def close(self) -> None:
        self.stop()
        for camera, thread in zip(self._live, self._threads, strict=True):
            if thread.ident is None:
                camera.close()
                continue
            thread.join(PATIENCE_S)
            if thread.is_alive():
                log.error("%s: its driver has not let go of it within %.0f s", camera.name, PATIENCE_S)
            if camera.counts.text:
                log.warning("%s: %d frames, %s", camera.name, camera.counts.frames, camera.counts.text)
        self._inbox.say_what_was_dropped()

    def _found(self, camera: LiveCamera) -> Node | None:
        try:
            return camera.find()
        except TroubleError as error:
            if not self._settings.wait:
                raise InputError(
                    f"source.cameras.{camera.name}.device: {error}: {here(self._host)} (wait: true waits for it)"
                ) from error
            log.warning("%s: %s yet: waiting for it", camera.name, error)
            return None

    def _open(self, camera: LiveCamera, node: Node) -> None:
        for other in self._live:
            if other.node is not None and other.node.path == node.path:
                raise InputError(f"source.cameras.{camera.name}.device: {node.path} is '{other.name}' already")
        try:
            camera.open(node)
        except InputError as error:
            raise InputError(f"source.cameras.{camera.name}.{error} ({node.path})") from error
        except TroubleError as error:
            raise InputError(f"source.cameras.{camera.name}: {node.path}: {error}") from error

    @staticmethod
    def _fps(camera: LiveCamera) -> float:
        if camera.fps is None:
            log.warning("%s: frame rate unknown: %g is assumed; set fps", camera.name, DEFAULT_FPS)
        return camera.fps or DEFAULT_FPS

    def _keep(self, camera: LiveCamera) -> None:
        """The thread of one camera."""
        try:
            camera.run()
        except Exception as error:  # a fault of this program: it ends the run and is told
            log.debug("%s", camera.name, exc_info=error)
            self._inbox.end(RunError(f"{camera.name}: {type(error).__name__}: {error}"))
