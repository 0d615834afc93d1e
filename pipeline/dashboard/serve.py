"""Serves the page: binds the address, runs the server, and ends it on a signal whoever is still connected."""

from __future__ import annotations

import asyncio
import ipaddress
import signal
import socket
from collections.abc import Iterator
from contextlib import contextmanager

import uvicorn

from pipeline.dashboard.app import make_app
from pipeline.errors import InputError
from pipeline.fleet.listener import FleetListener

END_WITHIN_S = 1
WAITING_BYTES = 256 * 1024
"""What may be on its way to a reader that takes nothing."""


def bind(host: str, port: int) -> socket.socket:
    """A socket bound to the first address of `host`. Raises InputError."""
    try:
        found = socket.getaddrinfo(host, port, type=socket.SOCK_STREAM, flags=socket.AI_PASSIVE)
    except (OSError, UnicodeError):
        raise InputError(f"--host '{host}': no such address: 127.0.0.1 is this machine, 0.0.0.0 all of it") from None
    family, _, _, _, address = found[0]
    made = socket.socket(family, socket.SOCK_STREAM)
    try:
        made.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        made.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, WAITING_BYTES)
        made.bind(address)
        made.listen()
    except OSError as error:
        made.close()
        raise InputError(_why_not(host, port, error)) from None
    return made


def is_loopback(bound: socket.socket) -> bool:
    return ipaddress.ip_address(bound.getsockname()[0]).is_loopback


def address_of(bound: socket.socket, host: str) -> str:
    """Where the page is, for people. host: what was asked for; an address of all interfaces is no place to go to."""
    name = socket.gethostname() if ipaddress.ip_address(bound.getsockname()[0]).is_unspecified else host
    return f"http://{f'[{name}]' if ':' in name else name}:{bound.getsockname()[1]}/"


def serve(listener: FleetListener, bound: socket.socket, *, host: str, token: str | None) -> int:
    """Serves until SIGINT or SIGTERM; returns that signal's number. The listener is started and stopped elsewhere."""
    received: list[int] = []
    asyncio.run(_serve_until_signal(listener, bound, host, token, received))
    return received[0]


async def _serve_until_signal(
    listener: FleetListener, bound: socket.socket, host: str, token: str | None, received: list[int]
) -> None:
    stopping = asyncio.Event()
    loop = asyncio.get_running_loop()

    def handle(number: int) -> None:
        received.append(number)
        stopping.set()

    for number in (signal.SIGINT, signal.SIGTERM):
        loop.add_signal_handler(number, handle, number)
    await serve_until(stopping, listener, bound, host=host, token=token)


async def serve_until(
    stopping: asyncio.Event, listener: FleetListener, bound: socket.socket, *, host: str, token: str | None
) -> None:
    """Serves until `stopping` is set, then ends streams, and after END_WITHIN_S whatever is still open."""
    hosts = frozenset({f"[{host}]" if ":" in host else host.lower()})
    app = make_app(listener, token=token, hosts=hosts, stopping=stopping)
    server = _Server(
        uvicorn.Config(
            app,
            log_config=None,
            log_level="critical",  # our own handler says what goes wrong
            access_log=False,
            lifespan="off",
            ws="none",
            server_header=False,
            proxy_headers=False,
            timeout_graceful_shutdown=END_WITHIN_S,
        )
    )

    async def end() -> None:
        await stopping.wait()
        server.should_exit = True

    ending = asyncio.create_task(end())
    await server.serve(sockets=[bound])
    ending.cancel()


class _Server(uvicorn.Server):
    @contextmanager
    def capture_signals(self) -> Iterator[None]:
        """Leaves signals to us: uvicorn would raise them again at the end, and the exit status would be theirs."""
        yield


def _why_not(host: str, port: int, error: OSError) -> str:
    if isinstance(error, PermissionError):
        return f"--port {port}: not allowed: take one above 1023"
    return f"cannot listen on {host} port {port}: {error.strerror}: choose with --host and --port (0 takes a free port)"
