"""Reads picture files and makes 8-bit pictures of one size a camera out of whatever a decoder returns."""

from __future__ import annotations

import zlib
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import cv2
import numpy as np

from pipeline.errors import InputError
from pipeline.frame import Picture
from sources.replay.files import unreadable
from sources.replay.notices import Notices
from sources.replay.streams import Raw

PNG_START = b"\x89PNG\r\n\x1a\n"
JPEG_START, JPEG_END = b"\xff\xd8", b"\xff\xd9"
JPEG_MARKER, JPEG_SCAN = 0xFF, 0xDA
BIT_DEPTHS = (10, 12, 14, 16)


class PictureMaker:
    """Makes the pictures of one camera: uint8, grey or blue-green-red, all of the first one's size."""

    def __init__(self, camera: str, notices: Notices) -> None:
        self._camera = camera
        self._notices = notices
        self._size: tuple[int, int] | None = None
        self._bits: int | None = None

    def make(self, raw: Raw, where: str) -> Picture:
        """Raises InputError for a picture that cannot be compared with the ones before it."""
        self._check_size(raw, where)
        flat = raw[:, :, 0] if raw.ndim == 3 and raw.shape[2] == 1 else raw
        if flat.ndim == 3:
            if flat.shape[2] not in {3, 4}:
                raise InputError(f"{where}: {flat.shape[2]} channels: expected grey or colour pictures")
            flat = flat[:, :, :3]
            self._notices.info(f"{self._camera}: colour pictures, judged as grey")
        if flat.dtype == np.uint16:
            flat = self._scaled(flat)
        if flat.dtype != np.uint8:
            raise InputError(f"{where}: values of type {flat.dtype}: expected 8 or 16 bits; convert the pictures first")
        return np.ascontiguousarray(flat, np.uint8)

    def _check_size(self, raw: Raw, where: str) -> None:
        size = (raw.shape[1], raw.shape[0])
        if self._size is None:
            self._size = size
        if size != self._size:
            (width, height), (usual_width, usual_height) = size, self._size
            raise InputError(
                f"{where}: {width}x{height} pixels, but the pictures of {self._camera} before it have "
                f"{usual_width}x{usual_height}: one camera keeps one size; split the recording there"
            )

    def _scaled(self, raw: Raw) -> Raw:
        brightest = int(raw.max(initial=0))
        if self._bits is None or brightest >= 1 << self._bits:
            again = "" if self._bits is None else " from here on, brighter than before"
            self._bits = next(bits for bits in BIT_DEPTHS if brightest < 1 << bits)
            self._notices.warning(f"{self._camera}: 16-bit pictures, scaled to 8 bits from {self._bits}{again}")
        shifted: Raw = np.right_shift(raw, self._bits - 8)
        return shifted.astype(np.uint8)


def read_picture(path: Path) -> Raw:
    """The picture in `path` as it is stored: its depth, its channels, not turned. Raises InputError naming the file."""
    try:
        data = path.read_bytes()
    except OSError as error:
        raise unreadable(path, error) from error
    if (wrong := damage(data)) is not None:
        raise InputError(f"{path}: {wrong}: replace the picture or remove it (a missing one is a hole)")
    with quiet():
        try:
            raw = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_UNCHANGED)
        except cv2.error:  # e.g. more pixels than OpenCV is willing to read
            raw = None
    if raw is None:
        raise InputError(f"{path}: cannot be decoded as a picture: replace it or remove it (a missing one is a hole)")
    return raw


@contextmanager
def quiet() -> Iterator[None]:
    """Keeps OpenCV's own log off stderr meanwhile: what it says about bad input, we say in one sentence."""
    level = cv2.utils.logging.setLogLevel(cv2.utils.logging.LOG_LEVEL_SILENT)
    try:
        yield
    finally:
        cv2.utils.logging.setLogLevel(level)


def damage(data: bytes) -> str | None:
    """What is wrong with a picture file as far as its bytes tell; OpenCV decodes half a picture without a word."""
    if not data:
        return "is empty (0 bytes)"
    if data.startswith(PNG_START):
        return _png_damage(data)
    if data.startswith(JPEG_START) and not _jpeg_ends(data):
        return "is truncated (a JPEG without its end marker)"
    return None


def _png_damage(data: bytes) -> str | None:
    at = len(PNG_START)
    while (end := at + 12 + int.from_bytes(data[at : at + 4], "big")) <= len(data):
        kind = data[at + 4 : at + 8]
        critical = kind[:1].isupper()
        if critical and zlib.crc32(data[at + 4 : end - 4]) != int.from_bytes(data[end - 4 : end], "big"):
            return f"is damaged (wrong checksum in a PNG's {kind.decode('ascii', 'replace')})"
        if kind == b"IEND":
            return None
        at = end
    return "is truncated (a PNG without its IEND)"


def _jpeg_ends(data: bytes) -> bool:
    """Whether the picture ends; the end of a thumbnail within the header does not count."""
    at = len(JPEG_START)
    while at + 4 <= len(data) and data[at] == JPEG_MARKER and data[at + 1] != JPEG_SCAN:
        padded = data[at + 1] == JPEG_MARKER
        at += 1 if padded else 2 + int.from_bytes(data[at + 2 : at + 4], "big")
    return data.find(JPEG_END, at) >= 0
