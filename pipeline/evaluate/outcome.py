"""What came of one run of a scenario or clip: was what had to be said said, how soon, and what else was said."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field
from statistics import median
from typing import Any, TypeAlias

from pipeline.conditions import HAPPENINGS
from pipeline.evaluate.suite import Clip, Expected
from pipeline.frame import NS_PER_MS
from pipeline.verdict import Cause, Event, PairTruth, Report, State, Verdict

GRACE_S = 1.5
"""Time from a change of the truth, during which either answer is allowed: a camera is called frozen after a second."""

CLEARLY = 1.5
"""Tolerances beyond which an offset that grows slowly must have been noticed."""

MOSTLY = 0.95
"""Share of frames that must say what is expected."""

EARLY = 0.5
"""Tolerances from which on an offset that grows may be called out of sync: it cannot be told from its edge."""

DECIDED = 0.5
"""Share of frames of which something must be said at all: silence is no answer to a scenario."""

NEAR = 0.10
"""Relative error of a drift that counts as right."""


BESIDE = frozenset({note.value for note in HAPPENINGS})
"""Events of single cameras that say nothing of whether pictures belong together: no false alarms."""

Named: TypeAlias = tuple[str, Cause | None, str | None]
"""Kind, cause and camera of an event."""


@dataclass(slots=True)
class Outcome:
    """One run.

    state, cause, event, notes, drift: whether right, None where nothing is expected. wrong: sentences on what was not.
    delay_frames, delay_s: from the first frame out of sync to the first that was called so; None: there was none, or it
    was not found, or was called so before already. false_async: frames in sync that were called out of sync, more than
    GRACE_S after a change. false_alarms: events that began with such frames; hours_in_sync: how long there was for it.
    confusion: frames by truth and by what was said. offset_errors_ms: of every frame that was told an offset, after
    GRACE_S.
    """

    scenario: str
    recording: str
    seed: int
    row: str = ""
    pair: str = ""
    hours: float = 0.0
    hours_in_sync: float = 0.0
    frames: int = 0
    decided: int = 0
    has_onset: bool = False
    delay_frames: int | None = None
    delay_s: float | None = None
    false_async: int = 0
    false_alarms: int = 0
    state: bool | None = None
    cause: bool | None = None
    event: bool | None = None
    notes: bool | None = None
    drift: bool | None = None
    drift_error: float | None = None
    wrong: list[str] = field(default_factory=list)
    confusion: dict[str, dict[str, int]] = field(default_factory=dict)
    offset_errors_ms: list[float] = field(default_factory=list)

    @property
    def right(self) -> bool:
        return not self.wrong

    def to_json(self) -> dict[str, Any]:
        told = asdict(self)
        errors = told.pop("offset_errors_ms")
        told["offset_error_median_ms"] = round(median(errors), 4) if errors else None
        return {**told, "right": self.right}


def outcome_of(clip: Clip, pair: str, fps: float, reports: Sequence[Report]) -> Outcome:
    """What came of one pair of a run.

    The truth of a frame is `Verdict.truth`: none where the partner is missing. A frame is settled once the truth has
    been the same for GRACE_S.

    State right
        Out of sync is expected: of the settled frames, from GRACE_S after the offset is CLEARLY beyond the tolerance,
        half are decided, and 95 % of these are called out of sync, as early as `within_frames` asks for; before and
        after, not more than 5 % of the settled frames in sync are.
        In sync is expected: after GRACE_S half is decided, unless `unknown` allows for silence, and no frame of the
        whole run is called out of sync. Unknown is expected: nothing is decided.
        In any case nothing is decided of a frame without a partner, unless a camera is missing for good.
    Cause right
        95 % of the frames called out of sync, GRACE_S after the first, name it.
    Event right
        Those that are expected begin, once each, with that cause and camera, none while all is well, and no others.
    Notes right
        Each that is expected is seen.
    Drift right
        What is told at the end is within 10 %.

    Where the truth is unknown, a state is right if 95 % of all decided frames after GRACE_S say so, any number of
    events say so with it, and nothing counts as a false alarm.
    """
    verdicts = [item for item in reports if isinstance(item, Verdict) and item.pair == pair]
    expected = clip.scenario.expect if clip.scenario else None
    made = Outcome(clip.manipulation, clip.recording, clip.seed, clip.scenario.row if clip.scenario else "", pair)
    grace = round(GRACE_S * fps)
    made.frames = len(verdicts)
    made.hours = made.frames / fps / 3600
    made.decided = sum(verdict.state is not State.UNKNOWN for verdict in verdicts)
    alarms = _alarms(reports, pair, verdicts)
    if clip.truth_known:
        _measure(made, verdicts, grace)
        made.hours_in_sync = sum(_is(verdict.truth, State.SYNC) for verdict in verdicts) / fps / 3600
        _find(made, verdicts, _onset(verdicts, expected), fps)
        made.false_alarms = sum(_is_false(verdicts, at, grace) for event, at in alarms if event.kind == "async")
    if expected is not None:
        _compare(made, expected, verdicts, [event for event, _ in alarms], grace, truth_known=clip.truth_known)
    return made


def _find(made: Outcome, verdicts: Sequence[Verdict], onset: int | None, fps: float) -> None:
    """When it was found that the pair is out of sync; saying so beforehand finds nothing."""
    made.has_onset = onset is not None
    if onset is None:
        return
    found = next((n for n in range(onset, len(verdicts)) if verdicts[n].state is State.ASYNC), None)
    if found is None:
        return
    begun = found
    while begun > 0 and verdicts[begun - 1].state is State.ASYNC:
        begun -= 1
    if begun < onset and not _beyond(verdicts[begun], EARLY):
        return
    made.delay_frames = found - onset
    made.delay_s = made.delay_frames / fps


def _measure(made: Outcome, verdicts: Sequence[Verdict], grace: int) -> None:
    counts: Counter[tuple[str, str]] = Counter()
    for n, verdict in enumerate(verdicts):
        truth = verdict.truth
        if truth is None or not _settled(verdicts, n, grace):
            continue
        counts[truth.state.value, verdict.state.value] += 1
        if verdict.offset_ns is not None and verdict.state is not State.UNKNOWN:
            made.offset_errors_ms.append(abs(verdict.offset_ns - truth.offset_ns) / NS_PER_MS)
    made.confusion = {
        true: {said.value: counts[true, said.value] for said in State} for true in (State.SYNC.value, State.ASYNC.value)
    }
    made.false_async = counts[State.SYNC.value, State.ASYNC.value]


def _settled(verdicts: Sequence[Verdict], at: int, grace: int) -> bool:
    """Whether the truth has been what it is for as long as it may take to notice."""
    truth = verdicts[at].truth
    before = verdicts[max(at - grace, 0) : at]
    return truth is not None and all(one.truth is None or one.truth.state is truth.state for one in before)


def _onset(verdicts: Sequence[Verdict], expected: Expected | None) -> int | None:
    """The first frame that is out of sync, or, where a camera goes missing, the first without it."""
    if expected is not None and expected.cause is Cause.MISSING:
        return next((n for n, one in enumerate(verdicts) if one.truth is None), None)
    return next((n for n, one in enumerate(verdicts) if _is(one.truth, State.ASYNC)), None)


def _is(truth: PairTruth | None, state: State) -> bool:
    return truth is not None and truth.state is state


def _alarms(reports: Sequence[Report], pair: str, verdicts: Sequence[Verdict]) -> list[tuple[Event, int]]:
    """Events that begin, of the pair or of a camera, each with the place of the verdict before it."""
    place = {id(verdict): n for n, verdict in enumerate(verdicts)}
    at, alarms = -1, []
    for report in reports:
        at = place.get(id(report), at)
        if isinstance(report, Event) and report.phase == "onset" and report.pair in {pair, None}:
            alarms.append((report, at))
    return alarms


def _is_false(verdicts: Sequence[Verdict], at: int, grace: int) -> bool:
    """Whether nothing was out of sync, or missing, for a while before an event."""
    recent = verdicts[max(at - grace, 0) : at + 1]
    return all(_is(one.truth, State.SYNC) for one in recent)


def _compare(
    made: Outcome,
    expected: Expected,
    verdicts: Sequence[Verdict],
    alarms: Sequence[Event],
    grace: int,
    *,
    truth_known: bool,
) -> None:
    begun: Counter[Named] = Counter(
        (event.kind, event.cause, event.camera)
        for event in alarms
        if event.kind not in BESIDE or event.kind == expected.event
    )
    if truth_known:
        made.state = _state_right(made, expected, verdicts, grace)
        wanted: Counter[Named] = Counter([("async", expected.cause, expected.camera)] if expected.cause else [])
    else:
        made.state = _mostly(made, expected, [one for one in verdicts if one.truth is not None][grace:])
        wanted = Counter({name: count for name, count in begun.items() if name[0] == "async"})
        if not wanted and expected.state is State.ASYNC:
            wanted["async", expected.cause, expected.camera] = 1
    if expected.cause is not None:
        made.cause = _cause_right(made, expected.cause, verdicts, grace)
    if expected.event is not None:
        wanted[expected.event, None, expected.camera] += 1
    made.event = begun == wanted and not made.false_alarms
    if begun != wanted:
        made.wrong.append(f"events {_named(begun)} in place of {_named(wanted)}")
    elif made.false_alarms:
        made.wrong.append("an event began while all was well")
    if expected.notes:
        seen = {note for verdict in verdicts for note in verdict.notes}
        absent = [note.value for note in expected.notes if note.value not in seen]
        made.notes = not absent
        if absent:
            made.wrong.append(f"no note {', '.join(absent)}")
    for name, ppm in (("stamps_ppm", expected.stamps_ppm), ("pictures_ppm", expected.pictures_ppm)):
        if ppm is not None and verdicts:
            _compare_drift(made, name, ppm, getattr(verdicts[-1].drift, name))


def _compare_drift(made: Outcome, name: str, ppm: float, told: float | None) -> None:
    error = None if told is None else abs(told / ppm - 1)
    made.drift = made.drift is not False and error is not None and error <= NEAR
    if error is not None:
        made.drift_error = max(made.drift_error or 0.0, error)
    if error is None or error > NEAR:
        made.wrong.append(f"drift by {name[:-4]} {'unknown' if told is None else f'{told:.1f} ppm'}, not {ppm:g}")


def _state_right(made: Outcome, expected: Expected, verdicts: Sequence[Verdict], grace: int) -> bool:
    before = len(made.wrong)
    paired = [one for one in verdicts if one.truth is not None]
    if expected.state is State.ASYNC:
        _mostly(made, expected, _judged_async(expected, verdicts, grace))
        in_sync = sum(made.confusion[State.SYNC.value].values())
        if made.false_async > (1 - MOSTLY) * in_sync:
            made.wrong.append(f"{made.false_async} of {in_sync} frames in sync called out of sync")
        _in_time(made, expected.within_frames)
    else:
        called = sum(one.state is State.ASYNC for one in verdicts)
        if called:
            made.wrong.append(f"{called} frames called out of sync")
        else:
            _mostly(made, expected, paired[grace:])
    alone = sum(one.truth is None and one.state is not State.UNKNOWN for one in verdicts)
    if alone and expected.cause is not Cause.MISSING:
        made.wrong.append(f"{alone} frames without a partner were decided")
    return len(made.wrong) == before


def _mostly(made: Outcome, expected: Expected, judged: Sequence[Verdict]) -> bool:
    """Whether enough of the frames are decided, and say what is expected."""
    decided = [one for one in judged if one.state is not State.UNKNOWN]
    if expected.state is State.UNKNOWN:
        if decided:
            made.wrong.append(f"{len(decided)} frames were decided")
        return not decided
    if not expected.unknown and (not decided or len(decided) < DECIDED * len(judged)):
        made.wrong.append(f"{len(decided)} of {len(judged)} frames decided")
        return False
    fitting = sum(one.state is expected.state for one in decided)
    if fitting < MOSTLY * len(decided):
        made.wrong.append(f"{fitting} of {len(decided)} frames {expected.state.value}")
        return False
    return True


def _in_time(made: Outcome, within_frames: int | None) -> None:
    if within_frames is not None and (made.delay_frames is None or made.delay_frames > within_frames):
        late = "never" if made.delay_frames is None else f"after {made.delay_frames} frames"
        made.wrong.append(f"found {late}, not within {within_frames}")


def _judged_async(expected: Expected, verdicts: Sequence[Verdict], grace: int) -> list[Verdict]:
    """The frames that must be called out of sync."""
    if expected.cause is Cause.MISSING:
        silent = [one for one in verdicts if one.truth is None]
        return silent[grace:] or silent[-1:]
    clear = [n for n, one in enumerate(verdicts) if _is(one.truth, State.ASYNC) and _beyond(one, CLEARLY)]
    return [verdicts[n] for n in clear if n >= clear[0] + grace and _settled(verdicts, n, grace)] if clear else []


def _beyond(verdict: Verdict, tolerances: float) -> bool:
    return verdict.truth is not None and abs(verdict.truth.offset_ns) > tolerances * verdict.tolerance_ns


def _cause_right(made: Outcome, cause: Cause, verdicts: Sequence[Verdict], grace: int) -> bool:
    called = [one for one in verdicts if one.state is State.ASYNC]
    counted = called[min(grace, len(called) // 2) :]
    fitting = sum(one.cause is cause for one in counted)
    if counted and fitting >= MOSTLY * len(counted):
        return True
    others = Counter(one.cause.value for one in counted if one.cause is not None and one.cause is not cause)
    made.wrong.append(f"cause {', '.join(others) or 'none'} in place of {cause.value}")
    return False


def _named(events: Mapping[Named, int]) -> str:
    words = [
        f"{'' if count == 1 else f'{count} '}{kind}{f'/{cause.value}' if cause else ''} of {camera}"
        for (kind, cause, camera), count in events.items()
    ]
    return ", ".join(sorted(words)) or "none"
