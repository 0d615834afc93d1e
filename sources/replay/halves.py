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

WIDTH_PX, HEIGHT_PX = 96, 72
"""The size at which two halves are compared."""

LOOKED_AT = (0, 15, 60)
"""Frames by which halves are recognised: recordings may begin with a black title."""

ALIKE = 0.7
"""Normalised correlation of two views of one scene, disparity allowed for; halves of one view stay far below."""

FLAT = 4.0
"""Standard deviation in grey levels below which a picture shows nothing that could be compared."""


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
    """The layout whose halves are more alike, if they are alike at all."""
    video = _video(paths)
    if video is None:
        return None
    layouts: tuple[Layout, Layout] = ("side_by_side", "top_bottom")
    likeness = dict.fromkeys(layouts, 0.0)
    for raw in _samples(video):
        for layout in layouts:
            likeness[layout] = max(likeness[layout], _likeness(*(view(raw) for view in _views(layout))))
    best = max(layouts, key=lambda layout: likeness[layout])
    return best if likeness[best] >= ALIKE else None


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


def _likeness(first: Raw, second: Raw) -> float:
    """The best normalised correlation of the middle of one view within the other."""
    small = [cv2.resize(_grey(view), (WIDTH_PX, HEIGHT_PX), interpolation=cv2.INTER_AREA) for view in (first, second)]
    middle = small[0][HEIGHT_PX // 12 : -HEIGHT_PX // 12, WIDTH_PX // 6 : -WIDTH_PX // 6]
    if middle.std() < FLAT or small[1].std() < FLAT:
        return 0.0
    return float(cv2.matchTemplate(small[1], middle, cv2.TM_CCOEFF_NORMED).max())


def _grey(raw: Raw) -> Raw:
    grey = raw if raw.ndim == 2 else cv2.cvtColor(raw, cv2.COLOR_BGR2GRAY)
    return np.ascontiguousarray(grey)
