"""Recordings of our own (`syncwatch record`): MCAP files that give back every frame as it was."""

from __future__ import annotations

from collections.abc import Generator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from itertools import count
from pathlib import Path
from typing import Any

from mcap.records import Message

from pipeline.errors import InputError
from pipeline.frame import StampOrigin
from pipeline.mcap.frames import frame_fields, picture_of
from pipeline.mcap.schemas import RECORDING_METADATA, frame_topic, image_topic
from sources.replay.mcap_reader import Logged, McapReader, metadata_of
from sources.replay.streams import Entry, Raw, Recording, Request, Stream, Told

MOST_WAITING = 16
"""Messages of a camera that wait for their counterpart: what a frame is told of stands right before its picture."""


@dataclass(frozen=True, slots=True)
class _Camera:
    name: str
    fps: float


def matches(paths: Sequence[Path]) -> bool:
    return len(paths) == 1 and len(_cameras(paths[0])) > 1


def lone_camera(path: Path) -> str | None:
    cameras = _cameras(path)
    return f"recorded camera '{cameras[0].name}'" if len(cameras) == 1 else None


def read(request: Request) -> Recording:
    (path,) = request.paths
    if request.settings.pair_by == "number":
        raise InputError(f"{path}: a recording pairs by time or index, or as it was delivered, not by number")
    if request.settings.topics is not None or request.settings.stamps != "auto":
        raise InputError(f"{path}: a recording of syncwatch has cameras: topics and stamps go with format: mcap only")
    told = metadata_of(path, RECORDING_METADATA) or {}
    cameras = _described(told)
    file = McapReader(path, request.notices)
    counts = file.counts()
    began_ns = next((logged.message.log_time for logged in file.messages(_topics(cameras))), 0)
    names = _names(path, cameras, request.settings.cameras)
    streams = []
    for camera, name in zip(cameras, names, strict=True):
        entries = partial(_entries, file, camera.name, began_ns, request.settings.pair_by)
        first = next(entries(), None)
        if first is None:
            raise InputError(f"{path}: {_nothing_of(camera.name, counts)}")
        streams.append(
            Stream(
                name=name,
                where=path,
                fps=request.fps(camera.fps),
                count=None if counts is None else counts.get(image_topic(camera.name)),
                entries=entries,
                origin_ns=first.captured_ns,
            )
        )
    return Recording(tuple(streams), StampOrigin.DEVICE, pairs=_pairs(told, cameras, names))


def _cameras(path: Path) -> list[_Camera]:
    """The cameras that a file of ours says it holds; none for anything else."""
    return _described(metadata_of(path, RECORDING_METADATA) or {}) if path.is_file() else []


def _described(told: Mapping[str, str]) -> list[_Camera]:
    try:
        rates = [float(text) for text in told["fps"].split(",")]
        return [_Camera(name, fps) for name, fps in zip(told["cameras"].split(","), rates, strict=True)]
    except (KeyError, ValueError):
        return []


def _pairs(
    told: Mapping[str, str], cameras: Sequence[_Camera], names: Sequence[str]
) -> tuple[tuple[str, str], ...] | None:
    """The pairs that were judged, by the names that the cameras have now."""
    called = {camera.name: name for camera, name in zip(cameras, names, strict=True)}
    pairs = [pair.split("-") for pair in told.get("pairs", "").split(",")]
    if not all(len(pair) == 2 and set(pair) <= set(called) for pair in pairs):
        return None
    return tuple((called[first], called[second]) for first, second in pairs)


def _names(path: Path, cameras: Sequence[_Camera], wanted: Sequence[str] | None) -> list[str]:
    names = [camera.name for camera in cameras]
    if wanted is None:
        return names
    if len(wanted) != len(names):
        raise InputError(
            f"cameras: {len(wanted)} names ({', '.join(wanted)}) for the {len(names)} cameras of {path.name} "
            f"({', '.join(names)}): give one name a camera, in that order"
        )
    return list(wanted)


def _nothing_of(camera: str, counts: Any) -> str:
    if counts and counts.get(frame_topic(camera)) and not counts.get(image_topic(camera)):
        return f"{camera} was recorded without pictures: record with pictures raw, png or jpeg to judge it again"
    return f"there is no frame of {camera} in it"


def _topics(cameras: Sequence[_Camera]) -> set[str]:
    return {topic for camera in cameras for topic in (image_topic(camera.name), frame_topic(camera.name))}


@dataclass(slots=True)
class _Halves:
    """Messages by their number, each waiting for the one that completes the frame; the oldest is given up."""

    told: dict[int, Message] = field(default_factory=dict)
    pictures: dict[int, Logged] = field(default_factory=dict)

    def put(self, logged: Logged, *, is_picture: bool) -> tuple[Message, Logged] | None:
        number = logged.message.sequence
        if is_picture:
            self.pictures[number] = logged
        else:
            self.told[number] = logged.message
        for waiting in (self.told, self.pictures):
            if len(waiting) > MOST_WAITING:
                del waiting[next(iter(waiting))]
        if number in self.told and number in self.pictures:
            return self.told.pop(number), self.pictures.pop(number)
        return None


def _entries(file: McapReader, camera: str, began_ns: int, pair_by: str) -> Generator[Entry, None, None]:
    of_pictures, of_frames = image_topic(camera), frame_topic(camera)
    halves = _Halves()
    numbers = count()
    for logged in file.messages({of_pictures, of_frames}):
        whole = halves.put(logged, is_picture=logged.topic == of_pictures)
        if whole is None:
            continue
        told, picture = whole
        where = f"{file.path}: {of_pictures} {told.sequence}"
        try:
            fields = frame_fields(told.data)
        except ValueError as error:
            raise InputError(f"{where}: what is told of the frame cannot be read: {error}") from error
        groups = {"auto": fields["group"], "time": None, "index": next(numbers)}
        yield Entry(
            sequence=fields["sequence"],
            group=groups[pair_by],
            captured_ns=fields["captured_ns"],
            where=where,
            load=partial(_picture, picture, where),
            arrived_ns=fields["arrived_ns"],
            exposure_ns=fields["exposure_ns"],
            told=Told(
                clock=fields["clock"],
                epoch=fields["epoch"],
                stamp_reference=fields["stamp_reference"],
                stamp_origin=fields["stamp_origin"],
                truth=fields["truth"],
            ),
            at_ns=told.log_time - began_ns,
        )


def _picture(logged: Logged, where: str) -> Raw:
    try:
        return picture_of("" if logged.schema is None else logged.schema.name, logged.message.data)
    except ValueError as error:
        raise InputError(f"{where}: the picture cannot be read: {error}") from error
