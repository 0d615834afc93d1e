"""Writes a recording anew after it has been judged."""

from __future__ import annotations

import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from pipeline.buffer import BufferSettings, WindowBuffer
from pipeline.frame import Frame, Rig, Source, Window
from pipeline.mcap.schemas import REPAIR_METADATA
from pipeline.mcap.timeline import Timeline
from pipeline.mcap.writer import Encoder, RecordingWriter
from pipeline.repair.account import metadata, sentences
from pipeline.repair.groups import Regrouper
from pipeline.repair.measured import Measured

JPEG_QUALITY = 95


@dataclass(frozen=True, slots=True)
class Rewrite:
    """What is written anew, and how. pairing: as when it was judged, so that windows are the same."""

    taken: Path
    rig: Rig
    measured: Measured
    pairing: BufferSettings
    pictures: Literal["raw", "png", "jpeg"]
    restamp: bool
    version: str

    def write(self, source: Source, made: Path) -> list[str]:
        """Writes the frames of `source`, which is open, into `made`; what was done, for people.

        Raises OSError where that cannot be written.
        """
        regrouper = Regrouper(self.rig, self.measured.pairs, restamp=self.restamp)
        about = {"pictures": self.pictures, "repaired_from": self.taken.name}
        writer = RecordingWriter(made, self.rig, version=self.version, about=about, overwrite=True)
        try:
            self._write_frames(source, regrouper, writer)
            told = [f"{regrouper.groups} groups of frames that belong together", *sentences(self.measured, regrouper)]
            done = metadata(self.taken, self.measured, regrouper, restamp=self.restamp, version=self.version)
            writer.add_metadata(REPAIR_METADATA, done)
            writer.attach("repair.txt", "\n".join([f"repaired from {self.taken.name}", *told, ""]), time.time_ns())
            writer.finish()
        except BaseException:
            writer.abandon()
            raise
        return told

    def _write_frames(self, source: Source, regrouper: Regrouper, writer: RecordingWriter) -> None:
        encoder = Encoder(self.pictures, JPEG_QUALITY)
        timeline = Timeline(self.rig.cameras, live=False, wall_ns=time.time_ns, monotonic_ns=time.monotonic_ns)
        for group in self._groups(source, regrouper):
            at_ns = timeline.of(group[0])
            for frame in group:
                for item in encoder.frame(frame, at_ns):
                    writer.write(item)

    def _groups(self, source: Source, regrouper: Regrouper) -> Iterator[list[Frame]]:
        for window in self._windows(source):
            yield from regrouper.take(window)
        yield from regrouper.finish()

    def _windows(self, source: Source) -> Iterator[Window]:
        buffer = WindowBuffer(self.rig.cameras, self.pairing)
        for frame in source.frames():
            yield from buffer.push(frame)
        yield from buffer.flush()
