"""Where three.js is, which draws the page: from npm, in the exact version of web/package-lock.json."""

from __future__ import annotations

import hashlib
import shutil
import subprocess
from pathlib import Path

from rcare_marl.atomic_file import draft
from rcare_marl.cache import cache_folder
from rcare_marl.console import print_line
from rcare_marl.errors import ConfigError

WEB = Path(__file__).parent / "web"
FILES = ("three.module.js", "three.core.js")  # the first imports the second
LONGEST = 300.0  # of the installation [s]


def three_folder(*, install: bool = True) -> Path:
    """Return the folder with three.js, installed now by npm if it is not there yet.

    It is looked for beside the page (where `make test-browser` puts it), then in the cache.

    Raises:
        ConfigError: If it is not there and cannot be installed; it says what to do.
    """
    recipe = (WEB / "package.json").read_bytes() + (WEB / "package-lock.json").read_bytes()
    cached = cache_folder() / f"coach-page-{hashlib.sha256(recipe).hexdigest()[:16]}"
    for place in (WEB, cached):
        build = place / "node_modules" / "three" / "build"
        if all((build / file).is_file() for file in FILES):
            return build
    command = f"cd {WEB} && npm ci --omit=dev --ignore-scripts"
    if not install:
        raise ConfigError(f"three.js is not installed: {command}")
    npm = shutil.which("npm")
    if npm is None:
        raise ConfigError(
            f"the page needs three.js from npm, which is not here: install Node, then {command}"
        )
    print_line(f"installing three.js with npm into {cached} (once)")
    _install(npm, cached, command)
    return cached / "node_modules" / "three" / "build"


def _install(npm: str, target: Path, command: str) -> None:
    """Install into a new folder and move it into place, whole or not at all."""
    try:
        with draft(target) as folder:
            for file in ("package.json", "package-lock.json"):
                shutil.copy(WEB / file, folder.path / file)
            done = subprocess.run(
                [npm, "ci", "--omit=dev", "--ignore-scripts", "--no-audit", "--no-fund"],
                cwd=folder.path,
                capture_output=True,
                text=True,
                timeout=LONGEST,
            )
            if done.returncode != 0:
                last = (done.stderr.strip() or "no message").splitlines()[-1]
                raise ConfigError(f"npm could not install three.js ({last}); try: {command}")
            if target.is_dir():  # one that is not whole
                shutil.rmtree(target)
            folder.publish()
    except (OSError, subprocess.TimeoutExpired) as error:
        raise ConfigError(f"three.js could not be installed: {error}; try: {command}") from error
