"""Saves what was learned of a rig's geometry to a file that people can read, and loads it."""

from __future__ import annotations

import os
import tempfile
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import asdict, dataclass
from datetime import datetime, timezone
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
import yaml
from pydantic import Field, ValidationError, field_validator

from pipeline.configtext.document import ConfigError, load_text, problems_from
from pipeline.detectors.offset.arrays import Floats
from pipeline.detectors.offset.geometry import TERMS
from pipeline.errors import InputError, RunError
from pipeline.frame import NS_PER_S
from pipeline.settings import Settings

SCHEMA = "syncwatch.rig.v1"
NAMES = ("one", "u", "v", "d", "uv", "vv", "vd", "vrr")
"""The terms of `geometry.design`, in its order."""

ROUNDING = 1e-6
"""Correlations may be beside what they should by this: sums of thousands of windows leave less."""

MOST_BYTES = 1_000_000
"""Two hundred pairs' worth."""

_HEADER = "# What syncwatch learned of a rig's geometry while it ran in sync. Delete this file to let it start anew.\n"


@dataclass(frozen=True, slots=True, eq=False)
class SavedPair:
    """What is remembered of a pair of cameras.

    size: width and height of the working pictures, px. terms: 8 of `geometry.design`, picture widths. information:
    8 x 8, their inverse covariance. windows: how many were learned. floor_frames: the systematic error, None if not
    known. saved_at_ns: Unix time. version: of the program that saved it.

    Raises ValueError, in words, for what no rig can have taught.
    """

    size: tuple[int, int]
    terms: Floats
    information: Floats
    windows: int
    floor_frames: float | None
    saved_at_ns: int
    version: str

    def __post_init__(self) -> None:
        if min(self.size) < 1:
            raise ValueError(f"a picture of {self.size[0]} x {self.size[1]} px; both must be at least 1")
        if self.windows < 0:
            raise ValueError(f"{self.windows} windows learned; there cannot be less than 0")
        if self.floor_frames is not None and not 0 <= self.floor_frames < np.inf:
            raise ValueError(f"a systematic error of {self.floor_frames} frames; it must be 0 or more, and finite")
        if self.terms.shape != (TERMS,) or self.information.shape != (TERMS, TERMS):
            raise ValueError(f"terms {self.terms.shape}, information {self.information.shape}; needed are 8 and 8 x 8")
        if not (np.isfinite(self.terms).all() and np.isfinite(self.information).all()):
            raise ValueError("terms or information hold a number that is not finite")
        _check_information(self.information)

    def suits(self, size: tuple[int, int]) -> bool:
        """Whether pictures of `size` show the same, perhaps scaled: aspect ratios within 1 % (rounding of heights)."""
        return abs(self.size[0] * size[1] / (self.size[1] * size[0]) - 1) <= 0.01


def save_rig(path: Path, pairs: Mapping[str, SavedPair]) -> None:
    """Writes all pairs, by name; a reader sees the old file or the new one, never a part.

    Raises RunError, one line, when the file cannot be written; the old one then remains.
    """
    document = {"schema": SCHEMA, "pairs": {name: _written(pair) for name, pair in pairs.items()}}
    text = _HEADER + yaml.safe_dump(document, sort_keys=False, default_flow_style=None, width=1000, explicit_end=True)
    path = path.resolve()  # the file behind a symbolic link is replaced, not the link
    written: Path | None = None
    try:
        with tempfile.NamedTemporaryFile(
            "w", encoding="utf-8", dir=path.parent, prefix=f".{path.name}.", delete=False
        ) as file:
            written = Path(file.name)
            file.write(text)
            file.flush()
            os.fsync(file.fileno())
        written.chmod(path.stat().st_mode & 0o777 if path.exists() else 0o644)
        written.replace(path)  # fails for a directory
    except OSError as error:
        if written is not None:
            with suppress(OSError):
                written.unlink()
        raise RunError(f"the rig cannot be saved to {path}: {error.strerror or error}") from None


def check_rig_path(path: Path) -> None:
    """Raises InputError if `save_rig` could not write there: better known before a day's run than after it."""
    folder = path.resolve().parent
    if path.is_dir():
        raise InputError(f"rig file {path} is a directory: give the path of a file in it")
    if not folder.is_dir():
        raise InputError(f"rig file {path}: there is no folder {folder}: create it")
    if not os.access(folder, os.W_OK | os.X_OK):
        raise InputError(f"rig file {path}: the folder {folder} may not be written to")


