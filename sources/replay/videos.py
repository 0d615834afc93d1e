"""Video files, one a camera, read by OpenCV and paired by frame index."""

from __future__ import annotations

import os
from collections.abc import Callable, Generator, Sequence
from functools import partial
from itertools import count
from pathlib import Path
from typing import NamedTuple, TypeAlias

import cv2

from pipeline.errors import InputError
from pipeline.frame import StampOrigin
from sources.replay import files
from sources.replay.names import camera_names, is_text
from sources.replay.notices import Notices
from sources.replay.pictures import quiet
from sources.replay.streams import SAME_FPS, Entry, Raw, Recording, Request, Stream, fps_of, synthesised_ns

SANE_FPS = (0.1, 1000.0)
FFMPEG_QUIET = "-8"
MOST_FRAMES = 1 << 40  # a damaged header tells any number


class Stamp(NamedTuple):
    """What is known of a frame besides its picture."""

    sequence: int
    group: int | None
    captured_ns: int
    exposure_ns: int | None = None


Stamps: TypeAlias = Callable[[int], Stamp | None]
"""What is known of a video's frame by its index; None for a frame that is to be left out."""


def matches(paths: Sequence[Path]) -> bool:
    if len(paths) == 1:
        return paths[0].is_dir() and len(files.videos(paths[0])) > 1
    return all(files.is_video(path) for path in paths)


def lone_camera(path: Path) -> str | None:
    found = [path] if files.is_video(path) else files.videos(path) if path.is_dir() else []
    return f"video '{found[0].name}'" if len(found) == 1 else None


def read(request: Request) -> Recording:
    pair_by = request.settings.pair_by
    if pair_by == "number":
        raise InputError(f"{request.paths[0]}: videos have no file numbers: pair_by index or time is possible")
    videos = list(request.paths) if request.as_given else files.videos(request.paths[0])
    names = camera_names(videos, request.settings.cameras)
    told = [rate_and_count(video) for video in videos]
    rates = [request.fps(rate) for rate, _ in told]
    by_index = pair_by == "index" or (pair_by == "auto" and max(rates) <= min(rates) * (1 + SAME_FPS))
    if by_index:
        rates = [rates[0]] * len(rates)
    elif pair_by == "auto":
        listed = ", ".join(f"{video.name} {rate:g} Hz" for video, rate in zip(videos, rates, strict=True))
        request.notices.warning(f"the videos' frame rates differ ({listed}): frames are paired by time")
    streams = []
    for name, video, fps, (_, frames) in zip(names, videos, rates, told, strict=True):
        read_video = partial(entries, video, made_up(fps, by_index=by_index), frames, request.notices)
        streams.append(Stream(name, video, fps, frames, read_video))
    return Recording(tuple(streams), StampOrigin.SYNTHESISED)


def made_up(fps: float, *, by_index: bool) -> Stamps:
    """Stamps of a video that has none of its own."""
    return lambda index: Stamp(index, index if by_index else None, synthesised_ns(index, fps))


def listed(stamps: Sequence[Stamp]) -> Stamps:
    """The n-th stamp for the n-th frame; frames beyond the last are left out."""
    return lambda index: stamps[index] if index < len(stamps) else None


def stamped_stream(name: str, video: Path, stamps: Sequence[Stamp], origin_ns: int, request: Request) -> Stream:
    """A video whose frames a list gives stamps, one by one."""
    _, told = rate_and_count(video)
    if told is not None and told != len(stamps):
        request.notices.warning(
            f"{video.name} has {told} frames, its list of timestamps {len(stamps)}: they are matched from the start"
        )
    fps = request.fps(fps_of([stamp.captured_ns for stamp in stamps]))
    expected = min(told or len(stamps), len(stamps))
    read_video = partial(entries, video, listed(stamps), expected, request.notices)
    return Stream(name, video, fps, expected, read_video, origin_ns, partial(_headers, video, stamps))


def _headers(video: Path, stamps: Sequence[Stamp]) -> Generator[Entry, None, None]:
    for stamp in stamps:
        yield Entry(stamp.sequence, stamp.group, stamp.captured_ns, str(video), _none, exposure_ns=stamp.exposure_ns)


def _none() -> Raw:
    raise AssertionError("the picture of a header")


def rate_and_count(video: Path) -> tuple[float | None, int | None]:
    """The frame rate in Hz and the number of frames as the container tells them, None where that cannot be.

    Raises InputError for what is no video.
    """
    capture = opened(video)
    try:
        fps, frames = capture.get(cv2.CAP_PROP_FPS), capture.get(cv2.CAP_PROP_FRAME_COUNT)
    finally:
        capture.release()
    slowest, fastest = SANE_FPS
    return fps if slowest <= fps <= fastest else None, int(frames) if 0 < frames < MOST_FRAMES else None


def opened(video: Path) -> cv2.VideoCapture:
    """A capture that stands before the first frame. Raises InputError for what is no video."""
    # FFmpeg writes to stderr what we say in one sentence; OpenCV hears of that only here, and a user's own value stays.
    os.environ.setdefault("OPENCV_FFMPEG_LOGLEVEL", FFMPEG_QUIET)
    if not is_text(video):  # OpenCV would crash
        raise InputError(f"{video}: the name has bytes that are no UTF-8 text: rename it")
    # Named, because OpenCV would otherwise try left01.mp4 as the first of a sequence of pictures, too.
    with quiet():
        capture = cv2.VideoCapture(str(video), cv2.CAP_FFMPEG)
    if not capture.isOpened():
        raise InputError(f"{video}: cannot be opened as a video: it is damaged, empty or of an unknown kind")
    return capture


def entries(
    video: Path, stamps: Stamps, told: int | None, notices: Notices, view: Callable[[Raw], Raw] = lambda raw: raw
) -> Generator[Entry, None, None]:
    """The frames of a video. told: how many there should be. view: the part of each picture that is this camera's."""
    capture = opened(video)
    try:
        for index in count():
            if not capture.grab():
                break
            where = f"{video}: frame {index}"
            stamp = stamps(index)
            if stamp is not None:
                load = partial(_retrieved, capture, where, view)
                yield Entry(stamp.sequence, stamp.group, stamp.captured_ns, where, load, exposure_ns=stamp.exposure_ns)
    finally:
        capture.release()
    if told is not None and index < told:
        notices.warning(f"{video.name} ends after {index} of {told} frames")


def _retrieved(capture: cv2.VideoCapture, where: str, view: Callable[[Raw], Raw]) -> Raw:
    decoded, picture = capture.retrieve()
    if not decoded:
        raise InputError(f"{where} cannot be decoded")
    return view(picture)
