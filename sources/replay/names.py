"""Natural order, numbers in file names, and the names that streams give their cameras."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from typing import TypeAlias

from pipeline.errors import InputError

NaturalKey: TypeAlias = tuple[tuple[str | int, ...], str]

DIGITS = re.compile(r"([0-9]+)")


def natural(name: str) -> NaturalKey:
    """A sort key by which left2 comes before left10."""
    parts = DIGITS.split(name.lower())
    return tuple(int(part) if place % 2 else part for place, part in enumerate(parts)), name


def natural_path(path: Path) -> NaturalKey:
    return natural(path.name)


def is_text(path: Path) -> bool:
    """Whether a path is text: file names may hold any bytes."""
    try:
        str(path).encode()
    except UnicodeEncodeError:
        return False
    return True


def last_number(stem: str) -> int | None:
    """The last run of digits in a file name without its suffix."""
    runs = DIGITS.findall(stem)
    return int(runs[-1]) if runs else None


def camera_names(streams: Sequence[Path], wanted: Sequence[str] | None) -> list[str]:
    """One name a stream: those wanted, else left and right for two, else what the streams themselves are called.

    streams: files, or folders, in their order. Raises InputError when the number of wanted names is another.
    """
    if wanted is not None:
        if len(wanted) != len(streams):
            found = ", ".join(path.name for path in streams)
            raise InputError(
                f"cameras: {len(wanted)} names ({', '.join(wanted)}) for {len(streams)} streams ({found}): "
                "give one name a stream, in that order"
            )
        return list(wanted)
    if len(streams) == 2:
        return ["left", "right"]
    stems = [_stem(path) for path in streams]
    shared = Counter(map(_sanitised, stems))
    names = [
        _sanitised(f"{path.resolve().parent.name}_{stem}" if shared[_sanitised(stem)] > 1 else stem)
        for path, stem in zip(streams, stems, strict=True)
    ]
    return _unique(names)


def _stem(path: Path) -> str:
    whole = path.resolve()
    return whole.name if whole.is_dir() else whole.stem


def _sanitised(name: str) -> str:
    return re.sub(r"[^a-z0-9_]", "_", name.lower()) or "camera"


def _unique(names: Sequence[str]) -> list[str]:
    """The names, repeated ones counted on: cam, cam_2, cam_3."""
    taken: list[str] = []
    for name in names:
        candidate, copies = name, 1
        while candidate in taken or (copies > 1 and candidate in names):
            copies += 1
            candidate = f"{name}_{copies}"
        taken.append(candidate)
    return taken
