"""Serving a page of this computer until Ctrl-C: where it listens, and what is said of it."""

from __future__ import annotations

import asyncio
import socket
import ssl
import webbrowser
from collections.abc import Sequence
from typing import TYPE_CHECKING

from rcare_marl.console import print_line
from rcare_marl.errors import ConfigError

if TYPE_CHECKING:
    from rcare_marl.baselines.pages.door import Door

LOOPBACK = "127.0.0.1"
PORT = 8765


async def serve_page(
    server: Door,
    name: str,
    listening: socket.socket,
    *,
    notes: Sequence[str] = (),
    context: ssl.SSLContext | None = None,
    opens: bool = True,
) -> None:
    """Serve until it is cancelled.

    Args:
        server: What answers.
        name: What it is, for the line that says where.
        listening: From `bound`.
        notes: Further lines.
        context: Of HTTPS.
        opens: Whether to open the page in a browser.
    """
    from aiohttp import web

    runner = web.AppRunner(server.app, access_log=None, handle_signals=False)
    await runner.setup()
    try:
        await web.SockSite(runner, listening, ssl_context=context, shutdown_timeout=2.0).start()
        host, number = listening.getsockname()[:2]
        place = f"[{host}]" if ":" in host else host
        url = f"http{'s' if server.is_secure else ''}://{place}:{number}/"
        print_line(f"{name} is at {url}?token={server.token}  (Ctrl-C ends)")
        for note in notes:
            print_line(note)
        # Others may see what a browser is started with, so not the token itself.
        address = f"{url}?token={server.ticket()}"
        if opens and not await asyncio.to_thread(webbrowser.open, address):
            print_line("no browser could be opened; please open that address yourself")
        await asyncio.Event().wait()
    finally:
        await runner.cleanup()


def bound(host: str, port: int | None) -> socket.socket:
    """Return a socket that listens: at a port, or where none is given to the usual one or a free one.

    Raises:
        ConfigError: If it cannot be bound.
    """
    is_v6 = ":" in host
    family = socket.AF_INET6 if is_v6 else socket.AF_INET
    both = is_v6 and socket.has_dualstack_ipv6()
    tries = (PORT, 0) if port is None else (port,)
    for number in tries:
        try:
            return socket.create_server((host, number), family=family, dualstack_ipv6=both)
        except OSError as error:
            fault = error
    why = str(fault.strerror).partition(" (while")[0]
    raise ConfigError(
        f"cannot serve at {host}, port {number}: {why}; --port 0 takes a free one"
    ) from fault
