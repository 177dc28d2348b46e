"""Reads any URDF file into a model, and says clearly what is wrong with one that cannot be used."""

from __future__ import annotations

import logging
from collections.abc import Collection, Iterable, Mapping
from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path
from xml.etree import ElementTree as xml

import numpy as np

from rcare_marl.errors import ConfigError, UnknownNameError, check_name
from rcare_marl.model.shape import GREY, SOLID, ZERO, MeshFile, Rgba, Shape, Triple
from rcare_marl.pose import Pose, rpy_from_matrix

from . import inertia
from .mesh_file import DRAWN, MeshPath, hulls
from .urdf import FRAME_INERTIA, FRAME_MASS, Follow, Joint, Link, Model, joint_pose
from .urdf_document import FARTHEST, Document, parents_first, resolved

MOST_JOINTS = 127  # Bullet answers no questions about links beyond, and drops motors in silence
_SIZES = {
    "box": ("size",),
    "sphere": ("radius",),
    "cylinder": ("radius", "length"),
    "capsule": ("radius", "length"),
}
_KINDS = ("fixed", "revolute", "continuous", "prismatic")
_LOG = logging.getLogger(__name__)


def read(path: str | Path, *, repair: bool = True, packages: Iterable[str | Path] = ()) -> Model:
    """Return the model in a URDF file.

    Mesh files are found as `MeshPath` says; what a mesh collides with is its convex hull. Links
    without `<inertial>` are frames without mass. Materials are named by their colour. A joint that
    follows a follower follows the first of them.

    Args:
        path: The file.
        repair: Whether an inertia that no rigid body can have is replaced by that of a box round
            the link's shape, with a warning in the log; otherwise it is an error.
        packages: Folders that `package://` names are looked for in first.

    Raises:
        ConfigError: If there is no such file, or something in it is wrong or missing.
    """
    file = Path(path)
    try:
        stat = file.stat()
        seen = (stat.st_mtime_ns, stat.st_size)
    except OSError:
        seen = (0, 0)  # `Document` says what is wrong
    return _read(file, repair, tuple(str(package) for package in packages), seen)


@lru_cache(maxsize=32)
def _read(file: Path, repair: bool, packages: tuple[str, ...], _: tuple[int, int]) -> Model:
    reader = _Reader(Document(file), packages)
    links, joints = reader.links(), reader.joints()
    joints = resolved(parents_first(links, joints, file), file)
    children = {joint.child for joint in joints.values()}
    root = next(name for name in links if name not in children)
    movable = sum(joint.kind != "fixed" for joint in joints.values())
    if movable > MOST_JOINTS:
        raise ConfigError(
            f"{file} has {movable} movable joints; Bullet handles at most {MOST_JOINTS}: make some "
            "of them fixed"
        )
    links = _with_possible_inertia(file, {root: links[root], **links}, repair)
    name = reader.document.root.get("name", "").strip() or file.stem
    return Model(name, str(file), links, materials=reader.materials, joints=joints)


def drawn_meshes(
    path: str | Path,
    links: Collection[str],
    *,
    rename: Mapping[str, str] | None = None,
    packages: Iterable[str | Path] = (),
) -> dict[str, tuple[MeshFile, ...]]:
    """Return the meshes that a URDF draws for each of `links`; its physics is not looked at.

    What is drawn for a link of another name counts for the link that carries it by fixed joints.

    Args:
        path: The file.
        links: Names of the links that are wanted.
        rename: Names of links in `links` for names in the file, where they differ.
        packages: As for `read`.

    Raises:
        ConfigError: If there is no such file, it is no URDF, or its meshes cannot be found.
    """
    reader = _Reader(Document(path), tuple(packages))
    rename = dict(rename or {})
    elements = reader.document.named("link")
    for theirs in rename:
        if theirs not in elements:
            raise ConfigError(str(UnknownNameError(f"link in {path}", theirs, elements)))
    carriers = {joint.child: joint for joint in reader.joints(fixed_only=True).values()}
    wanted: dict[str, list[tuple[xml.Element, Pose]]] = {}
    for name, element in elements.items():
        carrier, pose, seen = name, Pose(), {name}
        while rename.get(carrier, carrier) not in links and carrier in carriers:
            joint = carriers[carrier]
            carrier, pose = joint.parent, joint_pose(joint) @ pose
            if carrier in seen:
                break
            seen.add(carrier)
        ours = rename.get(carrier, carrier)
        if ours in links:
            wanted.setdefault(ours, []).append((element, pose))
    out = {}
    for ours, parts in wanted.items():
        meshes = [_moved(mesh, pose) for element, pose in parts for mesh in reader.drawn(element)]
        if meshes:
            out[ours] = tuple(meshes)
    reader.require_meshes()
    if not out:
        theirs = ", ".join(list(elements)[:12])
        raise ConfigError(
            f"{path} has meshes for none of the links {', '.join(sorted(links)[:12])}; its links "
            f"are {theirs}: another robot, or links of other names"
        )
    return out


