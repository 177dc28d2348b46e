"""A world as meshes for a page that draws it: what stays the same once, and what moved in each frame."""

from __future__ import annotations

import abc
import json
from collections.abc import Iterator, Mapping
from functools import lru_cache
from itertools import count
from typing import Any

import numpy as np
import numpy.typing as npt

from ..model.mesh import Mesh
from ..world import Lines, Skin, World
from .coarse import RIGID, SKIN, coarse
from .geometry import Geometry, Part, mesh_levels, world_parts
from .gl_scene import OPEN_EDGES
from .mesh import Bytes, Floats, Ints, SmoothNormals, detail_levels, is_closed, level_for
from .stroke import TubeMesh, skin_opacity

DETAIL = 0.004  # [m] that vertices are apart where a graphics card draws; our own choice
CHANGING = (
    5000  # faces; a skin with fewer, as water, may have others in each step: it stays as it is
)
STEPS = 65535  # that a position is told in, from one side of its surface to the other
_VERSIONS = count()  # so that no two shapes have the same, of whatever scenery


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


class Surface(abc.ABC):
    """A mesh whose vertices move, and whose faces and colours may change.

    Attributes:
        version: Of its faces and colours.
        faces: Vertex indices, shape [m, 3].
        rgba: sRGB colours, shape [n, 4].
        closed: Whether its inside is never seen, so that who is in a head looks out of it.
        alpha: How opaque it is.
        name: Of the body whose skin it is; else empty.
    """

    version: int
    faces: Ints
    rgba: Bytes
    closed = True
    alpha = 1.0
    name = ""

    @abc.abstractmethod
    def now(self) -> tuple[Floats, Floats]:
        """Return the present vertices [m] and normals, shape [n, 3]; the attributes fit them."""

    def shape(self, number: int) -> bytes:
        """Return what a page is told of its faces and colours: kind `surface`."""
        facts = {"number": number, "alpha": self.alpha, "closed": self.closed, "name": self.name}
        faces = self.faces.astype(np.uint16 if len(self.rgba) <= STEPS else np.uint32)
        return packed("surface", facts, {"faces": faces, "rgba": self.rgba})


class SkinSurface(Surface):
    """A skin; `is_coarse` says that few triangles are wanted."""

    def __init__(self, skin: Skin, is_coarse: bool) -> None:
        self._skin, self._is_coarse, self.name = skin, is_coarse, skin.body.name
        self._known: tuple[object, object] = (None, None)

    def now(self) -> tuple[Floats, Floats]:
        skin = self._skin
        vertices = skin.vertices()  # of water and cloth this changes the faces, too
        if skin.faces is not self._known[0]:
            self._mesh(skin, vertices)
        if skin.faces is not self._known[0] or skin.colors is not self._known[1]:
            self._known, self.version = (skin.faces, skin.colors), next(_VERSIONS)
            self.rgba = np.full((len(self._source), 4), 255, np.uint8)
            self.rgba[:, :3] = skin.colors[self._source, :3]
            self.alpha = round(skin_opacity(skin), 3)
        vertices = vertices[self._source]
        return vertices, self._normals.compute(vertices)

    def _mesh(self, skin: Skin, vertices: Floats) -> None:
        normals = SmoothNormals(skin.faces, len(vertices)).compute(vertices)
        if self._is_coarse and len(skin.faces) <= CHANGING:
            faces = skin.faces
        elif self._is_coarse:
            faces = coarse(vertices, normals, skin.faces, skin.colors, SKIN)
        else:
            levels = detail_levels(vertices, normals, skin.faces, skin.colors)
            faces = levels[min(level_for(DETAIL), len(levels) - 1)]
        self._source, self.faces = _used(faces)
        self._normals = SmoothNormals(self.faces, len(self._source))
        pieces = skin.rest_pieces()
        rest = np.asarray(pieces[0][1] if pieces else vertices)
        self.closed = is_closed(skin.faces, rest, skin.faces, tolerance=OPEN_EDGES)


class TubeSurface(Surface):
    """Lines, as thin tubes."""

    def __init__(self, lines: Lines) -> None:
        self._lines = lines
        self._known: tuple[object, Bytes] = (None, np.empty(0, np.uint8))

    def now(self) -> tuple[Floats, Floats]:
        lines, colors = self._lines, self._lines.colors()
        if lines.starts is not self._known[0]:
            self._tubes = TubeMesh(lines.starts)
            self.faces = self._tubes.faces
        if lines.starts is not self._known[0] or not np.array_equal(colors, self._known[1]):
            self._known, self.version = (lines.starts, colors.copy()), next(_VERSIONS)
            self.rgba = np.full((self._tubes.vertex_count, 4), 255, np.uint8)
            self.rgba[:, :3] = self._tubes.spread(colors)
        return self._tubes.surface(lines.points(), lines.radii)


