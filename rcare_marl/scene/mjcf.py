"""A scene as MJCF, for MuJoCo 3 and later: the same links, joints, shapes, bonds and who touches whom.

MuJoCo takes the greater of two friction coefficients where Bullet multiplies them. Half of Bullet's is
written, which is the same wherever one of both has Bullet's usual 0.5.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from itertools import product
from xml.etree import ElementTree as xml

import numpy as np

from rcare_marl.errors import ConfigError
from rcare_marl.model.mesh_file import hulls
from rcare_marl.model.shape import Shape
from rcare_marl.model.urdf import FRAME_INERTIA, FRAME_MASS, Follow, Joint, Link, joint_pose
from rcare_marl.pose import Array, Pose

from .drawing import Drawn
from .scene import Bond, Place, Scene, SceneBody, apart

BITS = 31  # of MuJoCo's masks; its integers have a sign
USUAL_FRICTION = 0.5  # Bullet's
SOLREF = "0.0085 1"  # twice the physics step and a little: as rigid as MuJoCo stays stable
SIDES = 32  # of the prisms that are Bullet's cylinders
GRID = 10216  # steps along each edge of its box on which Bullet's hulls have their corners
START = "start"  # name of the key frame
_DULL = "dull"  # name of the material of all that is drawn
_SEEN, _SOLID = "2", "3"  # geom groups that MuJoCo's viewer shows, and hides


def body_name(place: Place) -> str:
    """Return the name of a link in the MJCF."""
    return "/".join(place)


def joint_name(body: str, joint: str) -> str:
    """Return the name of a joint in the MJCF, and of what drives it."""
    return f"{body}/{joint}"


def mjcf(
    scene: Scene,
    drawings: Mapping[Place, Sequence[Drawn]] | None = None,
    *,
    drives: bool = True,
    parts: bool = True,
    spare: int = 0,
    as_bullet: bool = False,
) -> dict[str, str]:
    """Return the files of a scene by name: `scene.xml` and the meshes that it needs.

    Args:
        scene: The scene.
        drawings: What to draw of each link; only what collides if None.
        drives: Whether joints have actuators.
        parts: Whether what is held rigidly is a part of who holds it; a weld if not.
        spare: How many welds that hold nothing, for who makes bonds later.
        as_bullet: Whether cylinders are the prisms that they are in Bullet, corners where it has them, and
            what follows a joint is bound to it by no more than a motor.

    Raises:
        ConfigError: If more bodies of their own rules of contact are in it than MuJoCo can tell apart.
    """
    return _Writer(scene, drawings or {}, drives=drives, parts=parts, as_bullet=as_bullet).files(
        spare
    )


class _Writer:
    def __init__(
        self,
        scene: Scene,
        drawings: Mapping[Place, Sequence[Drawn]],
        *,
        drives: bool,
        parts: bool,
        as_bullet: bool,
    ) -> None:
        self._drives, self._scene, self._drawings = drives, scene, drawings
        self._as_bullet = as_bullet
        self._held = scene.held() if parts else {}
        self._files: dict[str, str] = {}
        self._prisms: set[str] = set()  # names of their meshes
        self._root = xml.Element("mujoco", model="scene")
        _add(self._root, "compiler", angle="radian", autolimits="true", boundinertia="1e-9")
        _add(
            self._root,
            "option",
            timestep=repr(scene.physics_dt),
            gravity=f"0 0 {-scene.gravity}",
            integrator="implicitfast",
            cone="elliptic",
            iterations=str(max(scene.iterations, 30)),
        )
        look = _add(self._root, "visual")
        _add(look, "headlight", ambient="0.35 0.35 0.35", diffuse="0.4 0.4 0.4", specular="0 0 0")
        usual = _add(self._root, "default")
        _add(usual, "geom", solref=SOLREF, condim="3")
        _add(usual, "joint", solreflimit=SOLREF)
        self._assets = _add(self._root, "asset")
        sky = dict(type="skybox", builtin="gradient", width="64", height="384")
        _add(
            self._assets, "texture", name="sky", rgb1="0.85 0.88 0.92", rgb2="0.55 0.6 0.68", **sky
        )
        _add(self._assets, "material", name=_DULL, specular="0.1", shininess="0.1")
        self._world = _add(self._root, "worldbody")
        lamp = dict(pos="0 0 4", dir="0.3 -0.3 -1", diffuse="0.5 0.5 0.5", castshadow="false")
        _add(self._world, "light", type="directional", **lamp)
        self._contacts = _add(self._root, "contact")
        self._equalities = _add(self._root, "equality")
        self._motors = _add(self._root, "actuator")
        self._links: dict[Place, xml.Element] = {}
        self._geoms: dict[Place, list[str]] = {}
        self._start: list[float] = []

    def files(self, spare: int) -> dict[str, str]:
        masks = self._masks()
        for body in self._scene.bodies.values():
            if body.name not in self._held:
                self._body(body, self._world, body.pose, masks[body.name])
        for name, bond in self._held.items():  # who holds was written before
            carrier = self._links[bond.parent]
            self._body(self._scene.bodies[name], carrier, bond.at, masks[name])
        for pair in sorted(map(sorted, self._scene.meeting)):
            self._meet(*pair)
        for bond in self._scene.bonds:
            if bond is not self._held.get(bond.child[0]):
                self._bond(bond)
        first = next(iter(self._links.values()), None)
        if first is not None:
            name = first.get("name", "")
            for i in range(spare):
                _add(self._equalities, "weld", name=f"spare:{i}", body1=name, active="false")
        key = _add(_add(self._root, "keyframe"), "key", name=START)
        # Depth first, as MuJoCo counts joints.
        key.set("qpos", _text(self._positions(self._world)))
        xml.indent(self._root)
        text = xml.tostring(self._root, encoding="unicode") + "\n"
        return {"scene.xml": text, **self._files}

    def _positions(self, element: xml.Element) -> Iterable[float]:
        for child in element:
            if child.tag == "freejoint":
                yield from _numbers(element, "pos")
                yield from _numbers(element, "quat")
            elif child.tag == "joint":
                name, joint = child.get("name", "").rsplit("/", 1)
                yield self._scene.bodies[name].positions[joint]
            elif child.tag == "body":
                yield from self._positions(child)

    def _masks(self) -> dict[str, tuple[int, int]]:
        """Return contype and conaffinity of each body, and write which links pass through each other.

        A body that can move has a bit of its own, so that its links do not meet each other; single
        links that meet everybody share one.
        """
        scene, solid = self._scene, {}
        for body in scene.bodies.values():
            if body.solid():
                solid[body.name] = body
        parted = apart(scene)
        whole = {names for names, pairs in parted.items() if pairs is None}
        for pair in sorted(sorted(pair) for pairs in parted.values() for pair in pairs or ()):
            a, b = map(body_name, pair)
            _add(self._contacts, "exclude", body1=a, body2=b)
        still = {n for n, b in solid.items() if not (b.is_movable or b.model.joints)}
        still -= set(self._held)
        shy = {name for pair in whole for name in pair}
        common = {n for n, b in solid.items() if n not in still | shy and len(b.solid()) == 1}
        bits = dict.fromkeys(common, 1)
        for place, name in enumerate((n for n in solid if n not in still | common), 1):
            bits[name] = 1 << place
        if len(bits) - len(common) >= BITS:
            raise ConfigError(
                f"{len(bits) - len(common)} jointed bodies meet in the scene; MuJoCo's masks tell {BITS - 1} "
                "apart: take a smaller home, or none"
            )
        masks = {name: (0, 0) for name in scene.bodies}
        for name in solid:
            met = {
                o for o in bits if frozenset((name, o)) not in whole and (o != name or o in common)
            }
            mask = 0
            for other in met:
                mask |= bits[other]
            masks[name] = (bits.get(name, 0), mask)
        # MuJoCo asks both ways, and one yes is enough: who has no bit is asked by nobody.
        return masks

    def _body(
        self, body: SceneBody, place: xml.Element, pose: Pose, masks: tuple[int, int]
    ) -> None:
        model = body.model
        is_free = body.is_movable and place is self._world
        root = self._link(body, model.root, place, pose, masks, is_free=is_free)
        elements = {model.root: root}
        for name, joint in model.joints.items():
            at = joint_pose(joint)
            element = self._link(
                body, joint.child, elements[joint.parent], at, masks, joint=(name, joint)
            )
            elements[joint.child] = element
            if name in body.gears:
                self._couple(body, name, *body.gears[name])
            elif (rule := joint.follows) is not None and self._follows(body, rule):
                self._couple(body, name, rule.joint, rule.multiplier, rule.offset)

    def _link(
        self,
        body: SceneBody,
        name: str,
        place: xml.Element,
        pose: Pose,
        masks: tuple[int, int],
        *,
        joint: tuple[str, Joint] | None = None,
        is_free: bool = False,
    ) -> xml.Element:
        at: Place = (body.name, name)
        element = _add(place, "body", name=body_name(at), **_placed(pose))
        self._links[at] = element
        if is_free:
            _add(element, "freejoint", name=joint_name(body.name, "free"))
        if joint is not None and joint[0] in body.positions:
            self._joint(body, *joint, element)
        link = body.model.links[name]
        moves = joint is not None and joint[0] in body.positions
        if link.mass > 0 or moves:  # nothing that moves is without mass
            xx, xy, xz, yy, yz, zz = link.inertia if link.mass else FRAME_INERTIA
            inertia = _text((xx, yy, zz, xy, xz, yz))
            mass = repr(link.mass or FRAME_MASS)
            _add(element, "inertial", pos=_text(link.com), mass=mass, fullinertia=inertia)
        self._shapes(body, at, link, element, masks)
        for i, drawing in enumerate(self._drawings.get(at, ())):
            file = self._mesh(f"{_plain(at)}_{i}", drawing.obj(), inertia="shell")
            look = dict(type="mesh", mesh=file, rgba=_text(drawing.rgba), group=_SEEN)
            look |= {"material": _DULL}
            _add(element, "geom", contype="0", conaffinity="0", mass="0", **look)
        return element

    def _follows(self, body: SceneBody, rule: Follow) -> bool:
        """Return whether a joint is bound to the one that it follows; in Bullet only its motor follows.

        A bound finger shares the torque of the driven joint: two fingers press half as hard.
        """
        return rule.joint in body.positions and not self._as_bullet

    def _joint(self, body: SceneBody, name: str, joint: Joint, element: xml.Element) -> None:
        slides = joint.kind == "prismatic"
        own = {"type": "slide" if slides else "hinge", "axis": _text(joint.axis)}
        if joint.kind != "continuous" and joint.lower <= joint.upper:
            own["range"] = _text((joint.lower, joint.upper))
        friction = joint.friction + body.friction.get(name, 0.0)
        dry = {"frictionloss": repr(friction)} if friction else {}
        slow = {"damping": repr(joint.damping)} if joint.damping else {}
        full = joint_name(body.name, name)
        _add(element, "joint", name=full, **own, **dry, **slow)
        if name in body.gears or friction or not self._drives:
            return
        if name not in body.efforts:
            _add(self._motors, "motor", name=full, joint=full)
        elif (effort := body.efforts[name]) > 0:
            limits = _text((-effort, effort))
            _add(
                self._motors, "velocity", name=full, joint=full, kv=repr(effort), forcerange=limits
            )

    def _couple(
        self, body: SceneBody, name: str, leader: str, multiplier: float, offset: float = 0.0
    ) -> None:
        pair = (joint_name(body.name, each) for each in (name, leader))
        names = dict(zip(("joint1", "joint2"), pair, strict=True))
        _add(self._equalities, "joint", **names, polycoef=_text((offset, multiplier, 0, 0, 0)))

    def _shapes(
        self,
        body: SceneBody,
        at: Place,
        link: Link,
        element: xml.Element,
        masks: tuple[int, int],
    ) -> None:
        touch, names = body.touching[at[1]], self._geoms.setdefault(at, [])
        rubs = (touch.friction * USUAL_FRICTION, touch.spinning, touch.rolling)
        common = dict(contype=str(masks[0]), conaffinity=str(masks[1]), friction=_text(rubs))
        common |= {"condim": "6"} if touch.rolling or touch.spinning else {}
        common |= {"group": _SOLID, "mass": "0"}

        def named() -> dict[str, str]:
            names.append(f"{body_name(at)}:{len(names)}")
            return {"name": names[-1], **common}

        for shape in link.collision:
            _add(element, "geom", **named(), **_placed(shape.pose()), **self._geometry(shape))
        for solid in link.hulls:
            for corners in hulls(solid.file):
                points = corners * solid.scale
                if self._as_bullet:
                    points = _rounded(points)
                rows = [f"v {x!r} {y!r} {z!r}" for x, y, z in points.tolist()]
                file = self._mesh(f"{_plain(at)}_hull_{len(names)}", "\n".join(rows) + "\n")
                _add(element, "geom", **named(), **_placed(solid.pose()), type="mesh", mesh=file)

    def _geometry(self, shape: Shape) -> dict[str, str]:
        if shape.kind == "box":
            return {"type": "box", "size": _text(0.5 * edge for edge in shape.size)}
        if shape.kind == "sphere":
            return {"type": "sphere", "size": repr(shape.radius)}
        if shape.kind == "cylinder" and self._as_bullet:
            return {"type": "mesh", "mesh": self._prism(shape.radius, 0.5 * shape.span())}
        return {"type": shape.kind, "size": _text((shape.radius, 0.5 * shape.span()))}

    def _prism(self, radius: float, half: float) -> str:
        name = f"prism:{radius!r}:{half!r}"
        if name not in self._prisms:
            self._prisms.add(name)
            turns = [2 * math.pi * i / SIDES for i in range(SIDES)]
            corners = [(radius * math.sin(t), radius * math.cos(t)) for t in turns]
            points = _rounded(np.array([(x, y, z) for x, y in corners for z in (-half, half)]))
            _add(self._assets, "mesh", name=name, vertex=_text(points.ravel()))
        return name

    def _mesh(self, name: str, text: str, **own: str) -> str:
        file = f"{name}.obj"
        self._files[file] = text
        _add(self._assets, "mesh", name=name, file=file, **own)
        return name

    def _meet(self, a: Place, b: Place) -> None:
        """Let two links of one body touch, which share a mask."""
        one, other = (self._scene.bodies[place[0]].touching[place[1]] for place in (a, b))
        rubs = repr(one.friction * other.friction)
        friction = f"{rubs} {rubs} 0.005 0.0001 0.0001"
        for first, second in product(self._geoms.get(a, ()), self._geoms.get(b, ())):
            _add(self._contacts, "pair", geom1=first, geom2=second, friction=friction)

    def _bond(self, bond: Bond) -> None:
        name = f"bond:{self._scene.bonds.index(bond)}"
        ends = {"name": name, "body1": body_name(bond.parent), "body2": body_name(bond.child)}
        ends["active"] = str(bond.is_active).lower()
        if bond.pivot is not None:
            _add(self._equalities, "connect", **ends, anchor=_text(bond.pivot))
        else:
            (x, y, z), quat = bond.at.position, _quat(bond.at)
            _add(self._equalities, "weld", **ends, relpose=f"{_text((x, y, z))} {quat}")


def _rounded(points: Array) -> Array:
    """Return the corners that Bullet's hull of `points` has [m], shape [n, 3]: nearer to the middle."""
    low, high = points.min(axis=0), points.max(axis=0)
    step, middle = (high - low) * (1 / GRID), (low + high) * 0.5
    rounded: Array = np.trunc((points - middle) * (1 / step)) * step + middle
    return rounded


def _add(parent: xml.Element, tag: str, **attributes: str) -> xml.Element:
    return xml.SubElement(parent, tag, attributes)


def _text(values: Iterable[float]) -> str:
    return " ".join(repr(float(value)) for value in values)


def _numbers(element: xml.Element, key: str) -> list[float]:
    return [float(value) for value in element.get(key, "").split()]


def _quat(pose: Pose) -> str:
    x, y, z, w = pose.quaternion
    return _text((w, x, y, z))


def _placed(pose: Pose) -> dict[str, str]:
    return {"pos": _text(pose.position), "quat": _quat(pose)}


def _plain(place: Place) -> str:
    return "-".join(place).replace("/", "_")