def _moved(mesh: MeshFile, pose: Pose) -> MeshFile:
    if pose == Pose():
        return mesh
    placed = pose @ mesh.pose()
    x, y, z = placed.position
    return replace(mesh, at=(x, y, z), rpy=rpy_from_matrix(placed.matrix()[:3, :3]))


def check_driven(model: Model, joints: Iterable[str], where: object = "") -> None:
    """Refuse joints that the physics would not move though it is told to.

    Args:
        model: What has the joints.
        joints: Names of the joints that will be driven.
        where: The file to name in the message; the model's source if empty.

    Raises:
        UnknownNameError: If there is no joint of that name.
        ConfigError: If one is fixed, has no effort, no speed, no travel, or nothing with a mass
            to move.
    """
    carried = {name: link.mass for name, link in model.links.items()}
    for joint in reversed(model.joints.values()):
        carried[joint.parent] += carried[joint.child]
    problems = []
    for name in joints:
        check_name(f"joint in {where or model.source}", name, model.joints)
        joint = model.joints[name]
        if joint.kind == "fixed":
            problems.append(f"{name!r} is fixed")
            continue
        lacking = [w for w, v in (("effort", joint.effort), ("velocity", joint.velocity)) if v == 0]
        if lacking and joint.follows is None:
            given = " ".join(f'{word}="..."' for word in lacking)
            problems.append(
                f"{name!r} has no {' and no '.join(lacking)}: give <limit {given}> above 0"
            )
        if joint.kind != "continuous" and joint.lower == joint.upper:
            problems.append(f"{name!r} has no travel: lower and upper are both {joint.lower}")
        if carried[joint.child] == 0:
            problems.append(
                f"{name!r} moves only links without mass: give {joint.child!r} an <inertial>"
            )
    if problems:
        raise ConfigError(
            f"{where or model.source}: the physics could not move these joints: "
            + "; ".join(problems)
        )


