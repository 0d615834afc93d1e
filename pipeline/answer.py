"""One answer for a whole recording: in sync, out of sync, or cannot tell, in a paragraph."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace

from pipeline.tally import ENOUGH, PairTally, Stretch, Tally
from pipeline.verdict import State
from pipeline.words import CAUSE_ADVICE, CAUSE_WORDS, CONTRADICTORY_ADVICE, REASON_ADVICE, REASON_WORDS, describe

CLEAR = 0.9
"""Share of the decided frames that must agree for an answer about all of them."""

TOLD_STRETCHES = 4
"""Stretches that are told one by one: as many as fit into a paragraph."""

STRAY = 0.05
"""Where more than this share of the other frames is out of sync as well, what lasts may be chance."""


OF_PART = " This is of the part that could be read."
"""What is added to an answer about a recording that could not be read to its end."""


@dataclass(frozen=True, slots=True)
class Answer:
    """What is said of a recording, and the sentences that say why. pairs: the same of each of its pairs."""

    state: State
    text: str
    pairs: Mapping[str, Answer] = field(default_factory=dict)


def answer(tally: Tally) -> Answer:
    """The worst answer over all pairs: out of sync, else cannot tell, else in sync."""
    pairs = {name: _of_pair(name, pair) for name, pair in tally.pairs.items()}
    if not pairs:
        return Answer(State.UNKNOWN, "Cannot tell: no two frames came together.")
    states = {one.state for one in pairs.values()}
    state = next(state for state in (State.ASYNC, State.UNKNOWN, State.SYNC) if state in states)
    worst = (tally.pairs[name] for name, one in pairs.items() if one.state is state)
    words = [HEADLINE[state], *(one.text for one in pairs.values()), _advice(state, next(worst))]
    return Answer(state, " ".join(filter(None, words)), pairs)


def _of_pair(name: str, pair: PairTally) -> Answer:
    state = _state(pair)
    return Answer(state, _sentence(name, state, pair))


HEADLINE = {State.SYNC: "In sync.", State.ASYNC: "OUT OF SYNC.", State.UNKNOWN: "Cannot tell."}


def _state(pair: PairTally) -> State:
    if pair.never_came:
        return State.ASYNC
    if pair.decided < ENOUGH:
        return State.UNKNOWN
    lasting = pair.lasting_async
    if lasting and pair.states[State.ASYNC] - lasting <= STRAY * (pair.decided - lasting):
        return State.ASYNC
    if pair.states[State.SYNC] >= CLEAR * pair.decided:
        return State.SYNC
    return State.ASYNC if pair.states[State.ASYNC] >= CLEAR * pair.decided else State.UNKNOWN


def _sentence(name: str, state: State, pair: PairTally) -> str:
    if pair.never_came:
        return f"{name}: no frame of {name.partition('-')[0]} came."
    if not pair.decided:
        return f"{name}: none of {pair.total} frames could be judged{_why_not(pair, ', mostly because ')}."
    counts = f"{pair.decided} of {pair.total} frames could be judged{_ground(pair)}, {_shares(pair)}"
    if state is State.ASYNC:
        return f"{name}: {counts}. {_stretches(pair)}"
    if state is State.SYNC:
        return f"{name}: {counts}."
    if pair.decided >= ENOUGH:
        return f"{name}: {counts}, and they contradict each other from frame to frame."
    return f"{name}: only {counts}: too few for an answer{_why_not(pair, '. Of the others mostly: ')}."


def _shares(pair: PairTally) -> str:
    sync, wrong = pair.states[State.SYNC], pair.states[State.ASYNC]
    if sync and wrong:
        return f"{sync} of them in sync and {wrong} not"
    return f"all of them {'in' if sync else 'out of'} sync"


def _ground(pair: PairTally) -> str:
    """That most of it rests on timestamps alone, if so: these can lie."""
    return " (mostly by timestamps alone, which can lie)" if 2 * pair.by_stamps > pair.decided else ""


def _stretches(pair: PairTally) -> str:
    """Since when and how it is out of sync: the longest stretches, in order of time."""
    longest = sorted(pair.stretches, key=lambda stretch: -stretch.frames)[:TOLD_STRETCHES]
    told, explained = [], set()
    for stretch in (one for one in pair.stretches if one in longest):
        told.append(_stretch(stretch, explain=stretch.first.cause not in explained))
        explained.add(stretch.first.cause)
    more = len(pair.stretches) - len(told)
    return " ".join(told) + (f" And {more} shorter stretch{'es' * (more > 1)}." if more > 0 else "")


def _stretch(stretch: Stretch, *, explain: bool) -> str:
    """explain: what its cause means."""
    first = stretch.first
    words = describe(replace(first, offset_ns=stretch.offset_ns)) if stretch.offset_ns else describe(first)
    where = "" if first.frame is None else f"Frames {first.frame} to {stretch.last_frame}: "
    meaning = f": {CAUSE_WORDS[first.cause]}" if first.cause and explain else ""
    cause = f" ({first.cause.value}{meaning})" if first.cause else ""
    return f"{where}{words}{cause}."


def _why_not(pair: PairTally, lead: str) -> str:
    """Why most of the other frames could not be judged."""
    reason = pair.main_reason
    return "" if reason is None else f"{lead}{REASON_WORDS[reason]} ({reason.value})"


def _advice(state: State, pair: PairTally) -> str:
    """What to do about a pair of that state: about what lasted longest, or kept most frames from being judged."""
    if state is State.ASYNC and pair.stretches:
        cause = max(pair.stretches, key=lambda stretch: stretch.frames).first.cause
        return f"What to do: {CAUSE_ADVICE[cause]}" if cause else ""
    if state is State.UNKNOWN and pair.decided >= ENOUGH:
        return f"What to do: {CONTRADICTORY_ADVICE}"
    if state is State.UNKNOWN and pair.main_reason is not None:
        return f"What to do: {REASON_ADVICE[pair.main_reason]}"
    return ""
