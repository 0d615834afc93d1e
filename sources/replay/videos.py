"""Video files, one a camera, read by OpenCV and paired by frame index."""

from __future__ import annotations

import os
from collections.abc import Generator, Sequence
from functools import partial
from itertools import count
from pathlib import Path

import cv2

from pipeline.errors import InputError
from pipeline.frame import StampOrigin
from sources.replay import files
from sources.replay.names import camera_names
from sources.replay.notices import Notices
from sources.replay.pictures import quiet
from sources.replay.streams import Entry, Raw, Recording, Request, Stream, synthesised_ns

SANE_FPS = (0.1, 1000.0)
SAME_FPS = 0.01
"""Containers write 29.97 as 30: rates closer than this, as a share of the smaller, are the same."""

FFMPEG_QUIET = "-8"
MOST_FRAMES = 1 << 40  # a damaged header tells any number


def matches(paths: Sequence[Path]) -> bool:
    if len(paths) == 1:
        return paths[0].is_dir() and len(files.videos(paths[0])) > 1
    return all(files.is_video(path) for path in paths)


def lone_camera(path: Path) -> str | None:
    if files.is_video(path):
        return f"video '{path.name}'"
    found = files.videos(path) if path.is_dir() else []
    return f"video '{found[0].name}'" if len(found) == 1 else None


def read(request: Request) -> Recording:
    pair_by = request.settings.pair_by
    if pair_by == "number":
        raise InputError(f"{request.paths[0]}: videos have no file numbers: pair_by index or time is possible")
    # FFmpeg writes to stderr what we say in one sentence; OpenCV hears of that only here, and a user's own value stays.
    os.environ.setdefault("OPENCV_FFMPEG_LOGLEVEL", FFMPEG_QUIET)
    videos = list(request.paths) if request.as_given else files.videos(request.paths[0])
    names = camera_names(videos, request.settings.cameras)
    told = [_rate_and_count(video) for video in videos]
    rates = [request.fps(rate) for rate, _ in told]
    by_index = pair_by == "index" or (pair_by == "auto" and max(rates) <= min(rates) * (1 + SAME_FPS))
    if by_index:
        rates = [rates[0]] * len(rates)
    elif pair_by == "auto":
        listed = ", ".join(f"{video.name} {rate:g} Hz" for video, rate in zip(videos, rates, strict=True))
        request.notices.warning(f"the videos' frame rates differ ({listed}): frames are paired by time")
    streams = (
        Stream(name, video, fps, frames, partial(_entries, video, fps, frames, request.notices, by_index=by_index))
        for name, video, fps, (_, frames) in zip(names, videos, rates, told, strict=True)
    )
    return Recording(tuple(streams), StampOrigin.SYNTHESISED)


def _rate_and_count(video: Path) -> tuple[float | None, int | None]:
    """The frame rate in Hz and the number of frames as the container tells them, None where that cannot be."""
    capture = _opened(video)
    try:
        fps, frames = capture.get(cv2.CAP_PROP_FPS), capture.get(cv2.CAP_PROP_FRAME_COUNT)
    finally:
        capture.release()
    slowest, fastest = SANE_FPS
    return fps if slowest <= fps <= fastest else None, int(frames) if 0 < frames < MOST_FRAMES else None


def _opened(video: Path) -> cv2.VideoCapture:
    # Named, because OpenCV would otherwise try left01.mp4 as the first of a sequence of pictures, too.
    with quiet():
        capture = cv2.VideoCapture(str(video), cv2.CAP_FFMPEG)
    if not capture.isOpened():
        raise InputError(f"{video}: cannot be opened as a video: it is damaged, empty or of an unknown kind")
    return capture


def _entries(
    video: Path, fps: float, told: int | None, notices: Notices, *, by_index: bool
) -> Generator[Entry, None, None]:
    capture = _opened(video)
    try:
        for index in count():
            if not capture.grab():
                break
            where = f"{video}: frame {index}"
            load = partial(_retrieved, capture, where)
            yield Entry(index, index if by_index else None, synthesised_ns(index, fps), where, load)
    finally:
        capture.release()
    if told is not None and index < told:
        notices.warning(f"{video.name} ends after {index} of {told} frames")


def _retrieved(capture: cv2.VideoCapture, where: str) -> Raw:
    decoded, picture = capture.retrieve()
    if not decoded:
        raise InputError(f"{where} cannot be decoded")
    return picture
