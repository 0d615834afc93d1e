"""Caliscope recordings: cam_0.mp4, cam_1.mp4 ... and a timestamps.csv with the host's time of every frame."""

from __future__ import annotations

import re
from collections.abc import Sequence
from decimal import Decimal, InvalidOperation
from pathlib import Path

from pipeline.errors import InputError
from pipeline.frame import NS_PER_S, StampOrigin
from sources.replay import files
from sources.replay.listed import lines
from sources.replay.names import camera_names, last_number
from sources.replay.streams import Recording, Request, origins_ns
from sources.replay.videos import Stamp, stamped_stream

LIST = "timestamps.csv"
COLUMNS = (("cam_id", "port"), ("frame_index",), ("frame_time",))
"""What a row must tell, by the names of caliscope's versions: camera, frame, seconds."""


def matches(paths: Sequence[Path]) -> bool:
    return len(paths) == 1 and (paths[0] / LIST).is_file() and len(_videos(paths[0])) > 1


def lone_camera(_: Path) -> str | None:
    return None


def read(request: Request) -> Recording:
    folder = request.paths[0]
    stamps = _stamps(folder / LIST)
    videos = {number: video for number, video in _videos(folder).items() if number in stamps}
    if len(videos) < 2:
        there = ", ".join(map(str, sorted(stamps)))
        raise InputError(f"{folder / LIST}: has times of the cameras {there}: two or more of their videos are needed")
    names = camera_names(list(videos.values()), request.settings.cameras)
    of = [stamps[number] for number in videos]
    origins = origins_ns([[stamp.captured_ns for stamp in own] for own in of], request.notices)
    streams = (
        stamped_stream(name, video, own, origin, request)
        for name, video, own, origin in zip(names, videos.values(), of, origins, strict=True)
    )
    return Recording(tuple(streams), StampOrigin.DRIVER)


def _videos(folder: Path) -> dict[int, Path]:
    """The videos by the numbers of their cameras."""
    found = {last_number(video.stem): video for video in files.videos(folder)}
    return {
        number: video
        for number, video in found.items()
        if number is not None and re.fullmatch(r"(cam|port)_\d+", video.stem)
    }


def _stamps(listing: Path) -> dict[int, list[Stamp]]:
    """The stamps of every camera, in order of its frames: the n-th belongs to the n-th frame of its video."""
    content = lines(listing)
    _, header = next(content, ("", ""))
    titles = [title.strip() for title in header.split(",")]
    places = [next((titles.index(name) for name in names if name in titles), None) for names in COLUMNS]
    if None in places:
        raise InputError(f"{listing}:1: '{header[:60]}': expected the columns cam_id, frame_index and frame_time")
    found: dict[int, list[Stamp]] = {}
    for where, text in content:
        cells = text.split(",")
        try:
            camera, index, seconds = (cells[place].strip() for place in places if place is not None)
            stamp = Stamp(int(index), None, int(Decimal(seconds) * NS_PER_S))
            found.setdefault(int(camera), []).append(stamp)
        except (IndexError, ValueError, InvalidOperation, OverflowError) as error:
            raise InputError(f"{where}: '{text[:60]}': expected a camera, a frame and its time in seconds") from error
    return {camera: sorted(own) for camera, own in sorted(found.items())}
