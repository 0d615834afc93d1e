"""Serves rendered pictures as network cameras do, over HTTP as MJPEG, and over RTSP."""

from __future__ import annotations

import socket
import socketserver
import threading
import time
from collections.abc import Sequence
from contextlib import suppress
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from typing import Any

import av
import cv2
import numpy as np

from tests.frames import texture


def jpeg(picture: np.ndarray) -> bytes:
    return cv2.imencode(".jpg", picture)[1].tobytes()


class Streams:
    """Cameras by name, each at http://127.0.0.1:PORT/NAME; all show the picture of the moment, whoever joins when.

    pictures: JPEGs by camera, shown one after the other and again from the start. A camera in `stalled` keeps its
    connections and sends nothing; one in `watched` has been asked for. `die` closes everything, `rise` serves at the
    same port again.
    login: the header that a client has to bring.
    """

    def __init__(self, pictures: dict[str, Sequence[bytes]], fps: float = 30) -> None:
        self.pictures = pictures
        self.fps = fps
        self.stalled: set[str] = set()
        self.port = 0
        self.login: str | None = None
        self.watched: set[str] = set()
        self._server: ThreadingHTTPServer | None = None
        self._started_s = time.monotonic()
        self._dead = threading.Event()

    def url(self, camera: str, login: str = "") -> str:
        return f"http://{login}127.0.0.1:{self.port}/{camera}"

    def rise(self) -> None:
        self._dead = threading.Event()
        self._server = ThreadingHTTPServer(("127.0.0.1", self.port), self._handler())
        self._server.daemon_threads = True
        self.port = self._server.server_port
        threading.Thread(target=self._server.serve_forever, kwargs={"poll_interval": 0.02}, daemon=True).start()

    def die(self) -> None:
        self._dead.set()
        assert self._server is not None
        self._server.shutdown()
        self._server.server_close()

    def begin(self) -> None:
        """The first picture is due now."""
        self._started_s = time.monotonic()

    def __enter__(self) -> Streams:
        self.rise()
        return self

    def __exit__(self, *_: object) -> None:
        if not self._dead.is_set():
            self.die()

    def send(self, camera: str, out: Any) -> None:
        dead = self._dead
        self.watched.add(camera)
        number = round((time.monotonic() - self._started_s) * self.fps)
        while not dead.wait(max(0.0, self._started_s + number / self.fps - time.monotonic())):
            own = self.pictures[camera]
            data = own[number % len(own)]
            number += 1
            if camera not in self.stalled:
                out.write(b"--frame\r\nContent-Type: image/jpeg\r\nContent-Length: %d\r\n\r\n" % len(data))
                out.write(data + b"\r\n")

    def _handler(self) -> type[BaseHTTPRequestHandler]:
        streams = self

        class Handler(BaseHTTPRequestHandler):
            def do_GET(self) -> None:
                camera = self.path.strip("/").partition("?")[0]
                if camera not in streams.pictures:
                    self.send_error(404)
                    return
                if streams.login not in {None, self.headers.get("Authorization")}:
                    self.send_response(401)
                    self.send_header("WWW-Authenticate", 'Basic realm="cameras"')
                    self.end_headers()
                    return
                self.send_response(200)
                self.send_header("Content-Type", "multipart/x-mixed-replace; boundary=frame")
                self.end_headers()
                with suppress(OSError):
                    streams.send(camera, self.wfile)

            def log_message(self, *_: object) -> None:
                pass

        return Handler


def plain(seed: int, size: tuple[int, int] = (96, 72)) -> list[bytes]:
    """A few pictures that differ."""
    return [jpeg(texture(seed + n, *size)) for n in range(3)]


class Rtsp:
    """An RTSP server of one stream, MJPEG over TCP; another transport is refused."""

    def __init__(self, fps: float = 30) -> None:
        self.fps = fps
        self._server = socketserver.ThreadingTCPServer(("127.0.0.1", 0), self._handler())
        self._server.daemon_threads = True
        self._done = threading.Event()

    @property
    def url(self) -> str:
        return f"rtsp://user:secret@127.0.0.1:{self._server.server_address[1]}/stream"

    def __enter__(self) -> Rtsp:
        threading.Thread(target=self._server.serve_forever, kwargs={"poll_interval": 0.02}, daemon=True).start()
        return self

    def __exit__(self, *_: object) -> None:
        self._done.set()
        self._server.shutdown()
        self._server.server_close()

    def send(self, out: Any) -> None:
        """Sends RTP packets, interleaved, that FFmpeg makes."""
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as packets:
            packets.bind(("127.0.0.1", 0))
            packets.settimeout(0)
            with av.open(f"rtp://127.0.0.1:{packets.getsockname()[1]}", "w", format="rtp") as muxer:
                stream = muxer.add_stream("mjpeg", rate=round(self.fps))
                stream.width, stream.height, stream.pix_fmt = 96, 72, "yuvj420p"
                number = 0
                while not self._done.wait(1 / self.fps):
                    number += 1
                    shown = np.dstack([texture(number % 3, 96, 72)] * 3)
                    for packet in stream.encode(av.VideoFrame.from_ndarray(shown, format="bgr24")):
                        muxer.mux(packet)
                    with suppress(BlockingIOError):
                        while data := packets.recv(4096):
                            out.write(b"$\0" + len(data).to_bytes(2, "big") + data)

    def _handler(self) -> type[socketserver.StreamRequestHandler]:
        server = self

        class Handler(socketserver.StreamRequestHandler):
            def handle(self) -> None:
                sdp = b"v=0\r\no=- 0 0 IN IP4 127.0.0.1\r\ns=-\r\nt=0 0\r\nm=video 0 RTP/AVP 26\r\na=control:0\r\n"
                with suppress(OSError):
                    while request := self.rfile.readline().split():
                        headers = dict(
                            iter(lambda: self.rfile.readline().decode().strip().partition(": ")[::2], ("", ""))
                        )
                        told, body, refused = f"CSeq: {headers['CSeq']}\r\nSession: 1\r\n", b"", False
                        if request[0] == b"DESCRIBE":
                            told, body = f"{told}Content-Type: application/sdp\r\n", sdp
                        if request[0] == b"SETUP":
                            refused = "TCP" not in headers["Transport"]
                            told += "Transport: RTP/AVP/TCP;unicast;interleaved=0-1\r\n"
                        status = "461 Unsupported Transport" if refused else "200 OK"
                        head = f"RTSP/1.0 {status}\r\n{told}Content-Length: {len(body)}\r\n\r\n"
                        self.wfile.write(head.encode() + body)
                        if request[0] == b"PLAY":
                            server.send(self.wfile)

        return Handler


def film(path: Path, count: int, fps: float = 50, size: tuple[int, int] = (96, 72)) -> Path:
    """A video file of pictures that differ."""
    kind = "MJPG" if path.suffix == ".avi" else "mp4v"
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter_fourcc(*kind), fps, size)
    for n in range(count):
        writer.write(np.dstack([texture(n, *size)] * 3))
    writer.release()
    return path
