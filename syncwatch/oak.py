"""Watches the cameras of a depthai pipeline of one's own: host nodes that tap outputs and feed a Monitor."""

from __future__ import annotations

import logging
from collections.abc import Mapping
from typing import Any

from pipeline.errors import InputError
from pipeline.frame import StampReference
from sources.oak.library import load
from sources.oak.message import clock_name, read_message
from sources.oak.settings import Clock
from syncwatch.monitor import Monitor

__all__ = ["Tap", "tap"]

dai = load(telemetry=False)  # whoever has imported depthai before has decided on telemetry already
HostNode: Any = dai.node.ThreadedHostNode

log = logging.getLogger("syncwatch.oak")

TAP_FRAMES = 8
"""Frames that may wait at a tap; beyond, the oldest is overwritten, and the pipeline it taps never waits."""


class Tap(HostNode):
    """A host node that pushes what comes on `input`. It never raises: that would abort the whole program."""

    def __init__(self) -> None:
        super().__init__()
        self.input = self.createInput()
        self.input.setBlocking(False)
        self.input.setMaxSize(TAP_FRAMES)
        self._monitor: Monitor | None = None
        self._camera = ""
        self._clock: Clock = "device"
        self._epoch = 0
        self._sequence = 0
        self._refused: set[str] = set()

    def build(self, monitor: Monitor, camera: str, clock: Clock, epoch: int) -> Tap:
        self._monitor, self._camera, self._clock, self._epoch = monitor, camera, clock, epoch
        return self

    def run(self) -> None:
        try:
            while self.isRunning():
                self._push(self.input.get())
        except dai.MessageQueue.QueueException:
            pass  # the pipeline has ended
        except Exception:  # one that leaves a node of depthai aborts the whole program
            log.exception("the tap of %s has failed: nothing more is watched there", self._camera)

    def _push(self, message: Any) -> None:
        assert self._monitor is not None
        try:
            said = read_message(message, self._clock)
            self._epoch += said.sequence < self._sequence
            self._sequence = said.sequence
            self._monitor.push(
                self._camera,
                said.image,
                said.captured_ns,
                said.sequence,
                said.exposure_ns,
                clock=clock_name(self._clock, "oak"),
                epoch=self._epoch,
                stamp_reference=StampReference.END,
                copy=False,
            )
        except InputError as error:
            if str(error) not in self._refused:
                self._refused.add(str(error))
                log.warning("%s", error)


def tap(
    pipeline: Any, monitor: Monitor, outputs: Mapping[str, Any], *, clock: Clock = "device", epoch: int = 0
) -> list[Tap]:
    """Taps outputs of cameras, by the monitor's names for them, before the pipeline is started.

    ::

        with Monitor(cameras={"left": 30, "right": 30}) as monitor:
            taps = tap(pipeline, monitor, {"left": left.requestOutput(...), "right": right.requestOutput(...)})
            pipeline.start()

    clock: `device` for the cameras of one OAK, `host` or `ptp` for those of several. epoch: is to rise where a monitor
    goes on with a pipeline that is started anew; when a counter falls, it rises by itself. The pipeline is not slowed
    down: a tap that cannot keep up loses frames, which shows as drops. Keep what is returned as long as the pipeline
    runs.
    """
    taps = []
    for camera, output in outputs.items():
        node = pipeline.create(Tap).build(monitor, camera, clock, epoch)
        output.link(node.input)
        taps.append(node)
    return taps
