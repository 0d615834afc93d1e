"""Writes MCAP files chunk by chunk, so that what was written stays readable whatever happens next."""

from __future__ import annotations

import json
import time
from collections import Counter
from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import IO, Any, cast

from google.protobuf.message import Message as Protobuf
from mcap.well_known import MessageEncoding, SchemaEncoding
from mcap.writer import CompressionType, Writer
from mcap_protobuf.schema import build_file_descriptor_set

from pipeline.errors import InputError
from pipeline.frame import NS_PER_S, Frame, Rig
from pipeline.mcap.frames import IMAGE_CLASSES, Pictures, frame_message, image_message
from pipeline.mcap.schemas import (
    FRAME_SCHEMA,
    RECORDING_METADATA,
    JsonSchema,
    frame_topic,
    image_topic,
    json_schemas,
    report_topic,
)
from pipeline.verdict import Message, Report

CHUNK_BYTES = 4 * 1024 * 1024

CHUNK_NS = NS_PER_S // 2
"""A chunk ends after this time, too: with the status that comes every second, nothing is held back for longer."""

SEQUENCES = 1 << 32

RECORD_BYTES, INDEX_BYTES = 64, 32
"""At most what a message takes beside its data, in its chunk and in the chunk's index."""

SUMMARY_BYTES = 4096


@dataclass(frozen=True, slots=True)
class Item:
    """One message as it is written. sequence: counts the frames of a camera, in the picture and what is told of it."""

    topic: str
    schema: str
    data: bytes
    log_time_ns: int
    sequence: int = 0

    @property
    def size(self) -> int:
        return len(self.data) + RECORD_BYTES + INDEX_BYTES


class Encoder:
    """Makes messages of frames and reports."""

    def __init__(self, pictures: Pictures, jpeg_quality: int) -> None:
        self._pictures = pictures
        self._jpeg_quality = jpeg_quality
        self._frames: Counter[str] = Counter()

    def frame(self, frame: Frame, log_time_ns: int) -> list[Item]:
        """What is told of the frame, then its picture. Raises RunError for a picture that cannot be encoded."""
        number = self._frames[frame.camera] % SEQUENCES
        told = _json(frame_message(frame))
        items = [Item(frame_topic(frame.camera), FRAME_SCHEMA, told, log_time_ns, number)]
        if self._pictures != "none":
            image = image_message(frame, self._pictures, self._jpeg_quality)
            schema, data = image.DESCRIPTOR.full_name, image.SerializeToString()
            items.append(Item(image_topic(frame.camera), schema, data, log_time_ns, number))
        self._frames[frame.camera] += 1
        return items

    def report(self, report: Report, log_time_ns: int) -> Item:
        message = report.to_message()
        return Item(report_topic(report), str(message["schema"]), _json(_without_nulls(message)), log_time_ns)


