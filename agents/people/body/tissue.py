"""Soft tissue of a person: which segments have it, what it is made of, and what it shows.

A segment with tissue keeps its mass, but its rigid shape shrinks to the core, so that a robot can press
into the flesh around it. The flesh rides on the segment's link; inner layer and both ends are held there.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path

import numpy as np
import numpy.typing as npt

from rcare_marl import assets
from rcare_marl.body import Body
from rcare_marl.config import load
from rcare_marl.errors import ConfigError, check_name
from rcare_marl.pose import Array, Pose, Vector, matrix_from_quaternion, quaternion_from_matrix
from rcare_marl.soft.material import Material
from rcare_marl.soft.soft_body import SUBSTEPS, SoftBody
from rcare_marl.soft.soft_object import Carrier
from rcare_marl.soft.soft_world import SoftWorld
from rcare_marl.world import World

from .refinement import refined
from .segment import Segment, Shape, frame_along
from .skeleton import JOINT_INDEX, JOINTS, SIDES
from .skin import BodyModel, JointFrame, PersonSkin
from .tetrahedra import Flesh, centre_line, make_flesh

Floats = npt.NDArray[np.float32]

_NEXT = {
    "shoulder": "elbow",
    "elbow": "wrist",
    "hip": "knee",
    "knee": "ankle",
    "spine1": "spine2",
    "spine2": "spine3",
    "spine3": "neck",
}
_TRUNK = ("spine1", "spine2", "spine3")
_AROUND_TRUNK = ("pelvis", *_TRUNK)  # whose skin is the trunk's
SEGMENTS = (
    *(f"{side}_{kind}" for side in SIDES for kind in _NEXT if kind not in _TRUNK),
    *_TRUNK,
)
GROUPS = {
    "torso": _TRUNK,
    **{f"{side}_arm": (f"{side}_shoulder", f"{side}_elbow") for side in SIDES},
    **{f"{side}_leg": (f"{side}_hip", f"{side}_knee") for side in SIDES},
}
FULL_HEAT = 5e4  # [Pa] at the red end of the heat map; our own choice: a firm push of a thumb
SKIN_REFINEMENT = 2  # times that the faces of yielding skin are cut in four: to 5 mm on a forearm
STEADY = 0.97  # weight of one joint from which a vertex counts as carried by it alone
_LEAST_HEAT = 200.0  # [Pa] that shows
_HEAT = np.array(((48, 80, 200), (40, 190, 190), (90, 200, 70), (245, 215, 50), (210, 30, 25)))


@dataclass(frozen=True)
class FleshConfig:
    """The flesh of one kind of segment.

    Attributes:
        core: Radius of what does not yield, as a share of the skin's.
        begin: Where the flesh begins, as a share of the segment's length.
        end: Where it ends.
        sectors: Cells around, an even number.
        stations: Cells along.
        layers: Cells from core to skin.
        source: Where the figures come from.
    """

    core: float
    begin: float
    end: float
    sectors: int
    stations: int
    layers: int
    source: str

    def __post_init__(self) -> None:
        if not 0 < self.core < 1:
            raise ConfigError(f"core must lie between 0 and 1, got {self.core}")
        if not 0 <= self.begin < self.end <= 1:
            raise ConfigError(f"0 <= begin < end <= 1 is needed, got {self.begin}, {self.end}")


@dataclass(frozen=True)
class TissueConfig:
    """Soft tissue (`assets/tissue/<name>.yaml`).

    Attributes:
        description: One line for a person to read.
        material: Its material.
        segments: Flesh by kind of segment, the SMPL-X joint without its side.
        mass_factor: See `SoftBody`.
        focus_m: How far around a contact flesh is simulated [m]; the whole segment if absent.
    """

    description: str
    material: Material
    segments: dict[str, FleshConfig]
    mass_factor: float = 1.0
    focus_m: float | None = None

    def __post_init__(self) -> None:
        for kind in self.segments:
            check_name("kind of segment", kind, _NEXT)


def load_tissue(name: str | Path = "flesh") -> TissueConfig:
    """Return the tissue of that name, or from that YAML file."""
    return load(TissueConfig, assets.find("tissue", name))


def expand_tissue(names: Iterable[str]) -> tuple[str, ...]:
    """Return SMPL-X joints in the order of the skeleton; `left_arm` stands for upper arm and forearm.

    Raises:
        UnknownNameError: If a name is neither a segment nor a group that can have tissue.
    """
    chosen: set[str] = set()
    for name in names:
        check_name("segment with tissue", name, (*SEGMENTS, *GROUPS))
        chosen.update(GROUPS.get(name, (name,)))
    return tuple(joint for joint in JOINTS if joint in chosen)


@lru_cache(maxsize=64)
def _flesh(model: BodyModel, joint: str, config: FleshConfig, refinement: float) -> Flesh:
    is_trunk = joint in _TRUNK
    kind = joint if is_trunk else joint.split("_", 1)[1]
    child = _NEXT[kind] if is_trunk else joint.replace(kind, _NEXT[kind])
    j = JOINT_INDEX[joint]
    skin = model.vertices.astype(np.float64) - model.joints[j]
    to_end = model.joints[JOINT_INDEX[child]] - model.joints[j]
    owner = model.owner
    if is_trunk:  # the spine lies at the back: the axis goes through the middle instead
        own = skin[owner == j]
        depth = 0.5 * (own[:, 2].min() + own[:, 2].max())
        first, to_end = np.array((0.0, 0.0, depth)), np.array((0.0, to_end[1], 0.0))
        owners = [JOINT_INDEX[name] for name in _AROUND_TRUNK]
    else:
        first, owners = np.zeros(3), [j, JOINT_INDEX[child]]
    faces = model.faces[np.isin(owner[model.faces], owners).all(axis=1)]
    start, end = first + config.begin * to_end, first + config.end * to_end
    if not is_trunk:  # a joint is not in the middle of the flesh; the bone shall be
        start, end = centre_line(skin, faces, start, end)
    return make_flesh(
        skin,
        faces,
        start=start,
        end=end,
        core=config.core,
        round_core=not is_trunk,
        sectors=2 * round(config.sectors * refinement / 2),
        stations=round(config.stations * refinement),
        layers=round(config.layers * refinement),
    )


def make_segment_flesh(
    model: BodyModel, joint: str, config: TissueConfig, *, refinement: float = 1.0
) -> Flesh:
    """Return the flesh of a segment in the frame of its joint in the T-pose.

    Args:
        model: The body.
        joint: SMPL-X joint of the segment.
        config: The tissue.
        refinement: Factor of the number of cells in each direction, to see what the mesh changes.

    Raises:
        UnknownNameError: If the segment cannot have tissue, or the tissue does not say how.
        ConfigError: If the skin does not suit.
    """
    check_name("segment with tissue", joint, SEGMENTS)
    kind = joint if joint in _TRUNK else joint.split("_", 1)[1]
    check_name("kind of segment in this tissue", kind, config.segments)
    if not refinement > 0:
        raise ConfigError(f"refinement must be above 0, got {refinement}")
    try:
        return _flesh(model, joint, config.segments[kind], float(refinement))
    except ConfigError as error:
        raise ConfigError(f"{joint}: {error}") from error


def with_cores(
    segments: Mapping[str, Segment],
    model: BodyModel,
    tissue: Sequence[str],
    config: TissueConfig | None = None,
) -> dict[str, Segment]:
    """Return the segments of a person where those with `tissue` have the shape of their core.

    Args:
        segments: The 55 segments by joint; masses and inertias stay.
        model: The body.
        tissue: Names as in `expand_tissue`.
        config: The tissue; that of `load_tissue` if None.
    """
    chosen = load_tissue() if config is None else config
    out = dict(segments)
    for joint in expand_tissue(tissue):
        flesh = make_segment_flesh(model, joint, chosen)
        shape = _trunk_core(flesh) if joint in _TRUNK else _bone_core(flesh)
        out[joint] = replace(segments[joint], shapes=(shape,))
    return out


def _bone_core(flesh: Flesh) -> Shape:
    length = float(flesh.stations[-1])
    size = (max(length - 2 * flesh.core_radius, 0.001), flesh.core_radius)
    return Shape("capsule", size, flesh.origin + flesh.axis * length / 2, frame_along(flesh.axis))


def _trunk_core(flesh: Flesh) -> Shape:
    """Return a capsule from side to side that lies inside the innermost layer."""
    inner = flesh.positions[: flesh.outer.size]
    low, high = inner.min(axis=0), inner.max(axis=0)
    radius = float(high[2] - low[2]) / 2
    length = max(float(high[0] - low[0]) - 2 * radius, 0.001)
    return Shape("capsule", (length, radius), (low + high) / 2, frame_along(np.eye(3)[0]))


class Tissue:
    """The soft tissue of one spawned person.

    Attributes:
        config: What it is made of.
        bodies: The flesh by SMPL-X joint, as the world simulates it.
    """

    def __init__(
        self,
        model: BodyModel,
        config: TissueConfig,
        parts: Mapping[str, tuple[Flesh, SoftBody]],
    ) -> None:
        self.config = config
        self._flesh = {joint: flesh for joint, (flesh, _) in parts.items()}
        self.bodies = {joint: body for joint, (_, body) in parts.items()}
        self._model = model
        self._bonds = {joint: _bond(model, joint, flesh) for joint, (flesh, _) in parts.items()}
        self._heat = 0.0
        self._painted = False

    @property
    def particle_count(self) -> int:
        """Number of particles in all."""
        return sum(len(body.rest) for body in self.bodies.values())

    def contact_forces(self, by: Body | None = None) -> dict[str, float]:
        """Return the force on the flesh of each touched segment [N], by SMPL-X joint.

        Args:
            by: What presses; everything if None.
        """
        out = {}
        for joint, soft in self.bodies.items():
            pressed = [c.force for c in soft.contacts if by is None or c.body is by]
            if pressed:
                out[joint] = float(sum(np.linalg.norm(force) for force in pressed))
        return out

    def skin_point(self, joint: str, towards: Vector, *, along: float = 0.5) -> tuple[Array, Array]:
        """Return a point on the skin of a segment and the way out of the flesh, both in the world.

        Args:
            joint: A segment with tissue.
            towards: Direction from the axis in the world, shape [3].
            along: Where on the axis, as a share of the flesh's length.

        Returns:
            The particle of the skin next to that point [m] and the direction from the axis to it.
        """
        check_name("segment with tissue", joint, self.bodies)
        flesh, soft = self._flesh[joint], self.bodies[joint]
        frame = soft.frame()
        turn = matrix_from_quaternion(frame[3:7])
        ring = flesh.outer[round(along * (len(flesh.stations) - 1))]
        arms = soft.positions[ring].astype(np.float64) - flesh.origin
        arms -= np.outer(arms @ flesh.axis, flesh.axis)
        arms /= np.linalg.norm(arms, axis=1, keepdims=True)
        chosen = int(np.argmax(arms @ (turn.T @ np.asarray(towards, np.float64))))
        point = turn @ soft.positions[ring[chosen]].astype(np.float64) + frame[:3]
        return point, turn @ arms[chosen]

    def pressure(self) -> Floats:
        """Return the contact pressure on each vertex of the skin [Pa], shape [v]."""
        out = np.zeros(len(self._model.vertices), np.float32)
        for joint, soft in self.bodies.items():
            if soft.contacts:
                vertices, nodes, shares = self._bonds[joint]
                out[vertices] = (soft.pressure[nodes] * shares).sum(axis=1)
        return out

    def displace(self, vertices: Floats, rotations: Array) -> None:
        """Move vertices of the skin with the flesh beneath, in place.

        Args:
            vertices: The skin in the world [m], shape [v, 3].
            rotations: Of the joints in the world, shape [55, 3, 3].
        """
        for joint, soft in self.bodies.items():
            if soft.is_awake:
                moved, nodes, shares = self._bonds[joint]
                offset = soft.positions - soft.rest
                local = np.einsum("vka,vk->va", offset[nodes], shares)
                vertices[moved] += (local @ rotations[JOINT_INDEX[joint]].T).astype(np.float32)

    def show_pressure(self, full: float = FULL_HEAT) -> None:
        """Paint the skin by pressure from now on, red at `full` [Pa]; 0 paints it no more."""
        if not full >= 0:
            raise ConfigError(f"the full pressure must not be negative, got {full}")
        self._heat = full

    def paint(self, skin: PersonSkin) -> None:
        """Give a skin the colours of the present pressure, or its own where nothing presses."""
        pressure = self.pressure() if self._heat else np.zeros(1, np.float32)
        if pressure.max() < _LEAST_HEAT:
            if self._painted:
                skin.colors, self._painted = self._model.colors, False
            return
        skin.colors, self._painted = heat_colors(self._model.colors, pressure, self._heat), True


def heat_colors(
    colors: npt.NDArray[np.uint8], pressure: Floats, full: float
) -> npt.NDArray[np.uint8]:
    """Return colours that turn from the skin's own through blue, green and yellow to red.

    Args:
        colors: The skin's own, shape [v, 3].
        pressure: On each vertex [Pa], shape [v].
        full: Pressure that is red [Pa].
    """
    share = np.clip(pressure / full, 0.0, 1.0)
    place = np.linspace(0.0, 1.0, len(_HEAT))
    ramp = np.stack([np.interp(share, place, _HEAT[:, k]) for k in range(3)], axis=1)
    cover = np.clip(share / 0.08, 0.0, 1.0)[:, None]  # the faintest touch fades into the skin
    return np.round((1 - cover) * colors[:, :3] + cover * ramp).astype(np.uint8)


def _bond(
    model: BodyModel, joint: str, flesh: Flesh
) -> tuple[npt.NDArray[np.intp], npt.NDArray[np.int32], Floats]:
    """Return vertices of the skin, for each the four particles around it [b, 4], and their shares."""
    j = JOINT_INDEX[joint]
    owner = model.owner
    owners = [JOINT_INDEX[name] for name in _AROUND_TRUNK] if joint in _TRUNK else [j]
    local = model.vertices.astype(np.float64) - model.joints[j] - flesh.origin
    along = local @ flesh.axis
    inside = np.isin(owner, owners) & (along >= 0) & (along <= flesh.stations[-1])
    vertices = np.flatnonzero(inside)
    stations, sectors = flesh.outer.shape
    x, y = (local[vertices] @ across for across in flesh.across)
    s = along[vertices] / flesh.stations[-1] * (stations - 1)
    a = (np.arctan2(y, x) % (2 * np.pi)) / (2 * np.pi) * sectors
    low = np.minimum(s.astype(np.int64), stations - 2)
    left = a.astype(np.int64) % sectors
    u, w = s - low, a - np.floor(a)
    right = (left + 1) % sectors
    around = ((low, left), (low, right), (low + 1, left), (low + 1, right))
    nodes = np.stack([flesh.outer[at] for at in around], axis=1)
    shares = np.stack(((1 - u) * (1 - w), (1 - u) * w, u * (1 - w), u * w), axis=1)
    return vertices, nodes, shares.astype(np.float32)


def attach_tissue(
    world: World,
    body: Body,
    model: BodyModel,
    frames: Sequence[JointFrame],
    tissue: Sequence[str],
    *,
    config: TissueConfig | None = None,
    refinement: float = 1.0,
    substeps: int = SUBSTEPS,
    ignore: Sequence[Body] = (),
    skin: PersonSkin | None = None,
) -> Tissue:
    """Put flesh onto a spawned person whose URDF was written from `with_cores`.

    Args:
        world: The world.
        body: The person's body.
        model: Its surface.
        frames: Where the joints are found in the body.
        tissue: Names as in `expand_tissue`.
        config: What it is made of; that of `load_tissue` if None.
        refinement: Factor of the number of cells in each direction.
        substeps: Small steps in a physics step.
        ignore: Bodies that flesh does not feel, such as the chair that the person sits on.
        skin: The skin that shows it; it is made finer where it yields.

    Raises:
        UnknownNameError: If a name is not that of a segment that can have tissue.
        ConfigError: If a figure is impossible.
    """
    chosen = load_tissue() if config is None else config
    parts = {}
    for joint in expand_tissue(tissue):
        flesh = make_segment_flesh(model, joint, chosen, refinement=refinement)
        frame = frames[JOINT_INDEX[joint]]
        place = Pose(
            tuple(frame.offset.tolist()), tuple(quaternion_from_matrix(frame.rotation).tolist())
        )
        soft = SoftBody(
            f"{body.name}_{joint}",
            flesh.positions,
            material=chosen.material,
            tetrahedra=flesh.tetrahedra,
            faces=flesh.faces,
            held=flesh.held,
            carrier=Carrier(body, frame.link, place),
            substeps=substeps,
            mass_factor=chosen.mass_factor * refinement**2,
            focus=chosen.focus_m,
        )
        parts[joint] = (flesh, soft)
    soft_world = SoftWorld.of(world)
    for _, soft in parts.values():
        soft_world.add(soft)
    soft_world.ignore(ignore, by=SoftBody)
    if skin is None:
        return Tissue(model, chosen, parts)
    shown = np.zeros(len(model.vertices), np.bool_)
    for joint, (flesh, _) in parts.items():
        shown[_bond(model, joint, flesh)[0]] = True
    shown &= model.weights.max(axis=1) > STEADY  # where joints fold the skin it stays as it is
    fine = refined(model, shown, times=SKIN_REFINEMENT)
    made = Tissue(fine, chosen, parts)
    skin.model, skin.faces, skin.colors, skin.tissue = fine, fine.faces, fine.colors, made
    return made
