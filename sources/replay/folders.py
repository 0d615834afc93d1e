"""Folders of pictures, one a camera, paired by file number, by place, or by timestamps that are the file names."""

from __future__ import annotations

import re
from collections.abc import Generator, Sequence
from functools import partial
from pathlib import Path
from typing import NamedTuple

from pipeline.errors import InputError
from pipeline.frame import StampOrigin
from sources.replay import files
from sources.replay.names import camera_names, last_number
from sources.replay.numbers import slots
from sources.replay.pictures import read_picture
from sources.replay.streams import Entry, Recording, Request, Stream, fps_of, origins_ns, synthesised_ns

EPOCH_STAMP = re.compile(r"[1-9][0-9]{15}|[1-9][0-9]{18}")
"""µs or ns since 1970, for any moment since 2001; leading zeros mean a counter."""

US_DIGITS = 16


class Item(NamedTuple):
    """A picture with its place in the recording."""

    sequence: int
    group: int | None
    captured_ns: int
    name: str


def matches(paths: Sequence[Path]) -> bool:
    if len(paths) == 1:
        return paths[0].is_dir() and len(_cameras(paths[0])) > 1
    return all(path.is_dir() for path in paths)


def lone_camera(path: Path) -> str | None:
    if not path.is_dir():
        return None
    direct = files.picture_names(path)
    if direct:
        return f"{len(direct)} pictures"
    cameras = _cameras(path)
    return f"folder '{cameras[0].name}', {len(files.picture_names(cameras[0]))} pictures" if cameras else None


def read(request: Request) -> Recording:
    cameras = list(request.paths) if request.as_given else _cameras(request.paths[0])
    names = camera_names(cameras, request.settings.cameras)
    pictures = [_pictures(camera) for camera in cameras]
    way = _pairing(request, cameras, pictures)
    if way == "time":
        return _timed(request, cameras, names, pictures)
    numbers = [_numbers(files_of) if way == "number" else list(range(len(files_of))) for files_of in pictures]
    fps = request.fps(None)
    slot_of = slots(numbers)
    items = [
        [
            Item(number, slot_of[number], synthesised_ns(slot_of[number], fps), name)
            for number, name in sorted(zip(own, files_of, strict=True))
        ]
        for own, files_of in zip(numbers, pictures, strict=True)
    ]
    streams = (
        Stream(name, camera, fps, len(own), partial(_entries, camera, own))
        for name, camera, own in zip(names, cameras, items, strict=True)
    )
    return Recording(tuple(streams), StampOrigin.SYNTHESISED)


def _cameras(path: Path) -> list[Path]:
    return [folder for folder in files.folders(path) if files.has_pictures(folder)]


def _pictures(camera: Path) -> list[str]:
    names = files.picture_names(camera)
    if not names:
        raise InputError(f"{camera}: no pictures in this folder: expected {', '.join(files.PICTURE_SUFFIXES)} files")
    return names


def _pairing(request: Request, cameras: Sequence[Path], pictures: Sequence[Sequence[str]]) -> str:
    """How frames pair: as asked, if the file names allow it, else as they suggest."""
    wanted = request.settings.pair_by
    if wanted == "index":
        return wanted
    if wanted in {"time", "auto"}:
        unstamped = _first_unstamped(cameras, pictures)
        if unstamped is None:
            return "time"
        if wanted == "time":
            raise InputError(
                f"{unstamped}: the name is no timestamp (16 digits of µs, 19 of ns): pair_by time needs it"
            )
    problem = _number_problem(cameras, pictures)
    if wanted == "number" and problem is not None:
        raise InputError(f"{problem}: pair_by number is not possible; pair_by index takes natural order")
    problem = problem or (None if wanted == "number" else _few_shared(cameras, pictures))
    if problem is None:
        return "number"
    request.notices.warning(f"{problem}: frames are paired by their place in natural order")
    return "index"


def _first_unstamped(cameras: Sequence[Path], pictures: Sequence[Sequence[str]]) -> Path | None:
    return next(
        (
            camera / name
            for camera, names in zip(cameras, pictures, strict=True)
            for name in names
            if EPOCH_STAMP.fullmatch(Path(name).stem) is None
        ),
        None,
    )


def _number_problem(cameras: Sequence[Path], pictures: Sequence[Sequence[str]]) -> str | None:
    """Why file numbers cannot tell frames apart, if so."""
    for camera, names in zip(cameras, pictures, strict=True):
        seen: dict[int, str] = {}
        for name in names:
            number = last_number(Path(name).stem)
            if number is None:
                return f"{camera / name}: no number in the file name"
            if number in seen:
                return f"{camera}: {seen[number]} and {name} have the same number {number}"
            seen[number] = name
    return None


def _few_shared(cameras: Sequence[Path], pictures: Sequence[Sequence[str]]) -> str | None:
    first, *others = map(_numbers, pictures)
    for camera, own in zip(cameras[1:], others, strict=True):
        shared = len(set(first) & set(own))
        if 2 * shared < min(len(first), len(own)):
            return f"{camera}: only {shared} of {len(own)} file numbers are also in {cameras[0]}"
    return None


def _numbers(names: Sequence[str]) -> list[int]:
    return [number for name in names if (number := last_number(Path(name).stem)) is not None]


def _timed(
    request: Request, cameras: Sequence[Path], names: Sequence[str], pictures: Sequence[Sequence[str]]
) -> Recording:
    stamped = [sorted((_stamp_ns(Path(name).stem), name) for name in own) for own in pictures]
    items = [[Item(place, None, ns, name) for place, (ns, name) in enumerate(own)] for own in stamped]
    stamps_ns = [[item.captured_ns for item in own] for own in items]
    streams = (
        Stream(name, camera, request.fps(fps_of(own_ns)), len(own), partial(_entries, camera, own), origin)
        for name, camera, own, own_ns, origin in zip(
            names, cameras, items, stamps_ns, origins_ns(stamps_ns, request.notices), strict=True
        )
    )
    return Recording(tuple(streams), StampOrigin.DEVICE)


def _stamp_ns(stem: str) -> int:
    return int(stem) * (1000 if len(stem) == US_DIGITS else 1)


def _entries(camera: Path, items: Sequence[Item]) -> Generator[Entry, None, None]:
    for item in items:
        path = camera / item.name
        yield Entry(item.sequence, item.group, item.captured_ns, str(path), partial(read_picture, path))
