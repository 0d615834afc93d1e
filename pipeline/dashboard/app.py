"""The web application: one page with what belongs to it, the stream that keeps it up to date, and small pictures."""

from __future__ import annotations

import asyncio
import logging
from collections.abc import AsyncIterator, Callable
from contextlib import suppress
from importlib import resources

from starlette.applications import Starlette
from starlette.datastructures import MutableHeaders
from starlette.exceptions import HTTPException
from starlette.middleware import Middleware
from starlette.requests import Request
from starlette.responses import PlainTextResponse, Response, StreamingResponse
from starlette.routing import Route
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from pipeline.dashboard.access import PAGES, Guard
from pipeline.dashboard.stream import Board, Stream
from pipeline.fleet.listener import FleetListener

log = logging.getLogger("syncwatch.dashboard")

MAX_STREAMS = 64
"""Pages that may be open at a time."""

READER_S = 20.0

MEDIA_TYPES = {
    "html": "text/html",
    "css": "text/css",
    "js": "text/javascript",
    "svg": "image/svg+xml",
}

HEADERS = {
    "content-security-policy": "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self'; "
    "connect-src 'self'; form-action 'self'; base-uri 'none'; frame-ancestors 'none'",
    "x-content-type-options": "nosniff",
    "x-frame-options": "DENY",
    "referrer-policy": "no-referrer",
    "cross-origin-resource-policy": "same-origin",
    "cross-origin-opener-policy": "same-origin",
}
"""With every answer: nothing of anybody else's is loaded, nothing inline runs, and nobody frames the page."""


def make_app(
    listener: FleetListener,
    *,
    token: str | None,
    hosts: frozenset[str] = frozenset(),
    stopping: asyncio.Event | None = None,
) -> ASGIApp:
    """The application around a listener that is started elsewhere.

    token: who may look; None lets those in who name this machine, or one of `hosts`. stopping: ends all streams.
    """
    files = _files()
    pages = _Pages(listener, files, stopping or asyncio.Event())
    routes = [
        *(Route(path, pages.page) for path in PAGES),
        Route("/stream", pages.stream),
        Route("/preview", pages.preview),
        Route("/{file}", pages.file),
    ]
    middleware = [Middleware(Guard, token=token, hosts=hosts, refusal=files["token.html"].decode())]
    return _Headers(Starlette(routes=routes, middleware=middleware, exception_handlers={Exception: _unforeseen}))


class _Pages:
    """Answers requests that were let in."""

    def __init__(self, listener: FleetListener, files: dict[str, bytes], stopping: asyncio.Event) -> None:
        self._listener = listener
        self._board = Board(listener)
        self._files = files
        self._stopping = stopping
        self._streams = 0

    async def page(self, _: Request) -> Response:
        return _served("index.html", self._files["index.html"])

    async def file(self, request: Request) -> Response:
        name = request.path_params["file"]
        if name not in self._files or name.endswith(".html"):
            raise HTTPException(404)
        return _served(name, self._files[name])

    async def stream(self, request: Request) -> Response:
        if self._streams >= MAX_STREAMS:
            return PlainTextResponse(f"{MAX_STREAMS} pages are open already.\n", 503, {"retry-after": "5"})
        self._streams += 1
        told = Stream(self._board, request.query_params.get("rig"))
        return _EventStream(told.messages(self._stopping), ended=self._one_less)

    def _one_less(self) -> None:
        self._streams -= 1

    async def preview(self, request: Request) -> Response:
        asked = request.query_params
        found = self._listener.fleet.preview(asked.get("rig", ""), asked.get("camera", ""))
        if found is None:
            raise HTTPException(404)
        return Response(found.jpeg, media_type="image/jpeg", headers={"cache-control": "no-store"})


class _EventStream(StreamingResponse):
    """Server-sent events; ends when its reader has taken nothing for READER_S, and says that it has ended."""

    def __init__(self, messages: AsyncIterator[str], *, ended: Callable[[], None]) -> None:
        headers = {"cache-control": "no-store", "x-accel-buffering": "no"}
        super().__init__(messages, media_type="text/event-stream", headers=headers)
        self._ended = ended

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        try:
            await super().__call__(scope, receive, send)
        finally:
            self._ended()

    async def stream_response(self, send: Send) -> None:
        async def patiently(message: Message) -> None:
            await asyncio.wait_for(send(message), READER_S)

        with suppress(asyncio.TimeoutError):
            await super().stream_response(patiently)


class _Headers:
    """Adds HEADERS to every answer."""

    def __init__(self, app: ASGIApp) -> None:
        self._app = app

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        async def with_headers(message: Message) -> None:
            if message["type"] == "http.response.start":
                MutableHeaders(scope=message).update(HEADERS)
            await send(message)

        await self._app(scope, receive, with_headers)


def _files() -> dict[str, bytes]:
    """Everything the page is made of, by name."""
    folder = resources.files("pipeline.dashboard").joinpath("web")
    return {file.name: file.read_bytes() for file in folder.iterdir() if file.name.rpartition(".")[2] in MEDIA_TYPES}


def _served(name: str, content: bytes) -> Response:
    return Response(content, media_type=MEDIA_TYPES[name.rpartition(".")[2]], headers={"cache-control": "no-cache"})


def _unforeseen(request: Request, error: Exception) -> Response:
    log.error("%s: %s: %s", request.url.path, type(error).__name__, error)
    log.debug("not foreseen", exc_info=error)
    return PlainTextResponse("Something went wrong here; the dashboard's own output says what.\n", 500)
