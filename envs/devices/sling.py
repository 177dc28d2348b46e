"""A sling of fabric: how it lies round a person, and how it hangs empty."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from rcare_marl.agents.people.body.skeleton import JOINT_INDEX, SIDES
from rcare_marl.agents.people.body.skin import PersonSkin
from rcare_marl.body import Body
from rcare_marl.errors import ConfigError
from rcare_marl.pose import Array, Vector, matrix_from_quaternion
from rcare_marl.world import World

if TYPE_CHECKING:
    from rcare_marl.agents.people.human import Human

Floats = npt.NDArray[np.float32]
Faces = npt.NDArray[np.int32]
Rgba = tuple[float, float, float, float]

# How finely the fabric is drawn, and how taut it lies; our own choice.
_BACK, _FLAP = (30, 25), (10, 19)  # rows along the body, columns round it
_SLAB = 0.05  # half thickness of the slice of the body that a row of fabric goes round [m]
_TURNS = 72  # directions in which a slice of the body is measured
_EVERY = 4  # of so many points of the skin, one may lead the fabric
_PULLS = 3  # times that the rows are smoothed
_LOOP = 0.22  # of a strap, that is coloured
_ARMS, _HANDS = ("shoulder",), ("elbow", "wrist", "index", "middle", "ring", "pinky", "thumb")


@dataclass(frozen=True)
class SlingConfig:
    """A sling (`assets/devices/sling_*.yaml`); lengths in metres.

    Attributes:
        source: Where the figures are from.
        posture: How a person hangs in it (`assets/postures`).
        head_support: Whether it bears the head.
        holds_arms: Whether the arms lie inside the fabric.
        gap: Of the fabric from the skin.
        wrap_deg: How far it goes round, each way from the middle of the back [deg]: at the head, the
            neck, the shoulders, the waist, the hips and the seat.
        flap: Where a leg flap begins and ends on the thigh, as shares of its length.
        flap_wrap_deg: How far a flap goes round the thigh from below, outwards and inwards [deg].
        strap_width: Of the straps.
        idle_depth: How far it hangs below the bar when it is empty.
        fabric: Colour, red, green, blue, alpha, each in [0, 1].
        binding: Colour of its edges.
        strap: Colour of the straps.
        loop: Colour of their ends.
    """

    source: str
    posture: str
    head_support: bool
    holds_arms: bool
    gap: float
    wrap_deg: tuple[float, float, float, float, float, float]
    flap: tuple[float, float]
    flap_wrap_deg: tuple[float, float]
    strap_width: float
    idle_depth: float
    fabric: Rgba
    binding: Rgba
    strap: Rgba
    loop: Rgba

    def __post_init__(self) -> None:
        if not 0 <= self.flap[0] < self.flap[1] <= 1:
            raise ConfigError(f"flap must be two rising shares of the thigh, got {self.flap}")
        if max(*self.wrap_deg, *self.flap_wrap_deg) > 150:
            raise ConfigError("fabric goes round a body by 150 degrees each way at most")


@dataclass(frozen=True)
class _Cloth:
    """Fabric before it is bound: points [m], faces, colours, and which points hang on the bar."""

    points: Array
    faces: npt.NDArray[np.int64]
    colors: Array
    on_bar: npt.NDArray[np.bool_]


class Sling:
    """A sling on a spreader bar, for renderers: implements `rcare_marl.world.Skin`.

    It has no physics of its own: the bonds of the bar carry the person. Round a person the fabric
    follows their skin; empty, it hangs from the hooks in a fold.

    Attributes:
        config: Its figures.
        body: The lift.
        faces: Vertex indices, shape [m, 3].
        colors: RGB of each vertex, shape [n, 3].
    """

    body: Body
    faces: Faces
    colors: npt.NDArray[np.uint8]

    def __init__(self, config: SlingConfig) -> None:
        """Prepare a sling of these figures."""
        self.config = config

    def hang(self, world: World, lift: Body, link: str, hooks: Mapping[str, Vector]) -> None:
        """Hang it, empty, on the hooks of a link of a lift and let the renderers draw it.

        Args:
            world: Where the lift is.
            lift: The body of the lift.
            link: The bar.
            hooks: Where the hooks are in the frame of the bar [m].
        """
        # Renderers draw a skin in place of its body, but the lift is to be seen as well: a second
        # handle on the same body.
        self.body = Body(world, lift.uid, lift.name, lift.source)
        self._link = lift.link_index(link)
        self._hooks = {name: np.array(at) for name, at in hooks.items()}
        self.clear()
        world.skins.append(self)

    def clear(self) -> None:
        """Let it hang empty."""
        self._person: PersonSkin | None = None
        self._show(_idle(self.config, self._hooks))

    def drape(self, person: Human) -> None:
        """Lay it round a person as they are now."""
        skin = PersonSkin(person.model, person.body, person.frames)
        rotations, positions = skin.joint_transforms()
        surface = person.model.posed(rotations, positions).astype(np.float64)
        to_pelvis = rotations[0]
        local = (surface - positions[0]) @ to_pelvis
        joints = (positions - positions[0]) @ to_pelvis
        turn, at = self._bar()
        hooks = {n: (turn @ h + at - positions[0]) @ to_pelvis for n, h in self._hooks.items()}
        head_up = to_pelvis.T @ rotations[JOINT_INDEX["head"]][:, 1]
        cloth = _worn(self.config, local, person.model.owner, joints, head_up, hooks)
        # Each point of the fabric follows the skin next to it: its place in the body's rest pose.
        # Arms move freely, and pull no fabric along.
        model = person.model
        there = cloth.points @ to_pelvis.T + positions[0]
        free = np.flatnonzero(~cloth.on_bar)
        skinned = np.flatnonzero(~_owned(model.owner, (*_ARMS, *_HANDS)))[::_EVERY]
        shifted = surface[skinned] - positions[0]
        squares = (shifted**2).sum(axis=1)
        near = skinned[np.argmin(squares - 2 * (there[free] - positions[0]) @ shifted.T, axis=1)]
        self._joints = model.weight_joints[near].astype(np.intp)
        self._weights = model.weights[near].astype(np.float64)
        turns, shifts = self._moves(rotations, positions, model.joints)
        self._rest = np.linalg.solve(turns, (there[free] - shifts)[:, :, None])[:, :, 0]
        self._free = free
        self._person = skin
        self._show(
            _Cloth((there - at) @ turn, cloth.faces, cloth.colors, cloth.on_bar)
        )  # on the bar: in its frame

    def vertices(self) -> Floats:
        """Return the present fabric in the world [m], shape [n, 3]."""
        turn, at = self._bar()
        out = self._on_bar @ turn.T + at
        if self._person is not None:
            rotations, positions = self._person.joint_transforms()
            turns, shifts = self._moves(rotations, positions, self._person.model.joints)
            out[self._free] = np.einsum("nab,nb->na", turns, self._rest) + shifts
        return out.astype(np.float32)

    def rest_pieces(self) -> list[tuple[int, Floats, Faces]]:
        """Return the fabric as one piece of the bar, as it lay when it was last put on or off."""
        everything = np.arange(len(self.faces), dtype=np.int32)
        return [(self._link, self._on_bar.astype(np.float32), everything)]

    def _bar(self) -> tuple[Array, Array]:
        pose = self.body.link_pose(self._link)
        return matrix_from_quaternion(pose.quaternion), np.array(pose.position)

    def _moves(self, rotations: Array, positions: Array, rest: Array) -> tuple[Array, Array]:
        """Return how the skin next to each point has moved: matrices [n, 3, 3], shifts [n, 3]."""
        offsets = positions - np.einsum("jab,jb->ja", rotations, rest)
        turns = np.einsum("nk,nkab->nab", self._weights, rotations[self._joints])
        return turns, np.einsum("nk,nka->na", self._weights, offsets[self._joints])

    def _show(self, cloth: _Cloth) -> None:
        self._on_bar = cloth.points
        self.faces = cloth.faces.astype(np.int32)
        self.colors = np.round(255 * cloth.colors[:, :3]).astype(np.uint8)


def _worn(
    config: SlingConfig,
    surface: Array,
    owner: npt.NDArray[np.intp],
    joints: Array,
    head_up: Array,
    hooks: Mapping[str, Array],
) -> _Cloth:
    """Return the fabric round a body whose surface and joints are given, x to the body's left."""
    back = _back(config, surface, owner, joints, head_up)
    panels = [back]
    row = round(0.36 * (len(back) - 1)) if config.head_support else 0
    anchors = []
    for side, column in zip(SIDES, (-1, 0), strict=True):
        anchors.append((back[row, column], back[row + 2, column], hooks[f"hook_{side}_back"]))
    for side in SIDES:
        flap = _flap(config, surface, owner, joints, side)
        panels.append(flap)
        anchors.append((flap[-1, -1], flap[-2, -1], hooks[f"hook_{side}_front"]))
    return _join(config, panels, anchors)


