"""The content offset detector: epipolar regression on tracked corners, locked by motion signals."""

from __future__ import annotations

from collections.abc import Sequence

from pipeline.detectors.offset.motion_signal import MotionSignal
from pipeline.detectors.offset.pair import PairEstimator, View
from pipeline.detectors.offset.settings import OffsetSettings
from pipeline.detectors.offset.tracks import Flow, Tracker, Tracks
from pipeline.detectors.offset.weigh import Finding, weigh
from pipeline.detectors.offset.working import Working, work_on
from pipeline.frame import NS_PER_MS, Pair, Rig, Triple, Window
from pipeline.pictures import Memo
from pipeline.verdict import Basis, Evidence, State


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
        if now is not None and after is not None and index + 1 not in self._flows:
            flow = self._signal.add(index + 1, now, after)
            if flow is not None:
                self._flows[index + 1] = flow
        back, forth = self._flows.get(index), self._flows.get(index + 1)
        if self._tracker is not None and before and now and after and back and forth and alike(before, now, after):
            self._tracks[index] = self._tracker.step(index, before, now, after, back, forth)
        self._flows = {slot: f for slot, f in self._flows.items() if slot > index}
        self._pictures = {slot: p for slot, p in self._pictures.items() if slot >= index - self._keep}
        self._tracks = {slot: p for slot, p in self._tracks.items() if slot >= index - self._keep}


def alike(*pictures: Working) -> bool:
    return len({p.image.shape for p in pictures}) == 1


class OffsetDetector:
    """Implements Detector: one piece of evidence a pair, an offset with its error or why there is none."""

    def __init__(self, settings: OffsetSettings, *, name: str, rig: Rig, classic: bool = False) -> None:
        del classic
        self._settings = settings
        self._name = name
        self._rig = rig
        firsts = {pair.first for pair in rig.pairs}
        used = [c.name for c in rig.cameras if any(c.name in (p.first, p.second) for p in rig.pairs)]
        self._eyes = {camera: Eye(settings, tracked=camera in firsts) for camera in used}
        self._estimators = {
            pair.name: PairEstimator(settings.max_lag_frames, with_halves=settings.halves) for pair in rig.pairs
        }

    def observe(self, window: Window) -> Sequence[Evidence]:
        if window.index % self._settings.every:
            return [
                self._abstain(pair, f"not looked at: one window in {self._settings.every} is")
                for pair in self._rig.pairs
            ]
        for camera, eye in self._eyes.items():
            eye.look(window, window.cameras[camera])
        return [self._judge(pair, window) for pair in self._rig.pairs]

    def _judge(self, pair: Pair, window: Window) -> Evidence:
        for camera in (pair.first, pair.second):
            triple = window.cameras[camera]
            if triple.current is None:
                return self._abstain(pair, f"no frame of {camera}")
        first, second = self._eyes[pair.first].view, self._eyes[pair.second].view
        estimator = self._estimators[pair.name]
        points = estimator.update(window.index, first, second)
        return self._say(pair, weigh(points, estimator.signal))

    def _say(self, pair: Pair, found: Finding) -> Evidence:
        if found.tau is None or found.sigma is None:
            return self._abstain(pair, found.why)
        period_ns = self._rig.camera(pair.second).period_ns
        tolerance = self._tolerance_ns(period_ns) / period_ns
        away = abs(found.tau - pair.expected_offset_ns / period_ns)
        state, reason = State.UNKNOWN, found.why or "error too large beside the tolerance"
        if found.known and away + 2 * found.sigma <= tolerance:
            state, reason = State.SYNC, f"{found.spoke} agree to {found.sigma:.3f} frames"
        elif found.known and away - 2 * found.sigma > tolerance:
            later = "later" if found.tau > 0 else "earlier"
            state, reason = State.ASYNC, f"{pair.second} is {abs(found.tau):.2f} frames {later} by {found.spoke}"
        return Evidence(
            pair=pair.name,
            detector=self._name,
            basis=Basis.CONTENT,
            state=state,
            reason=reason,
            offset_ns=round(found.tau * period_ns),
            sigma_ns=round(found.sigma * period_ns),
            offset_frames=found.tau,
            sigma_frames=found.sigma,
            motion_px=found.motion_px,
            numbers=found.numbers,
        )

    def _tolerance_ns(self, period_ns: int) -> float:
        """5 ms, but at least 3 and at most 10 % of a period, unless set."""
        if self._settings.tolerance_ms == "auto":
            return min(max(5.0 * NS_PER_MS, 0.03 * period_ns), 0.10 * period_ns)
        return self._settings.tolerance_ms * NS_PER_MS

    def _abstain(self, pair: Pair, reason: str) -> Evidence:
        return Evidence(pair=pair.name, detector=self._name, basis=Basis.CONTENT, state=State.UNKNOWN, reason=reason)
