"""Finds or makes the files of a robot: a user's URDF, or our model, drawn plain or by real meshes.

Our model alone decides dynamics and collision, so that results do not depend on what is installed.
Real meshes, from an optional package or from a user's own files, add nothing but the look.
"""

from __future__ import annotations

import importlib.metadata as metadata
import logging
import os
from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass, field, replace
from functools import lru_cache
from pathlib import Path
from typing import Literal

from rcare_marl import assets
from rcare_marl.config import load
from rcare_marl.errors import ConfigError, MissingPackageError
from rcare_marl.model.shape import GREY, MeshFile
from rcare_marl.model.urdf import Model, write
from rcare_marl.model.urdf_document import Document
from rcare_marl.model.urdf_reader import MOST_JOINTS, check_driven, drawn_meshes, read

Meshes = Literal["auto", "never", "required"] | str | Path
"""`never`: our own shapes; `auto`: real meshes where there are any; `required`: those or an error;
or the path of a URDF of the user's own, whose meshes are drawn."""

MESH_FOLDERS = "RCARE_MARL_MESHES"
"""Environment variable: folders in which `<robot>.urdf` are a user's own copies, for the look."""

_LOG = logging.getLogger(__name__)


@dataclass(frozen=True)
class MeshPackage:
    """An optional package with a robot's real meshes, in a URDF or as files for a table of links.

    Attributes:
        distribution: Its name on PyPI.
        version: The version that was checked.
        extra: The extra of this package that installs it; empty if it is always installed.
        urdf: End of the path of a URDF in it, whose link frames are ours.
        package_root: A folder on that path in which `package://` names are looked for, where they
            are not found by the rules of `MeshPath`.
        licence: Licence of the meshes.
        meshes: Files by the link that they are drawn with, each by the end of its path in the package;
            this wins over the URDF.
        rename: Our name of a link by the URDF's, where they differ.
    """

    distribution: str
    version: str
    extra: str = ""
    urdf: str = ""
    package_root: str = ""
    licence: str = ""
    meshes: dict[str, tuple[MeshFile, ...]] = field(default_factory=dict)
    rename: dict[str, str] = field(default_factory=dict)

    def __post_init__(self) -> None:
        if not self.urdf and not self.meshes:
            raise ConfigError(f"the package {self.distribution} needs a `urdf` or `meshes`")


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


def robot_model(model: str, *, urdf: str | Path | None = None) -> Model:
    """Return the data of a robot; no file is made.

    Args:
        model: Model file below `assets/robots`, or a path of the user's own; not used with a URDF.
        urdf: A URDF of the user's own, which then replaces the model altogether.

    Raises:
        ConfigError: If the model or the user's URDF cannot be read or used.
    """
    if urdf is not None:
        return read(urdf)
    shipped = assets.ROOT / "robots" / model
    return _model(shipped if os.path.isfile(shipped) else Path(model).resolve())


def robot_files(
    model: str,
    package: MeshPackage | None = None,
    *,
    urdf: str | Path | None = None,
    meshes: Meshes = "never",
    fixed_joints: Mapping[str, float] | None = None,
    melt_except: Collection[str] | None = None,
    adapt: Callable[[Model], Model] | None = None,
) -> RobotFiles:
    """Return the files of a robot, made now if they are not in the cache.

    A user's URDF is written anew into the cache: with absolute paths of meshes, with convex hulls
    of those that collide, and with next to no mass for links that have none, of which Bullet would
    make 1 kg each.

    Args:
        model: Model file below `assets/robots`, such as `kinova_gen3/model.yaml`.
        package: The package with real meshes, if there is one.
        urdf: A URDF of the user's own, which then replaces the model altogether.
        meshes: What to draw in place of our own shapes, see `Meshes`. Real meshes are looked for
            in the installed package, then in the folders of `MESH_FOLDERS`.
        fixed_joints: Joints to freeze, with their positions [rad or m]. Where some are frozen in a
            user's URDF, all others must be such that the physics can move them.
        melt_except: As for `rcare_marl.model.urdf.write`.
        adapt: What adds links and joints to the model before it is written, such as a driving base.

    Raises:
        ConfigError: If the model, the user's URDF or the user's meshes cannot be read or used.
        UnknownNameError: If `fixed_joints` names a joint that is not there.
        MissingPackageError: If meshes are required and their package is not installed.
    """
    data = robot_model(model, urdf=urdf)
    if urdf is not None and fixed_joints is not None:
        driven = [n for n, j in data.joints.items() if j.kind != "fixed" and n not in fixed_joints]
        check_driven(data, driven, urdf)
    if adapt is not None:
        data = adapt(data)
    _check_size(data, fixed_joints or {}, melt_except)
    plain = "generated shapes" if urdf is None else f"user's URDF {urdf}"
    physics = f"generated model; figures: {data.source}" if urdf is None else plain
    drawn, look = _visuals(data, package, "never" if urdf and meshes in _WORDS else meshes)
    drawn = _painted(drawn, data)
    file = write(data, fixed_joints=fixed_joints, visuals=drawn, melt_except=melt_except)
    _say_once(data.name, physics, look or plain)
    return RobotFiles(file, data, physics, look or plain)


_WORDS = ("auto", "never", "required")
_UNCHOSEN = (GREY, (0.79216, 0.81961, 0.93333, 1.0))  # none, and what SolidWorks writes by itself
_Drawn = dict[str, tuple[MeshFile, ...]]


