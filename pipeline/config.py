"""What a configuration may say, apart from what each kind of source, fault, detector and sink adds."""

from __future__ import annotations

import re
from typing import Any

from pydantic import Field, field_validator

from pipeline.align import AlignSettings
from pipeline.buffer import BufferSettings
from pipeline.frame import CAMERA_NAME
from pipeline.judge import JudgeSettings
from pipeline.settings import Settings

RIG_NAME = re.compile(r"(?!@)[^/*$#?\s]+")
"""What may stand between two slashes of a key that others subscribe to."""


class PairSettings(Settings):
    """Two cameras to compare. expected_offset_ms: how much later the second is triggered on purpose."""

    pair: str
    expected_offset_ms: float = Field(default=0.0, ge=-1e9, le=1e9)

    @field_validator("pair")
    @classmethod
    def _two_names(cls, value: str) -> str:
        names = value.split("-")
        if len(names) != 2 or not all(CAMERA_NAME.fullmatch(name) for name in names) or names[0] == names[1]:
            raise ValueError(f"'{value}' is not a pair: write two camera names with a dash, e.g. left-right")
        return value


class Config(Settings):
    """The whole file. `source`, `faults`, `detectors` and `sinks` are checked by the kind they name.

    rig: the name under which everything is published.
    source: where frames come from.
    faults: field failures to inject, in order.
    pairs: which cameras are compared (default: the first with each other one).
    align: pair frames anew that come whole frames apart, and emit the pairs (default: off).
    detectors, sinks: by name; `type` defaults to the name.
    seed: of everything random: rendering and faults.
    """

    rig: str = "bench"
    seed: int = 0
    source: Any
    faults: tuple[Any, ...] = ()
    pairs: tuple[PairSettings, ...] | None = Field(default=None, min_length=1)
    buffer: BufferSettings = BufferSettings()
    detectors: dict[str, Any] = Field(min_length=1)
    judge: JudgeSettings = JudgeSettings()
    align: AlignSettings | None = None
    sinks: dict[str, Any] = Field(default={})

    @field_validator("rig")
    @classmethod
    def _publishable(cls, value: str) -> str:
        if not RIG_NAME.fullmatch(value):
            raise ValueError(f"'{value}' cannot be a rig's name: no spaces, none of / * $ # ?, no @ first")
        return value

    @field_validator("pairs")
    @classmethod
    def _once_each(cls, value: tuple[PairSettings, ...] | None) -> tuple[PairSettings, ...] | None:
        names = [entry.pair for entry in value or ()]
        for name in names:
            if names.count(name) > 1:
                raise ValueError(f"'{name}' is given twice")
        return value

    @field_validator("pairs", mode="before")
    @classmethod
    def _short_form(cls, value: Any) -> Any:
        """`- left-right` is short for `- {pair: left-right}`."""
        if isinstance(value, list):
            return [{"pair": item} if isinstance(item, str) else item for item in value]
        return value
