"""Prints what the content offset costs, as a ratio to the report's spatial test on the same pictures.

    python -m benchmarks.cost

CPU time of the whole process, one thread of OpenCV's, the same windows given to both detectors in turn.
"""

from __future__ import annotations

import statistics
import sys
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import cv2

from pipeline.buffer import BufferSettings, WindowBuffer
from pipeline.detectors.offset.detector import OffsetDetector
from pipeline.detectors.offset.settings import OffsetSettings
from pipeline.detectors.spatial import SpatialDetector, SpatialSettings
from pipeline.frame import Detector, Pair, Rig, Window
from sources.synthetic.settings import SyntheticSettings
from sources.synthetic.source import SyntheticSource

GOALS = {(640, 480): 1 / 2, (1920, 1080): 1 / 10}
"""The largest allowed ratio, by size of the pictures in px."""

MOTIONS = ("handheld", "objects", "drive")
FPS = 30.0
WARM_UP, MEASURED, REPEATS = 30, 20, 5
"""Windows that both detectors see before it counts (a second), then windows a repeat."""

MS = 1e6


@dataclass(frozen=True, slots=True)
class Cost:
    """CPU ms a pair and window of both detectors, a number a repeat."""

    width: int
    height: int
    motion: str
    offset_ms: Sequence[float]
    spatial_ms: Sequence[float]

    @property
    def ratios(self) -> list[float]:
        return [mine / theirs for mine, theirs in zip(self.offset_ms, self.spatial_ms, strict=True)]

    @property
    def ratio(self) -> float:
        return statistics.median(self.ratios)

    @property
    def met(self) -> bool:
        return self.ratio <= GOALS[self.width, self.height]


def measure(width: int, height: int, motion: str) -> Cost:
    """Both detectors on the same rendered windows, in alternation; which goes first alternates, too."""
    cv2.setNumThreads(1)
    windows, rig = _windows(width, height, motion)
    offset = OffsetDetector(OffsetSettings(), name="offset", rig=rig)
    spatial = SpatialDetector(SpatialSettings(), name="spatial", rig=rig)
    for window in (next(windows) for _ in range(WARM_UP)):
        _observe_ms([offset, spatial], window)
    offset_ms, spatial_ms = [], []
    for _ in range(REPEATS):
        spent_ms = [_observe_ms([offset, spatial], next(windows)) for _ in range(MEASURED)]
        offset_ms.append(statistics.mean(mine for mine, _ in spent_ms))
        spatial_ms.append(statistics.mean(theirs for _, theirs in spent_ms))
    return Cost(width, height, motion, offset_ms, spatial_ms)


def measure_all() -> Iterator[Cost]:
    for width, height in GOALS:
        for motion in MOTIONS:
            yield measure(width, height, motion)


def line(cost: Cost) -> str:
    """One result for people."""
    low, high = min(cost.ratios), max(cost.ratios)
    return (
        f"{f'{cost.width}x{cost.height}':10} {cost.motion:10} {statistics.median(cost.offset_ms):10.1f} "
        f"{statistics.median(cost.spatial_ms):11.1f} {cost.ratio:6.2f} ({low:.2f}..{high:.2f})"
    )


def _observe_ms(detectors: Sequence[Detector], window: Window) -> list[float]:
    """CPU time of each detector on a window, in the order given, whichever runs first."""
    spent_ms = [0.0] * len(detectors)
    order = range(len(detectors)) if window.index % 2 else reversed(range(len(detectors)))
    for place in order:
        started_ns = time.process_time_ns()
        detectors[place].observe(window)
        spent_ms[place] = (time.process_time_ns() - started_ns) / MS
    return spent_ms


def _windows(width: int, height: int, motion: str) -> tuple[Iterator[Window], Rig]:
    frames = WARM_UP + REPEATS * MEASURED + 2
    settings = SyntheticSettings.model_validate(
        {"motion": motion, "width": width, "height": height, "fps": FPS, "duration_s": frames / FPS}
    )
    source = SyntheticSource(settings, seed=1)
    source.open()
    rig = Rig("bench", tuple(source.cameras), (Pair("left", "right"),))
    buffer = WindowBuffer(rig.cameras, BufferSettings())
    return (window for frame in source.frames() for window in buffer.push(frame)), rig


def main() -> None:
    print(f"{'pictures':10} {'motion':10} {'offset ms':>10} {'spatial ms':>11} {'ratio':>6} (lowest..highest repeat)")
    for cost in measure_all():
        print(line(cost))
        sys.stdout.flush()
    for (width, height), limit in GOALS.items():
        print(f"goal at {width}x{height}: at most {limit:g}")


if __name__ == "__main__":
    main()
