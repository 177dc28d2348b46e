"""Thin tubes on the graphics card."""

from __future__ import annotations

from typing import Any

import numpy as np

from ..world import Lines
from .geometry import VERTEX
from .tube import TubeMesh


class LineBuffers:
    """The buffers of one set of polylines; to be made anew when these begin elsewhere."""

    def __init__(self, gl: Any, lines: Lines, surface: Any, depth: Any) -> None:
        self._starts, self._tubes = lines.starts, TubeMesh(lines.starts)
        self._data = np.zeros(self._tubes.vertex_count, VERTEX)
        self._data["rgba"][:, 3] = 255
        self._buffer = gl.buffer(reserve=max(self._data.nbytes, VERTEX.itemsize), dynamic=True)
        self._indices = gl.buffer(self._tubes.faces.tobytes() or bytes(12))
        self._surface_array = gl.vertex_array(
            surface,
            [(self._buffer, "3f 3f 4f1 1u4", "in_position", "in_normal", "in_rgba", "in_slot")],
            self._indices,
        )
        self._depth_array = gl.vertex_array(
            depth, [(self._buffer, "3f 16x 1u4", "in_position", "in_slot")], self._indices
        )

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

    def draw(self, *, depth_only: bool) -> None:
        """Draw the tubes."""
        if len(self._data):
            (self._depth_array if depth_only else self._surface_array).render()

    def release(self) -> None:
        """Free everything."""
        for thing in (self._surface_array, self._depth_array, self._buffer, self._indices):
            thing.release()


__all__ = ["LineBuffers"]
