"""Writes docs/methods.md: which methods there are, how they compare, and why the default is what it is."""

from __future__ import annotations

from collections.abc import Iterator
from statistics import median

from benchmarks.methods_scores import (
    BASE,
    Confusion,
    Measured,
    Method,
    abstained,
    count,
    frames,
    right,
    right_frames,
    right_of_all,
    wrong_of_all,
)
from pipeline.evaluate.columns import percent, told
from pipeline.evaluate.measures import RESAMPLES, Measure, Scores
from pipeline.verdict import State

REPORT, DEFAULT = "timestamp and spatial", "timestamp and offset"

ABOUT = {
    "timestamp": "compares stamps (the report, Algorithm 2); never looks at pictures",
    "offset": "follows corners and measures by how much of a frame the cameras are apart",
    "spatial": "slides the gradient of one picture over the others (the report, Algorithm 3)",
    "spatial_grey": "`spatial` with `picture: grey`",
    "spatial_zero_mean": "`spatial` with `correlation: zero_mean`",
    "spatial_grey_zero_mean": "both",
    "spatial_cautious": "`spatial` with `always_answer: false`",
    "adaptive_window": "stereo matching, windows grown by texture (2.3)",
    "weighted_template": "templates about corners, a weight a pixel (1.4.2)",
    "orb": "ORB corners whose matches agree (1.4.4)",
    "epipolar_classes": "is the epipolar geometry what it was before? (1.4.1)",
}

HEAD = """\
# The methods, side by side

<!-- Written by `make methods` in {minutes:g} minutes with {jobs} processes. Do not edit: words are in
     benchmarks/methods_page.py, footage in benchmarks/suites/methods.yaml and methods-report.yaml. -->

**Why the default is `timestamp` and `offset`.** Two things can go wrong: stamps can say that frames are apart, and
stamps can say that all is well while the pictures are apart.

- `timestamp` sees the first at no cost, whatever the pictures show, and is blind to the second: where stamps lie it
  says "in sync" of every frame.
- For the second, somebody must look. On footage that moves, `offset` was right in **{offset_right} %** of what it
  answered and abstained from {offset_abstained} % of the windows, at **{offset_cost} times** the CPU of the report's
  `spatial`, which always answers and was right in **{spatial_right} %**. Had all had to answer, `offset` would have
  been right in {offset_forced} %, the next best, `{next_name}`, in {next_forced} % at {next_cost} times the CPU.
- Where nothing moves no picture can tell. There `offset` answered {offset_still} % of the windows; `spatial` answers
  all of them, that is, it guesses.
- `offset` alone measures in parts of a frame; all others can only say t-1, t or t+1.

![Right, wrong and abstained by method, and the report's experiments as confusion matrices](methods.svg)

Each method is a detector and can be used in place of, or beside, the default:

```
syncwatch replay RECORDING --detectors orb,adaptive_window
```

`always_answer: true` makes any of them answer as the report does, even where the choice is chance, unless there is
nothing at all to compare; by default they abstain where the best candidate beats the second by no more than three
standard errors, and say so. `spatial` is the report's own and answers always; `always_answer: false` makes it abstain,
too.

## Accuracy and cost

The question put to each: the second camera's pictures are as they were taken, or a frame ahead, or a frame behind,
while all stamps say that they are in sync. Which is it?
"""

NOTES = """\
- **right**: of what was answered, the right one of t-1, t and t+1. **if it had to answer**: of all windows, with what
  the method leaned to where it abstained. In brackets, 95 % intervals by bootstrap over clips ({draws} draws); a clip
  is a recording at one offset.
- **nothing moves**: share of windows answered where nobody can know: every such answer is a guess.
- **CPU**: of a window, beside `spatial` on the same windows in the same run: the median over recordings, lowest and
  highest in brackets. {sizes}
- Footage: {moving} of real and rendered motion (`euroc`, `kitti`, `boof`, `rover`, `face`, `calis`; rendered
  `handheld`, `handheld_unequal`, `objects`, `pan`, `drive`), {still} in which nothing moves (`robot_static`, rendered
  `still`, `still_unequal`); at most 60 windows a clip, six runs of ten drawn with a fixed seed, {windows} in all.
  Recordings whose truth is not known to the frame are left out (`p2s_single_60fps`, `webcams_loose`, `hand_2webcam`).
  Methods that learn from what they have seen (`offset`, `epipolar_classes`) saw all windows before.
- What the report leaves open, resolutions and thresholds for instance, was chosen on some of this footage, as `offset`
  was developed on it: elsewhere all but `timestamp` and `spatial` may do somewhat worse.
- `timestamp` is right in a third by construction: of three offsets it always says 0, as the stamps do.
- `spatial`, `adaptive_window`, `weighted_template` and `orb` take rows of the two pictures to correspond, which they do
  not in `calis`.
"""

