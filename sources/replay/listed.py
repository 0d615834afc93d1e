"""Pictures that a list gives timestamps, one folder and one list a camera: what EuRoC, KITTI and TUM-VI share."""

from __future__ import annotations

from collections.abc import Generator, Iterator, Sequence
from functools import partial
from pathlib import Path
from typing import NamedTuple

from pipeline.errors import InputError
from pipeline.frame import StampOrigin
from sources.replay.files import picture_names, unreadable
from sources.replay.names import camera_names
from sources.replay.pictures import read_picture
from sources.replay.streams import Entry, Recording, Request, Stream, fps_of, origins_ns


class Row(NamedTuple):
    """A line of a list, counted from 0, and the picture it is about."""

    number: int
    captured_ns: int
    file: Path
    exposure_ns: int | None = None


class Listed(NamedTuple):
    """A camera's rows, the file that lists them and the folder that holds the pictures."""

    camera: Path
    rows: list[Row]
    listing: Path
    folder: Path


def lines(listing: Path) -> Iterator[tuple[str, str]]:
    """Where and what: every line of a list but blank ones and comments. Raises InputError."""
    try:
        data = listing.read_bytes()
    except OSError as error:
        raise unreadable(listing, error) from error
    for line_number, line in enumerate(data.splitlines(), 1):
        where = f"{listing}:{line_number}"
        try:
            text = line.decode("utf-8-sig").strip()
        except UnicodeDecodeError as error:
            raise InputError(f"{where}: {line[:60]!r} is not UTF-8 text") from error
        if text and not text.startswith("#"):
            yield where, text


def read_listed(request: Request, cameras: Sequence[Listed], stamp_origin: StampOrigin) -> Recording:
    """The recording of these cameras; pictures that are listed but absent are holes, and said.

    Raises InputError for a camera without a picture.
    """
    if request.settings.pair_by == "number":
        raise InputError(f"{request.paths[0]}: a recording with timestamps pairs by time or index, not by number")
    names = camera_names([one.camera for one in cameras], request.settings.cameras)
    rows = [_present(one) for one in cameras]
    _say_absent(request, cameras, rows)
    origins = origins_ns([[row.captured_ns for row in camera_rows] for camera_rows in rows], request.notices)
    by_index = request.settings.pair_by == "index" or stamp_origin is StampOrigin.SYNTHESISED
    streams = tuple(
        Stream(
            name=name,
            where=one.camera,
            fps=request.fps(fps_of([row.captured_ns for row in one.rows])),
            count=len(there),
            entries=partial(_entries, there, by_index=by_index),
            origin_ns=origin,
        )
        for name, one, there, origin in zip(names, cameras, rows, origins, strict=True)
    )
    return Recording(streams, stamp_origin)


def _present(listed: Listed) -> list[Row]:
    there = set(picture_names(listed.folder)) if listed.folder.is_dir() else set()
    # A name is looked up, never followed: a recording does not lead out of its own folder.
    present = [row for row in listed.rows if row.file.parent == listed.folder and row.file.name in there]
    if not present:
        raise InputError(
            f"{listed.camera}: none of the {len(listed.rows)} pictures that {listed.listing.name} lists is in "
            f"{listed.folder}"
        )
    return present


def _say_absent(request: Request, cameras: Sequence[Listed], present: Sequence[Sequence[Row]]) -> None:
    absent = [
        (listed, row)
        for listed, there in zip(cameras, present, strict=True)
        for numbers in [{row.number for row in there}]
        for row in listed.rows
        if row.number not in numbers
    ]
    if absent:
        listed, row = absent[0]
        request.notices.warning(
            f"{len(absent)} of {sum(len(one.rows) for one in cameras)} pictures listed in {listed.listing.name} are "
            f"absent, the first is {row.file}: they are left out"
        )


def _entries(rows: Sequence[Row], *, by_index: bool) -> Generator[Entry, None, None]:
    for row in rows:
        group = row.number if by_index else None
        load = partial(read_picture, row.file)
        yield Entry(row.number, group, row.captured_ns, str(row.file), load, exposure_ns=row.exposure_ns)