class Scenery:
    """The meshes of a world, and where they are.

    Attributes:
        world: The world.
        geometry: Its rigid shapes.
        surfaces: Its skins and lines.
        version: Of which shapes there are.
    """

    def __init__(self, world: World, is_coarse: bool = False) -> None:
        """Read them as they are now.

        Args:
            world: What is drawn.
            is_coarse: Whether few triangles are wanted, as by software OpenGL, see `coarse`.
        """
        self.world, self._is_coarse = world, is_coarse
        self._known: tuple[tuple[int, ...], list[object]] = (), []
        self.surfaces: list[Surface] = []
        self.version = -1
        self.read()

    def messages(self, known: tuple[int, ...], number: int) -> tuple[list[bytes], tuple[int, ...]]:
        """Return what a page draws next: shapes that it does not know, then the frame, a few of `packed`.

        - `shapes`: rigid runs of triangles of one vertex buffer; each vertex has a slot, the row of its
          transform in frames. All surfaces follow.
        - `surface`: faces and colours of a skin or of lines, by its number.
        - `frame`: `places`, the transforms of the slots without their last row, shape [slots, 3, 4]; of each
          surface `normal` and `position`, in STEPS of the box that `low` and `span` tell [m].

        Args:
            known: Versions that the page knows, as returned before; empty at first.
            number: Of the scene.
        """
        self.read()
        arrays: dict[str, npt.NDArray[Any]] = {}
        boxes = []
        for k, surface in enumerate(self.surfaces):
            vertices, normals = surface.now()
            low = vertices.min(axis=0, initial=np.inf)
            span = max(float((vertices.max(axis=0, initial=-np.inf) - low).max(initial=0)), 1e-6)
            arrays[f"position{k}"] = np.round((vertices - low) * (STEPS / span)).astype(np.uint16)
            arrays[f"normal{k}"] = _small(normals)
            boxes.append((*low.tolist(), span))
        self.geometry.update()
        arrays["places"] = self.geometry.transforms
        versions = (self.version, *(surface.version for surface in self.surfaces))
        out = list(self._unknown(known, versions))
        out.append(packed("frame", {"number": number, "boxes": boxes}, arrays))
        return out, versions

    def _unknown(self, known: tuple[int, ...], versions: tuple[int, ...]) -> Iterator[bytes]:
        is_new = known[:1] != versions[:1]
        if is_new:
            yield self._shapes()
        for k, surface in enumerate(self.surfaces):
            if is_new or known[k + 1] != versions[k + 1]:
                yield surface.shape(k)

    def read(self) -> None:
        """Read anew what came or went, if something did; `version` is another one then."""
        world = self.world
        skins = [skin for skin in world.skins if skin_opacity(skin) > 0]
        known = tuple(body.uid for body in world.bodies), [*skins, *world.lines]
        if self._known[0] == known[0] and len(self._known[1]) == len(known[1]):
            if all(a is b for a, b in zip(self._known[1], known[1], strict=True)):
                return
        self._known, self.version = known, next(_VERSIONS)
        self.geometry = Geometry(world_parts(world), self._levels)
        self.surfaces = [SkinSurface(skin, self._is_coarse) for skin in skins]
        self.surfaces += [TubeSurface(lines) for lines in world.lines]

    def _levels(self, part: Part) -> tuple[Ints, ...]:
        if self._is_coarse:
            return (_coarse_part(part.mesh, part.rgba.tobytes()),)
        levels = mesh_levels(part.mesh)
        return (levels[min(level_for(DETAIL), len(levels) - 1)],)

    def _shapes(self) -> bytes:
        used, indices = _used(self.geometry.indices)
        vertices = self.geometry.vertices[used]
        runs = [
            (*run.level(0), round(run.alpha, 3), run.closed, run.is_floor)
            for run in self.geometry.runs
        ]
        arrays: dict[str, npt.NDArray[Any]] = {
            "position": vertices["position"],
            "normal": _small(vertices["normal"]),
            "rgba": vertices["rgba"],
            "slot": vertices["slot"].astype(np.uint16),
            "index": indices.astype(np.uint32),
        }
        return packed("shapes", {"runs": runs, "surfaces": len(self.surfaces)}, arrays)


@lru_cache(maxsize=512)
def _coarse_part(mesh: Mesh, rgba: bytes) -> Ints:
    colors = np.frombuffer(rgba, np.uint8).reshape(-1, 4)
    return coarse(mesh.vertices, mesh.normals, mesh.faces, colors, RIGID)


def _used(faces: Ints) -> tuple[npt.NDArray[np.intp], Ints]:
    """Return the vertices that faces use, and the faces between these."""
    used, joined = np.unique(faces, return_inverse=True)
    return used.astype(np.intp), np.asarray(joined.reshape(faces.shape), np.int32)


def _small(normals: Floats) -> npt.NDArray[np.int8]:
    """Return unit vectors as bytes, four each, of which the last is nothing."""
    out = np.zeros((len(normals), 4), np.int8)
    out[:, :3] = np.round(127 * normals)
    return out