@dataclass
class _Reader:
    """Turns the elements of a document into links and joints."""

    document: Document
    packages: Iterable[str | Path]

    def __post_init__(self) -> None:
        self._paths = MeshPath(self.document.path, self.packages)
        self._missing: dict[str, str] = {}
        self.materials: dict[str, tuple[float, ...]] = {}
        self._colors: dict[str, Rgba] = {}
        for element in self.document.root.iter("material"):
            color = element.find("color")
            if color is not None:
                self._colors.setdefault(element.get("name", ""), self._rgba(color))

    def links(self) -> dict[str, Link]:
        elements = self.document.named("link")
        if not elements:
            raise ConfigError(f"{self.document.path} has no links: it needs at least one <link>")
        out = {name: self._link(element) for name, element in elements.items()}
        self.require_meshes()
        return out

    def joints(self, *, fixed_only: bool = False) -> dict[str, Joint]:
        elements = self.document.named("joint")
        if fixed_only:
            elements = {n: e for n, e in elements.items() if e.get("type") == "fixed"}
        return {name: self._joint(element) for name, element in elements.items()}

    def drawn(self, link: xml.Element) -> list[MeshFile]:
        """Return the meshes that are drawn with a link."""
        out = []
        for visual in link.findall("visual"):
            mesh = self.document.child(visual, "geometry").find("mesh")
            found = None if mesh is None else self._mesh(visual, mesh)
            if found is not None:
                out.append(found)
        return out

    def require_meshes(self) -> None:
        """Raise an error that lists the mesh files that were not found, if any."""
        if not self._missing:
            return
        listed = [f"{name} (looked in {where})" for name, where in self._missing.items()]
        more = f"; and {len(listed) - 5} more" if len(listed) > 5 else ""
        raise ConfigError(
            f"{self.document.path} names meshes that are not there: {'; '.join(listed[:5])}{more}. "
            "Put them there, or name the folder of their package in ROS_PACKAGE_PATH"
        )

    def _link(self, element: xml.Element) -> Link:
        mass, com, moments = self._inertial(element.find("inertial"))
        visual, meshes, collision, hulls = [], [], [], []
        for shown in element.findall("visual"):
            shape = self._shape(shown, is_drawn=True)
            if isinstance(shape, Shape):
                rgba = self._paint(shown)
                material = "rgba_" + "_".join(f"{round(255 * value)}" for value in rgba)
                self.materials[material] = rgba
                visual.append(replace(shape, material=material))
            elif shape is not None:
                meshes.append(shape)
        for solid in element.findall("collision"):
            shape = self._shape(solid)
            if isinstance(shape, Shape):
                collision.append(shape)
            elif shape is not None:
                hulls.append(shape)
        shapes = (tuple(visual), tuple(collision), tuple(meshes), tuple(hulls))
        return Link(mass, com, moments, *shapes)

    def _inertial(self, element: xml.Element | None) -> tuple[float, Triple, inertia.Inertia]:
        frame = Link()
        if element is None:
            return frame.mass, frame.com, frame.inertia
        weight = self.document.child(element, "mass")
        mass = self.document.number(weight, "value")
        if mass < 0:
            raise self.document.fault(weight, f"a mass cannot be negative, got {mass}")
        com, rpy = self._origin(element)
        given = element.find("inertia")
        xx, xy, xz, yy, yz, zz = frame.inertia
        if given is not None:
            number = self.document.number
            xx, yy, zz = (number(given, name) for name in ("ixx", "iyy", "izz"))
            xy, xz, yz = (number(given, name, 0.0) for name in ("ixy", "ixz", "iyz"))
        moments = inertia.turned((xx, xy, xz, yy, yz, zz), rpy)
        if mass == 0 or (mass == FRAME_MASS and moments == FRAME_INERTIA):
            return frame.mass, frame.com, frame.inertia  # as `write` gives to a frame
        return mass, com, moments

    def _shape(self, element: xml.Element, *, is_drawn: bool = False) -> Shape | MeshFile | None:
        """Return the shape of a visual or collision element.

        None stands for a mesh that is missing, or something so small that it is not drawn.
        """
        geometry = self.document.child(element, "geometry")
        kinds = [child for child in geometry if child.tag in (*SOLID, "mesh")]
        if len(kinds) != 1:
            got = ", ".join(f"<{child.tag}>" for child in geometry) or "nothing"
            allowed = ", ".join(f"<{kind}>" for kind in (*SOLID, "mesh"))
            raise self.document.fault(geometry, f"expected one of {allowed}, got {got}")
        shape = kinds[0]
        if shape.tag == "mesh":
            return self._mesh(element, shape)
        at, rpy = self._origin(element)
        sizes = {
            word: self.document.numbers(shape, word, 3 if word == "size" else 1)
            for word in _SIZES[shape.tag]
        }
        for word, values in sizes.items():
            if min(values) <= 0 and not (is_drawn and min(values) == 0):
                got = " ".join(f"{value:g}" for value in values)
                raise self.document.fault(shape, f"{word} must be positive, got {got}")
            if max(values) > FARTHEST:
                raise self.document.fault(shape, f"{word} must be at most {FARTHEST:g} m")
        if not all(all(values) for values in sizes.values()):
            return None
        x, y, z = sizes.get("size", ZERO)
        return Shape(
            shape.tag,  # type: ignore[arg-type]  # one of SOLID
            at=at,
            rpy=rpy,
            size=(x, y, z),
            radius=sizes.get("radius", (0.0,))[0],
            length=sizes.get("length", (0.0,))[0],
        )

    def _mesh(self, element: xml.Element, mesh: xml.Element) -> MeshFile | None:
        name = self.document.text(mesh, "filename")
        if not name.lower().endswith(DRAWN):
            raise self.document.fault(
                mesh, f"cannot read the mesh {name!r}: its format must be one of {', '.join(DRAWN)}"
            )
        found = self._paths.find(name)
        if found is None:
            self._missing.setdefault(name, self._paths.looked_in(name))
            return None
        scale = self.document.triple(mesh, "scale", (1.0, 1.0, 1.0))
        if not all(scale):
            raise self.document.fault(mesh, f"no part of scale may be 0, got {scale}")
        at, rpy = self._origin(element)
        return MeshFile(str(found), self._paint(element), scale, at, rpy)

    def _paint(self, element: xml.Element) -> Rgba:
        material = _child(element, "material")
        color = material.find("color")
        named = self._colors.get(material.get("name", ""), GREY)
        return named if color is None else self._rgba(color)

    def _rgba(self, color: xml.Element) -> Rgba:
        count = 3 if len(color.get("rgba", "").split()) == 3 else 4  # opaque, where nothing is said
        values = self.document.numbers(color, "rgba", count)
        if not all(0 <= value <= 1 for value in values):
            raise self.document.fault(color, f"rgba must lie between 0 and 1, got {values}")
        red, green, blue, *alpha = values
        return red, green, blue, alpha[0] if alpha else 1.0

    def _origin(self, element: xml.Element) -> tuple[Triple, Triple]:
        origin, triple = _child(element, "origin"), self.document.triple
        return triple(origin, "xyz", ZERO), triple(origin, "rpy", ZERO)

    def _joint(self, element: xml.Element) -> Joint:
        kind = self.document.text(element, "type")
        if kind not in _KINDS:
            hint = "; its base is placed by a mount" if kind in ("floating", "planar") else ""
            raise self.document.fault(
                element, f"a joint of a robot is one of {', '.join(_KINDS)}, got {kind!r}{hint}"
            )
        document = self.document
        parent, child = (
            document.text(document.child(element, tag), "link") for tag in ("parent", "child")
        )
        at, rpy = self._origin(element)
        if kind == "fixed":
            return Joint("fixed", parent, child, at, rpy)
        axis, limits, follow = (
            self._axis(element),
            self._limits(element, kind),
            self._follow(element),
        )
        resistance = _child(element, "dynamics")
        loss = (document.number(resistance, word, 0.0) for word in ("damping", "friction"))
        return Joint(kind, parent, child, at, rpy, axis, *limits, follow, *loss)  # type: ignore[arg-type]

    def _axis(self, element: xml.Element) -> Triple:
        axis = element.find("axis")
        if axis is None:
            return (1.0, 0.0, 0.0)
        x, y, z = self.document.triple(axis, "xyz")
        length = float(np.linalg.norm((x, y, z)))
        if length < 1e-9:
            raise self.document.fault(axis, f"an axis cannot have length 0, got {(x, y, z)}")
        if abs(length - 1) < 1e-6:
            return (x, y, z)
        return (x / length, y / length, z / length)

    def _limits(self, element: xml.Element, kind: str) -> tuple[float, float, float, float]:
        limit = _child(element, "limit")
        if kind != "continuous" and element.find("limit") is None:
            raise self.document.fault(
                element,
                f'a {kind} joint needs <limit lower=".." upper=".." effort=".." velocity=".."/>',
            )
        effort, velocity = (self.document.number(limit, w, 0.0) for w in ("effort", "velocity"))
        for word, value in (("effort", effort), ("velocity", velocity)):
            if value < 0:
                raise self.document.fault(limit, f"{word} cannot be negative, got {value:g}")
        if kind == "continuous":
            return 0.0, 0.0, effort, velocity
        if limit.get("lower") is None and limit.get("upper") is None:
            other = ' (or make the joint type="continuous")' if kind == "revolute" else ""
            raise self.document.fault(limit, f"a {kind} joint needs lower and upper{other}")
        lower, upper = (self.document.number(limit, word, 0.0) for word in ("lower", "upper"))
        if lower > upper:
            raise self.document.fault(limit, f"lower {lower:g} exceeds upper {upper:g}")
        return lower, upper, effort, velocity

    def _follow(self, element: xml.Element) -> Follow | None:
        mimic = element.find("mimic")
        if mimic is None:
            return None
        number = self.document.number
        other = self.document.text(mimic, "joint")
        return Follow(other, number(mimic, "multiplier", 1.0), number(mimic, "offset", 0.0))


