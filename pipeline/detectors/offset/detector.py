"""The content offset detector: epipolar regression on tracked corners, locked by motion signals."""

from __future__ import annotations

from collections.abc import Sequence

from pipeline.detectors.offset.motion_signal import MotionSignal
from pipeline.detectors.offset.pair import Estimate, PairEstimator, View
from pipeline.detectors.offset.settings import OffsetSettings
from pipeline.detectors.offset.tracks import Tracker, Tracks
from pipeline.detectors.offset.working import Working, work_on
from pipeline.frame import NS_PER_MS, Pair, Rig, Triple, Window
from pipeline.pictures import Memo
from pipeline.verdict import Basis, Evidence, State

FLOOR_FRAMES = 0.004
FLOOR_PX = 0.004
"""Systematic error: a share of a frame (unequal shutters, interpolation) and of a pixel (lens, pixel grid)."""

MOST_NOISE = 0.5
"""When half of the apparent motion is tracking noise, nothing is said."""

INTERPOLATION = 0.25
"""Error of a moment between two frames, by its distance from the nearer one: motion that is curved over a frame is only
known at three moments. A sine of a radian a frame is off by 0.06 of a frame midway, and
heads and hands by twice that."""

LEAST_MOVING, LEAST_REGIONS = 8, 2
"""Points that must move across the rows, and cells of the picture they must be in: fewer may all be false together."""


class Eye:
    """One camera's bounded history: pictures, tracks where needed, and its motion signal."""

    def __init__(self, settings: OffsetSettings, *, tracked: bool) -> None:
        self._width = settings.working_width_px
        self._keep = settings.max_lag_frames + 2
        self._memo: Memo[Working] = Memo(lambda frame: work_on(frame.image, self._width))
        self._tracker = Tracker(settings.points) if tracked else None
        self._pictures: dict[int, Working] = {}
        self._tracks: dict[int, Tracks] = {}
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
        if before is not None and now is not None and triple.previous is not None:
            self._signal.add(index, before, now)
            if self._tracker is not None and after is not None and alike(before, now, after):
                self._tracks[index] = self._tracker.step(index, before, now, after)
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
        self._estimators = {pair.name: PairEstimator(settings.max_lag_frames) for pair in rig.pairs}

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
        result = self._estimators[pair.name].update(window.index, first, second)
        return self._abstain(pair, result) if isinstance(result, str) else self._say(pair, result)

    def _say(self, pair: Pair, estimate: Estimate) -> Evidence:
        fit = estimate.fit
        period_ns = self._rig.camera(pair.second).period_ns
        between = INTERPOLATION * abs(fit.tau - round(fit.tau))
        floor = FLOOR_FRAMES + FLOOR_PX / max(fit.motion_px, 1e-3) + between
        sigma = float((fit.sigma**2 + floor**2) ** 0.5)
        tolerance = self._tolerance_ns(period_ns) / period_ns
        away = abs(fit.tau - pair.expected_offset_ns / period_ns)
        state, reason = State.UNKNOWN, "error too large beside the tolerance"
        if abs(fit.tau - estimate.lag) > 1.2:
            reason = "pairing not settled"
        elif (
            fit.motion_px < fit.scale_px
            or fit.noise_share > MOST_NOISE
            or fit.moving < LEAST_MOVING
            or fit.regions < LEAST_REGIONS
        ):
            reason = "no motion across the rows"
        elif away + 2 * sigma <= tolerance:
            state, reason = State.SYNC, f"points in both views agree to {sigma:.3f} frames"
        elif away - 2 * sigma > tolerance:
            later = "later" if fit.tau > 0 else "earlier"
            state, reason = State.ASYNC, f"{pair.second} is {abs(fit.tau):.2f} frames {later} by points in both views"
        return Evidence(
            pair=pair.name,
            detector=self._name,
            basis=Basis.CONTENT,
            state=state,
            reason=reason,
            offset_ns=round(fit.tau * period_ns),
            sigma_ns=round(sigma * period_ns),
            offset_frames=fit.tau,
            sigma_frames=sigma,
            motion_px=fit.motion_px,
            numbers={
                "sigma_random_frames": fit.sigma,
                "sigma_systematic_frames": floor,
                "matches": fit.matches / estimate.blocks,
                "moving_points": fit.moving,
                "regions": fit.regions,
                "noise_share": fit.noise_share,
                "residual_px": fit.scale_px,
                "lag": estimate.lag,
            },
        )

    def _tolerance_ns(self, period_ns: int) -> float:
        """5 ms, but at least 3 and at most 10 % of a period, unless set."""
        if self._settings.tolerance_ms == "auto":
            return min(max(5.0 * NS_PER_MS, 0.03 * period_ns), 0.10 * period_ns)
        return self._settings.tolerance_ms * NS_PER_MS

    def _abstain(self, pair: Pair, reason: str) -> Evidence:
        return Evidence(pair=pair.name, detector=self._name, basis=Basis.CONTENT, state=State.UNKNOWN, reason=reason)
