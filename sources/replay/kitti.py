"""KITTI raw (image_00/data and timestamps.txt, a camera each) and odometry (image_0, and one times.txt for all)."""

from __future__ import annotations

import datetime as dt
import re
from collections.abc import Sequence
from decimal import Decimal
from pathlib import Path

from pipeline.errors import InputError
from pipeline.frame import NS_PER_S, StampOrigin
from sources.replay.files import folders, has_pictures, picture_names
from sources.replay.listed import Listed, Row, lines, read_listed
from sources.replay.names import last_number
from sources.replay.streams import Recording, Request

MOMENT = re.compile(r"(\d{4}-\d{2}-\d{2} \d{2}:\d{2}:\d{2})(?:\.(\d{1,9})\d*)?")
SECONDS = re.compile(r"[0-9]+(\.[0-9]+)?([eE][+-]?[0-9]+)?")


def matches(paths: Sequence[Path]) -> bool:
    return len(paths) == 1 and paths[0].is_dir() and len(_raw(paths[0]) or _odometry(paths[0])) > 1


def lone_camera(path: Path) -> str | None:
    cameras = (_raw(path) or _odometry(path)) if path.is_dir() else []
    return f"KITTI camera '{cameras[0].name}'" if len(cameras) == 1 else None


def read(request: Request) -> Recording:
    root = request.paths[0]
    raw = _raw(root)
    if raw:
        return read_listed(request, [_listed(camera) for camera in raw], StampOrigin.DEVICE)
    times = root / "times.txt"
    request.notices.info(f"{times.name} has one time for all cameras: it says nothing about synchronization")
    listed = [Listed(camera, _rows(times, camera), times, camera) for camera in _odometry(root)]
    return read_listed(request, listed, StampOrigin.SYNTHESISED)


def _listed(camera: Path) -> Listed:
    listing, folder = camera / "timestamps.txt", camera / "data"
    return Listed(camera, _rows(listing, folder), listing, folder)


def _raw(root: Path) -> list[Path]:
    return [
        folder
        for folder in folders(root)
        if folder.name.startswith("image_") and (folder / "timestamps.txt").is_file() and (folder / "data").is_dir()
    ]


def _odometry(root: Path) -> list[Path]:
    if not (root / "times.txt").is_file():
        return []
    return [folder for folder in folders(root) if folder.name.startswith("image_") and has_pictures(folder)]


def _rows(listing: Path, folder: Path) -> list[Row]:
    """A row a line; the picture whose number is the line's, counted from 0."""
    by_number = {last_number(Path(name).stem): name for name in picture_names(folder)}
    rows = [
        Row(number, _moment_ns(text, where), folder / by_number.get(number, f"{number:010d}.png"))
        for number, (where, text) in enumerate(lines(listing))
    ]
    if not rows:
        raise InputError(f"{listing}: lists no pictures: expected one time a line")
    return rows


def _moment_ns(text: str, where: str) -> int:
    """KITTI's moments have no time zone; any will do, as long as it is the same for all."""
    match = MOMENT.fullmatch(text)
    if match is not None:
        moment = dt.datetime.fromisoformat(match[1]).replace(tzinfo=dt.timezone.utc)
        return int(moment.timestamp()) * NS_PER_S + int((match[2] or "0").ljust(9, "0"))
    if SECONDS.fullmatch(text):
        return int(Decimal(text) * NS_PER_S)
    raise InputError(f"{where}: '{text[:60]}' is no time: expected 2011-09-26 13:02:25.964389445 or seconds")
