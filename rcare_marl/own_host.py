"""Who may talk to a page that this computer serves: nobody by a foreign name, and no other page.

A name of somebody else may resolve to this computer, and a page of somebody else in the same browser may ask
for ours.
"""

from __future__ import annotations

import ipaddress
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

IDLE = 10.0  # [s] after which a connection that says nothing ends


def is_ours(asked: str, bound: str) -> bool:
    """Return whether the host of a request is this computer by a name that nobody else can give."""
    name = asked.rsplit(":", 1)[0] if not asked.endswith("]") else asked
    name = name.strip("[]").lower()
    if name in ("localhost", "127.0.0.1", "::1", bound.lower()):
        return True
    if not _is_address(bound) or not ipaddress.ip_address(bound).is_unspecified:
        return False
    return _is_address(name)  # bound everywhere: any address, but no name that may be another's


def _is_address(name: str) -> bool:
    try:
        ipaddress.ip_address(name)
    except ValueError:
        return False
    return True


def is_loopback(host: str) -> bool:
    """Return whether an address is reached from this computer alone."""
    return host == "localhost" or (_is_address(host) and ipaddress.ip_address(host).is_loopback)


def refusal(headers: Any, bound: str) -> str | None:
    """Return why a request is refused; None if it is not.

    Args:
        headers: Of the request, with `get_all(name)`.
        bound: Address that the page is served on.
    """
    hosts, origins = headers.get_all("Host"), headers.get_all("Origin")
    if len(hosts) != 1 or not is_ours(hosts[0], bound):
        return "this host name is not served"
    is_socket = bool(headers.get_all("Upgrade"))
    if origins and origins != [f"http://{hosts[0]}"] or is_socket and not origins:
        return "other pages may not ask"
    return None


@contextmanager
def guarded_websockets(bound: str) -> Iterator[None]:
    """Let servers of `websockets` that start meanwhile refuse others, and end connections that idle.

    For a library that starts such a server of its own and leaves no other way to say so.
    """
    from websockets.asyncio import server

    plain: Any = server.serve

    def serve(*args: Any, process_request: Any = None, **options: Any) -> Any:
        def check(connection: Any, request: Any) -> Any:
            if (why := refusal(request.headers, bound)) is not None:
                return connection.respond(403, f"{why}\n")
            return None if process_request is None else process_request(connection, request)

        waits = {"open_timeout": IDLE, "ping_interval": IDLE / 2, "ping_timeout": IDLE / 2}
        return plain(*args, process_request=check, **{**options, **waits})

    server.serve = serve  # type: ignore[assignment, misc, unused-ignore]
    try:
        yield
    finally:
        server.serve = plain  # type: ignore[misc, unused-ignore]
