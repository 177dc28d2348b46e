"""The pressure between a resting person and what bears them: an elastic foundation in balance.

Each cell of a pad carries a column of flesh between bone and skin, and below it a column of cushion. Both
yield in series. The body is let down until the columns bear its weight: along and up, about the axes
along and across, and at the joints that let a resting limb down. Displacements are small, so places are
linear in these; pressure in the columns is not.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt
from scipy.ndimage import distance_transform_edt, uniform_filter  # type: ignore[import-untyped]

from rcare_marl.errors import ConfigError, check_name
from rcare_marl.pose import Array, Pose
from rcare_marl.world import GRAVITY

from ..avatar import AvatarConfig, body_model, body_segments
from ..body.posture import PostureConfig, pelvis_pose
from ..body.segment import Segment
from ..body.skeleton import DOF_INDEX, DOFS, JOINT_INDEX, JOINTS, PARENTS, SIDES, forward_kinematics
from ..body.skin import BodyModel, PersonSkin
from .bone import bones, over_bone, regions, resting_flesh
from .support import Layer, Pad, Support

if TYPE_CHECKING:
    from ..human import Human

Ints = npt.NDArray[np.intp]

CELL = 0.005  # [m] edge of a cell
SENSOR = (
    0.015  # [m] edge of the square over which a peak is taken, as sensors of mats (10 to 28 mm)
)
CONTACT = 670.0  # [Pa] from which skin counts as in contact: 5 mmHg, where mats begin to read
_ABOVE = 0.15  # [m] over a pad within which skin may come to rest on it
_NEAR = 0.1  # [m] within which a limb makes its joint let it down
_LEAST_WIDTH = 0.01  # [m]
_HELD = 25  # steps
_STEPS, _STRIDE, _BALANCED = 200, 0.02, 1e-5  # at most; [m] or [rad] a step; of the weight


@dataclass(frozen=True, eq=False)
class PosedBody:
    """A person as they are at one time.

    Attributes:
        avatar: Who it is.
        model: Their body.
        segments: Their segments by SMPL-X joint.
        turns: Rotations of the joints in the world, shape [55, 3, 3].
        places: Their positions [m], shape [55, 3].
    """

    avatar: AvatarConfig
    model: BodyModel
    segments: Mapping[str, Segment]
    turns: Array
    places: Array

    @classmethod
    def of(cls, person: Human) -> PosedBody:
        """Return a spawned person as they are now."""
        skin = PersonSkin(person.model, person.body, person.frames)
        return cls(person.avatar, person.model, person.segments, *skin.joint_transforms())

    @classmethod
    def laid(cls, avatar: AvatarConfig, posture: PostureConfig, pose: Pose = Pose()) -> PosedBody:
        """Return somebody in a posture on the support at `pose`, as `body.posture.pelvis_pose` puts them."""
        path, height = avatar.body_path(), avatar.height_m
        model = body_model(path, height)
        angles = posture.angles(avatar.profile.limits("passive"))
        pelvis = pelvis_pose(posture, model, angles, pose).matrix()
        turns, places = forward_kinematics(model.joints, angles)
        return cls(
            avatar,
            model,
            body_segments(path, height, avatar.mass_kg, avatar.sex),
            pelvis[:3, :3] @ turns,
            places @ pelvis[:3, :3].T + pelvis[:3, 3],
        )


@dataclass(frozen=True, eq=False)
class PressureMap:
    """Pressure on the skin, cell by cell.

    Attributes:
        points: Skin of each loaded cell before it gave way, in the world [m], shape [n, 3].
        pressure: On each [Pa], shape [n].
        sensed: What a mat reads there, the mean over its sensors [Pa], shape [n].
        area: Of a cell [m²].
        pads: Which pad bears each, an index, shape [n].
        spots: Place of each on its pad, along and across from its middle [m], shape [n, 2].
        regions: Which region each belongs to, an index in `bone.regions()`, shape [n].
        squeeze: By how much the flesh of each is thinner than unloaded, as a share, shape [n].
        weight: What the pads bear: all but what something else does [N].
        off: What is left out of balance, as a share of that weight.
        tilt: How far the pelvis turned back as it came to rest [rad].
    """

    points: Array
    pressure: Array
    sensed: Array
    area: float
    pads: Ints
    spots: Array
    regions: Ints
    squeeze: Array
    weight: float
    off: float
    tilt: float

    def of(self, region: str = "", *, pad: int | None = None) -> npt.NDArray[np.bool_]:
        """Return which cells belong to a region, on either side if none is named, and to a pad, shape [n]."""
        names = regions()
        known = {name.removeprefix("left_").removeprefix("right_") for name in names}
        chosen = np.ones(len(self.pressure), bool)
        if region:
            check_name("region of skin", region, (*known, *names))
            same = [
                i for i, name in enumerate(names) if name == region or name.endswith(f"_{region}")
            ]
            chosen &= np.isin(self.regions, same)
        return chosen if pad is None else chosen & (self.pads == pad)

    def peak(self, region: str = "", *, pad: int | None = None) -> float:
        """Return the greatest pressure that a mat would read [Pa]; 0 where nothing is borne."""
        return float(self.sensed[self.of(region, pad=pad)].max(initial=0.0))

    def contact_area(self, region: str = "", *, pad: int | None = None) -> float:
        """Return the area in contact [m²]."""
        return self.area * float((self.sensed[self.of(region, pad=pad)] > CONTACT).sum())

    def mean(self, region: str = "", *, pad: int | None = None) -> float:
        """Return the mean pressure where there is contact [Pa]; 0 where there is none."""
        read = self.sensed[self.of(region, pad=pad)]
        read = read[read > CONTACT]
        return float(read.mean()) if len(read) else 0.0

    def force(self, region: str = "", *, pad: int | None = None) -> float:
        """Return the force at right angles to the pads [N]."""
        return self.area * float(self.pressure[self.of(region, pad=pad)].sum())


@dataclass(frozen=True, eq=False)
class _Cells:
    """Skin over the pads: lowest point in each cell, [n, ...]."""

    points: Array
    gaps: Array
    shares: Array  # of each of the 55 joints
    cover: Array
    pads: Ints
    index: Ints  # row and column, [n, 2]


Columns = tuple[Array, Array, Array, Array]  # thickness, modulus, limit, preload; each [n]


@dataclass(frozen=True, eq=False)
class _Foundation:
    """Columns beneath a body, and the k ways in which it can give."""

    gaps: Array  # between skin and pad [m], shape [n]
    area: float
    lift: Array  # how each way moves skin off and along its pad, [n, k]
    slide: Array
    grips: npt.NDArray[np.bool_]
    flesh: Columns
    pull: Array  # of gravity on each way, [k]
    weight: float
    hold: Array  # stiffness of each way, [k]

    def settle(self, at: Array, lower: Columns) -> tuple[Array, Array, float]:
        """Return where the body comes to rest on cushions, pressures, and what is left out of balance."""
        lift, slide, area = self.lift, self.slide, self.area
        give = 3 * (self.flesh[0] / self.flesh[1] + lower[0] / lower[1])  # of E / 3
        for k in range(_STEPS):
            pressure, slope = _series(-self.gaps - lift @ at, self.flesh, lower)
            if k < _HELD:  # then the same cells stick, or some might come and go for ever
                held = area * self.grips * (pressure > 0) / give
            left = self.pull + lift.T @ (pressure * area) - slide.T @ (held * (slide @ at))
            left -= self.hold * at
            off = float(np.abs(left).max() / self.weight)
            if off < _BALANCED:
                return at, pressure, off
            matrix = (lift * (slope * area)[:, None]).T @ lift + (slide * held[:, None]).T @ slide
            step = np.linalg.solve(matrix + np.diag(self.hold + 1e-3 * self.weight), left)
            at = at + step * min(1.0, _STRIDE / np.abs(step).max())
        raise ConfigError("does not come to rest: the support does not bear them")


def pressure_map(who: Human | PosedBody, support: Support, *, cell: float = CELL) -> PressureMap:
    """Return the pressure of a person on a support, settled from the posture in which they are.

    Args:
        who: A spawned person as they are now, or a posed body.
        support: What bears them.
        cell: Edge of a cell [m].

    Raises:
        ConfigError: If the cell is not 1 to 20 mm, nobody is over the support, or it cannot bear them.
    """
    if not 0.001 <= cell <= 0.02:
        raise ConfigError(f"a cell is 0.001 to 0.02 m, got {cell}")
    body = who if isinstance(who, PosedBody) else PosedBody.of(who)
    borne = _borne(support)
    cells = _footprint(body, support, cell, borne)
    if not len(cells.gaps):
        raise ConfigError(f"{body.avatar.name} is not over the support")
    flesh, where = _flesh(body, cells)
    stiff, layers = resting_flesh(), [pad.cushion.layer for pad in support.pads]
    own, lower = _columns(flesh, stiff.modulus_pa, stiff.limit), _columns_of(layers, cells.pads)
    joints = [j for j in _relaxed(cells) if borne[j]]
    base = support.pads[0].axes
    motion = _motion(cells.points, cells.shares, body.places, base, joints)
    axes = np.array([pad.axes for pad in support.pads])[cells.pads]
    pull, weight = _weights(body, borne, base, joints)
    foundation = _Foundation(
        gaps=cells.gaps,
        area=cell**2,
        lift=np.einsum("na,nka->nk", axes[:, :, 2], motion),
        slide=np.einsum("na,nka->nk", axes[:, :, 0], motion),
        grips=np.array([pad.grips for pad in support.pads])[cells.pads],
        flesh=own,
        pull=pull,
        weight=weight,
        hold=np.array([0.0] * 4 + [stiff.relaxed[_kind(JOINTS[j])] for j in joints]),
    )
    try:
        at, pressure, _ = foundation.settle(np.zeros(len(pull)), lower)
        grids = _on_pads(pressure, cells, support, cell)
        narrow = _off_pads([_half_width(grid > 0, cell) for grid in grids], cells)
        spread = np.array([layer.spread for layer in layers])[cells.pads] * lower[0] / narrow
        stiffer = (lower[0], lower[1] * (1 + 2 / np.pi * spread), *lower[2:])
        at, pressure, off = foundation.settle(at, stiffer)
    except ConfigError as error:
        raise ConfigError(f"{body.avatar.name} {error}") from error
    wide, grids = max(round(SENSOR / cell), 1), _on_pads(pressure, cells, support, cell)
    sensed = _off_pads([uniform_filter(grid, wide, mode="constant") for grid in grids], cells)
    loaded = pressure > 0
    sizes = np.array([pad.size for pad in support.pads])[cells.pads]
    return PressureMap(
        points=cells.points[loaded],
        pressure=pressure[loaded],
        sensed=sensed[loaded],
        area=cell**2,
        pads=cells.pads[loaded],
        spots=((cells.index + 0.5) * cell - 0.5 * sizes)[loaded],
        regions=where[loaded],
        squeeze=(pressure / (stiff.modulus_pa + pressure / stiff.limit))[loaded],
        weight=weight,
        off=off,
        tilt=-float(at[2]),
    )


def _kind(joint: str) -> str:
    return joint.split("_", 1)[1] if joint.startswith(SIDES) else joint


def _shape(pad: Pad, cell: float) -> tuple[int, int]:
    return int(np.ceil(pad.size[0] / cell)), int(np.ceil(pad.size[1] / cell))


def _on_pads(values: Array, cells: _Cells, support: Support, cell: float) -> list[Array]:
    """Return values of the cells as one grid a pad."""
    grids = [np.zeros(_shape(pad, cell)) for pad in support.pads]
    for k, grid in enumerate(grids):
        grid[tuple(cells.index[cells.pads == k].T)] = values[cells.pads == k]
    return grids


def _off_pads(grids: list[Array], cells: _Cells) -> Array:
    """Return the values in grids by cell."""
    out = np.zeros(len(cells.gaps))
    for k, grid in enumerate(grids):
        out[cells.pads == k] = grid[tuple(cells.index[cells.pads == k].T)]
    return out


def _half_width(contact: npt.NDArray[np.bool_], cell: float) -> Array:
    """Return the radius of the largest disc in contact that covers each cell [m], at least 10 mm."""
    inside = distance_transform_edt(np.pad(contact, 1))[1:-1, 1:-1] * cell
    out = np.full(contact.shape, _LEAST_WIDTH)
    for radius in _LEAST_WIDTH * 1.25 ** np.arange(1, 15):
        if not (inside >= radius).any():
            break
        out[distance_transform_edt(inside < radius) * cell <= radius] = radius
    return out


def _borne(support: Support) -> npt.NDArray[np.bool_]:
    """Return which segments the pads bear, shape [55]."""
    out = np.ones(len(JOINTS), bool)
    for j, joint in enumerate(JOINTS):
        out[j] = joint not in support.elsewhere and (j == 0 or out[PARENTS[j]])
    return out


def _footprint(
    body: PosedBody, support: Support, cell: float, borne: npt.NDArray[np.bool_]
) -> _Cells:
    """Return the lowest skin over each cell of the pads."""
    model = body.model
    skin = model.posed(body.turns, body.places).astype(np.float64)
    faces = model.faces[borne[model.owner[model.faces]].all(axis=1)]
    found = bones(model, body.avatar.height_m)
    parts = []
    for k, pad in enumerate(support.pads):
        local = (skin - pad.pose.position) @ pad.axes + (*(0.5 * np.array(pad.size)), 0.0)
        corners = local[faces]
        facing = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])[:, 2] < 0
        low, high = corners.min(axis=1), corners.max(axis=1)
        facing &= (low[:, 2] < _ABOVE) & (high[:, :2] > 0).all(axis=1)
        facing &= (low[:, :2] < pad.size).all(axis=1)
        chosen = faces[facing]
        if not len(chosen):
            continue
        # Points close enough that no cell between them is left out.
        longest = np.ptp(corners[facing], axis=1)[:, :2].max()
        count = int(np.ceil(1.5 * longest / cell)) + 1
        i, j = np.divmod(np.arange(count**2), count)
        inner = i + j < count
        shares = np.column_stack((i, j, count - 1 - i - j))[inner] / max(count - 1, 1)
        points = np.einsum("sc,fca->fsa", shares, local[chosen]).reshape(-1, 3)
        face = np.repeat(np.arange(len(chosen)), len(shares))
        part = np.tile(np.arange(len(shares)), len(chosen))
        index = np.floor(points[:, :2] / cell).astype(np.intp)
        size = _shape(pad, cell)
        inside = ((index >= 0) & (index < size)).all(axis=1)
        order = np.flatnonzero(inside)[np.argsort(points[inside, 2], kind="stable")]
        flat = index[order] @ (size[1], 1)
        first = order[np.unique(flat, return_index=True)[1]]
        first = first[points[first, 2] < _ABOVE]
        corner, share = chosen[face[first]], shares[part[first]]
        blend = np.zeros((len(first), len(JOINTS)))
        weights = model.weights[corner] * share[:, :, None]
        np.add.at(
            blend, (np.arange(len(first))[:, None, None], model.weight_joints[corner]), weights
        )
        where = np.einsum("nc,nca->na", share, skin[corner])
        cover = (found.cover[corner] * share).sum(axis=1)
        parts.append((where, points[first, 2], blend, cover, np.full(len(first), k), index[first]))
    if not parts:
        return _Cells(*(np.zeros(0),) * 4, np.zeros(0, np.intp), np.zeros((0, 2), np.intp))
    return _Cells(*(np.concatenate(column) for column in zip(*parts, strict=True)))


def _flesh(body: PosedBody, cells: _Cells) -> tuple[Array, Ints]:
    """Return thickness of flesh [m] and region of each cell; paralysed buttocks and legs are wasted."""
    wasted, left = resting_flesh().wasted, np.ones(len(JOINTS))
    for side in SIDES:
        dof = DOFS[DOF_INDEX[f"{side}_hip_flexion"]]
        grade = body.avatar.profile.grade(dof, positive=False)
        left[_below(JOINT_INDEX[f"{side}_hip"])] = wasted + (1 - wasted) * grade / 5
    left[0] = 0.5 * sum(left[JOINT_INDEX[f"{side}_hip"]] for side in SIDES)
    found = bones(body.model, body.avatar.height_m)
    return over_bone(found, body.turns, body.places, cells.points, cells.cover, cells.shares @ left)


def _below(joint: int) -> npt.NDArray[np.bool_]:
    """Return which segments hang on a joint, shape [55]."""
    out = np.zeros(len(JOINTS), bool)
    for j in range(len(JOINTS)):
        out[j] = j == joint or (j > 0 and out[PARENTS[j]])
    return out


def _relaxed(cells: _Cells) -> list[int]:
    """Return the joints that let down a limb which lies near a pad."""
    near = cells.shares[cells.gaps < cells.gaps.min() + _NEAR].sum(axis=0)
    kinds = resting_flesh().relaxed
    return [j for j, joint in enumerate(JOINTS) if _kind(joint) in kinds and near[j] > 1.0]


def _motion(points: Array, shares: Array, places: Array, base: Array, joints: list[int]) -> Array:
    """Return how points move with each of the ways to give [m/m] and [m/rad], shape [n, k, 3].

    The ways: along x and z of the first pad, about its y and x through the pelvis, about its y at joints.
    """
    x, y, z = base.T
    arms = points - places[0]
    ways = [np.tile(x, (len(points), 1)), np.tile(z, (len(points), 1)), np.cross(y, arms)]
    ways.append(np.cross(x, arms))
    for j in joints:
        ways.append(np.cross(y, points - places[j]) * shares[:, _below(j)].sum(axis=1)[:, None])
    return np.stack(ways, axis=1)


def _weights(
    body: PosedBody, borne: npt.NDArray[np.bool_], base: Array, joints: list[int]
) -> tuple[Array, float]:
    """Return the pull of gravity on each of the ways to give [N], [N·m], and the weight borne [N]."""
    own = [body.segments[joint] for joint in JOINTS]
    mass = np.array([segment.mass for segment in own]) * borne
    centres = np.einsum("jab,jb->ja", body.turns, np.array([s.centre for s in own])) + body.places
    motion = _motion(centres, np.eye(len(JOINTS)), body.places, base, joints)
    return -GRAVITY * mass @ motion[:, :, 2], float(GRAVITY * mass.sum())


def _columns(thickness: Array, modulus: float, limit: float) -> Columns:
    one = np.ones_like(thickness)
    return thickness, modulus * one, limit * one, 0.0 * one


def _columns_of(layers: list[Layer], which: Ints) -> Columns:
    rows = np.array([(la.thickness_m, la.modulus_pa, la.limit, la.preload_pa) for la in layers])
    thickness, modulus, limit, preload = rows[which].T
    return thickness, modulus, limit, preload


def _series(depth: Array, upper: Columns, lower: Columns) -> tuple[Array, Array]:
    """Return pressure [Pa] and its slope [Pa/m] of two columns pressed together by `depth` [m].

    Where the lower one does not yield yet, the upper one alone does.
    """
    t, e, limit, _ = upper
    deep = np.clip(depth, 0.0, 0.98 * (t * limit + lower[0] * lower[2]))
    strain = np.minimum(deep / t, 0.999 * limit)
    alone = e * strain / (1 - strain / limit)
    preload = lower[3]
    # Thickness p / (E + p / limit) of both sums up to the depth: quadratic in p over the preload.
    a1, b1 = e + preload / limit, 1 / limit
    a2, b2, t2 = lower[1], 1 / lower[2], lower[0]
    rest = deep - t * preload / a1
    # t (preload + q) / (a1 + b1 q) + t2 q / (a2 + b2 q) = deep
    c2 = t * b2 + t2 * b1 - deep * b1 * b2
    c1 = t * (a2 + b2 * preload) + t2 * a1 - deep * (a1 * b2 + a2 * b1)
    c0 = -rest * a1 * a2
    root = np.sqrt(np.maximum(c1 * c1 - 4 * c2 * c0, 0.0))
    both = preload + np.maximum(-2 * c0 / np.where(c1 + root > 0, c1 + root, np.inf), 0.0)
    pressure = np.where((rest > 0) & (deep > 0), both, np.where(deep > 0, alone, 0.0))
    give = t * e / (e + pressure / limit) ** 2
    more = np.maximum(pressure - preload, 0.0)
    give += np.where(pressure > preload, t2 * a2 / (a2 + more * b2) ** 2, 0.0)
    return pressure, np.where(deep > 0, 1 / give, 0.0)
