"""syncwatch: were the frames of this rig really taken at the same moment?

What other programs may import: `Monitor`, which watches frames that they take themselves; the records a source delivers
and a sink receives, the Protocols both keep, and the base of their settings.
"""

from typing import TYPE_CHECKING

from pipeline.errors import InputError, RunError, SyncwatchError
from pipeline.frame import (
    Camera,
    Detector,
    Frame,
    Pair,
    Rig,
    Source,
    StampOrigin,
    StampReference,
    Triple,
    Truth,
    Window,
)
from pipeline.settings import Settings
from pipeline.verdict import (
    AlignedPair,
    Basis,
    Cause,
    Event,
    Evidence,
    FrameSink,
    Level,
    Reason,
    Report,
    Sink,
    State,
    Status,
    Verdict,
)

if TYPE_CHECKING:
    from syncwatch.monitor import Monitor
else:

    def __getattr__(name: str) -> object:
        if name == "Monitor":
            from syncwatch.monitor import Monitor  # noqa: PLC0415 - brings the pipeline, which records do without

            return Monitor
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")


__all__ = [
    "AlignedPair",
    "Basis",
    "Camera",
    "Cause",
    "Detector",
    "Event",
    "Evidence",
    "Frame",
    "FrameSink",
    "InputError",
    "Level",
    "Monitor",
    "Pair",
    "Reason",
    "Report",
    "Rig",
    "RunError",
    "Settings",
    "Sink",
    "Source",
    "StampOrigin",
    "StampReference",
    "State",
    "Status",
    "SyncwatchError",
    "Triple",
    "Truth",
    "Verdict",
    "Window",
]
