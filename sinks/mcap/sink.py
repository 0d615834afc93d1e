"""The sink that records, and never lets a full disk stop the monitoring."""

from __future__ import annotations

import logging
import shutil
import time
from collections.abc import Callable, Sequence
from pathlib import Path

from mcap.writer import CompressionType

from pipeline.errors import InputError
from pipeline.frame import NS_PER_S, Frame, Rig
from pipeline.mcap.timeline import Timeline
from pipeline.mcap.writer import Encoder, Item, RecordingWriter
from pipeline.verdict import Event, Report
from sinks.mcap.around import Around
from sinks.mcap.settings import MIB, McapSettings, file_of

log = logging.getLogger("syncwatch.sinks.mcap")

LOOK_AT_DISK_NS = NS_PER_S


class McapSink:
    """Writes frames, and everything that is reported, into one MCAP file.

    A file that cannot be written any more, one that has grown to `max_bytes`, and a disk that is nearly full end the
    recording: that is said once, what follows is dropped, and the run goes on.

    base: the folder that a relative path counts from. Raises InputError where there is no folder to write in.
    """

    lossless = True
    wants_frames = True

    def __init__(
        self,
        settings: McapSettings,
        *,
        base: Path,
        rig: Rig,
        detectors: Sequence[str],
        version: str,
        live: bool,
        wall_ns: Callable[[], int] = time.time_ns,
        monotonic_ns: Callable[[], int] = time.monotonic_ns,
    ) -> None:
        self._settings = settings
        self._rig = rig
        self._detectors = tuple(detectors)
        self._version = version
        self._wall_ns = wall_ns
        self._monotonic_ns = monotonic_ns
        self._path = file_of(settings, base, rig.name, wall_ns())
        if not self._path.parent.is_dir():
            raise InputError(f"{self._path}: cannot be written: there is no folder {self._path.parent}")
        self._timeline = Timeline(rig.cameras, live=live, wall_ns=wall_ns, monotonic_ns=monotonic_ns)
        self._encoder = Encoder(settings.pictures, settings.jpeg_quality)
        reach_s = settings.around_events_s
        self._around = None if reach_s is None else Around(reach_s, settings.ring_bytes)
        self._writer: RecordingWriter | None = None
        self._look_at_disk_ns = monotonic_ns()

    def start(self) -> None:
        """Creates the file. Raises InputError where that cannot be."""
        settings = self._settings
        reach_s = settings.around_events_s
        try:
            self._writer = RecordingWriter(
                self._path,
                self._rig,
                version=self._version,
                about={
                    "pictures": settings.pictures,
                    "around_events_s": "" if reach_s is None else f"{reach_s:g}",
                    "began_ns": str(self._timeline.now()),
                },
                detectors=self._detectors,
                compress=CompressionType.ZSTD if settings.pictures == "none" else CompressionType.LZ4,
                chunk_bytes=settings.chunk_bytes,
                overwrite=settings.overwrite,
                monotonic_ns=self._monotonic_ns,
            )
        except OSError as error:
            raise InputError(f"{self._path}: cannot be written: {error.strerror}") from error

    def take_frame(self, frame: Frame) -> None:
        if self._writer is not None:
            self._put(self._encoder.frame(frame, self._timeline.of(frame)))

    def take(self, report: Report) -> None:
        if self._writer is None:
            return
        at_ns = self._timeline.now()
        if self._around is not None and isinstance(report, Event):
            self._around.take(report, at_ns)
        self._put([self._encoder.report(report, at_ns)])

    def stop(self) -> None:
        if self._around is not None:
            self._write(self._around.finish())
        closed = self._close()
        if closed is not None:
            log.info("%s", closed.summary)

    def _put(self, items: Sequence[Item]) -> None:
        if self._around is None:
            self._write(items)
            return
        for item in items:
            self._write(self._around.put(item))

    def _write(self, items: Sequence[Item]) -> None:
        """Writes messages that belong together, or none of them."""
        if self._writer is None or not items or self._is_full(self._writer, sum(item.size for item in items)):
            return
        try:
            for item in items:
                self._writer.write(item)
        except OSError as error:
            self._give_up(error)

    def _is_full(self, writer: RecordingWriter, more_bytes: int) -> bool:
        """Whether a limit is reached; the recording is then closed."""
        most = self._settings.max_bytes
        if most is not None and writer.size_bytes + more_bytes > most:
            self._end(logging.WARNING, f"it has reached max_bytes ({most})")
            return True
        if self._monotonic_ns() >= self._look_at_disk_ns:
            self._look_at_disk_ns = self._monotonic_ns() + LOOK_AT_DISK_NS
            least = self._settings.min_free_bytes
            free = shutil.disk_usage(writer.path.parent).free
            if free < least + more_bytes:
                self._end(logging.ERROR, f"only {free / MIB:.0f} MiB of the disk are free (min_free_bytes: {least})")
                return True
        return False

    def _end(self, level: int, why: str) -> None:
        closed = self._close()
        if closed is not None:
            log.log(level, "%s: recording ended: %s; monitoring goes on", closed.summary, why)

    def _close(self) -> RecordingWriter | None:
        """Finishes the file; what has written it, None if it was not open or could not be finished."""
        writer = self._writer
        if writer is None:
            return None
        try:
            writer.finish()
        except OSError as error:
            self._give_up(error)
            return None
        self._writer = None
        return writer

    def _give_up(self, error: OSError) -> None:
        assert self._writer is not None
        self._writer.abandon()
        self._writer = None
        log.error(
            "%s: cannot be written any more: %s: recording ended with what is whole; monitoring goes on",
            self._path,
            error.strerror or error,
        )
