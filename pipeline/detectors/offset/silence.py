"""Why nothing is said of an offset: words for people that carry the reason for programs."""

from __future__ import annotations

from pipeline.verdict import Reason


class Silence(str):
    """A sentence with the reason it gives."""

    __slots__ = ("reason",)
    reason: Reason

    def __new__(cls, text: str, reason: Reason) -> Silence:
        made = super().__new__(cls, text)
        made.reason = reason
        return made


def reason_of(why: str) -> Reason:
    return why.reason if isinstance(why, Silence) else Reason.NO_EVIDENCE
