"""What depthai's RecordVideo writes: a video a camera, and beside it an MCAP with every frame's ImgFrame metadata."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

from mcap_protobuf.decoder import DecoderFactory

from pipeline.errors import InputError
from pipeline.frame import NS_PER_S, StampOrigin
from sources.replay import files
from sources.replay.mcap_reader import McapReader
from sources.replay.messages.container import damage_refused
from sources.replay.messages.mcap_file import is_mcap
from sources.replay.names import camera_names
from sources.replay.notices import Notices
from sources.replay.streams import Recording, Request, origins_ns
from sources.replay.videos import Stamp, stamped_stream

SCHEMA = "dai.proto.img_frame.ImgFrame"
NS_PER_US = 1000


def matches(paths: Sequence[Path]) -> bool:
    return len(_videos(paths)) > 1 and all(_metadata(video) is not None for video in _videos(paths))


def lone_camera(_: Path) -> str | None:
    return None


def read(request: Request) -> Recording:
    videos = _videos(request.paths)
    names = camera_names(videos, request.settings.cameras)
    of = [_stamps(video, request.notices) for video in videos]
    origins = origins_ns([[stamp.captured_ns for stamp in own] for own in of], request.notices)
    streams = (
        stamped_stream(name, video, own, origin, request)
        for name, video, own, origin in zip(names, videos, of, origins, strict=True)
    )
    return Recording(tuple(streams), StampOrigin.DEVICE)


def _videos(paths: Sequence[Path]) -> list[Path]:
    if len(paths) == 1 and paths[0].is_dir():
        return [video for video in files.videos(paths[0]) if _metadata(video) is not None]
    return [path for path in paths if files.is_video(path)]


def _metadata(video: Path) -> Path | None:
    beside = video.with_suffix(".mcap")
    return beside if is_mcap(beside) else None


def _stamps(video: Path, notices: Notices) -> list[Stamp]:
    """Device time where the device told it, else the host's, which marks the end of the exposure."""
    metadata = video.with_suffix(".mcap")
    with damage_refused(metadata):
        stamps = [_stamp(message) for message in _messages(metadata, notices)]
    if not stamps:
        raise InputError(f"{metadata}: no frames of the kind {SCHEMA} in it")
    return stamps


def _messages(metadata: Path, notices: Notices) -> Iterator[Any]:
    reader, decoders = McapReader(metadata, notices), DecoderFactory()
    topics = {channel.topic for channel in reader.announced()}
    for _, schema, message in reader.messages(topics):
        decode = decoders.decoder_for("protobuf", schema) if schema is not None and schema.name == SCHEMA else None
        if decode is not None:
            yield decode(message.data)


def _stamp(message: Any) -> Stamp:
    time = message.tsDevice if message.HasField("tsDevice") else message.ts
    exposure_us = getattr(message.cam, "exposureTimeUs", 0)
    return Stamp(
        message.sequenceNum, None, time.sec * NS_PER_S + time.nsec, exposure_us * NS_PER_US if exposure_us else None
    )
