"""Who may look: with a token, anybody who has it; without one, programs on this machine by its own names."""

from __future__ import annotations

import hashlib
import hmac
from urllib.parse import urlencode

from starlette.requests import Request
from starlette.responses import PlainTextResponse, RedirectResponse, Response
from starlette.types import ASGIApp, Receive, Scope, Send

COOKIE = "syncwatch"
LOOPBACK_NAMES = frozenset({"localhost", "127.0.0.1", "[::1]"})
PAGES = ("/", "/rig")


class Guard:
    """Stands before the app and answers for it where a request may not pass.

    A token comes once, as ?token=; then a cookie that is derived from it does, so that it stands in no address bar and
    no history. `Authorization: Bearer` is for programs. Without a token the request must name this machine: a page of
    somebody else's that has had its own name point here (DNS rebinding) is turned away.
    """

    def __init__(self, app: ASGIApp, *, token: str | None, hosts: frozenset[str], refusal: str) -> None:
        self._app = app
        self._token = token
        self._hosts = hosts | LOOPBACK_NAMES
        self._refusal = refusal

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        request = Request(scope)
        response = self._elsewhere(request) if self._token is None else self._unknown(request, self._token)
        await (response or self._app)(scope, receive, send)

    def _elsewhere(self, request: Request) -> Response | None:
        if host_name(request.headers.get("host", "")) in self._hosts:
            return None
        return PlainTextResponse("This dashboard answers to the names of its own machine only.\n", 403)

    def _unknown(self, request: Request, token: str) -> Response | None:
        """An answer to a request that is not allowed in yet, None for one that is."""
        proof = proof_of(token)
        bearer = request.headers.get("authorization", "").removeprefix("Bearer ")
        if same(request.cookies.get(COOKIE, ""), proof) or same(bearer, token):
            return None
        if same(request.query_params.get("token", ""), token):
            response = RedirectResponse(_without_token(request), 303)
            response.set_cookie(COOKIE, proof, httponly=True, samesite="strict")
            return response
        return Response(self._refusal, 401, media_type="text/html")


def proof_of(token: str) -> str:
    """What the cookie holds: it shows that the token was known, and does not tell it."""
    return hmac.new(token.encode(), b"syncwatch dashboard", hashlib.sha256).hexdigest()


def same(given: str, expected: str) -> bool:
    """Compares in a time that tells nothing of where they differ."""
    return hmac.compare_digest(given.encode(), expected.encode())


def host_name(host: str) -> str:
    """The name in a Host header, without the port; an address of IPv6 keeps its brackets."""
    name = host if host.endswith("]") else host.rpartition(":")[0] or host
    return name.lower()


def _without_token(request: Request) -> str:
    path = request.url.path if request.url.path in PAGES else "/"
    rest = [(key, value) for key, value in request.query_params.multi_items() if key != "token"]
    return f"{path}?{urlencode(rest)}" if rest else path
