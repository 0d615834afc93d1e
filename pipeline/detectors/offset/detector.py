"""The content offset detector: epipolar regression on tracked corners, locked by motion signals."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from pathlib import Path

from pipeline.detectors.offset.budget import Budget
from pipeline.detectors.offset.knowledge import Knowledge
from pipeline.detectors.offset.loops import Edge, closed, measured_pairs
from pipeline.detectors.offset.motion_signal import MotionSignal
from pipeline.detectors.offset.pair import PairEstimator, View
from pipeline.detectors.offset.settings import OffsetSettings
from pipeline.detectors.offset.silence import Silence, reason_of
from pipeline.detectors.offset.tracks import Flow, Tracker, Tracks
from pipeline.detectors.offset.weigh import Finding, weigh
from pipeline.detectors.offset.working import Working, work_on
from pipeline.frame import NS_PER_MS, Pair, Rig, Triple, Window
from pipeline.pictures import Memo
from pipeline.verdict import Basis, Evidence, Reason, State

ACCUSING = 3.0
"""Standard errors by which an offset must exceed the tolerance to be called out of sync; in sync takes two."""


class Eye:
    """One camera's bounded history: pictures, tracks where needed, and its motion signal."""

    def __init__(self, settings: OffsetSettings, *, tracked: bool) -> None:
        self._width = settings.working_width_px
        self._keep = settings.max_lag_frames + 2
        self._memo: Memo[Working] = Memo(lambda frame: work_on(frame.image, self._width))
        self._tracker = Tracker(settings.points) if tracked else None
        self._pictures: dict[int, Working] = {}
        self._tracks: dict[int, Tracks] = {}
        self._flows: dict[int, Flow] = {}
        self._signal = MotionSignal(settings.max_lag_frames)

    @property
    def view(self) -> View:
        return View(self._pictures, self._tracks, self._signal)

    def look(self, window: Window, triple: Triple) -> None:
        self._memo.enter(window)
        index = window.index
        for slot, frame in ((index - 1, triple.previous), (index, triple.current), (index + 1, triple.following)):
            if frame is not None:
                self._pictures[slot] = self._memo[frame]
        before, now, after = (self._pictures.get(slot) for slot in (index - 1, index, index + 1))
        for slot, earlier, later in ((index, before, now), (index + 1, now, after)):
            if earlier is not None and later is not None and slot not in self._flows:
                flow = self._signal.add(slot, earlier, later)
                if flow is not None:
                    self._flows[slot] = flow
        back, forth = self._flows.get(index), self._flows.get(index + 1)
        if self._tracker is not None and before and now and after and back and forth and alike(before, now, after):
            self._tracks[index] = self._tracker.step(index, before, now, after, back, forth)
        self._flows = {slot: f for slot, f in self._flows.items() if slot > index}
        self._pictures = {slot: p for slot, p in self._pictures.items() if slot >= index - self._keep}
        self._tracks = {slot: p for slot, p in self._tracks.items() if slot >= index - self._keep}


def alike(*pictures: Working) -> bool:
    return len({p.image.shape for p in pictures}) == 1


