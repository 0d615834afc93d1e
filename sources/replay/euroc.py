"""The EuRoC layout: mav0/cam0/data.csv lists timestamps in ns and file names, a camera each; paired by time."""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from pathlib import Path

from pipeline.errors import InputError
from pipeline.frame import StampOrigin
from sources.replay.files import folders
from sources.replay.listed import Listed, Row, lines, read_listed
from sources.replay.streams import Recording, Request

STAMP = re.compile(r"[0-9]{1,19}")


def matches(paths: Sequence[Path]) -> bool:
    return len(paths) == 1 and len(_cameras(paths[0])) > 1


def lone_camera(path: Path) -> str | None:
    cameras = _cameras(path)
    return f"EuRoC camera '{cameras[0].name}'" if len(cameras) == 1 else None


def read(request: Request) -> Recording:
    cameras = [
        Listed(camera, list(_rows(camera)), camera / "data.csv", camera / "data")
        for camera in _cameras(request.paths[0])
    ]
    return read_listed(request, cameras, StampOrigin.DEVICE)


def _cameras(path: Path) -> list[Path]:
    root = path / "mav0" if (path / "mav0").is_dir() else path
    if not root.is_dir():
        return []
    return [folder for folder in folders(root) if folder.name.startswith("cam") and (folder / "data.csv").is_file()]


def _rows(camera: Path) -> Iterator[Row]:
    csv = camera / "data.csv"
    number = 0
    for where, text in lines(csv):
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
