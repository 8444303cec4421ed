"""The server of the page: plain HTTP, read by any number of viewers.

The page asks for the state again and again, and each time waits until there is a newer one than it has, or
a while has passed. The state becomes bytes once, for all who wait, and only while somebody does. A viewer
that reads slowly asks less often; nothing is kept for it.
"""

import asyncio
import gzip
import hashlib
import json
import secrets
import socket
import threading
import time
from collections.abc import Awaitable, Callable
from dataclasses import dataclass
from importlib.resources import files
from typing import Any
from urllib.parse import urlsplit

import uvicorn
from starlette.applications import Starlette
from starlette.requests import Request
from starlette.responses import Response
from starlette.routing import Route

from rig.live.web.address import LOOPBACK, Address

#: The state is encoded so often at most, and an answer is given after so long at the latest.
EVERY_S, WITHIN_S = 0.5, 2.0
#: Somebody who asked so long ago is still looking; so long is served after the end for them.
LOOKING_S, LINGER_S = 5.0, 2.5
#: Connections at once at most; the other ones are refused.
CONNECTIONS = 200
#: How long the server may take to end.
ENDING_S = 3.0

_ASSETS = {"/": ("page.html", "text/html"), "/page.css": ("page.css", "text/css")}
_ASSETS |= {f"/{name}": (name, "text/javascript") for name in ("page.js", "plots.js")}
_HEADERS = {
    "Content-Security-Policy": "default-src 'none'; script-src 'self'; style-src 'self'; img-src data:; "
    "connect-src 'self'; base-uri 'none'; form-action 'none'; frame-ancestors 'none'",
    "X-Content-Type-Options": "nosniff",
    "Referrer-Policy": "no-referrer",
    "Cache-Control": "no-store",
}
_TOKEN_NEEDED = "This page needs the address with the token that the program has printed on its terminal."
_FOREIGN = "The page is not served at this address."

Handler = Callable[[Request], Awaitable[Response]]


@dataclass(frozen=True)
class Encoded:
    """A state as bytes: JSON as it is, and packed; the version differs when they do."""

    version: str
    plain: bytes
    packed: bytes

    @classmethod
    def of(cls, document: dict[str, Any]) -> "Encoded":
        """Encode a document."""
        plain = json.dumps(document, allow_nan=False, separators=(",", ":")).encode()
        version = hashlib.blake2b(plain, digest_size=8).hexdigest()
        return cls(version, plain, gzip.compress(plain, 1, mtime=0))


class Encoder:
    """Makes the state to bytes, once for all who wait for it.

    Parameters
    ----------
    make
        Returns what is known now, for JSON; called in a thread of its own.
    """

    def __init__(self, make: Callable[[], dict[str, Any]]) -> None:
        self._make = make
        self._made_s = float("-inf")
        self._round: asyncio.Task[Encoded] | None = None

    async def newer(self, have: str, within_s: float = WITHIN_S) -> Encoded:
        """Wait for another version than one, and return it; after a while the same."""
        until_s = time.monotonic() + within_s
        while True:
            found = await self._next()
            if found.version != have or time.monotonic() >= until_s:
                return found

    async def _next(self) -> Encoded:
        if self._round is None:
            self._round = asyncio.create_task(self._encode())
        return await asyncio.shield(self._round)

    async def _encode(self) -> Encoded:
        await asyncio.sleep(max(0.0, self._made_s + EVERY_S - time.monotonic()))
        try:
            return await asyncio.to_thread(lambda: Encoded.of(self._make()))
        finally:
            self._made_s, self._round = time.monotonic(), None


