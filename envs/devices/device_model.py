"""Devices as data: links that weigh, joints, named frames, controls and contacts."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import lru_cache
from pathlib import Path

import numpy as np

from rcare_marl import assets
from rcare_marl.config import load
from rcare_marl.errors import ConfigError, UnknownNameError, check_name
from rcare_marl.model.inertia import Inertia, values
from rcare_marl.model.shape import MeshFile, Shape, Triple
from rcare_marl.model.urdf import Link, Model, joint_pose
from rcare_marl.pose import Array, Pose, quaternion_from_rpy


@dataclass(frozen=True)
class Frame:
    """A place on a device.

    Attributes:
        position: Origin in the frame of the device while all joints are at zero [m].
        rpy_deg: Turn in that frame, fixed-axis roll, pitch, yaw [degrees].
        note: What it is.
        link: The link that it goes with; the root if empty.
    """

    position: Triple
    rpy_deg: Triple = (0.0, 0.0, 0.0)
    note: str = ""
    link: str = ""

    @property
    def pose(self) -> Pose:
        """The pose of the frame in the device while all joints are at zero."""
        turn = quaternion_from_rpy(*(math.radians(angle) for angle in self.rpy_deg))
        return Pose(self.position, tuple(turn.tolist()))


@dataclass(frozen=True)
class DeviceControl:
    """A motor, actuator or hand that works one joint of a device.

    Attributes:
        joint: The joint.
        speed: Greatest speed [rad/s or m/s].
        force: Greatest force or torque [N or N·m]; what holds it where it stands, too.
        note: What it does.
    """

    joint: str
    speed: float
    force: float
    note: str = ""


@dataclass(frozen=True)
class Touch:
    """How a link behaves in contact; what is left out is as Bullet has it.

    Attributes:
        friction: Coefficient of friction; that of a contact is the product of both sides'.
        grips: Whether what it stands on holds it without creeping, as rubber on a floor.
        stiffness: Of a point of contact [N/m].
        damping: Of a point of contact [N·s/m].
    """

    friction: float | None = None
    grips: bool = False
    stiffness: float | None = None
    damping: float | None = None

    def __post_init__(self) -> None:
        if (self.stiffness is None) != (self.damping is None):
            raise ConfigError("a contact has a stiffness and a damping, or neither")
        if self.grips and self.friction is None:
            raise ConfigError("what grips has a friction")


@dataclass(frozen=True)
class DeviceModel(Model):
    """A device: what `Model` has, and what is done with it. A YAML file has these fields.

    A link with a mass and without `inertia` weighs as if its solids and its drawn tubes were of one density.

    Attributes:
        frames: Named places.
        controls: What can be worked by name; all other joints move freely, within their friction.
        postures: How people rest in it: name of a posture, and of the frame to spawn them on.
        contact: How links behave in contact.
        sticking: Joints that stick where they are left until their friction is overcome.
        sling: The sling that hangs on it (`assets/devices`), if it is a lift.
        figures: Further figures that whoever uses it needs, in SI units.
        is_movable: Whether it can be carried and pushed; else it stays where it is put.
        least_iterations: Of the world's solver, for a person whom it carries.
        detail: By how much what is drawn round may be angular [m]; as fine as shapes are if zero.
    """

    frames: dict[str, Frame] = field(default_factory=dict)
    controls: dict[str, DeviceControl] = field(default_factory=dict)
    postures: dict[str, tuple[str, str]] = field(default_factory=dict)
    contact: dict[str, Touch] = field(default_factory=dict)
    sticking: tuple[str, ...] = ()
    sling: str = ""
    figures: dict[str, float] = field(default_factory=dict)
    is_movable: bool = False
    least_iterations: int = 1
    detail: float = 0.0

    def __post_init__(self) -> None:
        super().__post_init__()
        for name, frame in self.frames.items():
            if frame.link and frame.link not in self.links:
                raise UnknownNameError(f"link (frame {name})", frame.link, self.links)
        for link in self.contact:
            check_name("link (contact)", link, self.links)
        joints = [(name, control.joint) for name, control in self.controls.items()]
        for name, joint in [*joints, *(("sticking", joint) for joint in self.sticking)]:
            check_name(f"joint ({name})", joint, self.joints)
        for _, resting in self.postures.values():
            check_name("frame (postures)", resting, self.frames)

    def figure(self, name: str) -> float:
        """Return one of `figures`; UnknownNameError if there is none of that name."""
        check_name(f"figure of {self.name}", name, self.figures)
        return self.figures[name]

    def link_pose(self, link: str, positions: Mapping[str, float] | None = None) -> Pose:
        """Return where a link is in the device; joints at zero, but for `positions` [rad or m]."""
        pose, placed = Pose(), positions or {}
        while link != self.root:
            name = next(name for name, joint in self.joints.items() if joint.child == link)
            joint = self.joints[name]
            pose, link = joint_pose(joint, placed.get(name, 0.0)) @ pose, joint.parent
        return pose

    def with_shapes(
        self,
        link: str,
        visual: Sequence[Shape] | None = None,
        collision: Sequence[Shape] | None = None,
        hulls: Sequence[MeshFile] = (),
    ) -> DeviceModel:
        """Return the device with other shapes of a link, which weighs anew if its solids change.

        Shapes stay the same where None; hulls are added.
        """
        old = self.links[link]
        new = dataclasses.replace(
            old,
            visual=old.visual if visual is None else tuple(visual),
            collision=old.collision if collision is None else tuple(collision),
            hulls=(*old.hulls, *hulls),
        )
        new = weighed(new) if collision is not None and new.mass else new
        return dataclasses.replace(self, links=self.links | {link: new})

    def with_frames(self, places: Mapping[str, Triple]) -> DeviceModel:
        """Return the device with frames at other places [m], turned as they were."""
        moved = {k: dataclasses.replace(self.frames[k], position=at) for k, at in places.items()}
        return dataclasses.replace(self, frames=self.frames | moved)

    def without(self, links: Iterable[str]) -> DeviceModel:
        """Return the device without some links that carry no others, and without their frames."""
        gone = set(links)
        return dataclasses.replace(
            self,
            links={k: link for k, link in self.links.items() if k not in gone},
            joints={k: joint for k, joint in self.joints.items() if joint.child not in gone},
            frames={k: frame for k, frame in self.frames.items() if frame.link not in gone},
        )


def load_device(source: str | Path) -> DeviceModel:
    """Return the device of that name in `assets/devices`, or of a YAML file (ends in `.yaml`).

    Raises:
        UnknownNameError: If there is no device of that name, or the file has a key or name that it
            should not; the message has the nearest.
        ConfigError: If the file cannot be read, or a value in it is missing or impossible.
    """
    path = Path(source)
    if path.suffix in (".yaml", ".yml"):
        return _read(path)
    return _shipped(str(source))


@lru_cache
def _shipped(name: str) -> DeviceModel:
    return _read(assets.find("devices", name))


def _read(path: Path) -> DeviceModel:
    model = load(DeviceModel, path)
    links = {
        name: _complete(link, model.detail, f"{path}: link {name!r}")
        for name, link in model.links.items()
    }
    return dataclasses.replace(model, links=links)


def _complete(link: Link, detail: float, where: str) -> Link:
    """Return a link drawn no finer than `detail` [m], with an inertia if it has a mass."""
    if detail:
        link = dataclasses.replace(link, visual=tuple(s.coarse(detail) for s in link.visual))
    if not link.mass or any(link.inertia):
        return link
    if any(link.com):
        raise ConfigError(f"{where} has a `com` but no `inertia`: give both or neither")
    if not link.collision and all(shape.kind != "tube" for shape in link.visual):
        raise ConfigError(f"{where} has a mass, but neither solids (`collision`) nor an `inertia`")
    return weighed(link)


def weigh(mass: float, shapes: Sequence[Shape]) -> tuple[Triple, Inertia]:
    """Return the centre of mass [m] and the inertia about it [kg·m²] of shapes of one density.

    Boxes, spheres, cylinders, capsules (as cylinders of their full length) and tubes, which are full
    rods.
    """
    lumps = [lump for shape in shapes for lump in _lumps(shape)]
    volume = sum(size for size, _, _ in lumps)
    centre = sum((size * at for size, at, _ in lumps), np.zeros(3)) / volume
    total = np.zeros((3, 3))
    for size, at, own in lumps:
        arm = at - centre
        total += size * (own + arm @ arm * np.eye(3) - np.outer(arm, arm))
    total *= mass / volume
    x, y, z = centre.tolist()
    return (x, y, z), values(total)


def volume(shapes: Iterable[Shape]) -> float:
    """Return the volume of shapes, those that overlap counted twice [m³]."""
    return sum(size for shape in shapes for size, _, _ in _lumps(shape))


def _lumps(shape: Shape) -> list[tuple[float, Array, Array]]:
    """Return volume [m³], centre [m] and inertia for each unit of mass [m²] of a shape's pieces."""
    if shape.kind == "tube":
        rods = zip(shape.points, shape.points[1:], strict=False)
        rod = [Shape(kind="cylinder", radius=shape.radius, points=ends) for ends in rods]
        return [lump for part in rod for lump in _lumps(part.moved(shape.pose()))]
    pose = shape.pose()
    turn = pose.matrix()[:3, :3]
    if shape.kind == "box":
        size = np.asarray(shape.size)
        volume, own = float(size.prod()), (size @ size - size**2) / 12
    elif shape.kind == "sphere":
        volume, own = 4 / 3 * math.pi * shape.radius**3, np.full(3, 0.4 * shape.radius**2)
    elif shape.kind in ("cylinder", "capsule"):
        long = shape.span() + (2 * shape.radius if shape.kind == "capsule" else 0.0)
        across = (3 * shape.radius**2 + long**2) / 12
        volume = math.pi * shape.radius**2 * long
        own = np.array((across, across, 0.5 * shape.radius**2))
    else:
        raise ValueError(f"a {shape.kind} has no known weight")
    return [(volume, np.asarray(pose.position), turn @ np.diag(own) @ turn.T)]


def weighed(link: Link) -> Link:
    """Return a link that weighs as if its solids and its drawn tubes were of one density."""
    tubes = [shape for shape in link.visual if shape.kind == "tube"]
    com, inertia = weigh(link.mass, [*link.collision, *tubes])
    return dataclasses.replace(link, com=com, inertia=inertia)
