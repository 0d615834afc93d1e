"""What is recorded, where to, and how much of it."""

from __future__ import annotations

import re
from datetime import datetime, timezone
from pathlib import Path
from typing import Annotated, Literal

from pydantic import Field, field_validator

from pipeline.frame import NS_PER_S
from pipeline.mcap.frames import Pictures
from pipeline.mcap.writer import CHUNK_BYTES
from pipeline.settings import Settings

MIB = 1024 * 1024
PLACEHOLDERS = ("{rig}", "{time}")


class McapSettings(Settings):
    """A recording.

    path:            the file; {rig} stands for the rig's name, {time} for when the run began (UTC).
    overwrite:       replace a file that is there.
    pictures:        raw and png lose nothing, jpeg is small, none records only what is told of frames.
    around_events_s: record only what is within so many seconds of an event, before it begins and after it ends.
    ring_bytes:      how much is held in memory for that; of more, the oldest is given up.
    chunk_bytes:     size of the pieces in which the file is written, before compression; a second ends one as well.
    max_bytes:       the recording is closed before the file grows larger.
    min_free_bytes:  it is closed while this much of the disk is still free.
    """

    type: Literal["mcap"] = "mcap"
    path: Annotated[str, Field(min_length=1)] = "{rig}-{time}.mcap"
    overwrite: bool = False
    pictures: Pictures = "raw"
    jpeg_quality: int = Field(default=90, ge=1, le=100)
    around_events_s: float | None = Field(default=None, gt=0, le=3600)
    ring_bytes: int = Field(default=256 * MIB, ge=MIB)
    chunk_bytes: int = Field(default=CHUNK_BYTES, ge=1024, le=64 * MIB)
    max_bytes: int | None = Field(default=None, ge=100_000)
    min_free_bytes: int = Field(default=256 * MIB, ge=0)

    @field_validator("path")
    @classmethod
    def _known_placeholders(cls, value: str) -> str:
        if value == "-":
            raise ValueError("a recording cannot go to standard output: name a file")
        unknown = [found for found in re.findall(r"\{[^{}]*\}", value) if found not in PLACEHOLDERS]
        if unknown:
            raise ValueError(f"unknown placeholder {unknown[0]}: {' and '.join(PLACEHOLDERS)} are possible")
        return value


def file_of(settings: McapSettings, base: Path, rig: str, wall_ns: int) -> Path:
    """The file to write. base: the folder that a relative path counts from."""
    began = datetime.fromtimestamp(wall_ns // NS_PER_S, timezone.utc)
    name = settings.path.replace("{rig}", rig).replace("{time}", began.strftime("%Y%m%dT%H%M%SZ"))
    return base / Path(name).expanduser()
