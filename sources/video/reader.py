"""Reads one stream in a process of its own, which can be ended at any moment.

A thread inside OpenCV cannot be interrupted, and one that is left there aborts the program when it ends.
"""

from __future__ import annotations

import errno
import json
import os
import socket
import sys
import threading
import time
from contextlib import suppress
from typing import BinaryIO
from urllib.parse import urlsplit

import cv2
import numpy as np

from sources.video.wire import FAILED, FRAME, MOST, OPENED, Head, Order

WAITED = 0.25
"""Periods from which a picture has been waited for; one that came sooner was waiting itself."""

STALE_S = 5.0
"""Of how long a time pictures may be waiting when a stream has been opened: FFmpeg looks at it for that long."""

SANE_FPS = (0.1, 1000.0)
USUAL_FPS = 25.0

ALMOST = 0.95
"""Share of a limit that FFmpeg keeps to."""

LOOK_S = 0.5
"""How often it is looked whether the program is still there."""


def main() -> None:
    """Obeys orders on standard input until it ends, and answers on what was standard output."""
    threading.Thread(target=_end_with, args=(os.getppid(),), daemon=True).start()
    answers = os.dup(sys.stdout.fileno())
    nowhere = os.open(os.devnull, os.O_WRONLY)
    for taken in (sys.stdout.fileno(), sys.stderr.fileno()):
        os.dup2(nowhere, taken)
    with suppress(BrokenPipeError), os.fdopen(answers, "wb") as out:
        reader = Reader(out)
        while line := sys.stdin.buffer.readline():
            reader.obey(Order(**json.loads(line)))


def _end_with(program: int) -> None:
    """Ends this process when the program that started it is gone, though a stream may be waited for."""
    while os.getppid() == program:
        time.sleep(LOOK_S)
    os._exit(0)


class Reader:
    """Answers on `out`."""

    def __init__(self, out: BinaryIO) -> None:
        self._out = out

    def obey(self, order: Order) -> None:
        """Opens the stream, and delivers it to its end or failure."""
        os.environ["OPENCV_FFMPEG_CAPTURE_OPTIONS"] = order.options
        settings = [
            cv2.CAP_PROP_OPEN_TIMEOUT_MSEC,
            order.open_within_ms,
            cv2.CAP_PROP_READ_TIMEOUT_MSEC,
            order.silent_after_ms,
            cv2.CAP_PROP_N_THREADS,
            1,  # more decode one frame each, which delays them by as many
        ]
        asked_s = time.monotonic()
        capture = cv2.VideoCapture(order.url, cv2.CAP_FFMPEG, settings)
        took_s = time.monotonic() - asked_s
        why = self._delivered(capture, order) if capture.isOpened() else why_not(order, took_s)
        capture.release()
        said = why.encode()
        self._say(Head(FAILED, size=len(said)), said)

    def _delivered(self, capture: cv2.VideoCapture, order: Order) -> str:
        """Delivers what was opened; why it ended."""
        if not capture.grab():
            return "it opens, but not one picture can be read"
        fps, count = capture.get(cv2.CAP_PROP_FPS), capture.get(cv2.CAP_PROP_FRAME_COUNT)
        slowest, fastest = SANE_FPS
        fps = fps if slowest <= fps <= fastest else 0.0
        is_recording = order.is_file or count > 0
        self._say(Head(OPENED, number=fps, size=int(min(max(count, 0), MOST))))
        sys.stdin.buffer.readline()
        period_s = order.period_s or 1 / (fps or USUAL_FPS)
        return self._recording(capture) if is_recording else self._stream(capture, order, period_s)

    def _recording(self, capture: cv2.VideoCapture) -> str:
        """From the first picture, which was grabbed to see whether there is one."""
        while True:
            self._show(capture, time.monotonic_ns())
            if not capture.grab():
                return "it ends"

    def _stream(self, capture: cv2.VideoCapture, order: Order, period_s: float) -> str:
        """From the first picture that was waited for: those before it were waiting and are stale."""
        left_out = round(STALE_S / period_s)
        while True:
            asked_s = time.monotonic()
            if not capture.grab():
                silent_s = time.monotonic() - asked_s
                silent = silent_s * 1000 >= ALMOST * order.silent_after_ms
                return f"no picture for {silent_s:.1f} s" if silent else "the stream has ended"
            arrived_ns = time.monotonic_ns()
            if left_out and arrived_ns / 1e9 - asked_s < WAITED * period_s:
                left_out -= 1
                continue
            left_out = 0
            self._show(capture, arrived_ns)

    def _show(self, capture: cv2.VideoCapture, arrived_ns: int) -> None:
        decoded, picture = capture.retrieve()
        if not decoded:
            return
        height, width = picture.shape[:2]
        channels = picture.size // (height * width)
        position_s = capture.get(cv2.CAP_PROP_POS_MSEC) / 1000
        head = Head(FRAME, arrived_ns, position_s, picture.nbytes, height, width, channels)
        self._say(head, np.ascontiguousarray(picture).data.cast("B"))

    def _say(self, head: Head, more: bytes | memoryview = b"") -> None:
        self._out.write(head.pack())
        self._out.write(more)
        self._out.flush()


def why_not(order: Order, took_s: float) -> str:
    """Why a stream cannot be opened, which OpenCV does not say. took_s: how long it has tried."""
    import av  # noqa: PLC0415 - only where something is wrong

    limit_s = order.open_within_ms / 1000
    late = f"no answer within {limit_s:g} s"
    if took_s > ALMOST * limit_s:
        return late
    try:
        options = dict(pair.split(";") for pair in order.options.split("|"))
        with av.open(order.url, options=options, timeout=limit_s):
            return "there is no video in it"
    except av.error.ExitError:
        return late
    except av.error.InvalidDataError:
        return "it is no video, or a damaged one"
    except (av.error.FFmpegError, OSError) as error:  # its text would hold the URL, and a password with it
        vague = error.errno in {errno.EIO, errno.EINVAL}
        return (_unknown_host(order.url) if vague else None) or f"{error.strerror}"


def _unknown_host(url: str) -> str | None:
    """What is wrong with where a URL leads, which FFmpeg has no words of its own for."""
    try:
        host = urlsplit(url).hostname
        if host is not None:
            socket.getaddrinfo(host, None)
    except ValueError:
        return "it is no URL"
    except socket.gaierror:
        return f"no machine is called '{host}'"
    return None


if __name__ == "__main__":
    main()
