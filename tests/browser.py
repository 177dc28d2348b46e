"""What tests in Chromium share: is it there, serve an application, run a driver in Node."""

from __future__ import annotations

import asyncio
import json
import os
import shutil
import ssl
import subprocess
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest

if TYPE_CHECKING:
    from aiohttp import web

# Where `make test-browser` installs what pages and their tests take from npm.
WEB = Path(__file__).resolve().parents[1] / "baselines" / "coaching" / "page" / "web"
PATIENCE = 120.0  # for anything on the page to happen on a loaded machine [s]
REQUIRED = "RCARE_MARL_REQUIRE_BROWSER"  # set by make test-browser: these tests must not be skipped
NAMES = ("chromium", "chromium-browser", "google-chrome", "google-chrome-stable")
CHROMIUM = next((found for name in NAMES if (found := shutil.which(name))), None)


def need(*packages: str) -> None:
    """Skip, or fail where it must not, if Chromium, Node or packages of npm are not installed."""
    there = {
        "Chromium (on Debian: apt-get install chromium)": CHROMIUM,
        "Node (on Debian: apt-get install nodejs npm)": shutil.which("node"),
        "the pages' npm packages (make browser)": all(
            (WEB / "node_modules" / name / "package.json").is_file() for name in packages
        ),
    }
    reason = f"not installed: {'; '.join(what for what in there if not there[what])}"
    if not all(there.values()) and os.environ.get(REQUIRED):
        pytest.fail(reason, pytrace=False)
    if not all(there.values()):
        pytest.skip(reason)


@contextmanager
def serving(app: web.Application, context: ssl.SSLContext | None = None) -> Iterator[str]:
    """Serve an application on a free port of this computer; yield its address."""
    from aiohttp import web

    loop, ready, ports = asyncio.new_event_loop(), threading.Event(), list[int]()

    async def start() -> web.AppRunner:
        runner = web.AppRunner(app, handle_signals=False)
        await runner.setup()
        site = web.TCPSite(runner, "127.0.0.1", 0, shutdown_timeout=1.0, ssl_context=context)
        await site.start()
        ports.append(runner.addresses[0][1])
        ready.set()
        return runner

    def work() -> None:
        runner = loop.run_until_complete(start())
        loop.run_forever()
        loop.run_until_complete(runner.cleanup())
        loop.close()

    thread = threading.Thread(target=work, daemon=True)
    thread.start()
    assert ready.wait(PATIENCE)
    yield f"{'http' if context is None else 'https'}://127.0.0.1:{ports[0]}"
    loop.call_soon_threadsafe(loop.stop)
    thread.join(30)


def watched(driver: str, folder: Path, job: dict[str, Any]) -> dict[str, Any]:
    """Return what a driver beside this file saw of a page; there was no error, and nothing from outside."""
    file = folder / "job.json"
    here = {"web": str(WEB), "chromium": CHROMIUM, "patience": 1000 * PATIENCE}
    file.write_text(json.dumps({**here, **job}))
    done = subprocess.run(
        ["node", str(Path(__file__).with_name(driver)), str(file)],
        capture_output=True,
        text=True,
        timeout=6 * PATIENCE,
    )
    assert done.returncode == 0, done.stderr
    seen: dict[str, Any] = json.loads(done.stdout.splitlines()[-1])
    assert not seen["errors"], seen["errors"]
    assert not seen["outside"], "the page asked for something outside this computer"
    return seen
