"""Models of linked bodies as data, and the URDF files that PyBullet loads, made from it."""

from __future__ import annotations

import math
import re
import zlib
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import lru_cache
from pathlib import Path
from typing import Literal
from xml.etree import ElementTree as xml

import numpy as np

from rcare_marl.cache import cached_folder
from rcare_marl.errors import check_name
from rcare_marl.pose import Pose, Vector, quaternion_from_axis_angle, quaternion_from_rpy

from . import inertia, mesh, mesh_file
from . import shape as shape_module
from .shape import SOLID, ZERO, MeshFile, Shape, Triple, surface, turn_rpy

# A link without mass would become 1 kg in Bullet: a frame weighs a hundredth of a gram.
FRAME_MASS = 1e-5  # [kg]
FRAME_INERTIA = (1e-9, 0.0, 0.0, 1e-9, 0.0, 1e-9)  # [kg·m²]


@dataclass(frozen=True)
class Link:
    """A rigid part.

    Attributes:
        mass: Mass [kg]; zero makes a frame without weight.
        com: Centre of mass in the link's frame [m].
        inertia: ixx, ixy, ixz, iyy, iyz, izz about the centre of mass, link's axes [kg·m²].
        visual: What to draw.
        collision: What to collide with; boxes, spheres, cylinders and capsules only.
        meshes: Mesh files to draw as well.
        hulls: Mesh files by whose convex hulls it collides as well.
    """

    mass: float = 0.0
    com: Triple = ZERO
    inertia: tuple[float, float, float, float, float, float] = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    visual: tuple[Shape, ...] = ()
    collision: tuple[Shape, ...] = ()
    meshes: tuple[MeshFile, ...] = ()
    hulls: tuple[MeshFile, ...] = ()

    def __post_init__(self) -> None:
        if self.mass < 0:
            raise ValueError(f"a mass cannot be negative, got {self.mass}")
        for shape in self.collision:
            if shape.kind not in SOLID:
                raise ValueError(f"a {shape.kind} cannot collide, only one of {', '.join(SOLID)}")


@dataclass(frozen=True)
class Follow:
    """How a joint follows another: position = multiplier × the other's + offset."""

    joint: str
    multiplier: float = 1.0
    offset: float = 0.0


@dataclass(frozen=True)
class Joint:
    """What joins two links, as in URDF.

    Attributes:
        kind: Kind of joint.
        parent: Link that carries.
        child: Link that is carried.
        at: Origin of the child's frame in the parent's [m].
        rpy: Turn of the child's frame in the parent's, fixed axes [rad].
        axis: Axis of motion in the child's frame.
        lower: Lower limit [rad or m].
        upper: Upper limit [rad or m].
        effort: Greatest torque or force [N·m or N].
        velocity: Greatest speed [rad/s or m/s].
        follows: The joint that it follows, if any; Bullet ignores this, we drive it.
        damping: Torque or force against motion for each unit of speed [N·m·s/rad or N·s/m].
        friction: Dry friction [N·m or N].
    """

    kind: Literal["fixed", "revolute", "continuous", "prismatic"]
    parent: str
    child: str
    at: Triple = ZERO
    rpy: Triple = ZERO
    axis: Triple = (0.0, 0.0, 1.0)
    lower: float = 0.0
    upper: float = 0.0
    effort: float = 0.0
    velocity: float = 0.0
    follows: Follow | None = None
    damping: float = 0.0
    friction: float = 0.0

    def __post_init__(self) -> None:
        if not 1e-9 <= math.hypot(*self.axis) <= 1e9:
            raise ValueError(f"an axis cannot have length {math.hypot(*self.axis):g}")


