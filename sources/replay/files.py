"""Looks into folders: which files are pictures or videos, in natural order, hidden ones left out."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator
from pathlib import Path

from pipeline.errors import InputError
from sources.replay.names import natural, natural_path

PICTURE_SUFFIXES = ("png", "jpg", "jpeg", "bmp", "tif", "tiff", "pgm", "ppm", "webp")
VIDEO_SUFFIXES = ("mp4", "avi", "mkv", "mov", "webm", "m4v", "mpg", "mpeg", "wmv")


def is_video(path: Path) -> bool:
    return _suffix(path.name) in VIDEO_SUFFIXES and path.is_file()


def is_picture(path: Path) -> bool:
    return _suffix(path.name) in PICTURE_SUFFIXES and path.is_file()


def picture_names(folder: Path) -> list[str]:
    """The names of the pictures right in `folder`."""
    return sorted(_files(folder, PICTURE_SUFFIXES), key=natural)


def has_pictures(folder: Path) -> bool:
    return next(_files(folder, PICTURE_SUFFIXES), None) is not None


def videos(folder: Path) -> list[Path]:
    return [folder / name for name in sorted(_files(folder, VIDEO_SUFFIXES), key=natural)]


def folders(folder: Path) -> list[Path]:
    return sorted((Path(entry.path) for entry in _visible(folder) if _is(entry.is_dir)), key=natural_path)


def is_empty(folder: Path) -> bool:
    return next(_visible(folder), None) is None


def unreadable(path: Path, error: OSError) -> InputError:
    return InputError(f"{path}: cannot be read: {error.strerror or error}")


def _files(folder: Path, suffixes: tuple[str, ...]) -> Iterator[str]:
    return (entry.name for entry in _visible(folder) if _suffix(entry.name) in suffixes and _is(entry.is_file))


def _visible(folder: Path) -> Iterator[os.DirEntry[str]]:
    try:
        with os.scandir(folder) as entries:
            for entry in entries:
                if not entry.name.startswith("."):
                    yield entry
    except OSError as error:
        raise unreadable(folder, error) from error


def _is(kind: Callable[[], bool]) -> bool:
    """False for a symbolic link that leads to itself, and for what must not be looked at."""
    try:
        return kind()
    except OSError:
        return False


def _suffix(name: str) -> str:
    return name.rpartition(".")[2].lower() if "." in name else ""
