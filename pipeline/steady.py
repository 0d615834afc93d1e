"""Turns the stream of verdicts into changes that last."""

from __future__ import annotations

from dataclasses import dataclass

from pipeline.verdict import Cause, State, Verdict

CONFIRM = 5
"""Verdicts in a row that make a change: a detector that errs on one frame in three does so five times in a row in less
than one case in a hundred, and at 30 fps a fault is still told within 0.2 s."""

WEIGHED = 2
"""The same for verdicts of a judge that lets evidence accumulate: these do not flicker by themselves."""

JUMP_FRAMES = 0.5
"""A change of the offset of a pair that is out of sync, in frames, that is told as a change."""

PLAIN = frozenset({Cause.MISSING, Cause.FROZEN})
"""Causes that are only named after having lasted: the first verdict counts."""


@dataclass(frozen=True, slots=True)
class Change:
    """A state that has lasted: the verdicts that confirmed it, and the time of day of the first of them."""

    state: State
    verdicts: tuple[Verdict, ...]
    since_ns: int

    @property
    def first(self) -> Verdict:
        return self.verdicts[0]

    @property
    def since_frame(self) -> int | None:
        """The frame since when it has been so: by the judge's own account, else that of the first verdict."""
        return self.first.frame if self.first.since_frame is None else self.first.since_frame

    @property
    def last(self) -> Verdict:
        return self.verdicts[-1]


class Steady:
    """The state of one pair, its cause and offset, without flicker: what is said often enough in a row replaces them.

    A frame that cannot be judged speaks neither for nor against a change: it is passed over, unless so many follow each
    other that not being able to tell is itself what lasts.

    confirm: verdicts in a row that make a change.
    """

    def __init__(self, confirm: int = CONFIRM) -> None:
        self.state: State | None = None
        self._said: Verdict | None = None
        self._confirm = confirm
        self._candidates: list[Verdict] = []
        self._since_ns = 0
        self._unknowns: list[Verdict] = []
        self._unknown_since_ns = 0

    def add(self, verdict: Verdict, now_ns: int = 0) -> Change | None:
        """Takes the pair's next verdict, said at `now_ns`; returns the change it confirms, if any."""
        if verdict.state is State.UNKNOWN:
            return self._cannot_tell(verdict, now_ns)
        self._unknowns.clear()
        if self._candidates and not alike(self._candidates[0], verdict):
            self._candidates.clear()
        if self._said is not None and alike(self._said, verdict):
            self._candidates.clear()
            return None
        if not self._candidates:
            self._since_ns = now_ns
        self._candidates.append(verdict)
        if len(self._candidates) < (1 if verdict.cause in PLAIN else self._confirm):
            return None
        return self._change(self._candidates, self._since_ns)

    def _cannot_tell(self, verdict: Verdict, now_ns: int) -> Change | None:
        if not self._unknowns:
            self._unknown_since_ns = now_ns
        if len(self._unknowns) < CONFIRM:
            self._unknowns.append(verdict)
        if len(self._unknowns) < CONFIRM:
            return None
        self._candidates.clear()
        if self.state is State.UNKNOWN:
            return None
        return self._change(self._unknowns, self._unknown_since_ns)

    def _change(self, verdicts: list[Verdict], since_ns: int) -> Change:
        change = Change(verdicts[0].state, tuple(verdicts), since_ns)
        self.state, self._said = change.state, change.last
        verdicts.clear()
        return change


def alike(one: Verdict, other: Verdict) -> bool:
    """Whether two verdicts say the same: state, cause, camera and, to half a frame unless it runs away, offset."""
    if (one.state, one.cause, one.camera) != (other.state, other.cause, other.camera):
        return False
    if one.cause is Cause.FREE_RUN or one.offset_frames is None or other.offset_frames is None:
        return True
    return one.state is not State.ASYNC or abs(one.offset_frames - other.offset_frames) <= JUMP_FRAMES
