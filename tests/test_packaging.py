"""Installed in any of the three ways, the package finds every file that it needs."""

from __future__ import annotations

import json
import os
import re
import shutil
import subprocess
import sys
import zipfile
from collections.abc import Iterable
from pathlib import Path

import pytest

import rcare_marl
from rcare_marl.cli.listing import rows

ROOT = Path(__file__).resolve().parents[1]
PARTS = ("agents", "assets", "baselines", "envs")

# Everything that reads a file of the package, run far from the checkout.
_USE = """
import json, rcare_marl
from rcare_marl import assets
from rcare_marl.agents.people.avatar import load_avatar, load_posture
from rcare_marl.agents.robots.robot_config import load_robot
for name in assets.names("avatars"):
    assert load_avatar(name).body_path().is_file(), name
for name in assets.names("postures"):
    load_posture(name)
for name in assets.names("robots"):
    load_robot(name)
env = rcare_marl.make("feeding", policies={"robot": "scripted", "recipient": "cooperative"})
env.reset(seed=0)
env.step({})
print(json.dumps({"where": rcare_marl.__file__, "assets": str(assets.ROOT)}))
"""


@pytest.fixture(scope="module")
def source(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a copy of what git tracks, so that a build leaves nothing in the checkout."""
    folder = tmp_path_factory.mktemp("source")
    listed = subprocess.run(
        ["git", "ls-files", "-co", "--exclude-standard"],
        cwd=ROOT,
        capture_output=True,
        text=True,
        check=True,
    )
    for name in listed.stdout.splitlines():
        origin, target = ROOT / name, folder / name
        if origin.is_symlink() or origin.is_file():
            target.parent.mkdir(parents=True, exist_ok=True)
            shutil.copy2(origin, target, follow_symlinks=False)
    return folder


@pytest.fixture(scope="module")
def wheel(source: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("wheel")
    command = [sys.executable, "-m", "pip", "wheel", "--no-deps", "-q", "-w", str(out), str(source)]
    subprocess.run(command, check=True, capture_output=True)
    return next(out.glob("*.whl"))


@pytest.mark.slow
def test_the_wheel_holds_every_module_and_asset_once(wheel: Path, source: Path) -> None:
    with zipfile.ZipFile(wheel) as archive:
        names = archive.namelist()
    assert len(names) == len(set(names))
    for part in PARTS:
        for file in (source / part).rglob("*"):
            if file.is_file() and file.suffix in (".py", ".yaml", ".npz"):
                assert f"rcare_marl/{file.relative_to(source)}" in names
    assert "rcare_marl/py.typed" in names
    for file in (source / "rcare_marl" / "rendering" / "glsl").iterdir():
        assert str(file.relative_to(source)) in names
    assert not any(name.startswith(("tests/", "experiments/", "agents/")) for name in names)


def _environment(folder: Path) -> Path:
    """Return the Python of a fresh environment that borrows the installed dependencies."""
    subprocess.run([sys.executable, "-m", "venv", str(folder)], check=True)
    python = folder / "bin" / "python"
    site = subprocess.run(
        [str(python), "-c", "import site; print(site.getsitepackages()[0])"],
        capture_output=True,
        text=True,
        check=True,
    ).stdout.strip()
    ours = Path(shutil.__file__).parent  # only to be sure that site-packages is not the library
    borrowed = [path for path in sys.path if path.endswith("site-packages") and path != str(ours)]
    (Path(site) / "borrowed.pth").write_text("\n".join(borrowed) + "\n")
    return python


@pytest.mark.slow
@pytest.mark.parametrize("way", ["wheel", "folder", "editable"])
def test_each_way_to_install_finds_every_asset(
    way: str, wheel: Path, source: Path, tmp_path: Path
) -> None:
    python = _environment(tmp_path / "venv")
    what = {"wheel": [str(wheel)], "folder": [str(source)], "editable": ["-e", str(source)]}[way]
    install = [
        str(python),
        "-m",
        "pip",
        "install",
        "-q",
        "--no-deps",
        "--force-reinstall",
        "--no-build-isolation",
        *what,
    ]
    if way != "wheel":
        install.remove("--no-build-isolation")
    subprocess.run(install, check=True, capture_output=True)
    elsewhere = tmp_path / "elsewhere"
    elsewhere.mkdir()
    environment = {key: value for key, value in os.environ.items() if key != "PYTHONPATH"}
    run = subprocess.run(
        [str(python), "-c", _USE], cwd=elsewhere, capture_output=True, text=True, env=environment
    )
    assert run.returncode == 0, run.stderr
    found = json.loads(run.stdout.splitlines()[-1])
    home = str(source) if way == "editable" else str(tmp_path / "venv")
    assert found["where"].startswith(home) and found["assets"].startswith(home)


TORCH = {"tensorboard", "tensordict", "torch", "torchrl"}
PICTURES = {"imageio", "matplotlib", "moderngl", "opencv-python-headless"}


def _names(lines: Iterable[str]) -> set[str]:
    found = (re.match(r"[\w.-]+", line) for line in lines if not line.startswith(("#", "-")))
    return {match[0].lower() for match in found if match}


def test_environments_alone_need_all_but_torch_and_pictures() -> None:
    said = re.search(
        r"^dependencies = \[(.*?)^\]", (ROOT / "pyproject.toml").read_text(), re.M | re.S
    )
    assert said is not None
    every = _names(re.findall(r'^ *"([^"]+)"', said[1], re.M))
    few = _names((ROOT / "docs" / "environments.txt").read_text().splitlines())
    assert every - few == TORCH | PICTURES and few < every


def test_what_is_locked_are_the_versions_that_are_tested() -> None:
    locked, pinned = (
        set(re.findall(r"^([\w-]+==[\w.]+)", file.read_text().lower().replace("_", "-"), re.M))
        for file in (ROOT / "docs" / "environments.lock", ROOT / "constraints.txt")
    )
    few = _names((ROOT / "docs" / "environments.txt").read_text().replace("_", "-").splitlines())
    assert locked <= pinned and few <= {each.partition("==")[0] for each in locked}


def test_environments_step_where_torch_and_pictures_are_missing() -> None:
    missing = sorted({"cv2", "imageio_ffmpeg", *TORCH, *PICTURES - {"opencv-python-headless"}})
    code = f"""
import sys
for name in {missing!r}:
    sys.modules[name] = None
import rcare_marl
from rcare_marl.cli.listing import rows
env = rcare_marl.make("feeding", policies={{"robot": "learned", "recipient": "cooperative"}})
env.reset(seed=0)
env.step({{}})
from rcare_marl.cli import main
sys.argv = ["rcare-marl", "train", "feeding"]
main()
"""
    run = subprocess.run([sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True)
    assert run.returncode == 2, run.stderr
    assert "needs t" in run.stderr and "not installed" in run.stderr
    assert "Traceback" not in run.stderr


def test_every_place_names_the_same_version() -> None:
    version = rcare_marl.__version__
    assert f'\nversion = "{version}"' in (ROOT / "pyproject.toml").read_text()
    assert f"\nversion: {version}\n" in (ROOT / "docs" / "CITATION.cff").read_text()
    assert f"\n## {version}" in (ROOT / "docs" / "changelog.md").read_text()


def test_ci_goes_on_where_nothing_can_be_installed(tmp_path: Path) -> None:
    (tmp_path / ".ci").mkdir()
    shutil.copy(ROOT / ".ci" / "run", tmp_path / ".ci" / "run")
    (tmp_path / "Makefile").write_text(
        "setup lint types docs ros test:\n\t@echo $@ [$$RCARE_MARL_REQUIRE_GL]\n"
    )
    few = tmp_path / "bin"  # no dpkg and no apt-get among them
    few.mkdir()
    for name in ("bash", "dirname", "id", "make"):
        (few / name).symlink_to(shutil.which(name) or name)
    run = subprocess.run(
        [str(few / "bash"), str(tmp_path / ".ci" / "run")],
        env={"PATH": str(few)},
        capture_output=True,
        text=True,
    )
    assert run.returncode == 0, run.stderr
    first, *beside, last = run.stdout.split()[::2]
    assert (first, sorted(beside), last) == ("setup", ["docs", "lint", "types"], "test")
    assert run.stdout.split()[1::2] == ["[]"] * 5
    assert "libegl1" in run.stderr and "ROS 2 is skipped" in run.stderr


def test_licences_of_what_is_needed_are_listed() -> None:
    told = {row["name"].lower(): row["licence"] for row in rows("licences")}
    assert {"pettingzoo", "gymnasium", "pybullet", "torch", "torchrl", "trimesh"} <= set(told)
    assert "zlib" in told["pybullet"] and all(told.values())
