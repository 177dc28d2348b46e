"""Who gets to the coach's page, and how the command that serves it begins and ends."""

from __future__ import annotations

import asyncio
import hashlib
import logging
import os
import re
import signal
import socket
import ssl
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

pytest.importorskip("aiohttp", reason="the coach's page needs the extra 'coach'")

from aiohttp import ClientConnectionError, ClientSession, WSServerHandshakeError, web
from self_signed import OPENSSL, self_signed
from typer.testing import CliRunner

from rcare_marl.baselines.coaching import page as coaching
from rcare_marl.baselines.coaching.page.packages import FILES, WEB, packages_folder
from rcare_marl.baselines.coaching.page.server import Server, Service
from rcare_marl.cli.app import app
from rcare_marl.cli.coach import LOOPBACK, bound
from rcare_marl.errors import ConfigError

WRONG = (
    "",
    "?token=",
    "?token=x",
    "?token=%C3%A9",
    "?token=of-this-star",
    "?token=of-this-start%20",
)
# A background job of a shell that is not interactive begins with interrupts ignored, and so do its children.
COMMAND = """\
import signal
signal.signal(signal.SIGINT, signal.default_int_handler)
from rcare_marl.cli import main
main()
"""
needs_openssl = pytest.mark.skipif(
    OPENSSL is None, reason="openssl is not installed: it makes the certificate"
)


def test_who_has_not_the_token_of_this_start_gets_the_bare_page_and_is_logged(
    caplog: pytest.LogCaptureFixture,
) -> None:
    async def ask() -> None:
        runner = web.AppRunner(Server(Service(WEB, token="of-this-start")).app)
        await runner.setup()
        await web.SockSite(runner, bound(LOOPBACK, 0), shutdown_timeout=0.5).start()
        url = f"http://{LOOPBACK}:{runner.addresses[0][1]}"
        async with ClientSession() as client:
            for query in WRONG:
                async with client.get(f"{url}/setting{query}") as response:
                    assert response.status == 403, query
                    assert "of-this-start" not in await response.text()
                with pytest.raises(WSServerHandshakeError) as caught:
                    await client.ws_connect(f"{url}/session{query}", origin=url)
                assert caught.value.status == 403
            async with client.get(f"{url}/web/page.js") as response:
                assert response.status == 200
            async with client.ws_connect(f"{url}/session?token=of-this-start", origin=url) as open_:
                assert (await open_.receive_json())["type"] == "state"
        await runner.cleanup()

    with caplog.at_level(logging.WARNING):
        asyncio.run(asyncio.wait_for(ask(), 60))
    logged = [record.message for record in caplog.records]
    assert sum("without the token" in each for each in logged) == 2 * len(WRONG)
    assert not any("of-this-start" in each for each in logged)


def test_what_was_recorded_is_handed_to_who_has_the_token_and_nothing_else_is(
    tmp_path: Path,
) -> None:
    kept = tmp_path / "session-20261123-101500"
    kept.mkdir()
    for name in ("report.html", "session.h5"):
        (kept / name).write_text(name)
    (tmp_path / "report.html").touch()

    async def ask() -> None:
        runner = web.AppRunner(Server(Service(WEB, record=tmp_path, token="of-this-start")).app)
        await runner.setup()
        await web.SockSite(runner, bound(LOOPBACK, 0), shutdown_timeout=0.5).start()
        url = f"http://{LOOPBACK}:{runner.addresses[0][1]}/kept"
        async with ClientSession() as client:
            for path, token, status in (
                (f"{kept.name}/report.html", "of-this-start", 200),
                (f"{kept.name}/report.html", "x", 403),
                (f"{kept.name}/session.h5", "of-this-start", 404),
                (f"{kept.name}/observations.json", "of-this-start", 404),
                ("%2e%2e/report.html", "of-this-start", 404),
                ("session-1/report.html", "of-this-start", 404),
            ):
                async with client.get(f"{url}/{path}?token={token}") as response:
                    assert response.status == status, path
        await runner.cleanup()

    asyncio.run(asyncio.wait_for(ask(), 60))