def _child(element: xml.Element, tag: str) -> xml.Element:
    """Return a child that need not be there: one without attributes, where it is not."""
    found = element.find(tag)
    return xml.Element(tag) if found is None else found


def _with_possible_inertia(file: Path, links: dict[str, Link], repair: bool) -> dict[str, Link]:
    """Return the links, each with an inertia that a rigid body can have."""
    faults = {}
    out = dict(links)
    for name, link in links.items():
        if link.mass == 0:
            continue
        fault = inertia.fault(link.inertia)
        if fault:
            faults[name] = fault
        if repair:
            good = _of_shape(link) if fault else inertia.nearest(link.inertia)
            out[name] = replace(link, inertia=good)
    if faults:
        listed = "; ".join(f"{name!r}: {fault}" for name, fault in faults.items())
        if not repair:
            raise ConfigError(f"{file} has inertias that no rigid body can have: {listed}")
        _LOG.warning(
            "%s has inertias that no rigid body can have, replaced by that of a box round the shape, "
            "or of a ball of water where there is none: %s",
            file,
            listed,
        )
    return out


def _of_shape(link: Link) -> inertia.Inertia:
    """Return the inertia of a box round what a link collides with, or is drawn with."""
    for shapes, meshes in ((link.collision, link.hulls), (link.visual, link.meshes)):
        clouds = [shape.mesh().vertices for shape in shapes]
        for mesh in meshes:
            pose = mesh.pose().matrix()
            for corners in hulls(mesh.file):
                clouds.append(corners * mesh.scale @ pose[:3, :3].T + pose[:3, 3])
        if clouds:
            return inertia.of_box(link.mass, np.ptp(np.concatenate(clouds), axis=0))
    return inertia.of_ball(link.mass)
