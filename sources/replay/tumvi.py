"""The TUM-VI layout for DSO: dso/cam0/times.txt lists id, seconds and exposure in ms; pictures lie in cam0/images.

TUM-VI's other layout is EuRoC's, and read as such.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from decimal import Decimal
from pathlib import Path

from pipeline.errors import InputError
from pipeline.frame import NS_PER_MS, NS_PER_S, StampOrigin
from sources.replay.files import folders, picture_names
from sources.replay.listed import Listed, Row, lines, read_listed
from sources.replay.streams import Recording, Request

LINE = re.compile(r"(\S+)\s+([0-9]+(?:\.[0-9]+)?)(?:\s+([0-9]+(?:\.[0-9]+)?))?")
STAMP_ID = re.compile(r"[1-9][0-9]{18}")


def matches(paths: Sequence[Path]) -> bool:
    return len(paths) == 1 and len(_cameras(paths[0])) > 1


def lone_camera(path: Path) -> str | None:
    cameras = _cameras(path)
    return f"TUM-VI camera '{cameras[0].name}'" if len(cameras) == 1 else None


def read(request: Request) -> Recording:
    cameras = [
        Listed(camera, _rows(camera), camera / "times.txt", camera / "images") for camera in _cameras(request.paths[0])
    ]
    return read_listed(request, cameras, StampOrigin.DEVICE)


def _cameras(path: Path) -> list[Path]:
    root = path / "dso" if (path / "dso").is_dir() else path
    if not root.is_dir():
        return []
    return [folder for folder in folders(root) if (folder / "times.txt").is_file() and (folder / "images").is_dir()]


def _rows(camera: Path) -> list[Row]:
    listing, folder = camera / "times.txt", camera / "images"
    by_stem = {Path(name).stem: name for name in picture_names(folder)}
    rows: list[Row] = []
    for where, text in lines(listing):
        match = LINE.fullmatch(text)
        if match is None:
            raise InputError(f"{where}: '{text[:60]}': expected id seconds exposure_ms")
        name, seconds, exposure_ms = match.groups()
        captured_ns = int(name) if STAMP_ID.fullmatch(name) else int(Decimal(seconds) * NS_PER_S)
        exposure_ns = int(Decimal(exposure_ms) * NS_PER_MS) if exposure_ms and Decimal(exposure_ms) else None
        rows.append(Row(len(rows), captured_ns, folder / by_stem.get(name, f"{name}.png"), exposure_ns))
    if not rows:
        raise InputError(f"{listing}: lists no pictures: expected lines id seconds exposure_ms")
    return rows
