"""The docs' site in a browser: its own search finds words, axe finds nothing; `make test-browser` runs it."""

from __future__ import annotations

import functools
import http.server
import subprocess
import sys
import threading
from pathlib import Path
from typing import Any

import pytest
from browser import need, watched

ROOT = Path(__file__).parents[1]
PAGES = ("index.html", "tasks.html", "reference/environments.html")  # that axe looks at
WANTED = {  # a word, and a page that its search has to name
    "spasticity": "actuation.html",
    "make_batch": "learning_environments.html",
    "wheelchair": "devices.html",
    "replay": "datasets.html",
    "checkpoint": "learning.html",
    "curriculum": "curriculum.html",
    "aruco": "sensors.html",
    "xpbd": "paper.html",
    "temperament": "co_training.html",
    "audit": "homes.html",
    "tremor": "actuation.html",
    "impedance": "control.html",
    "moveit": "moveit.html",
    "lerobot": "datasets.html",
    "dysreflexia": "physiology.html",
    "sponge": "bathing.html",
    "gravity": "export.html",
    "headset": "coaching_page.html",
    "mujoco": "engines.html",
    "parallel_env": "reference/environments.html",
}


@pytest.mark.slow
def test_the_site_finds_twenty_words_and_bars_nobody(tmp_path: Path) -> None:
    need("axe-core", "playwright-core")
    site = tmp_path / "site"
    config = ROOT / "docs" / "site" / "mkdocs.yml"
    build = [sys.executable, "-m", "mkdocs", "build", "--strict", "-q", "-f", str(config)]
    subprocess.run([*build, "-d", str(site)], check=True, capture_output=True)
    seen = seen_of(tmp_path, site)
    missed = {w: seen["found"][w][:8] for w, page in WANTED.items() if page not in seen["found"][w]}
    assert len(WANTED) == 20 and not missed, missed
    assert not seen["violations"], "\n".join(seen["violations"])


def seen_of(folder: Path, site: Path) -> dict[str, Any]:
    """Serve the site on this computer, and return what the driver saw of it."""
    handler = functools.partial(Quiet, directory=str(site))
    with http.server.ThreadingHTTPServer(("127.0.0.1", 0), handler) as server:
        threading.Thread(target=server.serve_forever, daemon=True).start()
        url = f"http://127.0.0.1:{server.server_port}"
        seen = watched("site_page.mjs", folder, {"url": url, "words": list(WANTED), "pages": PAGES})
        server.shutdown()
    return seen


class Quiet(http.server.SimpleHTTPRequestHandler):
    def log_message(self, *_: object) -> None:
        """Say nothing of each request."""
