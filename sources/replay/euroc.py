"""The EuRoC layout: mav0/cam0/data.csv lists timestamps in ns and file names, a camera each; paired by time."""

from __future__ import annotations

import re
from collections.abc import Generator, Iterator, Sequence
from functools import partial
from pathlib import Path
from typing import NamedTuple

from pipeline.errors import InputError
from pipeline.frame import StampOrigin
from sources.replay.files import folders, picture_names, unreadable
from sources.replay.names import camera_names
from sources.replay.pictures import read_picture
from sources.replay.streams import Entry, Recording, Request, Stream, fps_of, origins_ns

STAMP = re.compile(r"[0-9]{1,19}")


class Row(NamedTuple):
    """A line of data.csv, counted from 0."""

    number: int
    captured_ns: int
    file: Path


def matches(paths: Sequence[Path]) -> bool:
    return len(paths) == 1 and len(_cameras(paths[0])) > 1


def lone_camera(path: Path) -> str | None:
    cameras = _cameras(path)
    return f"EuRoC camera '{cameras[0].name}'" if len(cameras) == 1 else None


def read(request: Request) -> Recording:
    if request.settings.pair_by == "number":
        raise InputError(f"{request.paths[0]}: a EuRoC recording pairs by time or index, not by number")
    cameras = _cameras(request.paths[0])
    names = camera_names(cameras, request.settings.cameras)
    listed = [list(_rows(camera)) for camera in cameras]
    rows = [_present(camera, camera_rows) for camera, camera_rows in zip(cameras, listed, strict=True)]
    _say_absent(request, listed, rows)
    origins = origins_ns([[row.captured_ns for row in camera_rows] for camera_rows in rows], request.notices)
    by_index = request.settings.pair_by == "index"
    streams = tuple(
        Stream(
            name=name,
            where=camera,
            fps=request.fps(fps_of([row.captured_ns for row in all_rows])),
            count=len(there),
            entries=partial(_entries, there, by_index=by_index),
            origin_ns=origin,
        )
        for name, camera, all_rows, there, origin in zip(names, cameras, listed, rows, origins, strict=True)
    )
    return Recording(streams, StampOrigin.DEVICE)


def _cameras(path: Path) -> list[Path]:
    root = path / "mav0" if (path / "mav0").is_dir() else path
    if not root.is_dir():
        return []
    return [folder for folder in folders(root) if folder.name.startswith("cam") and (folder / "data.csv").is_file()]


def _rows(camera: Path) -> Iterator[Row]:
    csv = camera / "data.csv"
    try:
        data = csv.read_bytes()
    except OSError as error:
        raise unreadable(csv, error) from error
    number = 0
    for line_number, line in enumerate(data.splitlines(), 1):
        where = f"{csv}:{line_number}"
        try:
            text = line.decode("utf-8-sig").strip()
        except UnicodeDecodeError as error:
            raise InputError(f"{where}: {line[:60]!r} is not UTF-8 text") from error
        if not text or text.startswith("#"):
            continue
        stamp, _, rest = text.partition(",")
        name = rest.partition(",")[0].strip()
        if not STAMP.fullmatch(stamp.strip()):
            raise InputError(f"{where}: '{stamp[:60]}' is not a timestamp in ns: expected timestamp,filename")
        if not name:
            raise InputError(f"{where}: '{text[:60]}' names no picture: expected timestamp,filename")
        yield Row(number, int(stamp), camera / "data" / name)
        number += 1
    if not number:
        raise InputError(f"{csv}: lists no pictures: expected lines timestamp,filename")


def _present(camera: Path, rows: Sequence[Row]) -> list[Row]:
    folder = camera / "data"
    there = set(picture_names(folder)) if folder.is_dir() else set()
    # A name is looked up, never followed: a recording does not lead out of its own folder.
    present = [row for row in rows if row.file.parent == folder and row.file.name in there]
    if not present:
        raise InputError(f"{camera}: none of the {len(rows)} pictures that data.csv lists is in {folder}")
    return present


def _say_absent(request: Request, listed: Sequence[Sequence[Row]], present: Sequence[Sequence[Row]]) -> None:
    absent = [
        row
        for rows, there in zip(listed, present, strict=True)
        for numbers in [{row.number for row in there}]
        for row in rows
        if row.number not in numbers
    ]
    if absent:
        request.notices.warning(
            f"{len(absent)} of {sum(map(len, listed))} pictures listed in data.csv are absent, "
            f"the first is {absent[0].file}: they are left out"
        )


def _entries(rows: Sequence[Row], *, by_index: bool) -> Generator[Entry, None, None]:
    for row in rows:
        group = row.number if by_index else None
        yield Entry(row.number, group, row.captured_ns, str(row.file), partial(read_picture, row.file))
