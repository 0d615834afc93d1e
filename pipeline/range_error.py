"""What an offset does to a range measured by stereo."""

from __future__ import annotations

from pipeline.settings import Settings
from pipeline.verdict import RangeError


class RangeSettings(Settings):
    """Provisional."""


def range_error(settings: RangeSettings, offset_ns: int) -> RangeError:
    raise NotImplementedError