EXPERIMENTS = """\
## The report's two experiments

The report judges 300 frames of a static data set, 46 of them asynchronous (225 + 46 right, 90.33 %, figure 4.4), and
300 synchronous ones of a dynamic data set (290 right, 96.6 %, figure 4.7). Its data is not published; these are
rendered in its terms: a scene in which nothing moves but the sensors' noise, the right camera a frame late from frame
50 to 95, stamps included as in figure 4.3; and a hand-held rig that is always in sync. Every frame counts.
"""

READING = """\
A row is a confusion matrix: of the frames that are in sync, how many were called in sync, out of sync, or neither; then
the same of those that are out of sync. The first two rows are whole configurations, the others detectors alone.

In the static scene pictures tell nothing, so whoever answers from pictures guesses, and where "out of sync" takes only
one of two tests, as in the report, two guesses of three are false alarms. That the report lost only 29 frames so
suggests that something did move in its static data. The default leaves the answer to the stamps there; it wants three
frames more before it changes its mind, and these six are what it gets wrong. In the dynamic scene `spatial` errs now
and then because neighbouring frames look so alike.
"""


def write(measured: Measured) -> str:
    """The whole page."""
    methods = measured.methods
    offset, spatial = methods["offset"], methods[BASE]
    others = [name for name in methods if name not in {"timestamp", "offset", BASE}]
    best = max(others, key=lambda name: right_of_all(_forced(methods[name])) or 0.0)
    lines = [
        HEAD.format(
            minutes=measured.minutes,
            jobs=measured.jobs,
            offset_right=_share(right, offset.moving()),
            offset_cost=f"{median(offset.ratios_to(spatial)):.1f}",
            spatial_right=_share(right, spatial.moving()),
            next_name=best,
            next_forced=_share(right_of_all, _forced(methods[best])),
            next_cost=f"{median(methods[best].ratios_to(spatial)):.1f}",
            offset_abstained=_share(abstained, offset.moving()),
            offset_forced=_share(right_of_all, _forced(offset)),
            offset_still=_answered(offset),
        ),
        *_methods(measured),
        "",
        NOTES.format(
            draws=RESAMPLES,
            sizes="Pictures are 320x240 to 1280x720; the larger, the dearer `spatial` alone becomes.",
            moving=f"{len(spatial.moving())} clips",
            still=f"{len(spatial.still())} clips",
            windows=sum(item.windows for item in (*spatial.moving(), *spatial.still())),
        ),
        EXPERIMENTS,
        *_experiments(measured),
        "",
        READING.rstrip(),
    ]
    return "\n".join(lines) + "\n"


def _methods(measured: Measured) -> Iterator[str]:
    titles = ("right", "abstained", "wrong, of all", "right, if it had to answer", "nothing moves: answered", "CPU")
    yield f"| method | | {' | '.join(titles)} |"
    yield "|---|---|" + "---|" * len(titles)
    base = measured.methods[BASE]
    for name, method in measured.methods.items():
        moving = method.moving()
        ratios = method.ratios_to(base)
        cells = [
            f"`{name}`",
            ABOUT[name],
            told(right, percent, " %")(moving),
            f"{_share(abstained, moving)} %",
            f"{_share(wrong_of_all, moving)} %",
            told(right_of_all, percent, " %")(_forced(method)),
            f"{_answered(method)} %",
            "1" if name == BASE else f"{_few(median(ratios))} ({_few(ratios[0])}..{_few(ratios[-1])})",
        ]
        yield f"| {' | '.join(cells)} |"


def _forced(method: Method) -> Scores:
    return method.moving(lambda seen: seen.forced)


def _few(value: float) -> str:
    return f"{value:.2g}" if value >= 0.01 else "0.00"


def _share(measure: Measure, scores: Scores) -> str:
    value = measure(scores)
    return "-" if value is None else percent(value)


def _answered(method: Method) -> str:
    kept_quiet = abstained(method.still())
    return "-" if kept_quiet is None else percent(1 - kept_quiet)


def _experiments(measured: Measured) -> Iterator[str]:
    names = list(measured.experiments)
    yield (
        "| | "
        + " | ".join(f"{name}: in sync said {_said()} | out of sync said {_said()} | right" for name in names)
        + " |"
    )
    yield "|---|" + "---|" * (3 * len(names))
    first = (REPORT, DEFAULT)
    for method in (*first, *(name for name in measured.experiments[names[0]] if name not in first)):
        cells = [cell for name in names for cell in _confusion(measured.experiments[name][method])]
        label = {REPORT: f"**the report's: {REPORT}**", DEFAULT: f"**default: {DEFAULT}**"}.get(method, f"`{method}`")
        yield f"| {label} | {' | '.join(cells)} |"


def _said() -> str:
    return "sync / async / unknown"


def _confusion(confusion: Confusion) -> list[str]:
    rows = [
        " / ".join(
            f"**{count(confusion, truth, said)}**" if said is truth else str(count(confusion, truth, said))
            for said in (State.SYNC, State.ASYNC, State.UNKNOWN)
        )
        if confusion.get(truth.value)
        else "-"
        for truth in (State.SYNC, State.ASYNC)
    ]
    return [*rows, f"{right_frames(confusion)} of {frames(confusion)}"]
