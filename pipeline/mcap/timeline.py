"""When messages are logged: wall-clock time, for a recording as if it ran now at its own pace."""

from __future__ import annotations

from collections.abc import Callable, Sequence

from pipeline.frame import NS_PER_S, Camera, Frame

CLOCK_STEP_NS = NS_PER_S // 10
"""The wall clock has been set when it is further than this from where the monotonic clock expects it."""

OLDEST_NS = 60 * NS_PER_S
"""An arrival longer ago than this, or in the future, was not told on this host's monotonic clock."""

LONGEST_GAP_NS = 10 * NS_PER_S
"""Stamps that step back, or by more than this and ten periods, tell that a clock was set, not that time passed."""


class Timeline:
    """Log times of frames and reports, in nanoseconds since 1970.

    Live frames are logged when they arrived. Frames of a source that is not live, which may run faster or slower than
    time does, are logged by how much time their stamps say has passed.
    """

    def __init__(
        self,
        cameras: Sequence[Camera],
        *,
        live: bool,
        wall_ns: Callable[[], int],
        monotonic_ns: Callable[[], int],
    ) -> None:
        self._live = live
        self._wall_ns = wall_ns
        self._monotonic_ns = monotonic_ns
        self._ahead_ns = wall_ns() - monotonic_ns()
        self._period_ns = {camera.name: camera.period_ns for camera in cameras}
        self._passed: dict[str, tuple[int, int]] = {}
        self._now_ns = wall_ns()

    def of(self, frame: Frame) -> int:
        if self._live:
            return self._arrival_ns(frame)
        before = self._passed.get(frame.camera)
        at_ns = self._now_ns if before is None else before[0] + self._step_ns(frame, before[1])
        self._passed[frame.camera] = at_ns, frame.captured_ns
        self._now_ns = max(self._now_ns, at_ns)
        return self._now_ns

    def now(self) -> int:
        return self._wall_ns() if self._live else self._now_ns

    def _arrival_ns(self, frame: Frame) -> int:
        now_ns, wall_ns = self._monotonic_ns(), self._wall_ns()
        if abs(wall_ns - now_ns - self._ahead_ns) > CLOCK_STEP_NS:
            self._ahead_ns = wall_ns - now_ns
        if not 0 <= now_ns - frame.arrived_ns <= OLDEST_NS:
            return wall_ns
        return frame.arrived_ns + self._ahead_ns

    def _step_ns(self, frame: Frame, before_ns: int) -> int:
        period_ns = self._period_ns[frame.camera]
        step_ns = frame.captured_ns - before_ns
        return step_ns if 0 <= step_ns <= max(LONGEST_GAP_NS, 10 * period_ns) else period_ns