def _back(
    config: SlingConfig,
    surface: Array,
    owner: npt.NDArray[np.intp],
    joints: Array,
    head_up: Array,
) -> Array:
    """Return the panel from the head or the shoulders down to the seat, shape [rows, columns, 3]."""
    at = {
        name: joints[JOINT_INDEX[name]] for name in ("pelvis", "spine2", "spine3", "neck", "head")
    }
    hips, knees = (
        joints[[JOINT_INDEX[f"{s}_{name}"] for s in SIDES]].mean(axis=0) for name in ("hip", "knee")
    )
    shoulders = 0.5 * (at["neck"] + at["spine3"])
    stops = [at["head"] + 0.17 * head_up, at["neck"], shoulders, at["spine2"], at["pelvis"]]
    stops.append(hips + 0.32 * (knees - hips))
    wrap = np.radians(config.wrap_deg)
    if not config.head_support:
        # The upper edge runs below the armpits.
        stops, wrap = [0.7 * at["spine3"] + 0.3 * at["neck"], *stops[3:]], wrap[2:]
    middles, tangents, share = _curve(np.array(stops), _BACK[0])
    reach = np.interp(share[1], share[0], wrap)
    hidden = (*_HANDS, "knee", "ankle", "foot") + (() if config.holds_arms else _ARMS)
    seen = surface[~_owned(owner, hidden)]
    return _wrapped(config, seen, middles, tangents, -reach, reach, _BACK[1])