@dataclass(frozen=True)
class Model:
    """A tree of links and joints.

    Attributes:
        name: Name of the model.
        source: Where the figures are from.
        licence: Licence of the source of the figures.
        materials: Colours by name, red, green, blue, alpha, each in [0, 1].
        links: Links by name, the root first.
        joints: Joints by name, parents before children.
    """

    name: str
    source: str
    links: dict[str, Link]
    licence: str = ""
    materials: dict[str, tuple[float, ...]] = field(default_factory=dict)
    joints: dict[str, Joint] = field(default_factory=dict)

    def __post_init__(self) -> None:
        if not self.links:
            raise ValueError("a model has at least one link")
        for name, link in self.links.items():
            for shape in link.visual:
                check_name(f"material ({name})", shape.material, self.materials)
        placed = {self.root}
        for name, joint in self.joints.items():
            for end in (joint.parent, joint.child):
                check_name(f"link (joint {name})", end, self.links)
            if joint.parent not in placed or joint.child in placed:
                raise ValueError(f"joint {name!r} does not grow the tree from {self.root!r}")
            placed.add(joint.child)
        if placed != set(self.links):
            raise ValueError(f"no joint carries {sorted(set(self.links) - placed)}")

    @property
    def root(self) -> str:
        """Name of the root link."""
        return next(iter(self.links))

    def way(self, link: str, root: str | None = None) -> list[str]:
        """Return the joints from a link back to another, to the root of the model if None."""
        carried_by, out = {joint.child: name for name, joint in self.joints.items()}, list[str]()
        while link in carried_by and link != root:
            out.append(carried_by[link])
            link = self.joints[out[-1]].parent
        return out

    @property
    def mass(self) -> float:
        """Mass of all links [kg]."""
        return sum(link.mass for link in self.links.values())


def lump(name: str, solid: Shape, mass: float, rgba: Vector, *, collides: bool = True) -> Model:
    """Return the model of one sphere or box of `mass` [kg] and one colour."""
    is_box = solid.kind == "box"
    values = inertia.of_box(mass, solid.size) if is_box else inertia.of_ball(mass, solid.radius)
    link = Link(
        mass,
        inertia=values,
        visual=(replace(solid, material="own"),),
        collision=(solid,) if collides else (),
    )
    return Model(name, "", {"base": link}, materials={"own": tuple(float(part) for part in rgba)})


def write(
    model: Model,
    *,
    fixed_joints: Mapping[str, float] | None = None,
    visuals: Mapping[str, tuple[MeshFile, ...]] | None = None,
    melt_except: Collection[str] | None = None,
) -> Path:
    """Write `model` as a URDF with its meshes into the cache, once, and return the URDF's path.

    Args:
        model: The model.
        fixed_joints: Joints to freeze, with their positions [rad or m]: cost follows free joints.
        visuals: Mesh files that replace the drawn shapes of links.
        melt_except: Links that stay links of their own, while all others behind a fixed joint melt
            into the link that carries them: Bullet's cost follows links. Nothing melts if None.

    Raises:
        UnknownNameError: If `fixed_joints` or `visuals` name what the model does not have.
    """
    fixed_joints, visuals = dict(fixed_joints or {}), dict(visuals or {})
    for joint in fixed_joints:
        check_name("joint", joint, model.joints)
    for link in visuals:
        check_name("link", link, model.links)
    kept = None if melt_except is None else frozenset(melt_except)
    order = sorted(kept) if kept is not None else None
    recipe = repr((model, sorted(fixed_joints.items()), sorted(visuals.items()), order)).encode()
    recipe += _makers()
    used = [m for link in model.links.values() for m in (*link.hulls, *link.meshes)]
    used += [m for drawn in visuals.values() for m in drawn]
    recipe += mesh_file.stamp(m.file for m in used)
    name = _plain(model.name)
    made = cached_folder(name, recipe, lambda: files(model, fixed_joints, visuals, kept))
    return made / f"{name}.urdf"


@lru_cache
def _makers() -> bytes:
    """Return the code that makes the files: other code makes other files."""
    makers = (shape_module.__file__, mesh.__file__, inertia.__file__, mesh_file.__file__)
    return b"".join(Path(file).read_bytes() for file in (__file__, *makers))


