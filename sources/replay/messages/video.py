"""Decodes video that comes packet by packet in messages (foxglove.CompressedVideo), by PyAV."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

import av
import av.error
from av.video.codeccontext import VideoCodecContext

from pipeline.errors import InputError
from sources.replay.streams import Raw

CODECS = {"h264": "h264", "h265": "hevc", "vp9": "vp9", "av1": "av1"}
"""By the names of Foxglove's schema, which forbids B-frames: a message is a picture."""

MOST_WAITING = 300
"""Packets that may wait to be decoded: longer than the distance of key frames that cameras use."""

H264_KEY, H264_KINDS = {5, 7}, 0x1F
H265_KEY, H265_KINDS = {16, 17, 18, 19, 20, 21, 32}, 0x3F


class VideoDecoder:
    """The pictures of one stream. A picture that nobody loads is decoded only when a later one needs it."""

    def __init__(self) -> None:
        self._context: VideoCodecContext | None = None
        self._format = ""
        self._waiting: list[bytes] = []

    def loader(self, video_format: str, data: bytes) -> Callable[[], Raw]:
        """What decodes the packet `data`. Raises InputError for a format that is not understood."""
        if self._context is None or video_format != self._format:
            self._context, self._format = _opened(video_format), video_format
            self._waiting.clear()
        if is_key(video_format, data):
            self._waiting.clear()
        self._waiting.append(data)
        if len(self._waiting) > MOST_WAITING:
            self._decoded(self._context)
        return partial(self._decoded, self._context)

    def _decoded(self, context: VideoCodecContext) -> Raw:
        waiting, self._waiting = self._waiting, []
        picture: Raw | None = None
        try:
            for data in waiting:
                for frame in context.decode(av.Packet(data)):
                    picture = frame.to_ndarray(format="gray" if frame.format.name == "gray" else "bgr24")
        except av.error.FFmpegError as error:
            raise InputError(f"{self._format} video: a packet cannot be decoded: {error.strerror}") from error
        if picture is None:
            raise InputError(f"{self._format} video: no picture in the packet: a key frame is missing before it")
        return picture


def is_key(video_format: str, data: bytes) -> bool:
    """Whether a packet can be decoded without those before it, as far as its NAL units tell (H.264, H.265)."""
    if video_format not in {"h264", "h265"}:
        return False
    kinds, shift, keys = (H264_KINDS, 0, H264_KEY) if video_format == "h264" else (H265_KINDS, 1, H265_KEY)
    at = data.find(b"\0\0\1")
    while 0 <= at < len(data) - 3:
        if (data[at + 3] >> shift) & kinds in keys:
            return True
        at = data.find(b"\0\0\1", at + 3)
    return False


def _opened(video_format: str) -> VideoCodecContext:
    codec = CODECS.get(video_format)
    if codec is None:
        raise InputError(f"video format '{video_format}' is not understood: allowed are {', '.join(CODECS)}")
    context = av.CodecContext.create(codec, "r")
    assert isinstance(context, VideoCodecContext)
    context.thread_type = "SLICE"  # frame threads would give a picture back some packets late
    context.flags |= int(av.codec.context.Flags.low_delay)
    return context