def _flap(
    config: SlingConfig, surface: Array, owner: npt.NDArray[np.intp], joints: Array, side: str
) -> Array:
    """Return the flap under one thigh, from outside to inside, shape [rows, columns, 3]."""
    hip, knee = (joints[JOINT_INDEX[f"{side}_{name}"]] for name in ("hip", "knee"))
    ends = np.array([hip + share * (knee - hip) for share in config.flap])
    middles, tangents, _ = _curve(ends, _FLAP[0])
    outer, inner = np.radians(config.flap_wrap_deg)
    sign = 1.0 if side == "left" else -1.0
    taper = np.linspace(0.6, 1.0, _FLAP[0])  # narrow between the legs near the body
    thigh = surface[owner == JOINT_INDEX[f"{side}_hip"]]
    return _wrapped(
        config,
        thigh,
        middles,
        tangents,
        np.full(_FLAP[0], sign * outer),
        -sign * inner * taper,
        _FLAP[1],
    )


def _owned(owner: npt.NDArray[np.intp], parts: Sequence[str]) -> npt.NDArray[np.bool_]:
    chosen = [i for name, i in JOINT_INDEX.items() if any(part in name for part in parts)]
    return np.isin(owner, chosen)


def _curve(stops: Array, count: int) -> tuple[Array, Array, tuple[Array, Array]]:
    """Return points evenly along a path, its smoothed directions, and lengths at stops and points."""
    along = np.concatenate(([0.0], np.cumsum(np.linalg.norm(np.diff(stops, axis=0), axis=1))))
    even = np.linspace(0.0, along[-1], count)
    points = np.column_stack([np.interp(even, along, stops[:, k]) for k in range(3)])
    for _ in range(_PULLS):
        points[1:-1] = 0.25 * points[:-2] + 0.5 * points[1:-1] + 0.25 * points[2:]
    tangents = np.gradient(points, axis=0)
    return points, tangents / np.linalg.norm(tangents, axis=1, keepdims=True), (along, even)


def _wrapped(
    config: SlingConfig,
    surface: Array,
    middles: Array,
    tangents: Array,
    start: Array,
    end: Array,
    columns: int,
) -> Array:
    """Return fabric that lies round a surface, row by row across a path, shape [rows, columns, 3].

    Each row lies on the convex hull of a slice of the body, so that it spans hollows as taut fabric
    does. Angles [rad] go from below or behind towards the left.
    """
    sideways = np.array((1.0, 0.0, 0.0))
    outward = np.cross(sideways, tangents)
    outward /= np.linalg.norm(outward, axis=1, keepdims=True)
    sides = np.cross(tangents, outward)
    share = np.linspace(0.0, 1.0, columns)
    angles = start[:, None] + (end - start)[:, None] * share
    ways = (
        np.cos(angles)[:, :, None] * outward[:, None] + np.sin(angles)[:, :, None] * sides[:, None]
    )
    far = np.full(angles.shape, np.nan)
    every = np.linspace(-np.pi, np.pi, _TURNS, endpoint=False)
    circle = np.column_stack((np.cos(every), np.sin(every)))
    for k, (middle, tangent) in enumerate(zip(middles, tangents, strict=True)):
        arms = surface - middle
        slab = arms[np.abs(arms @ tangent) < _SLAB]
        if len(slab):
            flat = np.column_stack((slab @ outward[k], slab @ sides[k]))
            support = np.maximum((flat @ circle.T).max(axis=0), 0.02)
            lean = np.cos(angles[k][:, None] - every)
            ahead = lean > 0.05
            far[k] = np.where(ahead, support / np.where(ahead, lean, 1.0), np.inf).min(axis=1)
    rows = np.arange(len(far))
    for column in far.T:
        known = np.isfinite(column)
        column[:] = np.interp(rows, rows[known], column[known])
    out: Array = middles[:, None] + (far + config.gap)[:, :, None] * ways
    for _ in range(_PULLS):
        out[1:-1] = 0.25 * out[:-2] + 0.5 * out[1:-1] + 0.25 * out[2:]
    return out


