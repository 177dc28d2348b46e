"""URDF files that tests write, and a cache of their own, for several files of tests."""

from __future__ import annotations

from pathlib import Path

import pytest

BODY = '<inertial><mass value="1"/><inertia ixx="0.01" iyy="0.01" izz="0.01"/></inertial>'
LIMIT = '<limit lower="-1" upper="1" effort="5" velocity="2"/>'


@pytest.fixture(scope="module")
def cache(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("cache")


@pytest.fixture(autouse=True)
def own_cache(cache: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("RCARE_MARL_CACHE", str(cache))


def urdf(tmp_path: Path, body: str, name: str = "robot.urdf") -> Path:
    file = tmp_path / name
    file.parent.mkdir(parents=True, exist_ok=True)
    file.write_text(f'<?xml version="1.0"?>\n<robot name="r">\n{body}\n</robot>\n')
    return file


def link(name: str, inside: str = BODY) -> str:
    return f'<link name="{name}">{inside}</link>\n'


def joint(name: str, parent: str, child: str, inside: str = LIMIT, kind: str = "revolute") -> str:
    return (
        f'<joint name="{name}" type="{kind}"><parent link="{parent}"/><child link="{child}"/>'
        f"{inside}</joint>\n"
    )


def arm(first: str = LIMIT, kind: str = "revolute") -> str:
    return link("a") + link("b") + joint("j", "a", "b", first, kind)


def hull_file(tmp_path: Path) -> Path:
    file = tmp_path / "meshes" / "part.obj"
    file.parent.mkdir(parents=True, exist_ok=True)
    corners = [(x, y, z) for x in (0, 0.1) for y in (0, 0.2) for z in (0, 0.3)]
    rows = [f"v {x} {y} {z}" for x, y, z in corners]
    faces = [
        "1 2 4",
        "1 4 3",
        "5 7 8",
        "5 8 6",
        "1 5 6",
        "1 6 2",
        "3 4 8",
        "3 8 7",
        "1 3 7",
        "1 7 5",
    ]
    file.write_text("\n".join([*rows, *(f"f {face}" for face in faces), "f 2 6 8", "f 2 8 4"]))
    return file
