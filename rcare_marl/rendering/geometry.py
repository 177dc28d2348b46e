"""Everything rigid in a world as one indexed vertex buffer, and the transforms that place it."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import lru_cache
from itertools import groupby
from typing import Any, Literal

import numpy as np
import numpy.typing as npt

from rcare_marl.bullet import bullet

from ..body import Body
from ..body_part import VisualShape
from ..model.mesh import Mesh
from ..pose import matrix_from_quaternion
from ..world import World
from .mesh import Floats, Ints, detail_levels, shape_mesh
from .shot import Labels

VERTEX = np.dtype(
    [
        ("position", "f4", 3),
        ("normal", "f4", 3),
        ("rgba", "u1", 4),
        ("slot", "u4"),
        ("label", "i4"),
    ]
)

Pass = Literal["surface", "depth", "survey"]
LAYOUTS: dict[Pass, tuple[str, ...]] = {  # what each pass takes of `VERTEX`
    "surface": ("3f 3f 4f1 1u4 1i4", "in_position", "in_normal", "in_rgba", "in_slot", "in_label"),
    "depth": ("3f 16x 1u4 4x", "in_position", "in_slot"),
    "survey": ("3f 3f 4x 1u4 1i4", "in_position", "in_normal", "in_slot", "in_label"),
}

FLOOR_RGBA = (186, 160, 131, 255)  # light oak, sRGB
_UNCHOSEN = 0.8  # the grey of a shape that no colour was given to
_SLAB_WIDTH = 3.0  # [m]; a flat thing wider than that in both directions is a floor
_SLAB_HEIGHT = 0.3
_SLAB_COVER = 0.5  # share of the box around it that a floor covers at least
_WALL = (
    1.9  # [m]; a still thing larger than that in two directions casts no shadow, or rooms go dark
)


@dataclass(frozen=True)
class Part:
    """A shape with its mesh and its place in the scene."""

    body: Body
    shape: VisualShape
    mesh: Mesh
    rgba: npt.NDArray[np.uint8]  # sRGB, shape [n, 4]
    is_still: bool
    label: int  # number of its link, as in `Labels`

    @property
    def alpha(self) -> float:
        """Opacity in [0, 1]."""
        return self.shape.rgba[3]

    @property
    def is_floor(self) -> bool:
        """Whether it is a wide flat slab that does not move and lies level.

        It is none if it leaves most of the box around it free, as all worktops of a house in one mesh do.
        """
        wide, deep, high = np.ptp(self.mesh.vertices, axis=0).tolist()
        pose = self.body.base_pose() @ self.shape.pose
        level = abs(float(pose.matrix()[2, 2])) > 0.999
        is_slab = self.is_still and level and min(wide, deep) > _SLAB_WIDTH and high < _SLAB_HEIGHT
        return is_slab and self._seen_from_above() > _SLAB_COVER * wide * deep

    def _seen_from_above(self) -> float:
        """Return the area of the sides that look up its own z, seen along it [m²]."""
        corners = self.mesh.vertices[self.mesh.faces][..., :2]
        (ax, ay), (bx, by) = (corners[:, 1] - corners[:, 0]).T, (corners[:, 2] - corners[:, 0]).T
        return float(np.clip(0.5 * (ax * by - ay * bx), 0.0, None).sum())

    @property
    def is_plane(self) -> bool:
        """Whether it is a floor without thickness."""
        return self.is_floor and float(np.ptp(self.mesh.vertices[:, 2])) < 0.002

    @property
    def top(self) -> float:
        """Height of a level part's upper side at present [m]."""
        pose = self.body.base_pose() @ self.shape.pose
        turned = self.mesh.vertices @ pose.matrix()[2, :3]
        return float(pose.position[2] + turned.max())

    @property
    def area(self) -> float:
        """Area of the box around it, seen from above its own frame [m²]."""
        wide, deep, _ = np.ptp(self.mesh.vertices, axis=0).tolist()
        return float(wide * deep)

    @property
    def casts(self) -> bool:
        """Whether it casts a shadow."""
        extent = np.sort(np.ptp(self.mesh.vertices, axis=0))
        return self.alpha >= 0.99 and not (self.is_still and extent[1] > _WALL)