def files(
    model: Model,
    fixed_joints: Mapping[str, float] | None = None,
    visuals: Mapping[str, tuple[MeshFile, ...]] | None = None,
    kept: frozenset[str] | None = None,
) -> dict[str, str]:
    """Return the URDF of a model and its meshes, by file name; see `write`."""
    fixed_joints, visuals = fixed_joints or {}, visuals or {}
    made: dict[str, str] = {}
    carriers = _carriers(model, fixed_joints, kept)
    robot = xml.Element("robot", name=model.name)
    robot.append(xml.Comment(f" generated by rcare_marl; figures: {model.source} "))
    elements = {}
    for name in model.links:
        if carriers[name][0] == name:
            elements[name] = xml.SubElement(robot, "link", name=name)
            carried = [other for other, (carrier, _) in carriers.items() if carrier == name]
            parts = [(model.links[other], carriers[other][1]) for other in carried]
            _inertial(elements[name], parts[0][0] if len(parts) == 1 else _combined(parts))
    for name, link in model.links.items():
        carrier, pose = carriers[name]
        element = elements[carrier]
        if name in visuals:
            for drawn in visuals[name]:
                _mesh_visual(element, drawn, pose)
        else:
            made |= _generated_visuals(element, name, link, model, pose)
            for drawn in link.meshes:
                _mesh_visual(element, drawn, pose)
        made |= _hulls(element, name, link, pose)
        for shape in link.collision:
            collision = xml.SubElement(element, "collision")
            _origin(collision, pose @ shape.pose())
            _geometry(collision, shape)
    for name, joint in model.joints.items():
        if carriers[joint.child][0] == joint.child:
            _joint(robot, name, joint, fixed_joints, carriers[joint.parent])
    xml.indent(robot)
    made[f"{_plain(model.name)}.urdf"] = xml.tostring(robot, encoding="unicode") + "\n"
    return made


def _carriers(
    model: Model, fixed_joints: Mapping[str, float], kept: frozenset[str] | None
) -> dict[str, tuple[str, Pose]]:
    """Return for each link the link that it is part of, and where its frame lies in that one."""
    out = {model.root: (model.root, Pose())}
    for name, joint in model.joints.items():
        is_fixed = joint.kind == "fixed" or name in fixed_joints
        if kept is None or not is_fixed or joint.child in kept:
            out[joint.child] = (joint.child, Pose())
        else:
            carrier, pose = out[joint.parent]
            out[joint.child] = (carrier, pose @ joint_pose(joint, fixed_joints.get(name, 0.0)))
    return out


def _combined(parts: Sequence[tuple[Link, Pose]]) -> Link:
    """Return the mass, centre and inertia of links that are one."""
    mass = sum(link.mass for link, _ in parts)
    if mass == 0:
        return Link()
    centres = [np.array((pose @ Pose(link.com)).position) for link, pose in parts]
    centre = sum((link.mass * c for (link, _), c in zip(parts, centres, strict=True)), np.zeros(3))
    centre = centre / mass
    total = np.zeros((3, 3))
    for (link, pose), c in zip(parts, centres, strict=True):
        turn = pose.matrix()[:3, :3]
        own = turn @ inertia.matrix(link.inertia) @ turn.T
        arm = c - centre
        total += own + link.mass * (arm @ arm * np.eye(3) - np.outer(arm, arm))
    x, y, z = centre.tolist()
    return Link(mass, (x, y, z), inertia.values(total))


def _inertial(element: xml.Element, link: Link) -> None:
    inertial = xml.SubElement(element, "inertial")
    xml.SubElement(inertial, "origin", xyz=_text(link.com), rpy="0 0 0")
    xml.SubElement(inertial, "mass", value=repr(link.mass or FRAME_MASS))
    values = link.inertia if link.mass else FRAME_INERTIA
    names = ("ixx", "ixy", "ixz", "iyy", "iyz", "izz")
    xml.SubElement(
        inertial, "inertia", {n: repr(float(v)) for n, v in zip(names, values, strict=True)}
    )


def _generated_visuals(
    element: xml.Element, name: str, link: Link, model: Model, pose: Pose
) -> dict[str, str]:
    """Draw a link by one mesh a colour; return the files."""
    files = {}
    painted: dict[str, list[Shape]] = {}
    for shape in link.visual:
        painted.setdefault(shape.material, []).append(shape)
    for material, shapes in painted.items():
        file = f"{_plain(name)}_{_plain(material)}.obj"
        files[file] = surface(shapes, pose).obj()
        visual = xml.SubElement(element, "visual")
        xml.SubElement(xml.SubElement(visual, "geometry"), "mesh", filename=file)
        # Bullet keeps one colour for each material name of a link: make it unique.
        paint = xml.SubElement(visual, "material", name=f"{name}_{material}")
        xml.SubElement(paint, "color", rgba=_text(model.materials[material]))
    return files


