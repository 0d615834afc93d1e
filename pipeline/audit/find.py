"""Finds the recordings below a folder, and what looks like one but has one camera or cannot be read."""

from __future__ import annotations

import os
from collections import deque
from collections.abc import Collection, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

import cv2

from pipeline.errors import InputError
from pipeline.tally import ENOUGH
from sources.replay import files
from sources.replay.formats import FORMATS
from sources.replay.names import is_text, natural_path
from sources.replay.videos import opened

HALVES = "halves"
"""The format of a single video: such a recording is the video, not the folder that it lies in."""

IN_PLACE = {"folders", "videos"}
"""Formats whose lone camera lies right in a folder; others keep it, with more of it, in folders below."""

CONTAINERS = {".bag", ".db3", ".mcap"}
"""Files that are nothing else: one that is not recognised is damaged."""

NO_TEXT = "the name has bytes that are no UTF-8 text: rename it"

TWO_VIEWS = (1.0, 2.0)
"""Width by height of a picture at and beyond which it may hold two views."""


@dataclass(frozen=True, slots=True)
class Found:
    """A recording in a format, or what cannot be judged and why."""

    path: Path
    format: str | None
    trouble: str | None = None


def find(roots: Sequence[Path], skip: Collection[str] = ()) -> Iterator[Found]:
    """The topmost recordings at and below the roots, each once, in natural order; nothing is looked for inside of them.

    Hidden files and folders are left out. What symbolic links lead to comes last, unless it was met already.
    skip: real paths that are left out.
    """
    waiting = deque(_Place(root) for root in roots)
    links: deque[_Place] = deque()
    met = set(skip)
    taken: set[str] = set()
    while waiting or links:
        place = (waiting or links).popleft()
        real = os.path.realpath(place.path)
        if real in met or _inside(real, taken):
            continue
        met.add(real)
        try:
            found, below = _look(place)
        except InputError as error:
            found, below = Found(place.path, None, str(error)), []
        except OSError as error:
            found, below = Found(place.path, None, str(files.unreadable(place.path, error))), []
        if found is not None:
            if found.format is not None:
                taken.add(real)
            yield found
        links.extend(one for one in below if one.path.is_symlink())
        waiting.extendleft(one for one in reversed(below) if not one.path.is_symlink())


@dataclass(frozen=True, slots=True)
class _Place:
    """Where to look. told: its lone camera has been told of already, with a folder above it."""

    path: Path
    told: bool = False


def _inside(real: str, taken: Collection[str]) -> bool:
    return any(str(folder) in taken for folder in Path(real).parents)


def _look(place: _Place) -> tuple[Found | None, list[_Place]]:
    """What a place is, and where to look further."""
    path = place.path
    if not path.is_dir():
        return _file(path), []
    if not is_text(path):
        return Found(path, None, NO_TEXT), []
    name = _format(path)
    if name is not None and not _is_archive(path, name):
        return Found(path, name), []
    lone = None if place.told or name is not None else _lone_camera(path)
    if lone is None:
        return None, [_Place(one, place.told) for one in _visible(path)]
    below = [_Place(one, lone.below) for one in _visible(path) if one != lone.video]
    return Found(path, None, f"one camera only ({lone.words})"), below


def _file(path: Path) -> Found | None:
    if files.is_picture(path) or not path.is_file():
        return None
    if not is_text(path):
        return Found(path, None, NO_TEXT) if files.is_video(path) or path.suffix in CONTAINERS else None
    name = next((name for name, one in FORMATS.items() if one.matches([path])), None)
    if name is not None:
        return Found(path, name)
    if path.suffix in CONTAINERS:
        return Found(path, None, f"empty or damaged: no {path.suffix[1:]} file, as its name says")
    return None


def _format(folder: Path) -> str | None:
    """A folder below that cannot be looked into is no part of a recording: it is told when it is its turn."""
    for name, one in FORMATS.items():
        with suppress(InputError, OSError):
            if name != HALVES and one.matches([folder]):
                return name
    return None


def _is_archive(folder: Path, name: str) -> bool:
    """Whether what looks like one recording, a folder or a video a camera, rather holds several."""
    if name == "videos":
        return all(_has_two_views(video) for video in files.videos(folder))
    return name == "folders" and any(
        _is_recording_with_preview(one) for one in files.folders(folder) if files.has_pictures(one)
    )


def _is_recording_with_preview(folder: Path) -> bool:
    """Whether a folder with pictures is no camera: its pictures are few, and a recording lies beside them."""
    name = _format(folder)
    return name is not None and (name != "folders" or len(files.picture_names(folder)) < ENOUGH)


def _has_two_views(video: Path) -> bool:
    """Looks at the shape of its pictures first: comparing their halves takes longer."""
    try:
        capture = opened(video)
    except InputError:
        return False
    width, height = (capture.get(what) for what in (cv2.CAP_PROP_FRAME_WIDTH, cv2.CAP_PROP_FRAME_HEIGHT))
    capture.release()
    narrow, wide = TWO_VIEWS
    return not narrow * height < width < wide * height and FORMATS[HALVES].matches([video])


@dataclass(frozen=True, slots=True)
class _LoneCamera:
    """below: its pictures lie in folders below. video: it is this video."""

    words: str
    below: bool
    video: Path | None


def _lone_camera(folder: Path) -> _LoneCamera | None:
    """The only camera that a folder holds. A few pictures are no recording, and a video with two views is one."""
    for name, one in FORMATS.items():
        words = None
        with suppress(InputError, OSError):
            words = one.lone_camera(folder)
        if words is None or (name == "folders" and len(files.picture_names(folder)) < ENOUGH):
            continue
        video = files.videos(folder)[0] if name == "videos" else None
        if video is None or not FORMATS[HALVES].matches([video]):
            return _LoneCamera(words, name not in IN_PLACE, video)
    return None


def _visible(folder: Path) -> list[Path]:
    try:
        names = [entry.name for entry in os.scandir(folder) if not entry.name.startswith(".")]
    except OSError as error:
        raise files.unreadable(folder, error) from error
    return sorted((folder / name for name in names), key=natural_path)
