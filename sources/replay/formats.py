"""The table of recording formats, and which of them a path holds."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from statistics import median

from pipeline.errors import InputError
from sources.replay import caliscope, depthai_files, euroc, files, folders, halves, kitti, own, tumvi, videos
from sources.replay.messages import recording as messages
from sources.replay.streams import SAME_FPS, Recording, Request

EXPECTED = (
    "expected an MCAP file, a ROS 1 or ROS 2 bag, mav0/cam0/data.csv and mav0/cam1/data.csv (EuRoC), a TUM-VI, KITTI, "
    "caliscope or depthai recording, two or more folders of pictures, two or more videos, or one with both views"
)

MOST_NAMED = 5


@dataclass(frozen=True, slots=True)
class Format:
    """How a recording format is told by content, and read.

    matches:     whether the paths hold a recording of it with two or more cameras; cheap, decodes nothing.
    lone_camera: the only camera that a path holds in this format, in words, or None.
    """

    matches: Callable[[Sequence[Path]], bool]
    lone_camera: Callable[[Path], str | None]
    read: Callable[[Request], Recording]


FORMATS: Mapping[str, Format] = {
    "syncwatch": Format(own.matches, own.lone_camera, own.read),
    "mcap": Format(messages.is_messages_in_mcap, messages.no_lone_camera, messages.read),
    "rosbag1": Format(messages.is_rosbag1, messages.no_lone_camera, messages.read),
    "rosbag2": Format(messages.is_rosbag2, messages.no_lone_camera, messages.read),
    "euroc": Format(euroc.matches, euroc.lone_camera, euroc.read),
    "tumvi": Format(tumvi.matches, tumvi.lone_camera, tumvi.read),
    "kitti": Format(kitti.matches, kitti.lone_camera, kitti.read),
    "caliscope": Format(caliscope.matches, caliscope.lone_camera, caliscope.read),
    "depthai": Format(depthai_files.matches, depthai_files.lone_camera, depthai_files.read),
    "folders": Format(folders.matches, folders.lone_camera, folders.read),
    "videos": Format(videos.matches, videos.lone_camera, videos.read),
    "halves": Format(halves.matches, halves.lone_camera, halves.read),
}
"""In the order in which they are tried."""


def recognise(paths: Sequence[Path], wanted: str = "auto") -> str:
    """The name of the format that `paths` hold: one recording, or one stream a camera. Decodes nothing.

    Raises InputError that says what was found instead.
    """
    for path in paths:
        if not path.exists():
            raise InputError(f"no such file or folder: {path}")
    tried = FORMATS if wanted == "auto" else {wanted: FORMATS[wanted]}
    for name, recording_format in tried.items():
        if recording_format.matches(paths):
            return name
    if wanted != "auto" and any(other.matches(paths) for other in FORMATS.values()):
        found = next(name for name, other in FORMATS.items() if other.matches(paths))
        raise InputError(f"{paths[0]}: not in the format '{wanted}': it looks like '{found}'")
    raise _not_several(paths) if len(paths) > 1 else _not_a_recording(paths[0])


def read_recording(request: Request) -> Recording:
    """Reads what is cheap to know of a recording: its streams, but no picture. Raises InputError."""
    try:
        return _read(request)
    except OSError as error:
        raise files.unreadable(Path(error.filename or request.paths[0]), error) from error


def _read(request: Request) -> Recording:
    settings = request.settings
    told = settings.layout != "auto" and settings.format in {"auto", "halves"}  # then nothing has to be recognised
    name = "halves" if told else recognise(request.paths, settings.format)
    return _of_one_rate(FORMATS[name].read(request))


def _of_one_rate(recording: Recording) -> Recording:
    """Rates read off timestamps differ a little by chance: cameras of nearly the same rate have the same."""
    rates = [stream.fps for stream in recording.streams]
    if max(rates) > min(rates) * (1 + SAME_FPS):
        return recording
    return replace(recording, streams=tuple(replace(stream, fps=median(rates)) for stream in recording.streams))


def _not_a_recording(path: Path) -> InputError:
    """What is wrong with a path that is in none of the formats. Raises InputError as well."""
    if path.is_dir() and files.is_empty(path):
        return InputError(f"{path} is empty: {EXPECTED}")
    if files.is_video(path):
        videos.opened(path).release()  # raises InputError for a file that is only called a video
    for recording_format in FORMATS.values():
        lone = recording_format.lone_camera(path)
        if lone is not None:
            return InputError(
                f"{path}: one camera only ({lone}): two or more are needed; "
                "give the folder that holds all cameras, or one path a camera"
            )
    if files.is_picture(path):
        return InputError(f"{path}: a single picture: {EXPECTED}")
    if path.is_file() and path.stat().st_size == 0:
        return InputError(f"{path} is empty (0 bytes): {EXPECTED}")
    inside = [one.name for one in sorted(path.iterdir()) if messages.is_container(one)] if path.is_dir() else []
    if inside:
        return InputError(f"{path}: a folder with {', '.join(inside[:MOST_NAMED])} in it: name the file that is meant")
    return InputError(f"{path}: no recording that is known: {EXPECTED}")


def _not_several(paths: Sequence[Path]) -> InputError:
    a_folder = next((path for path in paths if path.is_dir()), None)
    a_file = next((path for path in paths if not path.is_dir()), None)
    if a_folder is not None and a_file is not None:
        return InputError(
            f"{a_folder} is a folder and {a_file} is a file: "
            "several paths are all folders of pictures, or all videos, one a camera"
        )
    odd = next(path for path in paths if not files.is_video(path))
    return InputError(f"{odd}: not a video: expected one of {', '.join(files.VIDEO_SUFFIXES)}")