class Site:
    """What is answered to whom.

    Parameters
    ----------
    address
        Where it is served.
    make
        Returns what is known now, for JSON.
    stop
        Called with who asked for a stop; None where nothing can be stopped.

    Attributes
    ----------
    asked_s
        When somebody asked for the state last, by the monotonic clock.
    """

    def __init__(
        self,
        address: Address,
        make: Callable[[], dict[str, Any]],
        stop: Callable[[str], bool] | None,
    ) -> None:
        self._address, self._stop = address, stop
        self._encoder = Encoder(make)
        self._cookie = f"rig-{address.port}"
        self.asked_s = float("-inf")
        folder = files("rig.live.web")
        self._assets = {
            path: ((folder / "page" / name).read_bytes(), kind) for path, (name, kind) in _ASSETS.items()
        }
        routes = [Route(path, self._guarded(self._asset)) for path in _ASSETS]
        routes.append(Route("/state", self._guarded(self._state, secret=True)))
        routes.append(Route("/stop", self._guarded(self._stop_asked, secret=True), methods=["POST"]))
        self.app = Starlette(routes=routes)

    def _guarded(self, handler: Handler, *, secret: bool = False) -> Handler:
        """Return a handler that refuses foreign names, and what is secret to those without the token."""

        async def guarded(request: Request) -> Response:
            if not self._address.token and not _is_loopback(request):
                return _answer(403, _FOREIGN)
            if secret and self._address.token and not self._knows(request.cookies.get(self._cookie, "")):
                return _answer(403, _TOKEN_NEEDED)
            return await handler(request)

        return guarded

    def _knows(self, token: str) -> bool:
        return secrets.compare_digest(token.encode(), self._address.token.encode())

    async def _asset(self, request: Request) -> Response:
        """Give a part of the page, which says nothing of the scan; and the cookie to who has the token."""
        content, kind = self._assets[request.url.path]
        answer = _answer(200, content, kind)
        token = request.query_params.get("token", "")
        if token and self._knows(token):
            answer.set_cookie(self._cookie, token, httponly=True, samesite="strict")
        return answer

    async def _state(self, request: Request) -> Response:
        """Give the state, as soon as it is another than the viewer has."""
        self.asked_s = time.monotonic()
        have = request.query_params.get("have", "")
        encoded = await self._encoder.newer(have)
        self.asked_s = time.monotonic()
        told = {"Rig-Version": encoded.version, "Rig-Now": f"{time.time():.3f}"}
        if encoded.version == have:
            return _answer(204, headers=told)
        if "gzip" in request.headers.get("accept-encoding", ""):
            return _answer(200, encoded.packed, "application/json", {**told, "Content-Encoding": "gzip"})
        return _answer(200, encoded.plain, "application/json", told)

    async def _stop_asked(self, request: Request) -> Response:
        """Ask for the stop, if the page itself asks."""
        if _place(request.headers.get("origin", "")) != request.headers.get("host"):
            return _answer(403, "Only the page itself can ask for a stop.")
        if self._stop is None:
            return _answer(403, "Nothing can be stopped from here: this page only reads a scan file.")
        who = request.client.host if request.client else "unknown"
        if not self._stop(who):
            return _answer(409, "The scan is over.")
        return _answer(202, "The scan stops after this position.")


def _is_loopback(request: Request) -> bool:
    """Return whether a browser was asked for this computer by a name that only it has.

    Another name may be one that a foreign page has pointed here.
    """
    try:
        return urlsplit(f"//{request.headers.get('host', '')}").hostname in LOOPBACK
    except ValueError:
        return False


def _place(url: str) -> str | None:
    """Return the computer and port of a URL, None of what is none."""
    try:
        return urlsplit(url).netloc
    except ValueError:
        return None


def _answer(
    status: int, content: bytes | str = b"", kind: str = "text/plain", headers: dict[str, str] | None = None
) -> Response:
    return Response(content, status, {**_HEADERS, **(headers or {})}, kind)


class Server:
    """Serves a site in a thread of its own.

    Parameters
    ----------
    site
        What is served.
    listening
        The socket where.
    """

    def __init__(self, site: Site, listening: socket.socket) -> None:
        self._site, self._socket = site, listening
        self._uvicorn = uvicorn.Server(
            uvicorn.Config(
                site.app,
                http="h11",
                ws="none",
                lifespan="off",
                log_config=None,
                log_level="critical",
                access_log=False,
                limit_concurrency=CONNECTIONS,
                timeout_graceful_shutdown=1,
                server_header=False,
            )
        )
        self._thread = threading.Thread(target=self._run, daemon=True)
        self._thread.start()

    def _run(self) -> None:
        self._uvicorn.run(sockets=[self._socket])

    def end(self) -> None:
        """End it, after those who are looking have had time to see the end."""
        if time.monotonic() - self._site.asked_s < LOOKING_S:
            time.sleep(LINGER_S)
        self._uvicorn.should_exit = True
        self._thread.join(ENDING_S)
        self._socket.close()
