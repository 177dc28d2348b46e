"""A world as meshes for a page that draws it: what stays the same once, and what moved in each frame."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from ..world import Lines, Skin, World
from .geometry import Geometry, world_parts
from .gl_scene import OPEN_EDGES
from .mesh import Bytes, Floats, Ints, SmoothNormals, detail_levels, is_closed, level_for
from .stroke import TubeMesh, skin_opacity

DETAIL = (
    0.008  # [m] that vertices are apart: software OpenGL pays for each triangle; our own choice
)


def packed(kind: str, facts: Mapping[str, Any], arrays: Mapping[str, npt.NDArray[Any]]) -> bytes:
    """Return a message of arrays: the length of a JSON header (four bytes, little-endian), it, then them.

    The header has `kind`, the facts, and of each array its type, where it begins and how long it is.
    """
    table, blocks, at = {}, list[bytes](), 0
    for name, array in arrays.items():
        block = np.ascontiguousarray(array).tobytes()
        table[name] = (array.dtype.str[1:], at, array.size)
        blocks.append(block.ljust(-(-len(block) // 4) * 4, b"\0"))
        at += len(blocks[-1])
    header = json.dumps({"kind": kind, **facts, "arrays": table}).encode()
    header = header.ljust(-(-len(header) // 4) * 4)
    return b"".join((len(header).to_bytes(4, "little"), header, *blocks))


@dataclass
class Surface:
    """A skin or lines, as a mesh whose vertices move.

    Attributes:
        of: What it is the surface of.
        faces: Vertex indices, shape [m, 3].
        source: Which vertices of a skin these are of, shape [n].
        rgba: sRGB colours, shape [n, 4].
        alpha: How opaque it is.
        closed: Whether its inside is never seen, so that who is in a head looks out of it.
        name: Of the body whose skin it is; empty of lines.
        lines: Of lines, what they are.
    """

    of: Skin | TubeMesh
    faces: Ints
    source: npt.NDArray[np.intp]
    rgba: Bytes
    alpha: float
    closed: bool = True
    name: str = ""
    lines: Lines | None = None

    def __post_init__(self) -> None:
        self._normals = SmoothNormals(self.faces, len(self.source))

    def now(self) -> tuple[Floats, Floats]:
        """Return the present vertices [m] and normals, shape [n, 3]."""
        if isinstance(self.of, TubeMesh):
            assert self.lines is not None
            return self.of.surface(self.lines.points(), self.lines.radii)
        vertices = self.of.vertices()[self.source]
        return vertices, self._normals.compute(vertices)


class Scenery:
    """The meshes of a world, and where they are.

    Attributes:
        world: The world.
    """

    def __init__(self, world: World) -> None:
        """Read them as they are now; `is_stale` says when that no longer fits."""
        self.world = world
        self._known = self._look()
        self._geometry = Geometry(world_parts(world))
        self._surfaces = [_skin(skin) for skin in world.skins if skin_opacity(skin) > 0]
        self._surfaces += [_tubes(lines) for lines in world.lines]

    def _look(self) -> tuple[object, ...]:
        world = self.world
        skins = tuple(id(part) for skin in world.skins for part in (skin, skin.faces, skin.colors))
        lines = tuple(id(part) for lines in world.lines for part in (lines, lines.starts))
        return tuple(body.uid for body in world.bodies), skins, lines

    @property
    def is_stale(self) -> bool:
        """Whether things came, went or changed colour since."""
        return self._look() != self._known

    def shapes(self) -> bytes:
        """Return what does not change, as `packed` does: kind `shapes`.

        Rigid shapes are runs of triangles of one vertex buffer; each vertex has a slot, the row of its
        transform in frames. Surfaces have their faces and colours.
        """
        vertices, indices = self._geometry.vertices, self._geometry.indices
        wanted = level_for(DETAIL)
        runs = [
            (*run.level(wanted), round(run.alpha, 3), run.closed) for run in self._geometry.runs
        ]
        arrays: dict[str, npt.NDArray[Any]] = {
            "position": vertices["position"],
            "normal": _small(vertices["normal"]),
            "rgba": vertices["rgba"],
            "slot": vertices["slot"].astype(np.float32),
            "index": indices.astype(np.uint32),
        }
        for k, surface in enumerate(self._surfaces):
            arrays[f"faces{k}"] = surface.faces.astype(np.uint32)
            arrays[f"rgba{k}"] = surface.rgba
        surfaces = [(round(s.alpha, 3), s.closed, s.name) for s in self._surfaces]
        facts = {"runs": runs, "surfaces": surfaces}
        return packed("shapes", facts, arrays)

    def frame(self, number: int) -> bytes:
        """Return where everything is now, as `packed` does: kind `frame`.

        `places` are the transforms of the slots without their last row, shape [slots, 3, 4].
        """
        self._geometry.update()
        arrays: dict[str, npt.NDArray[Any]] = {"places": self._geometry.transforms}
        for k, surface in enumerate(self._surfaces):
            vertices, normals = surface.now()
            arrays[f"position{k}"] = vertices.astype(np.float32)
            arrays[f"normal{k}"] = _small(normals)
        return packed("frame", {"number": number}, arrays)


def _small(normals: Floats) -> npt.NDArray[np.int8]:
    """Return unit vectors as bytes, four each, of which the last is nothing."""
    out = np.zeros((len(normals), 4), np.int8)
    out[:, :3] = np.round(127 * normals)
    return out


def _skin(skin: Skin) -> Surface:
    vertices = skin.vertices()
    normals = SmoothNormals(skin.faces, len(vertices)).compute(vertices)
    levels = detail_levels(vertices, normals, skin.faces, skin.colors)
    faces = levels[min(level_for(DETAIL), len(levels) - 1)]
    source, joined = np.unique(faces, return_inverse=True)
    rgba = np.full((len(source), 4), 255, np.uint8)
    rgba[:, :3] = skin.colors[source, :3]
    inverse = np.asarray(joined.reshape(-1, 3), np.int32)
    pieces = skin.rest_pieces()
    rest = np.asarray(pieces[0][1] if pieces else vertices)
    closed = is_closed(skin.faces, rest, skin.faces, tolerance=OPEN_EDGES)
    return Surface(
        skin, inverse, source.astype(np.intp), rgba, skin_opacity(skin), closed, skin.body.name
    )


def _tubes(lines: Lines) -> Surface:
    tubes = TubeMesh(lines.starts)
    rgba = np.full((tubes.vertex_count, 4), 255, np.uint8)
    rgba[:, :3] = tubes.spread(lines.colors())
    every = np.arange(tubes.vertex_count, dtype=np.intp)
    return Surface(tubes, tubes.faces, every, rgba, 1.0, lines=lines)
