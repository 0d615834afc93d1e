"""What an audit comes to: a table for people and segments as CSV."""

from __future__ import annotations

import csv
import os
import re
from collections import Counter
from collections.abc import Iterable, Sequence
from typing import TextIO

from rich.box import HEAVY_HEAD, SIMPLE
from rich.markup import escape
from rich.table import Table

from pipeline.audit.remote import is_url
from pipeline.messages import AuditShape
from pipeline.printable import printable
from pipeline.terms import State
from pipeline.words import REASON_WORDS

SAID = {State.SYNC: "in sync", State.ASYNC: "OUT OF SYNC", State.UNKNOWN: "cannot tell"}
COLOUR = {State.SYNC: "green", State.ASYNC: "bold red", State.UNKNOWN: "yellow"}
BROKEN, NOT_JUDGED = "broken", "not judged"
DAMAGE = re.compile(r": damaged | has no end|not indexed| ends after ")
"""Warnings that a recording was not read to its end."""

WIDE = 140
"""Letters from which all columns fit beside one another."""

LEFT_OUT_WHERE_NARROW = {"cameras", "length", "why"}
NUMBERS = {"cameras", "frames", "length", "offset", "judged"}
HEADER = ("path", "pair", "start_s", "stop_s", "first_frame", "last_frame", "state", "cause", "offset_ms")


def said(record: AuditShape) -> str:
    """The answer in a few words."""
    if record.error is None or record.state is not State.UNKNOWN:
        return SAID[record.state]
    return NOT_JUDGED if record.format is None else BROKEN


def headline(records: Sequence[AuditShape]) -> str:
    """How many of each there are, in a sentence without its end."""
    counts = Counter(map(said, records))
    told = [f"{counts[words]} {words.lower()}" for words in (*SAID.values(), BROKEN, NOT_JUDGED) if counts[words]]
    return f"{len(records)} recording{'s' * (len(records) != 1)}: {', '.join(told)}"


def table(records: Sequence[AuditShape], width: int) -> Table:
    """width: of the terminal, in letters. Where that is too narrow for the last column, `reasons` tell the same."""
    wide = width >= WIDE
    heads = ["recording", "format", "cameras", "frames", "length", "answer", "cause", "offset", "judged", "why"]
    kept = [place for place, head in enumerate(heads) if wide or head not in LEFT_OUT_WHERE_NARROW]
    made = Table(
        *(heads[place] for place in kept), box=HEAVY_HEAD if wide else SIMPLE, pad_edge=wide, collapse_padding=not wide
    )
    for column in made.columns:
        column.justify = "right" if column.header in NUMBERS else "left"
        column.overflow = "fold"
        column.no_wrap = column.header not in {"recording", "why"}
    for record, name in zip(records, _names(records), strict=True):
        known = bool(record.frames)
        cells = (
            escape(printable(name)),
            record.format or "",
            str(len(record.cameras) or ""),
            str(record.frames) if known else "",
            f"{record.duration_s:.1f} s" if known else "",
            f"[{COLOUR[record.state]}]{said(record)}[/]",
            record.cause.value if record.cause else "",
            "" if record.offset_ms is None else f"{record.offset_ms:+.1f} ms",
            f"{100 * record.coverage:.0f} %" if known else "",
            escape(printable(_why(record))),
        )
        made.add_row(*(cells[place] for place in kept))
    return made


def reasons(records: Sequence[AuditShape], width: int) -> list[str]:
    """What the table leaves out where it is narrow, a line a recording that there is something to say of."""
    if width >= WIDE:
        return []
    told = zip(_names(records), map(_why, records), strict=True)
    return [printable(f"{name}: {why}") for name, why in told if why]


def write_segments(file: TextIO, records: Iterable[AuditShape]) -> None:
    rows = csv.writer(file, lineterminator="\n")
    rows.writerow(HEADER)
    for record in records:
        for one in record.segments:
            offset = "" if one.offset_ms is None else one.offset_ms
            cause = one.cause.value if one.cause else ""
            frames = one.first_frame, one.last_frame
            rows.writerow((record.path, one.pair, one.start_s, one.stop_s, *frames, one.state.value, cause, offset))


def _why(record: AuditShape) -> str:
    if record.error is not None:
        return _within(record, record.error)
    damage = next((warning for warning in record.warnings if DAMAGE.search(warning)), None)
    if damage is not None:
        return _within(record, damage)
    return REASON_WORDS[record.reason] if record.reason is not None and record.state is State.UNKNOWN else ""


def _within(record: AuditShape, text: str) -> str:
    """The text without the path of the recording that it is told of anyway."""
    return text.replace(f"{record.path}/", "").removeprefix(record.path).lstrip(": ")


def _names(records: Sequence[AuditShape]) -> list[str]:
    """Paths from the folder that holds all of them; URLs as they are."""
    paths = [record.path for record in records if not is_url(record.path)]
    base = os.path.commonpath([os.path.dirname(path) for path in paths]) if paths else ""  # noqa: PTH120
    return [record.path if is_url(record.path) else os.path.relpath(record.path, base or os.sep) for record in records]