def load_rig_if_any(path: Path) -> Mapping[str, SavedPair]:
    """As `load_rig`; empty where there is no file yet."""
    return load_rig(path) if os.path.lexists(path) else {}


def load_rig(path: Path) -> Mapping[str, SavedPair]:
    """The pairs by name. Raises InputError, one line, for a file that is missing, broken or of another schema."""
    label = str(path)
    text = _read(path, label)
    try:
        document = load_text(text.replace("${", "$${"), label, {})
        if (found := document.data.get("schema")) != SCHEMA:
            said = f"schema '{found}'" if found else "no schema"
            raise InputError(f"rig file {label}: {said}, {SCHEMA} is needed: delete it to let the rig be learned anew")
        if not text.rstrip().endswith("\n..."):
            raise InputError(
                f"rig file {label} was cut: its last line is not '...': delete it to let the rig be learned anew"
            )
        try:
            rig = _RigText.model_validate(document.data)
        except ValidationError as error:
            raise document.error(problems_from(error, (), _RigText)) from None
    except ConfigError as error:
        raise InputError(error.problems[0].splitlines()[0]) from None
    pairs = {}
    for name, pair in rig.pairs.items():
        try:
            pairs[name] = pair.record()
        except ValueError as error:
            line = document.place(("pairs", name))[0].line
            raise InputError(f"{label}:{line}: pairs.{name}: {error} - delete it to let it be learned anew") from None
    return pairs


def _read(path: Path, label: str) -> str:
    try:
        with path.open("rb") as file:
            raw = file.read(MOST_BYTES + 1)
    except (OSError, ValueError) as error:
        raise InputError(f"rig file {label} cannot be read: {getattr(error, 'strerror', None) or error}") from None
    if len(raw) > MOST_BYTES:
        raise InputError(f"rig file {label} is larger than {MOST_BYTES // 1000} kB: it is no rig file")
    try:
        return raw.decode("utf-8")
    except UnicodeDecodeError as error:
        raise InputError(f"rig file {label} is not a text (byte 0x{raw[error.start]:02x} at {error.start})") from None


Row = Annotated[list[float], Field(min_length=TERMS, max_length=TERMS)]


class _PairText(Settings):
    size: Annotated[list[int], Field(min_length=2, max_length=2)]
    windows: int
    floor_frames: float | None
    saved_at_ns: int
    saved_at: str
    version: str
    terms: dict[str, float]
    information: Annotated[list[Row], Field(min_length=TERMS, max_length=TERMS)]

    @field_validator("terms")
    @classmethod
    def _all_terms(cls, terms: dict[str, float]) -> dict[str, float]:
        if set(terms) != set(NAMES):
            raise ValueError(f"the terms must be {', '.join(NAMES)}")
        return terms

    def record(self) -> SavedPair:
        return SavedPair(
            size=(self.size[0], self.size[1]),
            terms=np.array([self.terms[name] for name in NAMES], np.float64),
            information=np.array(self.information, np.float64),
            windows=self.windows,
            floor_frames=self.floor_frames,
            saved_at_ns=self.saved_at_ns,
            version=self.version,
        )


class _RigText(Settings):
    schema_: Literal["syncwatch.rig.v1"] = Field(alias="schema")
    pairs: dict[Annotated[str, Field(pattern="^[a-z0-9_]+-[a-z0-9_]+$")], _PairText]


def _written(pair: SavedPair) -> dict[str, Any]:
    moment = datetime.fromtimestamp(pair.saved_at_ns // NS_PER_S, timezone.utc)
    return {
        "saved_at": moment.strftime("%Y-%m-%d %H:%M:%S UTC"),
        **asdict(pair),
        "size": list(pair.size),
        "terms": dict(zip(NAMES, pair.terms.tolist(), strict=True)),
        "information": pair.information.tolist(),
    }


def _check_information(information: Floats) -> None:
    """Positive semi-definite, each term in units of its own standard deviation: the terms' own differ by thousands."""
    diagonal = np.diag(information)
    unit = np.sqrt(np.where(diagonal > 0, diagonal, 1.0))
    scaled = information / unit[:, None] / unit
    if float(np.abs(scaled - scaled.T).max()) > ROUNDING:
        raise ValueError("information is not symmetric")
    if float(np.linalg.eigvalsh(scaled)[0]) < -ROUNDING:
        raise ValueError("information is not positive semi-definite: some combination of terms has less than none")
