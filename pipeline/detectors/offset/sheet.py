"""The text of a calibration file as keys and values that know their lines: YAML, JSON, OpenCV's XML, KITTI's rows."""

from __future__ import annotations

import re
import xml.etree.ElementTree as ET
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np

from pipeline.configtext.document import ConfigError, load_text
from pipeline.configtext.report import dotted, show
from pipeline.detectors.offset.arrays import Floats
from pipeline.errors import InputError

MOST_BYTES = 1_000_000
"""A calibration of ten cameras takes ten thousand; whoever gives a picture or a recording learns it at once."""

_KITTI_ROW = re.compile(r"(P(?:\d|_rect_\d\d))\s*:\s*[-+.\d]")
_BARE_ROW = re.compile(r"\s*(?:[-+.\deE]+\s+){11}[-+.\deE]+\s*")

Key: TypeAlias = tuple[str | int, ...]


@dataclass(frozen=True, slots=True)
class Sheet:
    """data: what the file holds, by key. lines: of keys, from 1, where known. rows: it is one of KITTI's."""

    label: str
    data: Mapping[str, Any]
    lines: Mapping[Key, int] = field(default_factory=dict)
    rows: bool = False

    def error(self, key: Key, sentence: str) -> InputError:
        """One line: file, line if known, key, what is wrong."""
        line = self.lines.get(key)
        where = self.label if line is None else f"{self.label}:{line}"
        return InputError(": ".join(part for part in (where, dotted(key), sentence) if part))

    def value(self, key: Key) -> Any:
        at: Any = self.data
        for depth, part in enumerate(key):
            if not isinstance(at, dict) or part not in at:
                raise self.error(key[:depth], f"'{part}' is missing")
            at = at[part]
        return at

    def text(self, key: Key, default: str | None = None) -> str:
        if default is not None and key[-1] not in self.value(key[:-1]):
            return default
        value = self.value(key)
        if not isinstance(value, str):
            raise self.error(key, f"{show(value)} is no text")
        return value

    def numbers(self, key: Key, counts: tuple[int, ...], what: str) -> Floats:
        """The finite numbers of a list, a list of lists or one of OpenCV's matrices, row by row."""
        value = self.value(key)
        allowed = " or ".join(map(str, counts))
        if isinstance(value, dict):
            value = self._data(key, value)
        flat = list(_flat(value.split() if isinstance(value, str) else value))
        numbers = [self._number(key, item) for item in flat]
        if len(numbers) not in counts:
            raise self.error(key, f"{len(numbers)} numbers, {allowed} are needed: {what}")
        return np.array(numbers, np.float64)

    def _data(self, key: Key, matrix: dict[str, Any]) -> Any:
        if "data" not in matrix:
            raise self.error(key, "a mapping without data; a matrix has rows, cols and data")
        data = matrix["data"].split() if isinstance(matrix["data"], str) else matrix["data"]
        rows, columns = (matrix.get(name) for name in ("rows", "cols"))
        if rows is not None and columns is not None:
            size = self._number((*key, "rows"), rows) * self._number((*key, "cols"), columns)
            have = len(list(_flat(data)))
            if size != have:
                raise self.error(key, f"{show(rows)} rows and {show(columns)} columns, but {have} numbers")
        return data

    def _number(self, key: Key, item: Any) -> float:
        try:
            number = float("x" if isinstance(item, bool) else item)
        except (TypeError, ValueError, OverflowError):
            raise self.error(key, f"{show(item)} is not a number") from None
        if not np.isfinite(number) or abs(number) > 1e12:
            raise self.error(key, f"{show(item)} is not a finite number that a calibration can hold")
        return number


def read_sheet(path: Path) -> Sheet:
    """Raises InputError for what cannot be read, or is none of the four kinds of text."""
    label = str(path)
    text = _read(path, label)
    lines = text.splitlines()
    if any(_KITTI_ROW.match(line) for line in lines):
        return _rows(label, lines)
    filled = [line for line in lines if line.strip()]
    if len(filled) > 1 and all(_BARE_ROW.fullmatch(line) for line in filled):
        return _rows(label, [f"P{n}: {line}" for n, line in enumerate(lines)])
    if text.lstrip().startswith("<"):
        return _xml(label, text)
    return _yaml(label, text)


def _read(path: Path, label: str) -> str:
    try:
        with path.open("rb") as file:
            raw = file.read(MOST_BYTES + 1)
    except (OSError, ValueError) as error:
        reason = getattr(error, "strerror", None) or error
        raise InputError(f"calibration {label} cannot be read: {reason}") from None
    if len(raw) > MOST_BYTES:
        raise InputError(f"calibration {label} is larger than {MOST_BYTES // 1000} kB: that is no calibration")
    try:
        return raw.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        line = raw.count(b"\n", 0, error.start) + 1
        raise InputError(f"calibration {label} is not a text (byte 0x{raw[error.start]:02x} in line {line})") from None


def _rows(label: str, lines: list[str]) -> Sheet:
    data: dict[str, Any] = {}
    places: dict[Key, int] = {}
    for number, line in enumerate(lines, 1):
        key, colon, values = line.partition(":")
        key = key.strip()
        if not colon or not re.fullmatch(r"P\d|[PS]_rect_\d\d", key):
            continue
        places[key,] = number
        if key in data:
            raise Sheet(label, data, places).error((key,), "given twice")
        data[key] = values.split()
    return Sheet(label, data, places, rows=True)


def _yaml(label: str, text: str) -> Sheet:
    """OpenCV's dialect begins with %YAML:1.0 and tags its matrices; blanks in their place keep lines and columns."""
    text = re.sub(r"\A%YAML:?[ ]?1\.\d", lambda match: "#" * len(match[0]), text)
    text = re.sub(r"!!opencv-(?:nd-)?matrix", lambda match: " " * len(match[0]), text)
    try:
        document = load_text(text.replace("${", "$${"), label, {}) if text.strip() else None
    except ConfigError as error:
        raise InputError(error.problems[0].splitlines()[0]) from None
    if document is None:
        return Sheet(label, {})
    places: dict[Key, int] = {}
    for key, value in document.data.items():
        for path in [(key,), *((key, inner) for inner in (value if isinstance(value, dict) else ()))]:
            places[path] = document.place(path)[0].line
    return Sheet(label, document.data, places)


def _xml(label: str, text: str) -> Sheet:
    if "<!" in text.replace("<!--", ""):
        raise InputError(f"{label}: an XML document type or CDATA has no place in a calibration")
    try:
        root = ET.fromstring(text)  # noqa: S314 - a document type, which is what can hurt, is refused above
    except (ET.ParseError, ValueError) as error:
        raise InputError(f"{label}: not valid XML: {error}") from None
    if root.tag != "opencv_storage":
        raise InputError(f"{label}: XML that begins with <{root.tag}>: of XML only OpenCV's <opencv_storage> is read")
    return Sheet(label, {child.tag: _element(child) for child in root})


def _element(element: ET.Element) -> Any:
    inner = [child for child in element if child.tag != "_"]
    if inner:
        return {child.tag: _element(child) for child in inner}
    if len(element):
        return [_element(child) for child in element]
    return (element.text or "").strip()


def _flat(value: Any) -> Any:
    if isinstance(value, list):
        for item in value:
            yield from _flat(item)
    else:
        yield value
