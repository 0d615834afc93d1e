"""What is known of a rig before its first picture, and what is kept of it after the last."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

from pipeline.detectors.offset.calibration import Size, aged, for_pictures, geometry_start
from pipeline.detectors.offset.calibration_file import read_calibration
from pipeline.detectors.offset.geometry import Memory
from pipeline.detectors.offset.rig_file import SavedPair, check_rig_path, load_rig_if_any, save_rig

LEAST_WINDOWS = 100
"""Windows learned from before a rig is worth keeping: a few seconds."""


class Knowledge:
    """Memories to start from, out of a file learned earlier or else a calibration; and the file to write.

    Raises InputError for a file that is not what it should be, and for a calibration that does not suit the pictures.
    """

    def __init__(
        self,
        cameras: Sequence[str],
        calibration: Path | None,
        rig: Path | None,
        *,
        version: str,
        wall_ns: Callable[[], int],
    ) -> None:
        self._cameras = cameras
        self._calibration = calibration
        self._rig = rig
        self._version = version
        self._wall_ns = wall_ns
        self._saved: Mapping[str, SavedPair] = {}
        if calibration is not None:
            read_calibration(calibration, cameras[0], cameras[1], cameras)
        if rig is not None:
            check_rig_path(rig)
            self._saved = load_rig_if_any(rig)

    def memory(self, first: str, second: str, recorded: tuple[Size, Size], working: Size) -> Memory:
        """What to start from for a pair whose pictures were `recorded` in those sizes."""
        saved = self._saved.get(f"{first}-{second}")
        if saved is not None and saved.suits(working):
            return Memory(saved.terms, aged(saved.information))
        if self._calibration is None:
            return Memory()
        stereo = for_pictures(read_calibration(self._calibration, first, second, self._cameras), *recorded)
        start = geometry_start(stereo, working)
        return Memory(start.terms, start.information)

    def keep(self, learned: Mapping[str, tuple[Size, Memory]]) -> None:
        """Writes what was learned, beside what the file holds of other pairs. Raises RunError."""
        worth = {name: item for name, item in learned.items() if item[1].windows >= LEAST_WINDOWS}
        if self._rig is None or not worth:
            return
        now_ns = self._wall_ns()
        fresh = {
            name: SavedPair(size, memory.terms, memory.information, memory.windows, None, now_ns, self._version)
            for name, (size, memory) in worth.items()
        }
        save_rig(self._rig, {**self._saved, **fresh})
