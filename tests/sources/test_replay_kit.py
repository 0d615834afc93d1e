"""Small recordings for the replay tests, whose every picture tells its own number, and the proof that it does."""

from __future__ import annotations

import logging
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from pipeline.frame import Frame
from sources.replay.settings import ReplaySettings
from sources.replay.source import ReplaySource

LOGGER = "syncwatch.sources.replay"
SIZE = (48, 32)
DARKEST, STEP = 24, 8


def picture(number: int, size: tuple[int, int] = SIZE) -> Any:
    """Plain grey, brighter with its number, so that compression keeps it."""
    return np.full((size[1], size[0]), DARKEST + STEP * number, np.uint8)


def shown(frame: Frame) -> int:
    """The number that the picture of `frame` tells."""
    return round((float(frame.image.mean()) - DARKEST) / STEP)


def write_folder(folder: Path, files: Mapping[str, Any] | Iterable[str]) -> Path:
    """Writes pictures by file name; names alone get pictures 0, 1, 2, ... in the order given."""
    folder.mkdir(parents=True)
    if not isinstance(files, Mapping):
        files = {name: picture(number) for number, name in enumerate(files)}
    for name, image in files.items():
        assert cv2.imwrite(str(folder / name), image)
    return folder


def write_folders(root: Path, count: int = 3, cameras: Sequence[str] = ("left", "right")) -> Path:
    for camera in cameras:
        write_folder(root / camera, [f"{number:06}.png" for number in range(count)])
    return root


def write_euroc_camera(camera: Path, stamps_ns: Sequence[int], lines: str | bytes | None = None) -> None:
    write_folder(camera / "data", [f"{stamp}.png" for stamp in stamps_ns])
    if lines is None:
        lines = "#timestamp [ns],filename\n" + "".join(f"{stamp},{stamp}.png\n" for stamp in stamps_ns)
    (camera / "data.csv").write_bytes(lines.encode() if isinstance(lines, str) else lines)


def write_euroc(root: Path, *stamps_ns: Sequence[int]) -> Path:
    for number, stamps in enumerate(stamps_ns):
        write_euroc_camera(root / "mav0" / f"cam{number}", stamps)
    return root


def write_video(path: Path, count: int = 5, fps: float = 20.0, size: tuple[int, int] = SIZE) -> Path:
    path.parent.mkdir(parents=True, exist_ok=True)
    code = cv2.VideoWriter.fourcc(*("MJPG" if path.suffix.lower() == ".avi" else "mp4v"))
    writer = cv2.VideoWriter(str(path), cv2.CAP_FFMPEG, code, fps, size)
    assert writer.isOpened()
    for number in range(count):
        writer.write(cv2.cvtColor(picture(number, size), cv2.COLOR_GRAY2BGR))
    writer.release()
    return path


def opened(path: Path | str | Sequence[Path], **settings: Any) -> ReplaySource:
    paths = [str(path)] if isinstance(path, (Path, str)) else [str(one) for one in path]
    source = ReplaySource(ReplaySettings(path=paths, **settings), base=Path("/nonexistent"))
    source.open()
    return source


def replayed(path: Path | str | Sequence[Path], **settings: Any) -> list[Frame]:
    source = opened(path, **settings)
    frames = list(source.frames())
    source.close()
    return frames


def of(frames: Iterable[Frame], camera: str) -> list[Frame]:
    return [frame for frame in frames if frame.camera == camera]


def said(caplog: pytest.LogCaptureFixture, level: int = logging.WARNING) -> list[str]:
    return [text for name, number, text in caplog.record_tuples if name == LOGGER and number == level]


@pytest.mark.parametrize("name", ["left.avi", "left.mp4"])
def test_a_video_of_the_kit_keeps_the_numbers_of_its_pictures(tmp_path, name):
    write_video(tmp_path / name, count=12)
    write_video(tmp_path / f"right{Path(name).suffix}", count=12)

    assert [shown(frame) for frame in of(replayed(tmp_path), "left")] == list(range(12))
