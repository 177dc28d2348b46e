"""Finds or makes the files of a robot: a user's URDF, or our model, drawn plain or by real meshes.

Our model alone decides dynamics and collision, so that results do not depend on what is installed.
An optional package adds nothing but the look.
"""

from __future__ import annotations

import importlib.metadata as metadata
from collections.abc import Collection, Mapping
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Literal
from xml.etree import ElementTree as xml

from rcare_marl import assets
from rcare_marl.config import load
from rcare_marl.errors import ConfigError, MissingPackageError
from rcare_marl.urdf import MeshFile, Model, write
from rcare_marl.urdf_reader import read

Meshes = Literal["auto", "never", "required"]


@dataclass(frozen=True)
class MeshPackage:
    """An optional package with a robot's real meshes.

    Attributes:
        distribution: Its name on PyPI.
        version: The version that was checked.
        extra: The extra of this package that installs it.
        urdf: End of the path of the URDF in it, whose link frames are ours.
        package_root: Folder that `package://` stands for, found as a part of the URDF's path.
        licence: Licence of the meshes.
    """

    distribution: str
    version: str
    extra: str
    urdf: str
    package_root: str
    licence: str


@dataclass(frozen=True)
class RobotFiles:
    """A robot ready to load.

    Attributes:
        urdf: The file to load.
        model: The data behind it.
        physics: Where dynamics and collision shapes come from, for people.
        visuals: Where the drawn shapes come from, for people.
    """

    urdf: Path
    model: Model
    physics: str
    visuals: str


def robot_files(
    model: str,
    package: MeshPackage | None = None,
    *,
    urdf: str | Path | None = None,
    meshes: Meshes = "never",
    fixed_joints: Mapping[str, float] | None = None,
    melt_except: Collection[str] | None = None,
) -> RobotFiles:
    """Return the files of a robot, made now if they are not in the cache.

    Args:
        model: Model file below `assets/robots`, such as `kinova_gen3/model.yaml`.
        package: The package with real meshes, if there is one.
        urdf: A URDF of the user's own, which then replaces the model altogether.
        meshes: `never` draws our own shapes, `required` the real meshes, `auto` those if installed.
        fixed_joints: Joints to freeze, with their positions [rad or m].
        melt_except: As for `rcare_marl.urdf.write`.

    Raises:
        ConfigError: If the model or the user's URDF cannot be read or used.
        UnknownNameError: If `fixed_joints` names a joint that is not there.
        MissingPackageError: If meshes are required and their package is not installed.
    """
    if urdf is not None:
        if fixed_joints:
            raise ConfigError(
                f"joints {sorted(fixed_joints)} cannot be frozen in the user's own URDF {urdf}: "
                "make them fixed in the file, or use gripper='free'"
            )
        return RobotFiles(Path(urdf), read(urdf), f"user's URDF {urdf}", f"user's URDF {urdf}")
    if meshes not in ("auto", "never", "required"):
        raise ConfigError(f"meshes must be one of auto, never, required, got {meshes!r}")
    data = _model(assets.ROOT / "robots" / model)
    drawn: dict[str, tuple[MeshFile, ...]] = {}
    look = "generated shapes"
    if meshes != "never":
        source = _installed(package) if package else None
        if source is None and meshes == "required":
            if package is None:
                raise ConfigError(f"no package has real meshes for {data.name}")
            raise MissingPackageError(f"real meshes of {data.name}", package.extra)
        if source is not None and package is not None:
            drawn = _mesh_visuals(source, package.package_root, frozenset(data.links))
            version = metadata.version(package.distribution)
            look = f"meshes of {package.distribution} {version} ({package.licence})"
    file = write(data, fixed_joints=fixed_joints, visuals=drawn, melt_except=melt_except)
    return RobotFiles(file, data, f"generated model; figures: {data.source}", look)


@lru_cache(maxsize=32)
def _model(path: Path) -> Model:
    return load(Model, path)


def _installed(package: MeshPackage) -> Path | None:
    """Return the URDF of an installed mesh package, or None."""
    try:
        files = metadata.files(package.distribution) or []
    except metadata.PackageNotFoundError:
        return None
    for file in files:
        if file.as_posix().endswith(package.urdf):
            path = Path(str(file.locate())).resolve()
            return path if path.is_file() else None
    return None


@lru_cache(maxsize=32)
def _mesh_visuals(
    urdf: Path, package_root: str, links: frozenset[str]
) -> dict[str, tuple[MeshFile, ...]]:
    """Return what a package's URDF draws for each of our `links`, with absolute paths."""
    text = urdf.as_posix()
    at = text.find(package_root) if package_root else -1
    root = Path(text[: at + len(package_root)]) if at >= 0 else urdf.parent
    out: dict[str, list[MeshFile]] = {}
    for link in xml.parse(urdf).getroot().iter("link"):
        name = link.get("name", "")
        if name not in links:
            continue
        for visual in link.iter("visual"):
            mesh = visual.find("geometry/mesh")
            if mesh is None:
                continue
            file = mesh.get("filename", "")
            path = root / file[10:] if file.startswith("package://") else urdf.parent / file
            if not path.is_file():
                raise ConfigError(f"{urdf} names a mesh that is not there: {path}")
            color = visual.find("material/color")
            rgba = _numbers(None if color is None else color.get("rgba"), (0.75, 0.75, 0.75, 1.0))
            x, y, z = _numbers(mesh.get("scale"), (1.0, 1.0, 1.0))
            origin = visual.find("origin")
            attributes = {} if origin is None else origin.attrib
            px, py, pz = _numbers(attributes.get("xyz"), (0.0, 0.0, 0.0))
            roll, pitch, yaw = _numbers(attributes.get("rpy"), (0.0, 0.0, 0.0))
            drawn = MeshFile(str(path), rgba, (x, y, z), (px, py, pz), (roll, pitch, yaw))
            out.setdefault(name, []).append(drawn)
    return {name: tuple(drawn) for name, drawn in out.items()}


def _numbers(text: str | None, default: tuple[float, ...]) -> tuple[float, ...]:
    return default if text is None else tuple(float(word) for word in text.split())