def skinned_bodies(world: World) -> set[int]:
    """Return the `id` of each body that a skin is drawn for."""
    return {id(skin.body) for skin in world.skins}


def world_parts(world: World) -> list[Part]:
    """Return the shapes of every body that no skin stands for; what is invisible is left out."""
    skinned, labels = skinned_bodies(world), Labels(world)
    out = []
    for body in world.bodies:
        if id(body) in skinned:
            continue
        dynamics = bullet.getDynamicsInfo(body.uid, -1, physicsClientId=world.client)
        is_still = dynamics[0] == 0 and not body.link_count
        for shape in body.visual_shapes():
            mesh = shape_mesh(shape) if shape.rgba[3] > 0.003 else None
            if mesh is not None and len(mesh.faces):
                label = labels.of(body.uid, shape.link)
                part = Part(body, shape, mesh, _rgba(shape, mesh), is_still, label)
                if part.is_floor and (part.is_plane or _is_grey(shape)):
                    part.rgba[:] = FLOOR_RGBA  # nobody chose a colour
                out.append(part)
    return out


def _rgba(shape: VisualShape, mesh: Mesh) -> npt.NDArray[np.uint8]:
    given = np.round(np.clip(shape.rgba, 0, 1) * 255).astype(np.uint8)
    out = np.tile(given, (len(mesh.vertices), 1))
    if mesh.colors is not None and min(shape.rgba[:3]) > 0.99:  # Bullet's white: the file decides
        out[:, :3] = mesh.colors
    return out


def _is_grey(shape: VisualShape) -> bool:
    return bool(np.allclose(shape.rgba[:3], _UNCHOSEN, atol=0.01))


@dataclass(frozen=True)
class Run:
    """A run of indices that is drawn at once: a dense shape, or many plain ones of a kind.

    Attributes:
        levels: (first index, count) of each level of detail, the full one first.
        slot: Row of the transform of its first shape.
        center: Middle of its first shape in the frame of the shape [m], shape [3].
        radius: Of the sphere around its first shape [m].
        is_one: Whether there is no other shape in it.
    """

    levels: tuple[tuple[int, int], ...]
    is_floor: bool
    is_still: bool
    casts: bool
    closed: bool
    alpha: float
    slot: int
    center: npt.NDArray[np.float32]
    radius: float
    is_one: bool

    def level(self, wanted: int) -> tuple[int, int]:
        """Return (first index, count) of a level, or of the coarsest there is."""
        return self.levels[min(wanted, len(self.levels) - 1)]


