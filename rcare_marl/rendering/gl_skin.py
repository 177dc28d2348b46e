"""A deforming surface on the graphics card."""

from __future__ import annotations

from typing import Any

import numpy as np

from ..world import Skin
from .detail import detail_levels
from .mesh import Floats, SmoothNormals, is_closed

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

    def __init__(self, gl: Any, skin: Skin, surface: Any, depth: Any) -> None:
        vertices = np.ascontiguousarray(skin.vertices(), np.float32)
        faces = np.ascontiguousarray(skin.faces, np.int32)
        self._faces, self._colors, self._count = skin.faces, skin.colors, len(vertices)
        self.closed = is_closed(faces, vertices, faces, tolerance=_OPEN_EDGES)
        self._normals = SmoothNormals(faces, len(vertices))
        self._data = np.empty((len(vertices), 6), np.float32)
        constant = np.zeros(len(vertices), [("rgba", "u1", 4), ("slot", "u4")])
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
        self._constant = gl.buffer(constant.tobytes() or bytes(8))
        self._indices = gl.buffer(indices.tobytes() or bytes(12))
        self._surface_array = gl.vertex_array(
            surface,
            [
                (self._moving, "3f 3f", "in_position", "in_normal"),
                (self._constant, "4f1 1u4", "in_rgba", "in_slot"),
            ],
            self._indices,
        )
        self._depth_array = gl.vertex_array(
            depth,
            [(self._moving, "3f 12x", "in_position"), (self._constant, "4x 1u4", "in_slot")],
            self._indices,
        )
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

    def draw(self, level: int, *, depth_only: bool) -> None:
        """Draw at a level of detail; 0 is full."""
        first, count = self._levels[min(level, len(self._levels) - 1)]
        array = self._depth_array if depth_only else self._surface_array
        if count:
            array.render(vertices=count, first=first)

    def release(self) -> None:
        """Free everything."""
        for thing in (
            self._surface_array,
            self._depth_array,
            self._moving,
            self._constant,
            self._indices,
        ):
            thing.release()


__all__ = ["SkinBuffers"]
