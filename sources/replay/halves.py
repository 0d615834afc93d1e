"""One video with both views in every picture, side by side or one above the other: first camera first."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from pathlib import Path
from typing import Literal, TypeAlias

import cv2
import numpy as np

from pipeline.errors import InputError
from pipeline.frame import StampOrigin
from sources.replay import files
from sources.replay.names import camera_names
from sources.replay.notices import Notices
from sources.replay.streams import Raw, Recording, Request, Stream
from sources.replay.videos import entries, made_up, opened, rate_and_count

Layout: TypeAlias = Literal["side_by_side", "top_bottom"]

WIDTH_PX = 480
"""The width at which two halves are compared."""

LOOKED_AT = (0, 15, 60)
"""Frames by which halves are recognised: recordings may begin with a black title."""

KEYPOINTS, CLOSE_BITS = 500, 40
"""ORB keypoints a half, and the Hamming distance up to which two of them are the same."""

SAME_ROW, SAME_COLUMN = 0.06, 0.3
"""How far a point may move from view to view, as a share of the height and of the width."""

ENOUGH, AGREE = 15, 0.6
"""Points that two views of one scene share at least, and their share in all matches; halves of one view share none."""


def matches(paths: Sequence[Path]) -> bool:
    return _layout(paths) is not None


def lone_camera(_: Path) -> str | None:
    return None


def read(request: Request) -> Recording:
    """Raises InputError where the halves are not told and are not alike."""
    video = _video(request.paths)
    if video is None:
        raise InputError(f"{request.paths[0]}: layout is of a single video with two views in every picture")
    wanted = request.settings.layout
    layout = _layout(request.paths) if wanted == "auto" else wanted
    if layout is None:
        raise InputError(f"{video}: its halves do not show the same scene: give its layout, or one path a camera")
    if wanted == "auto":
        request.notices.info(f"{video.name}: two views in every picture, {layout.replace('_', ' ')}; layout tells else")
    rate, told = rate_and_count(video)
    fps = request.fps(rate)
    names = camera_names([video, video], request.settings.cameras)
    stamps = made_up(fps, by_index=True)
    streams = (
        Stream(name, video, fps, told, partial(entries, video, stamps, told, _quiet_second(request, place), view))
        for place, (name, view) in enumerate(zip(names, _views(layout), strict=True))
    )
    return Recording(tuple(streams), StampOrigin.SYNTHESISED)


def _quiet_second(request: Request, place: int) -> Notices:
    """Both halves end with the one file: that is said once."""
    return request.notices if place == 0 else Notices()


def _views(layout: Layout) -> tuple[partial[Raw], partial[Raw]]:
    return partial(_half, layout, 0), partial(_half, layout, 1)


def _half(layout: Layout, place: int, raw: Raw) -> Raw:
    axis = 1 if layout == "side_by_side" else 0
    middle = raw.shape[axis] // 2
    part = slice(place * middle, (place + 1) * middle)
    return raw[:, part] if axis else raw[part]


def _video(paths: Sequence[Path]) -> Path | None:
    if len(paths) != 1:
        return None
    if files.is_video(paths[0]):
        return paths[0]
    inside = files.videos(paths[0]) if paths[0].is_dir() else []
    return inside[0] if len(inside) == 1 else None


def _layout(paths: Sequence[Path]) -> Layout | None:
    """The layout whose halves share more points, if they are views of one scene at all."""
    video = _video(paths)
    if video is None:
        return None
    layouts: tuple[Layout, Layout] = ("side_by_side", "top_bottom")
    shared = dict.fromkeys(layouts, 0)
    for raw in _samples(video):
        for layout in layouts:
            shared[layout] = max(shared[layout], _shared(*(view(raw) for view in _views(layout))))
    best = max(layouts, key=lambda layout: shared[layout])
    return best if shared[best] >= ENOUGH else None


def _samples(video: Path) -> list[Raw]:
    try:
        capture = opened(video)
    except InputError:
        return []
    try:
        found = []
        for index in range(LOOKED_AT[-1] + 1):
            if not capture.grab():
                break
            if index in LOOKED_AT:
                decoded, picture = capture.retrieve()
                found += [picture] if decoded else []
        return found
    finally:
        capture.release()


def _shared(first: Raw, second: Raw) -> int:
    """How many points both views show in nearly the same row; 0 where most matches disagree."""
    orb = cv2.ORB.create(KEYPOINTS)
    views = [_grey(view) for view in (first, second)]
    (here, ours), (there, theirs) = (orb.detectAndCompute(view, np.ones_like(view)) for view in views)
    if not here or not there:
        return 0
    matches = cv2.BFMatcher(cv2.NORM_HAMMING, crossCheck=True).match(ours, theirs)
    moved = np.array(
        [np.subtract(here[one.queryIdx].pt, there[one.trainIdx].pt) for one in matches if one.distance <= CLOSE_BITS]
    ).reshape(-1, 2)
    fits = np.all(np.abs(moved) <= (SAME_COLUMN * views[0].shape[1], SAME_ROW * views[0].shape[0]), axis=1)
    return int(fits.sum()) if fits.sum() >= AGREE * max(len(moved), 1) else 0


def _grey(raw: Raw) -> Raw:
    grey = raw if raw.ndim == 2 else cv2.cvtColor(raw, cv2.COLOR_BGR2GRAY)
    height_px = max(1, round(WIDTH_PX * raw.shape[0] / raw.shape[1]))
    return cv2.resize(np.ascontiguousarray(grey), (WIDTH_PX, height_px), interpolation=cv2.INTER_AREA)
