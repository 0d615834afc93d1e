"""Lets evidence on a pair accumulate frame by frame, so that no single one flips what is said of it."""

from __future__ import annotations

from pipeline.verdict import State

SURE = 9.2
"""Log odds at which a state is believed: one error in ten thousand decisions if evidence errs as it says it does."""

MOST_PICTURES = SURE
MOST_STAMPS = SURE / 2
"""Log odds that one frame may add, however convincing: two frames of pictures make a change, as windows of many frames
stand behind each, and four of stamps, which are sometimes plainly wrong by themselves."""


def support(away_ns: float, sigma_ns: float, tolerance_ns: float) -> float:
    """How much an offset `away_ns` from what is expected speaks for out of sync against in sync: log likelihood ratio.

    Generalised likelihood ratio of a normal error: the likeliest offset beyond the tolerance against the likeliest
    within; positive for out of sync.
    """
    beyond = (abs(away_ns) - tolerance_ns) / max(sigma_ns, 1.0)
    return beyond * abs(beyond) / 2


class Belief:
    """Sequential test of out of sync against in sync (Wald 1945), with hysteresis.

    The log odds are held within bounds, so that a change is found as fast as after a fresh start (CUSUM, Page 1954).
    Between the bounds, what was believed stays.
    """

    def __init__(self) -> None:
        self._log_odds = 0.0
        self.state = State.UNKNOWN

    def add(self, supported: float, most: float) -> State:
        """Takes the log likelihood ratio of one frame, of which `most` counts; the state believed now."""
        step = min(max(supported, -most), most)
        self._log_odds = min(max(self._log_odds + step, -SURE), SURE)
        needed = SURE / 2 if self.state is State.UNKNOWN else SURE
        if self._log_odds >= needed:
            self.state = State.ASYNC
        elif self._log_odds <= -needed:
            self.state = State.SYNC
        return self.state
