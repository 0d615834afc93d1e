"""What is said of a pair at the top of a report, in sentences for somebody who sees the rig for the first time."""

from __future__ import annotations

from pipeline.answer import Answer
from pipeline.report.recorder import PairRecord
from pipeline.sentences import capital, happened
from pipeline.tally import ENOUGH
from pipeline.verdict import Basis, State
from pipeline.words import REASON_WORDS


def told(record: PairRecord, said: Answer) -> list[str]:
    """What is wrong, that nothing is, or why it cannot be told. said: of this pair."""
    events = happened(record.timeline)
    if said.state is State.ASYNC:
        return events or [said.text]
    words = [_in_sync(record) if said.state is State.SYNC else _cannot_tell(record)]
    return words + ([f"Apart from that: {' '.join(events)}"] if events else [])


def _in_sync(record: PairRecord) -> str:
    first, second = record.pair.first, record.pair.second
    offset = record.series.summary("offset_ms")
    apart = "" if offset is None else f", {abs(offset['mean']):.1f} ms apart on average"
    expected = "" if not record.pair.expected_offset_ns else ", as far apart as is expected of them"
    by = "pictures" if record.bases[Basis.CONTENT] >= record.bases[Basis.TIMESTAMPS] else "timestamps alone"
    return capital(
        f"{first} and {second} take their pictures together{expected}{apart}: so say the {by}, in "
        f"{100 * record.coverage:.0f} % of the frames; {_others(record)}."
    )


def _others(record: PairRecord) -> str:
    if not record.tally.reasons:
        return "all could be judged"
    return f"the others could not be judged, mostly because {_why(record)}"


def _cannot_tell(record: PairRecord) -> str:
    first, second = record.pair.first, record.pair.second
    if record.tally.decided >= ENOUGH:
        return f"What is said of {first} and {second} contradicts itself from frame to frame."
    return f"Nothing can be said of {first} and {second}: {_why(record)}."


def _why(record: PairRecord) -> str:
    reason = record.tally.main_reason
    return "too few frames came together" if reason is None else REASON_WORDS[reason]
