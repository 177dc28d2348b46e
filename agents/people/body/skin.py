"""The surface of a person and how it deforms: linear blend skinning over the SMPL-X joints.

Two sources give the same `BodyModel`: the bodies that ship with this package, baked from CC0 data
(`agents/people/body/bake`), and a user's own licensed `SMPLX_*.npz`, which is read with numpy alone.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numba
import numpy as np
import numpy.typing as npt

from rcare_marl.body import Body
from rcare_marl.errors import ConfigError
from rcare_marl.pose import Array, matrix_from_quaternion
from rcare_marl.reading import ArrayFile, check_numbers, parse_json, refusing

from .skeleton import JOINT_INDEX, JOINTS, PARENTS

if TYPE_CHECKING:
    from .tissue import Tissue

Floats = npt.NDArray[np.float32]
_SKIN_TONE = (198, 150, 122)
SMPLX_VERTEX_COUNT = 10475


@dataclass(frozen=True, eq=False)
class BodyModel:
    """A person's surface and skeleton in the T-pose, in SMPL-X axes (x left, y up, z forward).

    Attributes:
        vertices: Surface [m], shape [n, 3].
        faces: Vertex indices, counter-clockwise from outside, shape [m, 3].
        joints: Joint centres [m], shape [55, 3].
        weight_joints: The joints that move each vertex, shape [n, 4].
        weights: Their weights, rows sum to 1, shape [n, 4].
        colors: RGB of each vertex, shape [n, 3].
        mouth: Point between the lips [m], shape [3].
        meta: Where the data came from, and what was measured on it.
    """

    vertices: Floats
    faces: npt.NDArray[np.int32]
    joints: Array
    weight_joints: npt.NDArray[np.uint8]
    weights: Floats
    colors: npt.NDArray[np.uint8]
    mouth: Array
    meta: dict[str, Any]

    @property
    def owner(self) -> npt.NDArray[np.intp]:
        """Joint with the greatest weight on each vertex, shape [n]."""
        strongest = np.argmax(self.weights, axis=1)
        return self.weight_joints[np.arange(len(self.weights)), strongest].astype(np.intp)

    def posed(self, rotations: Array, positions: Array) -> Floats:
        """Return the surface for joint rotations [55, 3, 3] and positions [m] [55, 3]."""
        out = np.empty_like(self.vertices)
        rotations = np.ascontiguousarray(rotations, np.float32)
        offsets = positions - np.einsum("jab,jb->ja", rotations, self.joints)
        _blend(
            self.vertices,
            self.weight_joints,
            self.weights,
            rotations,
            offsets.astype(np.float32),
            out,
        )
        return out


@numba.njit(cache=True)
def _blend(  # type: ignore[no-untyped-def]
    vertices, weight_joints, weights, rotations, offsets, out
) -> None:
    for v in range(vertices.shape[0]):
        x, y, z = vertices[v, 0], vertices[v, 1], vertices[v, 2]
        for axis in range(3):
            total = np.float32(0.0)
            for k in range(weights.shape[1]):
                w = weights[v, k]
                if w > 0:
                    j = weight_joints[v, k]
                    r = rotations[j, axis]
                    total += w * (r[0] * x + r[1] * y + r[2] * z + offsets[j, axis])
            out[v, axis] = total


def load_body_model(path: str | Path) -> BodyModel:
    """Read a baked body or a user's own `SMPLX_*.npz`; which of the two is seen from its keys.

    Raises:
        ConfigError: If the file is missing, is no npz, or lacks or misshapes an array.
    """
    file = Path(path)
    data = ArrayFile(file, "a body")
    is_smplx = "v_template" in data.names
    # A licensed file holds pickled objects beside the arrays; those are never touched.
    wanted = _SMPLX_KEYS if is_smplx else _BAKED_KEYS
    arrays = dict(zip(wanted, data.take(*wanted), strict=True))
    check_numbers({key: arrays[key] for key in wanted if key != "meta_json"}, file, largest=2**32)
    with refusing(file, "a body"):
        model = _from_smplx(arrays, file) if is_smplx else _from_baked(arrays)
        _check(model, file)
    return model


_BAKED_KEYS = tuple("vertices faces joints weight_joints weights colors mouth meta_json".split())
_SMPLX_KEYS = ("v_template", "f", "weights", "J_regressor", "kintree_table")


def _from_baked(a: dict[str, npt.NDArray[Any]]) -> BodyModel:
    weights = a["weights"].astype(np.float32)
    return BodyModel(
        vertices=a["vertices"].astype(np.float32),
        faces=a["faces"].astype(np.int32),
        joints=a["joints"].astype(np.float64),
        weight_joints=a["weight_joints"],
        weights=weights / weights.sum(axis=1, keepdims=True),
        colors=a["colors"],
        mouth=a["mouth"].astype(np.float64),
        meta=parse_json(str(a["meta_json"])),
    )


def _from_smplx(a: dict[str, npt.NDArray[Any]], file: Path) -> BodyModel:
    vertices = a["v_template"].astype(np.float64)
    parents = a["kintree_table"][0].astype(np.int64)
    parents[0] = -1
    if len(parents) != len(JOINTS) or (parents != PARENTS).any():
        raise ConfigError(f"{file}: kintree_table is not that of SMPL-X with {len(JOINTS)} joints")
    shapes = {
        "v_template": (SMPLX_VERTEX_COUNT, 3),
        "weights": (SMPLX_VERTEX_COUNT, len(JOINTS)),
        "J_regressor": (len(JOINTS), SMPLX_VERTEX_COUNT),
    }
    for key, shape in shapes.items():
        if a[key].shape != shape:
            raise ConfigError(f"{file}: {key} must be {shape}, got {a[key].shape}")
    full = a["weights"].astype(np.float32)
    joints = a["J_regressor"].astype(np.float64) @ vertices
    strongest = np.argsort(-full, axis=1, kind="stable")[:, :4]
    weights = np.take_along_axis(full, strongest, axis=1)
    floor = np.array((0.0, vertices[:, 1].min(), 0.0))
    # The lips of SMPL-X lie in front of and a little above the jaw joint; the foremost point there
    # is the mouth.
    jaw = joints[JOINT_INDEX["jaw"]]
    near = np.abs(vertices[:, 0] - jaw[0]) < 0.01
    near &= np.abs(vertices[:, 1] - (jaw[1] - 0.02)) < 0.025
    candidates = vertices[near] if near.any() else jaw[None] + (0.0, -0.02, 0.09)
    mouth = candidates[np.argmax(candidates[:, 2])]
    return BodyModel(
        vertices=(vertices - floor).astype(np.float32),
        faces=a["f"].astype(np.int32),
        joints=joints - floor,
        weight_joints=strongest.astype(np.uint8),
        weights=weights / weights.sum(axis=1, keepdims=True),
        colors=np.tile(np.array(_SKIN_TONE, np.uint8), (len(vertices), 1)),
        mouth=mouth - floor,
        meta={"source": file.name, "licence": "as licensed to the user by its makers"},
    )


def _check(model: BodyModel, file: Path) -> None:
    count = len(model.vertices)
    shapes: dict[str, tuple[int, ...]] = {
        "vertices": (count, 3),
        "faces": (len(model.faces), 3),
        "joints": (len(JOINTS), 3),
        "weights": (count, 4),
        "weight_joints": (count, 4),
        "colors": (count, 3),
        "mouth": (3,),
    }
    for key, wanted in shapes.items():
        if (got := getattr(model, key).shape) != wanted:
            raise ConfigError(f"{file}: {key} must have shape {wanted}, got {got}")
    for key in ("vertices", "joints", "weights", "mouth"):
        if not np.isfinite(getattr(model, key)).all():
            raise ConfigError(f"{file}: {key} holds values that are not finite")
    if model.faces.min() < 0 or model.faces.max() >= count:
        raise ConfigError(f"{file}: faces name vertices that are not there")
    if model.weight_joints.max() >= len(JOINTS):
        raise ConfigError(f"{file}: weight_joints names joints that are not there")


@dataclass(frozen=True, eq=False)
class JointFrame:
    """Where a joint's frame is found in a physics body: a link, and a fixed transform in it."""

    link: int
    rotation: Array  # [3, 3]
    offset: Array  # [m], shape [3]