def _mesh_visual(element: xml.Element, drawn: MeshFile, pose: Pose) -> None:
    visual = xml.SubElement(element, "visual")
    _origin(visual, pose @ drawn.pose())
    shape = xml.SubElement(visual, "geometry")
    xml.SubElement(shape, "mesh", filename=drawn.file, scale=_text(drawn.scale))
    # Where the file has colours, as RViz takes them, white lets them through to the renderers.
    rgba = (1.0, 1.0, 1.0, drawn.rgba[3]) if mesh_file.has_colors(drawn.file) else drawn.rgba
    painted = xml.SubElement(visual, "material", name=f"{Path(drawn.file).stem}_{rgba}")
    xml.SubElement(painted, "color", rgba=_text(rgba))


def _hulls(element: xml.Element, name: str, link: Link, pose: Pose) -> dict[str, str]:
    """Let a link collide by the convex hulls of its mesh files; return the hulls' files."""
    files: dict[str, str] = {}
    for solid in link.hulls:
        for corners in mesh_file.hulls(solid.file):
            file = f"{_plain(name)}_hull_{len(files)}.obj"
            files[file] = mesh_file.hull_obj(corners * solid.scale)
            collision = xml.SubElement(element, "collision")
            _origin(collision, pose @ solid.pose())
            xml.SubElement(xml.SubElement(collision, "geometry"), "mesh", filename=file)
    return files


def _geometry(element: xml.Element, shape: Shape) -> None:
    is_box, is_long = shape.kind == "box", shape.kind in ("cylinder", "capsule")
    size = {"size": _text(shape.size)} if is_box else {"radius": repr(shape.radius)}
    size |= {"length": repr(shape.span())} if is_long else {}
    xml.SubElement(xml.SubElement(element, "geometry"), shape.kind, size)


def _joint(
    robot: xml.Element,
    name: str,
    joint: Joint,
    fixed_joints: Mapping[str, float],
    parent: tuple[str, Pose],
) -> None:
    kind = "fixed" if name in fixed_joints else joint.kind
    element = xml.SubElement(robot, "joint", name=name, type=kind)
    xml.SubElement(element, "parent", link=parent[0])
    xml.SubElement(element, "child", link=joint.child)
    _origin(element, parent[1] @ joint_pose(joint, fixed_joints.get(name, 0.0)))
    if kind == "fixed":
        return
    length = float(np.linalg.norm(joint.axis))  # Bullet warns where it is not quite one
    xml.SubElement(element, "axis", xyz=_text(tuple(a / length for a in joint.axis)))
    limit = {"effort": repr(joint.effort), "velocity": repr(joint.velocity)}
    if kind != "continuous":
        limit |= {"lower": repr(joint.lower), "upper": repr(joint.upper)}
    xml.SubElement(element, "limit", limit)
    if joint.damping or joint.friction:
        dynamics = {"damping": repr(joint.damping), "friction": repr(joint.friction)}
        xml.SubElement(element, "dynamics", dynamics)
    rule = joint.follows
    if rule is not None and rule.joint not in fixed_joints:
        numbers = {"multiplier": repr(rule.multiplier), "offset": repr(rule.offset)}
        xml.SubElement(element, "mimic", {"joint": rule.joint} | numbers)


def joint_pose(joint: Joint, position: float = 0.0) -> Pose:
    """Return the pose of a joint's child in its parent at `position` [rad or m]."""
    origin = Pose(joint.at, tuple(quaternion_from_rpy(*joint.rpy).tolist()))
    if joint.kind == "fixed" or position == 0.0:
        return origin
    if joint.kind == "prismatic":
        return origin @ Pose(tuple(position * a for a in joint.axis))
    return origin @ Pose(
        quaternion=tuple(quaternion_from_axis_angle(joint.axis, position).tolist())
    )


def _origin(element: xml.Element, pose: Pose) -> None:
    rpy = turn_rpy(pose.quaternion)
    xml.SubElement(element, "origin", xyz=_text(pose.position), rpy=_text(rpy))


def _text(values: tuple[float, ...]) -> str:
    return " ".join(repr(float(v)) for v in values)


def _plain(name: str) -> str:
    """Return a name that a file can have; that of another name is another."""
    plain = re.sub(r"\W", "_", name)
    return plain if plain == name else f"{plain}_{zlib.crc32(name.encode()):08x}"
