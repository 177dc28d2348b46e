"""Who may talk to a page of this computer: the base of the servers of pages.

It answers this computer alone unless told otherwise. A page of somebody else in the same browser must not
talk to it either, so the host that was asked for and the origin of a websocket are checked (a foreign name
that resolves to this computer is refused), and the page may load nothing from elsewhere. Nor must other
users of this computer: all but the files of the page wants a token that only the address of whoever
started the page has.
"""

from __future__ import annotations

import hmac
import logging
import secrets
import ssl
import time
from collections.abc import Awaitable, Callable, Mapping
from pathlib import Path

from aiohttp import web

from rcare_marl.own_host import is_ours

TYPES = {
    ".js": "text/javascript; charset=utf-8",
    ".css": "text/css; charset=utf-8",
    ".html": "text/html; charset=utf-8",
    ".csv": "text/csv; charset=utf-8",
    ".json": "application/json",
    ".wasm": "application/wasm",
}
TOKEN = 24  # random bytes of a token: 192 bits, which nobody guesses
RATE = 120.0  # messages a second in the long run: a headset of 90 Hz, and then some
BURST = 120.0  # at once
HEADERS = {
    "Content-Security-Policy": "default-src 'none'; script-src 'self'; style-src 'self'; "
    "img-src 'self' data:; connect-src 'self'; base-uri 'none'; form-action 'none'; "
    "frame-ancestors 'none'",
    "Permissions-Policy": "camera=(), microphone=(), geolocation=(), xr-spatial-tracking=(self)",
    "X-Content-Type-Options": "nosniff",
    "Referrer-Policy": "no-referrer",
    "Cross-Origin-Opener-Policy": "same-origin",
    "Cross-Origin-Resource-Policy": "same-origin",
    "Cache-Control": "no-store",
}

logger = logging.getLogger(__name__)

Handler = Callable[[web.Request], Awaitable[web.StreamResponse]]


class Limiter:
    """Lets so many messages through a second, and drops the rest.

    Attributes:
        dropped: How many were dropped so far.
    """

    def __init__(self, *, rate: float = RATE, burst: float = BURST) -> None:
        self._rate, self._burst = rate, burst
        self._left, self._at = burst, 0.0
        self.dropped = 0

    def lets(self, now: float) -> bool:
        """Return whether a message at a time [s] may pass; it counts as one."""
        self._left = min(self._burst, self._left + self._rate * (now - self._at))
        self._at = now
        if self._left < 1:
            self.dropped += 1
            return False
        self._left -= 1
        return True


class Door:
    """The application of a page, which refuses whom it does not serve.

    Attributes:
        headers: Of every answer.
        app: The application, for aiohttp.
        token: What a page has to know.
        is_secure: Whether it is served by HTTPS.
    """

    headers: Mapping[str, str] = HEADERS

    def __init__(self, host: str, token: str, *, is_secure: bool = False) -> None:
        """Begin without any route.

        Args:
            host: Address that is bound.
            token: What a page has to know.
            is_secure: Whether it is served by HTTPS.
        """
        self._host, self.token, self.is_secure = host, token, is_secure
        self._tickets: set[str] = set()
        self._notes = Limiter(rate=5, burst=20)  # the log is no place for floods
        self.app = web.Application(middlewares=[self._guard], client_max_size=1024)

    def check_origin(self, request: web.Request) -> None:
        """Refuse a websocket of another page."""
        origin = f"{'https' if self.is_secure else 'http'}://{request.host}"
        if request.headers.get("Origin") != origin:
            self.note("refused a websocket of another origin")
            raise web.HTTPForbidden(text="sessions are for the own page")

    def ticket(self) -> str:
        """Return a token that opens the page once.

        Other users of the computer can read what programs are started with, so this one is for a browser.
        """
        ticket = secrets.token_urlsafe(TOKEN)
        self._tickets.add(ticket)
        return ticket

    def check_token(self, request: web.Request, *, takes_ticket: bool = False) -> None:
        """Refuse a request without the token; a ticket passes once, where it is taken."""
        given = request.query.get("token", "")
        if is_same(given, self.token):
            return
        for ticket in tuple(self._tickets) if takes_ticket else ():
            if is_same(given, ticket):
                self._tickets.discard(ticket)
                return
        self.note("refused a request without the token of this start")
        raise web.HTTPForbidden(text="the token is missing, or not of this start")

    def note(self, what: str) -> None:
        """Log what was refused."""
        if self._notes.lets(time.monotonic()):
            logger.warning(what)

    @web.middleware
    async def _guard(self, request: web.Request, handler: Handler) -> web.StreamResponse:
        if not is_ours(request.host, self._host):
            self.note("refused a request for a host that is not ours")
            raise web.HTTPForbidden(text="this host name is not served", headers=self.headers)
        other = request.headers.get("Sec-Fetch-Site", "none") not in ("none", "same-origin")
        if other and request.headers.get("Sec-Fetch-Mode") != "navigate":
            self.note("refused a request of another page")
            raise web.HTTPForbidden(text="other pages may not ask", headers=self.headers)
        try:
            response = await handler(request)
        except web.HTTPException as error:
            error.headers.update(self.headers)
            raise
        if not response.prepared:
            response.headers.update(self.headers)
        return response


def answer(file: Path) -> web.FileResponse:
    """Return a file of a page."""
    kind = TYPES.get(file.suffix, "application/octet-stream")
    return web.FileResponse(file, headers={"Content-Type": kind})


def is_same(given: str, wanted: str) -> bool:
    """Compare two tokens in a time that does not tell how much of them is the same."""
    return hmac.compare_digest(given.encode("utf-8", "surrogatepass"), wanted.encode())


def secured(certificate: Path, key: Path) -> ssl.SSLContext:
    """Return what HTTPS needs.

    Raises:
        OSError: If the files cannot be read, or are no certificate and key.
    """
    context = ssl.create_default_context(ssl.Purpose.CLIENT_AUTH)
    context.load_cert_chain(certificate, key)
    return context
