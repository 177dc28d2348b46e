"""Who may talk to a page that this computer serves."""

from __future__ import annotations

import socket
import time
from collections.abc import Iterator
from urllib.parse import urlparse

import pytest

from rcare_marl import own_host
from rcare_marl.rendering import Camera, Viewer
from rcare_marl.world import World

SOCKET = (
    "Upgrade: websocket\r\nConnection: Upgrade\r\nSec-WebSocket-Version: 13\r\n"
    "Sec-WebSocket-Key: dGhlIHNhbXBsZSBub25jZQ==\r\nSec-WebSocket-Protocol: viser-v{}\r\n"
)


@pytest.fixture(scope="module")
def port() -> Iterator[int]:
    pytest.importorskip("viser")
    before, own_host.IDLE = own_host.IDLE, 1.0
    viewer = Viewer(World(), Camera((0.0, -2.0, 1.0), (0.0, 0.0, 0.5)), follow=False)
    yield urlparse(viewer.url).port or 0
    viewer.close()
    own_host.IDLE = before


def answer(port: int, headers: str) -> str:
    """Return the first line that is answered."""
    with socket.create_connection(("127.0.0.1", port), timeout=10) as connection:
        connection.sendall(f"GET / HTTP/1.1\r\n{headers}\r\n".encode())
        return connection.recv(200).decode(errors="replace").splitlines()[0]


def websocket(port: int, origin: str) -> str:
    import viser

    sent = f"Origin: {origin}\r\n" if origin else ""
    return answer(port, f"Host: localhost:{port}\r\n{sent}{SOCKET.format(viser.__version__)}")


@pytest.mark.parametrize("host", ["localhost", "127.0.0.1", "[::1]", "LOCALHOST"])
def test_the_viewer_answers_its_own_names(port: int, host: str) -> None:
    assert " 200 " in answer(port, f"Host: {host}:{port}\r\n")


@pytest.mark.parametrize(
    "host", ["evil.com", "127.0.0.1.evil.com", "10.0.0.1", "", "localhost.evil.com"]
)
def test_the_viewer_answers_no_foreign_name(port: int, host: str) -> None:
    assert " 403 " in answer(port, f"Host: {host}:{port}\r\n")


def test_the_viewer_answers_no_two_names_and_none_at_all(port: int) -> None:
    assert " 403 " in answer(port, f"Host: localhost:{port}\r\nHost: evil.com\r\n")
    assert " 403 " in answer(port, "")


def test_the_viewer_talks_to_its_own_page_alone(port: int) -> None:
    assert " 101 " in websocket(port, f"http://localhost:{port}")
    for origin in (
        "http://evil.com",
        "null",
        f"https://localhost:{port}",
        "http://localhost:1",
        "",
    ):
        assert " 403 " in websocket(port, origin)


def test_idle_connections_to_the_viewer_end(port: int) -> None:
    begun = time.monotonic()
    connections = [socket.create_connection(("127.0.0.1", port), timeout=10) for _ in range(50)]
    for number, connection in enumerate(connections):
        connection.sendall(b"GET / HT" if number % 2 else b"")
    for connection in connections:
        while connection.recv(1000):
            pass
        connection.close()
    assert time.monotonic() - begun < 5.0


def test_a_page_bound_everywhere_is_asked_for_by_address() -> None:
    assert own_host.is_ours("192.168.0.7:80", "0.0.0.0")
    assert not own_host.is_ours("robot.evil.com", "0.0.0.0")
