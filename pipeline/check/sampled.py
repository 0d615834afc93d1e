"""Looks at stretches of a recording, one after another, until its answer is sure."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace

from pipeline.answer import Answer, answer
from pipeline.check.stretches import Stretch
from pipeline.check.survey import Survey
from pipeline.tally import Tally
from pipeline.verdict import Reason, Report, State, Verdict

AGREEING = 4
"""Stretches, besides the suspect ones, that must be in sync before the whole recording is said to be: start, end,
middle and one between."""

STILL_FRAMES = 90
"""A stretch in which so many frames in a row show nothing is left for the next."""

NOTHING_TO_SEE = {Reason.NO_MOTION, Reason.NO_TEXTURE, Reason.DARK, Reason.NO_OVERLAP}


@dataclass(slots=True)
class Look:
    """What was said of one stretch. base: the number of its first frame in the recording."""

    base: int
    tally: Tally = field(default_factory=Tally)
    _still: int = 0

    def add(self, report: Report) -> None:
        if not isinstance(report, Verdict):
            return
        self._still = self._still + 1 if report.reason in NOTHING_TO_SEE else 0
        frame = None if report.frame is None else report.frame + self.base
        since = None if report.since_frame is None else report.since_frame + self.base
        self.tally.add(replace(report, frame=frame, since_frame=since))

    def shows_nothing(self) -> bool:
        return self._still >= STILL_FRAMES


@dataclass(frozen=True, slots=True)
class Sampled:
    """sure: whether what was looked at is enough for an answer about all of it."""

    answer: Answer
    looked: int
    sure: bool


def sample(survey: Survey, planned: Sequence[Stretch], look: Callable[[Stretch, Look], bool]) -> Sampled:
    """Looks at stretch after stretch: one out of sync settles it, and so do some in sync that are spread over all.

    look: judges a stretch and adds what is said to the Look; false when it was interrupted, and so is this.
    """
    total = Tally()
    agreeing = 0
    for looked, stretch in enumerate(planned, 1):
        one = Look(survey.frames_before(stretch.from_s))
        if not look(stretch, one):
            return Sampled(answer(total), looked, sure=False)
        total.merge(one.tally)
        state = answer(one.tally).state
        agreeing += state is State.SYNC
        if state is State.ASYNC or (agreeing >= AGREEING and looked >= len(survey.suspects_s) + AGREEING):
            return Sampled(answer(total), looked, sure=True)
    result = answer(total)
    return Sampled(result, len(planned), sure=result.state is not State.UNKNOWN)
