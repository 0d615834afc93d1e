"""What is wanted of the content offset: goals, the rows each is about, and the tables the rows stand in."""

from __future__ import annotations

from dataclasses import dataclass

from pipeline.evaluate import measures
from pipeline.evaluate.goals import Goal, at_least, at_most, both
from pipeline.evaluate.measures import Scores

MOVING = ("kitti", "boof", "rover", "handheld", "handheld_15fps", "handheld_7fps", "handheld_unequal")
ROUGHLY_KNOWN = ("rover", "calis")
"""Real recordings whose truth is known to the frame, but not to the hundredth of one."""


@dataclass(frozen=True, slots=True)
class Aim:
    """A goal, and the rows it is about: of these suites, of the recordings `only` (or all), `but` of some not.

    in_parts: other aims are about the same rows in parts, and tell row by row what is missed.
    """

    goal: Goal
    suites: tuple[str, ...]
    only: tuple[str, ...] = ()
    but: tuple[str, ...] = ()
    in_parts: bool = False

    def about(self, suite: str, recording: str) -> bool:
        wanted = not self.only or recording in self.only
        return suite in self.suites and wanted and recording not in self.but


@dataclass(frozen=True, slots=True)
class Section:
    """A table: the suite whose rows it has, and its columns.

    together: manipulations, places of a step say, are one row, as each alone has too little to tell.
    """

    title: str
    suite: str
    columns: tuple[str, ...]
    together: bool = False


def _calibrated(scores: Scores) -> bool:
    """93 to 98 % within two standard errors, or more where these are small anyway."""
    inside, sigma = measures.within_two_sigma(scores), measures.sigma_median(scores)
    return inside is not None and sigma is not None and inside >= 0.93 and (inside <= 0.98 or sigma <= 0.05)


def _two_sigma(what: str) -> Goal:
    limit = "93 to 98 %, or more if the median sigma is <= 0.05 frame"
    return Goal(f"error within 2 sigma{what}", "2 sigma", limit, ("in 2 sigma", "sigma"), _calibrated)


CLEAN, WHOLE = ("clean", "clean-rendered"), ("whole", "whole-rendered")
FRACTIONS, FRACTIONS_RENDERED = "fractions", "fractions-rendered"

AIMS = (
    Aim(
        Goal(
            "clean synchronized footage and constant-speed driving: confident async",
            "async",
            "0",
            ("false async",),
            at_most(measures.false_async, 0),
            accuracy=False,
        ),
        CLEAN,
    ),
    Aim(
        Goal(
            "±1, ±2, ±5 frames from the first frame on: right whole frame",
            "whole frame",
            ">= 99.5 %",
            ("whole frame",),
            at_least(measures.whole_right, 0.995),
        ),
        WHOLE,
    ),
    Aim(
        Goal(
            "camera moving: decided",
            "decided",
            ">= 95 %",
            ("decided",),
            at_least(measures.decided, 0.95),
            accuracy=False,
        ),
        CLEAN,
        only=MOVING,
    ),
    Aim(
        Goal(
            "two people before a static camera: decided",
            "decided",
            ">= 60 %",
            ("decided",),
            at_least(measures.decided, 0.60),
            accuracy=False,
        ),
        ("clean",),
        only=("face",),
    ),
    Aim(
        Goal(
            "zero offset: absolute error",
            "zero",
            "median <= 0.01, 95 % <= 0.03 frame",
            ("error median", "error 95 %"),
            both(at_most(measures.error_median, 0.01), at_most(measures.error_p95, 0.03)),
        ),
        CLEAN,
        but=ROUGHLY_KNOWN,
    ),
    Aim(
        Goal(
            "±1/4, ±1/2, ±3/4 and 0 by sub-sampling: within 0.10 frame",
            "within 0.1",
            ">= 98 %",
            ("within 0.1",),
            at_least(measures.small_error, 0.98),
        ),
        (FRACTIONS,),
    ),
    Aim(
        Goal(
            "±1/4, ±1/2, ±3/4 rendered: within 0.10 frame",
            "within 0.1",
            ">= 98 %",
            ("within 0.1",),
            at_least(measures.small_error, 0.98),
        ),
        (FRACTIONS_RENDERED,),
    ),
    Aim(
        _two_sigma(""),
        (*CLEAN, *WHOLE, FRACTIONS, FRACTIONS_RENDERED),
        but=ROUGHLY_KNOWN,
        in_parts=True,
    ),
    Aim(_two_sigma(", of these at zero and whole frames"), (*CLEAN, *WHOLE), but=ROUGHLY_KNOWN),
    Aim(_two_sigma(", of these at fractions by sub-sampling"), (FRACTIONS,)),
    Aim(_two_sigma(", of these at rendered fractions"), (FRACTIONS_RENDERED,)),
    Aim(
        Goal(
            "a one-frame step while things move: frames until async",
            "steps",
            "median <= 4, 95 % <= 10",
            ("steps found", "after frames"),
            both(at_most(measures.delay_median, 4), at_most(measures.delay_p95, 10)),
        ),
        ("steps", "steps-rendered"),
    ),
    Aim(
        Goal("nothing moves: decided", "decided", "0 %", ("decided",), at_most(measures.decided, 0), accuracy=False),
        ("still",),
    ),
    Aim(
        Goal(
            "wide baseline: right whole frame",
            "whole frame",
            ">= 95 %",
            ("whole frame",),
            at_least(measures.whole_right, 0.95),
        ),
        ("wide",),
    ),
)

PRECISION = ("error median", "error 95 %", "in 2 sigma", "sigma")
SECTIONS = (
    Section("In sync, real", "clean", ("windows", "decided", "false async", *PRECISION)),
    Section("In sync, rendered", "clean-rendered", ("windows", "decided", "false async", *PRECISION)),
    Section("Whole frames, real", "whole", ("windows", "decided", "missed", "whole frame", *PRECISION)),
    Section("Whole frames, rendered", "whole-rendered", ("windows", "decided", "missed", "whole frame", *PRECISION)),
    Section("Fractions, real", "fractions", ("windows", "decided", "missed", "within 0.1", *PRECISION)),
    Section("Fractions, rendered", "fractions-rendered", ("windows", "decided", "missed", "within 0.1", *PRECISION)),
    Section("Steps, real", "steps", ("windows", "decided", "steps found", "after frames"), together=True),
    Section("Steps, rendered", "steps-rendered", ("windows", "decided", "steps found", "after frames"), together=True),
    Section("Nothing moves", "still", ("windows", "decided", "false async")),
    Section("Wide baseline", "wide", ("windows", "decided", "whole frame", "error median", "error 95 %")),
)
SUITES = tuple(section.suite for section in SECTIONS)