def _join(
    config: SlingConfig, panels: Sequence[Array], anchors: Sequence[tuple[Array, Array, Array]]
) -> _Cloth:
    """Return panels and straps as one cloth; a strap runs from an edge of a panel to a hook."""
    points, faces, colors, on_bar = [], [], [], []
    count = 0
    for panel in panels:
        rows, columns = panel.shape[:2]
        paint = np.tile(config.fabric, (rows, columns, 1))
        paint[[0, -1]] = config.binding
        paint[:, [0, -1]] = config.binding
        points.append(panel.reshape(-1, 3))
        colors.append(paint.reshape(-1, 4))
        faces.append(_grid(rows, columns) + count)
        on_bar.append(np.zeros(rows * columns, np.bool_))
        count += rows * columns
    for a, b, hook in anchors:
        strip, paint = _strap(config, a, b, hook)
        points.append(strip)
        colors.append(paint)
        faces.append(_grid(len(strip) // 2, 2) + count)
        held = np.zeros(len(strip), np.bool_)
        held[2:] = True  # its first two points are sewn on
        on_bar.append(held)
        count += len(strip)
    return _Cloth(
        np.concatenate(points),
        np.concatenate(faces),
        np.concatenate(colors),
        np.concatenate(on_bar),
    )


def _strap(config: SlingConfig, a: Array, b: Array, hook: Array) -> tuple[Array, Array]:
    """Return points and colours of a strap from the edge at `a`, towards `b`, to a hook."""
    across = (b - a) / np.linalg.norm(b - a) * config.strap_width
    start = np.array((a, a + across))
    top = np.array((hook - 0.4 * across, hook + 0.4 * across))
    shares = (0.0, 1 - _LOOP, 1 - _LOOP + 0.001, 1.0)
    rows = [(1 - s) * start + s * top for s in shares]
    paint = np.array([config.strap] * 4 + [config.loop] * 4)
    return np.concatenate(rows), paint


def _grid(rows: int, columns: int) -> npt.NDArray[np.int64]:
    """Return the triangles of a grid of points, row by row, shape [2 (rows-1) (columns-1), 3]."""
    index = np.arange(rows * columns).reshape(rows, columns)
    a, b, c, d = index[:-1, :-1], index[:-1, 1:], index[1:, 1:], index[1:, :-1]
    quads = np.stack((a, b, c, a, c, d), axis=-1)
    return quads.reshape(-1, 3)


def _idle(config: SlingConfig, hooks: Mapping[str, Array]) -> _Cloth:
    """Return the empty sling: a fold of fabric between the front and the back hooks, in the bar."""
    along = np.linspace(-1.0, 1.0, 25)
    across = np.linspace(-1.0, 1.0, 13)
    s, v = np.meshgrid(along, across, indexing="ij")
    half = max(float(h[1]) for h in hooks.values())
    reach = max(float(h[0]) for h in hooks.values())
    width = half * (0.62 + 0.2 * (1 - s**2))
    fold = 0.02 * np.sin(3 * np.pi * v) * (1 - s**2)
    panel = np.stack(
        (
            0.8 * reach * np.sign(s) * np.abs(s) ** 0.5 + fold,
            width * v,
            -0.14 - (config.idle_depth - 0.14) * (1 - np.abs(s) ** 3),
        ),
        axis=-1,
    )
    anchors = []
    for side, column, inner in (("left", -1, -2), ("right", 0, 1)):
        for end, row in (("front", -1), ("back", 0)):
            anchors.append((panel[row, column], panel[row, inner], hooks[f"hook_{side}_{end}"]))
    cloth = _join(config, [panel], anchors)
    return _Cloth(cloth.points, cloth.faces, cloth.colors, np.ones(len(cloth.points), np.bool_))
