"""What deforms, on the graphics card: skins and thin tubes."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from ..world import Lines, Skin
from .geometry import LAYOUTS, VERTEX, Pass
from .mesh import Floats, Ints, SmoothNormals, detail_levels, is_closed
from .stroke import TubeMesh

_OPEN_EDGES = 0.003  # a person's nostrils and eyes may be open, a garment is drawn on both sides


class SkinBuffers:
    """The buffers of one skin; to be made anew when its faces or colours are replaced.

    Attributes:
        closed: Whether the inside can never be seen.
        is_opaque: Whether nothing behind it can be seen.
        is_visible: Whether any of it can be seen.
        center: Middle of the surface at the last upload [m], shape [3].
        radius: Of the sphere around the surface at the last upload [m].
    """

    def __init__(
        self, gl: Any, skin: Skin, programs: Mapping[Pass, Any], link_labels: Sequence[int]
    ) -> None:
        """Make them.

        Args:
            gl: The context.
            skin: What they are for.
            programs: What draws them, by pass.
            link_labels: Label of each link of the body, base first.
        """
        pieces = skin.rest_pieces()
        # Not the present surface: coarser levels would depend on when the first picture is taken.
        vertices = np.ascontiguousarray(pieces[0][1] if pieces else skin.vertices(), np.float32)
        faces = np.ascontiguousarray(skin.faces, np.int32)
        self._faces, self._colors, self._count = skin.faces, skin.colors, len(vertices)
        self.closed = is_closed(faces, vertices, faces, tolerance=_OPEN_EDGES)
        self._normals = SmoothNormals(faces, len(vertices))
        self._data = np.empty((len(vertices), 6), np.float32)
        constant = np.zeros(len(vertices), [("rgba", "u1", 4), ("slot", "u4"), ("label", "i4")])
        constant["label"] = np.asarray(link_labels)[_links(skin.faces, pieces, len(vertices)) + 1]
        constant["rgba"][:, 3] = 255
        constant["rgba"][:, : skin.colors.shape[1]] = skin.colors
        opacity = constant["rgba"][:, 3]
        self.is_opaque, self.is_visible = bool((opacity == 255).all()), bool(opacity.any())
        levels = [faces]
        if len(faces):
            normals = self._normals.compute(vertices)
            levels = detail_levels(vertices, normals, faces, constant["rgba"])
        starts = np.cumsum([0] + [level.size for level in levels]).tolist()
        self._levels = [(start, level.size) for start, level in zip(starts, levels, strict=False)]
        indices = np.concatenate([level.ravel() for level in levels])
        self._moving = gl.buffer(reserve=max(self._data.nbytes, 24), dynamic=True)
        self._constant = gl.buffer(constant.tobytes() or bytes(12))
        self._indices = gl.buffer(indices.tobytes() or bytes(12))
        moving, constants = self._moving, self._constant
        parts: dict[Pass, list[tuple[Any, ...]]] = {
            "surface": [
                (moving, "3f 3f", "in_position", "in_normal"),
                (constants, "4f1 1u4 1i4", "in_rgba", "in_slot", "in_label"),
            ],
            "depth": [(moving, "3f 12x", "in_position"), (constants, "4x 1u4 4x", "in_slot")],
            "survey": [
                (moving, "3f 3f", "in_position", "in_normal"),
                (constants, "4x 1u4 1i4", "in_slot", "in_label"),
            ],
        }
        self._arrays = {
            kind: gl.vertex_array(program, parts[kind], self._indices)
            for kind, program in programs.items()
        }
        self.center, self.radius = np.zeros(3, np.float32), 0.0

    def fits(self, skin: Skin, vertices: Floats) -> bool:
        """Whether the buffers still have the skin's faces, colours and number of vertices."""
        return (
            skin.faces is self._faces
            and skin.colors is self._colors
            and len(vertices) == self._count
        )

    def upload(self, vertices: Floats) -> None:
        """Send the present vertices and their normals."""
        if not self._count:
            return
        vertices = np.ascontiguousarray(vertices, np.float32)
        low, high = vertices.min(axis=0), vertices.max(axis=0)
        self.center, self.radius = (low + high) / 2, float(np.linalg.norm(high - low)) / 2
        self._data[:, :3], self._data[:, 3:] = vertices, self._normals.compute(vertices)
        self._moving.write(self._data)

    def draw(self, kind: Pass, level: int) -> None:
        """Draw at a level of detail; 0 is full."""
        first, count = self._levels[min(level, len(self._levels) - 1)]
        if count:
            self._arrays[kind].render(vertices=count, first=first)

    def release(self) -> None:
        """Free everything."""
        for thing in (*self._arrays.values(), self._moving, self._constant, self._indices):
            thing.release()


def _links(faces: Ints, pieces: Sequence[tuple[int, Floats, Ints]], count: int) -> Ints:
    """Return the link that each vertex follows: the one of the faces that begin with it."""
    out = np.full(count, -1, np.int32)
    for corners in (slice(1, 3), slice(0, 1)):
        for link, _, chosen in pieces:
            there = chosen[chosen < len(faces)]  # a skin may have been torn since
            out[faces[there, corners]] = link
    return out


class LineBuffers:
    """The buffers of one set of polylines; to be made anew when these begin elsewhere."""

    def __init__(self, gl: Any, lines: Lines, programs: Mapping[Pass, Any]) -> None:
        self._starts, self._tubes = lines.starts, TubeMesh(lines.starts)
        self._data = np.zeros(self._tubes.vertex_count, VERTEX)
        self._data["rgba"][:, 3], self._data["label"] = 255, -1
        self._buffer = gl.buffer(reserve=max(self._data.nbytes, VERTEX.itemsize), dynamic=True)
        self._indices = gl.buffer(self._tubes.faces.tobytes() or bytes(12))
        self._arrays = {
            kind: gl.vertex_array(program, [(self._buffer, *LAYOUTS[kind])], self._indices)
            for kind, program in programs.items()
        }

    def fits(self, lines: Lines) -> bool:
        """Whether the buffers are for lines that begin where these do."""
        return lines.starts is self._starts

    def upload(self, lines: Lines) -> None:
        """Send where the lines are now, and their colours."""
        if not len(self._data):
            return
        vertices, normals = self._tubes.surface(lines.points(), lines.radii)
        self._data["position"], self._data["normal"] = vertices, normals
        self._data["rgba"][:, :3] = self._tubes.spread(lines.colors())
        self._buffer.write(self._data)

    def draw(self, kind: Pass) -> None:
        """Draw the tubes."""
        if len(self._data):
            self._arrays[kind].render()

    def release(self) -> None:
        """Free everything."""
        for thing in (*self._arrays.values(), self._buffer, self._indices):
            thing.release()