def test_the_address_that_a_browser_is_started_with_opens_the_page_once() -> None:
    async def ask() -> None:
        service = Service(WEB)
        server = Server(service)
        runner = web.AppRunner(server.app)
        await runner.setup()
        await web.SockSite(runner, bound(LOOPBACK, 0), shutdown_timeout=0.5).start()
        url, ticket = f"http://{LOOPBACK}:{runner.addresses[0][1]}", server.ticket()
        async with ClientSession() as client:
            with pytest.raises(WSServerHandshakeError):
                await client.ws_connect(f"{url}/session?token={ticket}", origin=url)
            async with client.get(f"{url}/setting?token={ticket}") as response:
                assert (await response.json())["token"] == service.token
            async with client.get(f"{url}/setting?token={ticket}") as response:
                assert response.status == 403
        await runner.cleanup()

    asyncio.run(asyncio.wait_for(ask(), 60))


def test_every_start_has_a_token_of_its_own_that_is_not_shown_by_chance() -> None:
    one, other = Service(WEB), Service(WEB)
    assert one.token != other.token and len(one.token) >= 32
    assert one.token not in repr(one)


def test_only_this_computer_is_reached_by_default() -> None:
    with bound(LOOPBACK, None) as listening:
        assert listening.getsockname()[0] == "127.0.0.1"
        with bound(LOOPBACK, None) as second:  # the usual port is taken now
            assert second.getsockname()[1] != listening.getsockname()[1]
        with pytest.raises(ConfigError, match="--port 0"):
            bound(LOOPBACK, listening.getsockname()[1])


def refused(*given: str) -> str:
    """Run the command, which refuses what it was given; return what it says."""
    done = CliRunner().invoke(app, ["coach", "--no-open", *given])
    assert done.exit_code == 2, done.output
    assert done.stderr.startswith("error: ") or "warning: " in done.stderr
    assert "Traceback" not in done.stderr
    return done.stderr