class Geometry:
    """The rigid shapes of a world in one vertex and one index buffer.

    Attributes:
        parts: The shapes, in the order of their slots, of which the first is 1.
        vertices: Array of `VERTEX`, in the frames of the shapes.
        indices: Shape [n].
        runs: What to draw at once.
        transforms: From shape to world, without the last row, shape [slots, 3, 4]; 0 is identity.
        still: Slots of what does not move by itself.

    `levels` says which faces a part has at each level of detail; those of `mesh_levels` if None.
    """

    def __init__(
        self, parts: Sequence[Part], levels: Callable[[Part], tuple[Ints, ...]] | None = None
    ) -> None:
        self._levels = levels or (lambda part: mesh_levels(part.mesh))
        self.parts = sorted(parts, key=_order)
        self.transforms = np.zeros((len(parts) + 1, 3, 4), np.float32)
        self.transforms[0, :, :3] = np.eye(3)
        self.still = np.array([1 + i for i, p in enumerate(self.parts) if p.is_still], np.intp)
        blocks: list[npt.NDArray[Any]] = [np.empty(0, VERTEX)]
        for slot, part in enumerate(self.parts, 1):
            block = np.empty(len(part.mesh.vertices), VERTEX)
            block["position"], block["normal"] = part.mesh.vertices, part.mesh.normals
            block["rgba"], block["slot"], block["label"] = part.rgba, slot, part.label
            blocks.append(block)
        self.vertices = np.concatenate(blocks)
        self._starts = np.cumsum([0] + [len(block) for block in blocks[1:]])
        self._index_blocks: list[Ints] = []
        self._index_count = 0
        self.runs = self._find_runs()
        self.indices = np.concatenate([np.empty(0, np.int32), *self._index_blocks])
        self._bodies: list[tuple[Body, list[int], npt.NDArray[np.intp], Floats]] = []
        by_body: dict[int, list[int]] = {}
        for i, part in enumerate(self.parts):
            by_body.setdefault(id(part.body), []).append(i)
        for indices in by_body.values():
            body = self.parts[indices[0]].body
            links = [self.parts[i].shape.link + 1 for i in indices]
            local = np.stack([self.parts[i].shape.pose.matrix() for i in indices])
            self._bodies.append(
                (body, links, np.array(indices, np.intp) + 1, local.astype(np.float32))
            )

    def _find_runs(self) -> list[Run]:
        out: list[Run] = []
        for key, group in groupby(range(len(self.parts)), lambda i: _order(self.parts[i])):
            members = list(group)
            # What is transparent or dense is drawn shape by shape.
            alone = [i for i in members if key[0] or len(self._levels(self.parts[i])) > 1]
            together = [i for i in members if i not in alone]
            out.extend(self._run([i]) for i in alone)
            if together:
                out.append(self._run(together))
        return out

    def _run(self, members: list[int]) -> Run:
        lead = self.parts[members[0]]
        per_part = [self._levels(self.parts[i]) for i in members]
        levels: list[tuple[int, int]] = []
        for level in range(len(per_part[0])):
            count = 0
            for i, faces in zip(members, per_part, strict=True):
                self._index_blocks.append((faces[level].ravel() + self._starts[i]).astype(np.int32))
                count += faces[level].size
            levels.append((self._index_count, count))
            self._index_count += count
        low, high = lead.mesh.vertices.min(axis=0), lead.mesh.vertices.max(axis=0)
        return Run(
            tuple(levels),
            lead.is_floor,
            lead.is_still,
            lead.casts,
            lead.mesh.closed,
            lead.alpha,
            members[0] + 1,
            (low + high) / 2,
            float(np.linalg.norm(high - low)) / 2,
            len(members) == 1,
        )

    def update(self) -> bool:
        """Fetch the poses of all links; return whether a still thing moved."""
        before = self.transforms[self.still].copy()
        for body, links, slots, local in self._bodies:
            positions, quaternions = body.link_poses()
            matrices = _matrices(positions[links], quaternions[links])
            self.transforms[slots] = matrices @ local
        return not np.array_equal(before, self.transforms[self.still])


@lru_cache(maxsize=512)
def mesh_levels(mesh: Mesh) -> tuple[Ints, ...]:
    """Return the faces of a mesh at each level of detail."""
    return tuple(detail_levels(mesh.vertices, mesh.normals, mesh.faces, mesh.colors))


def _order(part: Part) -> tuple[bool, bool, bool, bool, bool]:
    return (part.alpha < 0.99, part.is_floor, part.is_still, part.casts, part.mesh.closed)


def _matrices(positions: npt.NDArray[Any], quaternions: npt.NDArray[Any]) -> Floats:
    """Return rigid transforms without their last row, shape [n, 3, 4]."""
    out = np.empty((len(positions), 3, 4), np.float32)
    out[:, :, :3] = matrix_from_quaternion(quaternions.T).transpose(2, 0, 1)
    out[:, :, 3] = positions
    return out