class PersonSkin:
    """The skin of a spawned person, for renderers: implements `rcare_marl.world.Skin`.

    Attributes:
        tissue: The soft tissue beneath it, if there is any.
    """

    def __init__(self, model: BodyModel, body: Body, frames: list[JointFrame]) -> None:
        self.model, self.body = model, body
        self.faces, self.colors = model.faces, model.colors
        self.tissue: Tissue | None = None
        self._links = np.array([frame.link + 1 for frame in frames])
        self._rotations = np.array([frame.rotation for frame in frames])
        self._offsets = np.array([frame.offset for frame in frames])

    def joint_transforms(self) -> tuple[Array, Array]:
        """Return joint rotations [55, 3, 3] and positions [m] [55, 3] in the world."""
        positions, quaternions = self.body.link_poses()
        turned = np.array([matrix_from_quaternion(q) for q in quaternions])[self._links]
        return (
            turned @ self._rotations,
            positions[self._links] + np.einsum("jab,jb->ja", turned, self._offsets),
        )

    def vertices(self) -> Floats:
        """Return the present surface in the world [m], shape [n, 3]."""
        rotations, positions = self.joint_transforms()
        out = self.model.posed(rotations, positions)
        if self.tissue is not None:
            self.tissue.displace(out, rotations)
            self.tissue.paint(self)
        return out

    def rest_pieces(self) -> list[tuple[int, Floats, npt.NDArray[np.int32]]]:
        """Return (link, vertices in its frame, indices of faces) of rigid pieces, for fallbacks."""
        owner = self.model.owner[self.model.faces[:, 0]]
        pieces = []
        for j in range(len(JOINTS)):
            faces = np.flatnonzero(owner == j).astype(np.int32)
            if len(faces):
                local = (self.model.vertices - self.model.joints[j]) @ self._rotations[j].T
                pieces.append(
                    (int(self._links[j]) - 1, (local + self._offsets[j]).astype(np.float32), faces)
                )
        return pieces