def _visuals(model: Model, package: MeshPackage | None, meshes: Meshes) -> tuple[_Drawn, str]:
    """Return the meshes to draw by link, and where they are from; empty for the model's own."""
    if meshes == "never":
        return {}, ""
    rename = {} if package is None else package.rename
    if meshes not in _WORDS:
        if not os.path.exists(meshes) and Path(meshes).suffix == "":
            raise ConfigError(
                f"meshes must be one of {', '.join(_WORDS)}, or the path of a URDF, got {meshes!r}"
            )
        return _own_meshes(Path(meshes), model, rename)
    if package is not None:
        try:
            return _package_meshes(package, model)
        except MissingPackageError:
            _LOG.debug("%s is not installed", package.distribution)
        except ConfigError as error:
            if meshes == "required":
                raise
            _LOG.warning("no real meshes for %s: %s", model.name, error)
    for folder in filter(None, os.environ.get(MESH_FOLDERS, "").split(os.pathsep)):
        own = Path(folder) / f"{model.name}.urdf"
        if os.path.isfile(own):
            return _own_meshes(own, model, rename)
    if meshes == "auto":
        return {}, ""
    if package is None:
        raise ConfigError(
            f"no package has real meshes for {model.name}: give meshes the path of a URDF that has "
            f"them, or put {model.name}.urdf into a folder named in {MESH_FOLDERS}"
        )
    what = f"real meshes of {model.name}"
    if package.extra:
        raise MissingPackageError(what, package.extra)
    raise MissingPackageError(what, package=package.distribution)


def _painted(drawn: _Drawn, model: Model) -> _Drawn:
    """Return the meshes with our colour of their link, where nobody chose one."""
    out = {}
    for name, meshes in drawn.items():
        shapes = model.links[name].visual if name in model.links else ()
        red, green, blue, alpha = model.materials[shapes[0].material] if shapes else GREY
        ours = (red, green, blue, alpha)
        out[name] = tuple(
            replace(mesh, rgba=ours) if _is_unchosen(mesh.rgba) else mesh for mesh in meshes
        )
    return out


def _is_unchosen(rgba: tuple[float, ...]) -> bool:
    return any(max(abs(a - b) for a, b in zip(rgba, c, strict=True)) < 1e-4 for c in _UNCHOSEN)


def _own_meshes(urdf: Path, model: Model, rename: Mapping[str, str]) -> tuple[_Drawn, str]:
    theirs = Document(urdf).named("link")  # they may have the package's names, or ours
    rename = {old: new for old, new in rename.items() if old in theirs}
    drawn = drawn_meshes(urdf, model.links, rename=rename)
    return drawn, f"meshes of the user's {urdf}, {len(drawn)} links"


def _package_meshes(package: MeshPackage, model: Model) -> tuple[_Drawn, str]:
    """Return what a package draws.

    Raises:
        MissingPackageError: If it is not installed.
        ConfigError: If it is, and lacks a file or draws nothing.
    """
    try:
        version = _files(package.distribution)[0]
    except metadata.PackageNotFoundError as error:
        raise MissingPackageError("drawing", package=package.distribution) from error
    drawn: _Drawn = {}
    if package.urdf:
        urdf = _installed(package, package.urdf)
        end = urdf.as_posix().find(package.package_root) + len(package.package_root)
        packages = (Path(urdf.as_posix()[:end]),) if package.package_root else ()
        drawn |= _cached_meshes(
            urdf, frozenset(model.links), tuple(package.rename.items()), packages
        )
    for link, parts in package.meshes.items():
        drawn[link] = tuple(
            replace(part, file=str(_installed(package, part.file))) for part in parts
        )
    return drawn, f"meshes of {package.distribution} {version} ({package.licence})"


@lru_cache(maxsize=32)
def _cached_meshes(
    urdf: Path,
    links: frozenset[str],
    rename: tuple[tuple[str, str], ...],
    packages: tuple[Path, ...],
) -> _Drawn:
    return drawn_meshes(urdf, links, rename=dict(rename), packages=packages)


def _installed(package: MeshPackage, end: str) -> Path:
    """Return the file of an installed package whose path ends so."""
    version, files = _files(package.distribution)
    tail = "/" + end.lstrip("/")
    found = min((name for name in files if ("/" + name).endswith(tail)), key=len, default=None)
    if found is None or not os.path.isfile(files[found]):
        raise ConfigError(
            f"{package.distribution} {version} is installed and has no file {end}; version "
            f"{package.version} was checked: pip install {package.distribution}=={package.version}"
        )
    return files[found].resolve()


@lru_cache(maxsize=16)
def _files(distribution: str) -> tuple[str, dict[str, Path]]:
    """Return the version and the files of a distribution; one that is not there is not kept."""
    found = metadata.distribution(distribution)
    names = [file.as_posix() for file in found.files or []]
    return found.version, {name: Path(str(found.locate_file(name))) for name in sorted(names)}


@lru_cache(maxsize=64)
def _model(path: Path) -> Model:
    return load(Model, path)


@lru_cache(maxsize=64)
def _say_once(name: str, physics: str, visuals: str) -> None:
    _LOG.info("robot %s: physics from %s; drawn from %s", name, physics, visuals)


def _check_size(
    model: Model, fixed_joints: Mapping[str, float], melt_except: Collection[str] | None
) -> None:
    """Refuse more joints than Bullet can answer questions about."""
    count = len(model.joints)
    if melt_except is not None:
        count = sum(
            (joint.kind != "fixed" and name not in fixed_joints) or joint.child in melt_except
            for name, joint in model.joints.items()
        )
    if count > MOST_JOINTS:
        raise ConfigError(
            f"{model.name} has {count} joints, fixed ones included; Bullet handles at most "
            f"{MOST_JOINTS}: take out links that carry nothing, or joints that need not move"
        )