@pytest.fixture
def _packages(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setenv("RCARE_MARL_CACHE", str(cache_with_packages(tmp_path / "cache")))


def cache_with_packages(cache: Path) -> Path:
    """Make a cache in which the packages count as installed, so that no test needs a network."""
    recipe = (WEB / "package.json").read_bytes() + (WEB / "package-lock.json").read_bytes()
    modules = cache / f"coach-page-{hashlib.sha256(recipe).hexdigest()[:16]}/node_modules"
    for folder, names in FILES.values():
        (modules / folder).mkdir(parents=True)
        for name in names:
            (modules / folder / name).touch()
    return cache


@pytest.mark.usefixtures("_packages")
def test_what_cannot_be_served_or_recorded_is_said_before_anybody_exercises(tmp_path: Path) -> None:
    with socket.create_server((LOOPBACK, 0)) as taken:
        port = str(taken.getsockname()[1])
        assert f"port {port}" in refused("--port", port)
    assert "--certificate" in refused("--host", "0.0.0.0")
    assert "belong together" in refused("--key", "key.pem")
    missing = [str(tmp_path / name) for name in ("no.crt", "no.key")]
    assert f"no file {missing[0]}" in refused("--certificate", missing[0], "--key", missing[1])
    file = tmp_path / "file"
    file.touch()
    assert f"cannot record to {file}" in refused("--record", str(file / "below"))


@pytest.mark.usefixtures("_packages")
@pytest.mark.skipif(os.geteuid() == 0, reason="the superuser may write everywhere")
def test_a_folder_that_may_not_be_written_is_refused_before_anybody_exercises(
    tmp_path: Path,
) -> None:
    locked = tmp_path / "locked"
    locked.mkdir(mode=0o500)
    assert f"cannot record to {locked}" in refused("--record", str(locked))


@pytest.mark.parametrize("package", ("aiohttp", "h5py"))
def test_without_the_extra_the_command_says_how_to_install_it(
    package: str, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setenv("RCARE_MARL_CACHE", str(cache_with_packages(tmp_path / "cache")))
    # Import it anew; afterwards its package shall have the module of before.
    monkeypatch.setattr(
        coaching, "server", sys.modules["rcare_marl.baselines.coaching.page.server"]
    )
    monkeypatch.delitem(sys.modules, "rcare_marl.baselines.coaching.page.server")
    monkeypatch.setitem(sys.modules, package, None)
    assert "pip install 'rcare-marl[coach]'" in refused("--record", str(tmp_path / "kept"))


@needs_openssl
@pytest.mark.usefixtures("_packages")
def test_a_key_of_another_certificate_is_refused_by_name(tmp_path: Path) -> None:
    certificate, _ = self_signed(tmp_path, "one")
    _, key = self_signed(tmp_path, "other")
    said = refused("--certificate", str(certificate), "--key", str(key))
    assert str(certificate) in said and str(key) in said and "MISMATCH" in said.upper()
    said = refused("--certificate", str(key), "--key", str(certificate))  # changed about
    assert "are no certificate and key" in said


@contextmanager
def started(folder: Path, *given: str) -> Iterator[tuple[str, subprocess.Popen[str]]]:
    """Start the command; yield the address that it prints, and its process."""
    process = subprocess.Popen(
        [sys.executable, "-c", COMMAND, "coach", "--no-open", "--port", "0", *given],
        stderr=subprocess.PIPE,
        text=True,
        env={**os.environ, "RCARE_MARL_CACHE": str(cache_with_packages(folder / "cache"))},
    )
    try:
        assert process.stderr is not None
        found = None
        for line in process.stderr:
            if found := re.search(r"https?://\S+", line):
                break
        assert found is not None, "no address was printed"
        yield found.group(), process
    finally:
        process.kill()
        process.communicate(timeout=60)


async def begins(url: str, context: ssl.SSLContext | None) -> None:
    """Check that page and sessions are reached at an address."""
    origin, token = url.split("/?")
    async with ClientSession() as client:
        async with client.get(url, ssl=context or True) as response:
            assert "Exercise with the coach" in await response.text()
        session = f"{origin}/session?{token}"
        async with client.ws_connect(session, origin=origin, ssl=context or True) as open_:
            assert (await open_.receive_json())["phase"] == "waiting"


def test_the_printed_address_opens_the_page_and_interrupting_ends_it_well(tmp_path: Path) -> None:
    with started(tmp_path) as (url, process):
        assert url.startswith("http://127.0.0.1:")
        asyncio.run(asyncio.wait_for(begins(url, None), 60))
        process.send_signal(signal.SIGINT)
        said = process.communicate(timeout=60)[1]
        assert process.returncode == 0
        assert said.strip().splitlines()[-1] == "stopped"
        assert "Traceback" not in said


@needs_openssl
@pytest.mark.slow
def test_over_https_page_and_sessions_are_reached_by_who_trusts_the_certificate(
    tmp_path: Path,
) -> None:
    certificate, key = self_signed(tmp_path)
    given = ("--host", LOOPBACK, "--certificate", str(certificate), "--key", str(key))
    with started(tmp_path, *given) as (url, _):
        assert url.startswith("https://127.0.0.1:")
        asyncio.run(
            asyncio.wait_for(begins(url, ssl.create_default_context(cafile=certificate)), 60)
        )
        with pytest.raises(ClientConnectionError):
            asyncio.run(asyncio.wait_for(begins(url, ssl.create_default_context()), 60))
        with pytest.raises(ClientConnectionError):
            asyncio.run(asyncio.wait_for(begins(url.replace("https", "http"), None), 60))


def test_without_packages_and_npm_the_command_says_what_to_do(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    if (WEB / "node_modules").exists():
        monkeypatch.setattr(
            "rcare_marl.baselines.coaching.page.packages.FILES", {"x": ("x", ("x.js",))}
        )
    monkeypatch.setenv("RCARE_MARL_CACHE", str(tmp_path))
    monkeypatch.setattr("shutil.which", lambda *_, **__: None)
    with pytest.raises(ConfigError, match="npm ci"):
        packages_folder()
