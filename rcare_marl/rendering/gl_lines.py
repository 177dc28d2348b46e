"""Thin tubes on the graphics card."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from ..world import Lines
from .geometry import LAYOUTS, VERTEX, Pass
from .tube import TubeMesh


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