class RecordingWriter:
    """An MCAP file of a rig. Every method but `abandon` raises OSError where it cannot be written (any more).

    messages: counts them by topic. about: further metadata. detectors: those whose evidence is in the verdicts.
    overwrite: whether a file that is there is replaced. Raises InputError where it is not, and for a place that cannot
    be written to.
    """

    def __init__(
        self,
        path: Path,
        rig: Rig,
        *,
        version: str,
        about: Mapping[str, str],
        detectors: tuple[str, ...] = (),
        compress: CompressionType = CompressionType.LZ4,
        chunk_bytes: int = CHUNK_BYTES,
        overwrite: bool = False,
        monotonic_ns: Callable[[], int] = time.monotonic_ns,
    ) -> None:
        self.path = path
        self._monotonic_ns = monotonic_ns
        cameras, pairs = [camera.name for camera in rig.cameras], [pair.name for pair in rig.pairs]
        self._cameras = cameras
        self._json_schemas = json_schemas(cameras, pairs, detectors)
        self._channels: dict[str, int] = {}
        self._schemas: dict[str, int] = {}
        self._chunk_began_ns: int | None = None
        self._pending_bytes = self._chunks = self._chunk_end = 0
        self.messages: Counter[str] = Counter()
        self._file = _WholeFile(path, overwrite=overwrite)
        self._writer = Writer(cast("IO[Any]", self._file), chunk_size=chunk_bytes, compression=compress)
        try:
            self._writer.start(profile="", library=f"syncwatch {version}")
            self._writer.add_metadata(RECORDING_METADATA, {**_described(rig), "version": version, **about})
        except OSError:
            self.abandon()
            raise
        self._file.keep()

    @property
    def size_bytes(self) -> int:
        """At most how large the file is when it is finished now."""
        per_chunk = RECORD_BYTES + INDEX_BYTES * len(self._channels)
        summary = SUMMARY_BYTES * (1 + len(self._schemas)) + per_chunk * (self._chunks + 1)
        return self._file.tell() + self._pending_bytes + summary

    @property
    def summary(self) -> str:
        """What has been written, for people."""
        frames = ", ".join(f"{self.messages[frame_topic(name)]} of {name}" for name in self._cameras)
        return f"{self.path}: frames: {frames}; {self._file.tell() / 1e6:.1f} MB"

    def write(self, item: Item) -> None:
        channel = self._channels.get(item.topic) or self._channel(item)
        self._writer.add_message(
            channel, log_time=item.log_time_ns, data=item.data, publish_time=item.log_time_ns, sequence=item.sequence
        )
        self.messages[item.topic] += 1
        self._pending_bytes += item.size
        now_ns = self._monotonic_ns()
        self._chunk_began_ns = now_ns if self._chunk_began_ns is None else self._chunk_began_ns
        if now_ns - self._chunk_began_ns >= CHUNK_NS:
            self._writer.flush()
        self._note_progress()

    def add_metadata(self, name: str, data: dict[str, str]) -> None:
        self._writer.flush()
        self._writer.add_metadata(name, data)
        self._note_progress()

    def attach(self, name: str, text: str, at_ns: int) -> None:
        """Attaches a text file."""
        self._writer.flush()
        self._writer.add_attachment(at_ns, at_ns, name, "text/plain", text.encode())
        self._note_progress()

    def finish(self) -> None:
        """Writes the index and closes the file."""
        self._writer.finish()
        self._file.keep()
        self._file.close()

    def abandon(self) -> None:
        """Closes the file after its last whole chunk; never raises."""
        with suppress(OSError):
            self._file.cut()
        with suppress(OSError):
            self._file.close()

    def _note_progress(self) -> None:
        """What has been written ends with a whole record."""
        if self._file.tell() == self._chunk_end:
            return
        self._file.keep()
        self._chunk_end = self._file.tell()
        self._chunks += 1
        self._pending_bytes = 0
        self._chunk_began_ns = None

    def _channel(self, item: Item) -> int:
        if item.schema not in self._schemas:
            self._schemas[item.schema] = self._register(item.schema)
        is_json = item.schema in self._json_schemas
        encoding = MessageEncoding.JSON if is_json else MessageEncoding.Protobuf
        channel = self._writer.register_channel(item.topic, encoding, self._schemas[item.schema])
        self._channels[item.topic] = channel
        return channel

    def _register(self, name: str) -> int:
        schema: JsonSchema | None = self._json_schemas.get(name)
        if schema is not None:
            return int(self._writer.register_schema(name, SchemaEncoding.JSONSchema, json.dumps(schema).encode()))
        described = build_file_descriptor_set(cast("type[Protobuf]", IMAGE_CLASSES[name]))
        return int(self._writer.register_schema(name, SchemaEncoding.Protobuf, described.SerializeToString()))


class _WholeFile:
    """A file that is only ever appended to, and knows up to where it makes sense."""

    def __init__(self, path: Path, *, overwrite: bool) -> None:
        try:
            self._raw = path.open("wb" if overwrite else "xb", buffering=0)
        except FileExistsError:
            raise InputError(f"{path}: exists already: name another file, or allow it to be overwritten") from None
        except OSError as error:
            raise InputError(f"{path}: cannot be written: {error.strerror}") from error
        self._position = self._whole = 0

    def write(self, data: bytes) -> int:
        rest = memoryview(data)
        while rest:
            count = self._raw.write(rest) or 0
            self._position += count
            rest = rest[count:]
        return len(data)

    def tell(self) -> int:
        return self._position

    def flush(self) -> None:
        """Nothing is held back."""

    def keep(self) -> None:
        self._whole = self._position

    def cut(self) -> None:
        self._raw.truncate(self._whole)

    def close(self) -> None:
        self._raw.close()


def _described(rig: Rig) -> dict[str, str]:
    return {
        "rig": rig.name,
        "cameras": ",".join(camera.name for camera in rig.cameras),
        "fps": ",".join(repr(camera.fps) for camera in rig.cameras),
        "pairs": ",".join(pair.name for pair in rig.pairs),
        "expected_offset_ns": ",".join(str(pair.expected_offset_ns) for pair in rig.pairs),
    }


def _json(message: Message) -> bytes:
    return json.dumps(message, allow_nan=False, separators=(",", ":")).encode()


def _without_nulls(value: Any) -> Any:
    if isinstance(value, dict):
        return {name: _without_nulls(inner) for name, inner in value.items() if inner is not None}
    return value