class OffsetDetector:
    """Implements Detector: one piece of evidence a pair, an offset with its error or why there is none.

    base: the folder from which paths of files count. cpu_ns: CPU time used so far. sync_tolerance_ms: the judge's.
    """

    def __init__(
        self,
        settings: OffsetSettings,
        *,
        name: str,
        rig: Rig,
        base: Path = Path(),
        version: str = "",
        sync_tolerance_ms: float | None = None,
        wall_ns: Callable[[], int] = time.time_ns,
        cpu_ns: Callable[[], int] = time.thread_time_ns,
    ) -> None:
        self._settings = settings
        self._name = name
        self._rig = rig
        self._tolerance_ms = sync_tolerance_ms if settings.tolerance_ms == "auto" else settings.tolerance_ms
        self._edges = measured_pairs(rig.pairs, [camera.name for camera in rig.cameras])
        firsts = {first for first, _ in self._edges}
        self._eyes = {name: Eye(settings, tracked=name in firsts) for edge in self._edges for name in edge}
        self._estimators: dict[Edge, PairEstimator] = {}
        self._sizes: dict[Edge, tuple[int, int]] = {}
        self._in_sync: dict[Edge, bool] = {}
        self._budget = Budget(settings.cpu_percent / 100, min(camera.period_ns for camera in rig.cameras), cpu_ns)
        self._knowledge = Knowledge(
            [camera.name for camera in rig.cameras],
            None if settings.calibration is None else base / settings.calibration,
            None if settings.rig is None else base / settings.rig,
            version=version,
            wall_ns=wall_ns,
        )

    def observe(self, window: Window) -> Sequence[Evidence]:
        if window.index % self._settings.every:
            return self._abstain_all(f"not looked at: one window in {self._settings.every} is")
        if not self._budget.allows(window.index):
            return self._abstain_all(f"not looked at: over {self._settings.cpu_percent:g} % of a core")
        with self._budget:
            for camera, eye in self._eyes.items():
                eye.look(window, window.cameras[camera])
            found = {edge: self._find(edge, window) for edge in self._edges}
            if len(self._edges) > 2:
                found = closed(found, {camera.name: camera.period_ns for camera in self._rig.cameras})
            return [self._say(pair, found[pair.first, pair.second]) for pair in self._rig.pairs]

    def close(self) -> None:
        """Keeps what was learned of pairs that are in sync. Raises RunError."""
        self._knowledge.keep(
            {
                f"{first}-{second}": (self._sizes[first, second], estimator.memory)
                for (first, second), estimator in self._estimators.items()
                if self._in_sync.get((first, second))
            }
        )

    def _find(self, edge: Edge, window: Window) -> Finding:
        for camera in edge:
            if window.cameras[camera].current is None:
                return Finding(None, None, Silence(f"no frame of {camera}", Reason.UNPAIRED))
        estimator = self._estimators.get(edge) or self._start(edge, window)
        points = estimator.update(window.index, self._eyes[edge[0]].view, self._eyes[edge[1]].view)
        return weigh(points, estimator.signal)

    def _start(self, edge: Edge, window: Window) -> PairEstimator:
        pictures = [frame.image for camera in edge if (frame := window.cameras[camera].current) is not None]
        recorded = [(image.shape[1], image.shape[0]) for image in pictures]
        shown = self._eyes[edge[0]].view.pictures[window.index].image.shape
        self._sizes[edge] = shown[1], shown[0]
        memory = self._knowledge.memory(*edge, (recorded[0], recorded[1]), self._sizes[edge])
        most, with_halves = self._settings.max_lag_frames, self._settings.halves
        self._estimators[edge] = PairEstimator(most, memory, with_halves=with_halves)
        return self._estimators[edge]

    def _say(self, pair: Pair, found: Finding) -> Evidence:
        if found.tau is None or found.sigma is None:
            return self._abstain(pair, found.why)
        period_ns = self._rig.camera(pair.second).period_ns
        tolerance = self._tolerance_ns(period_ns) / period_ns
        away = abs(found.tau - pair.expected_offset_ns / period_ns)
        state, reason = State.UNKNOWN, found.why or Silence("error too large beside the tolerance", Reason.WIDE_ERROR)
        if found.known and away + 2 * found.sigma <= tolerance:
            state, reason = State.SYNC, f"{found.spoke} agree to {found.sigma:.3f} frames"
        elif found.known and away - ACCUSING * found.sigma > tolerance:
            later = "later" if found.tau > 0 else "earlier"
            state, reason = State.ASYNC, f"{pair.second} is {abs(found.tau):.2f} frames {later} by {found.spoke}"
        if state is not State.UNKNOWN:
            self._in_sync[pair.first, pair.second] = state is State.SYNC
        return Evidence(
            pair=pair.name,
            detector=self._name,
            basis=Basis.CONTENT,
            state=state,
            reason=str(reason),
            offset_ns=round(found.tau * period_ns),
            sigma_ns=round(found.sigma * period_ns),
            offset_frames=found.tau,
            sigma_frames=found.sigma,
            motion_px=found.motion_px,
            numbers=found.numbers,
            silence=reason_of(reason) if state is State.UNKNOWN else None,
        )

    def _tolerance_ns(self, period_ns: int) -> float:
        """5 ms, but at least 3 and at most 10 % of a period, unless set."""
        if self._tolerance_ms is None:
            return min(max(5.0 * NS_PER_MS, 0.03 * period_ns), 0.10 * period_ns)
        return self._tolerance_ms * NS_PER_MS

    def _abstain_all(self, reason: str) -> list[Evidence]:
        return [self._abstain(pair, reason) for pair in self._rig.pairs]

    def _abstain(self, pair: Pair, reason: str) -> Evidence:
        return Evidence(
            pair=pair.name,
            detector=self._name,
            basis=Basis.CONTENT,
            state=State.UNKNOWN,
            reason=str(reason),
            silence=reason_of(reason),
        )
