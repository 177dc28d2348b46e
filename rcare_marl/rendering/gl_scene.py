"""The surfaces of a world on the graphics card, kept up to date with the physics."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from typing import Any

import numpy as np

from ..pose import Array
from ..world import World
from .camera import Camera
from .detail import level_for
from .geometry import FLOOR_RGBA, VERTEX, Geometry, Part, Run, world_parts
from .gl_context import make_program, matrix_bytes
from .gl_lines import LineBuffers
from .gl_skin import SkinBuffers
from .mesh import Floats
from .shading import DEPTH_FRAGMENT, DEPTH_VERTEX, surface_program

_COARSENESS = 1.4  # [pixel], of the cells that vertices are joined in
_FLOOR_HALF = 14.0  # [m]
_SURFACE = ("3f 3f 4f1 1u4", "in_position", "in_normal", "in_rgba", "in_slot")
_DEPTH = ("3f 16x 1u4", "in_position", "in_slot")

Level = Callable[[Floats, float], int]


class GLScene:
    """The buffers and programs that draw a world's surfaces.

    Attributes:
        programs: By kind of surface: `plastic`, `skin`, `line`, `floor`.
        geometry: What is rigid.
    """

    def __init__(self, gl: Any, world: World, *, floor: bool) -> None:
        self._gl, self._world, self._floor = gl, world, floor
        kinds = ("plastic", "skin", "line", "floor")
        self.programs = {kind: make_program(gl, surface_program(kind)) for kind in kinds}
        self._depth_program = make_program(gl, (DEPTH_VERTEX, DEPTH_FRAGMENT))
        self._skins: dict[int, SkinBuffers] = {}
        self._lines: dict[int, LineBuffers] = {}
        self._made: list[Any] = []
        self._known: tuple[tuple[int, ...], ...] = ()
        self.geometry = Geometry([])

    def refresh(self) -> None:
        """Read all shapes and colours anew at the next update."""
        self._known = ()

    def update(self) -> bool:
        """Follow the physics; return whether anything that stood still has changed."""
        bodies, skins = self._world.bodies, self._world.skins
        known = tuple(body.uid for body in bodies), tuple(id(skin.body) for skin in skins)
        changed = known != self._known
        if changed:
            self._known = known
            self._build()
        moved = self.geometry.update()
        self._transforms.write(self.geometry.transforms)
        present = {id(skin) for skin in skins}
        for key in [key for key in self._skins if key not in present]:
            self._skins.pop(key).release()
        for skin in skins:
            vertices = skin.vertices()
            buffers = self._skins.get(id(skin))
            if buffers is None or not buffers.fits(skin, vertices):
                if buffers is not None:
                    buffers.release()
                buffers = SkinBuffers(self._gl, skin, self.programs["skin"], self._depth_program)
                self._skins[id(skin)] = buffers
            buffers.upload(vertices)
        self._update_lines()
        return moved or changed

    def _update_lines(self) -> None:
        present = {id(lines) for lines in self._world.lines}
        for key in [key for key in self._lines if key not in present]:
            self._lines.pop(key).release()
        for lines in self._world.lines:
            buffers = self._lines.get(id(lines))
            if buffers is None or not buffers.fits(lines):
                if buffers is not None:
                    buffers.release()
                buffers = LineBuffers(self._gl, lines, self.programs["line"], self._depth_program)
                self._lines[id(lines)] = buffers
            buffers.upload(lines)

    def _build(self) -> None:
        gl = self._gl
        self._release_made()
        parts = world_parts(self._world)
        floors = [p for p in parts if p.is_floor] if self._floor else []
        planes = [p for p in floors if p.is_plane]
        self.geometry = Geometry([p for p in parts if p not in planes])
        vertices = gl.buffer(self.geometry.vertices.tobytes() or bytes(VERTEX.itemsize))
        indices = gl.buffer(self.geometry.indices.tobytes() or bytes(12))
        self._transforms = gl.texture((3, len(self.geometry.transforms)), 4, dtype="f4")
        self._arrays = {
            kind: gl.vertex_array(self.programs[kind], [(vertices, *_SURFACE)], indices)
            for kind in ("plastic", "floor")
        }
        self._depth_array = gl.vertex_array(self._depth_program, [(vertices, *_DEPTH)], indices)
        self._made = [
            *self._arrays.values(), self._depth_array, vertices, indices, self._transforms
        ]  # fmt: skip
        self._floor_arrays: list[Any] = []
        if self._floor:
            self._add_floor(max(floors, key=lambda part: part.area, default=None))

    def _add_floor(self, like: Part | None) -> None:
        """Draw a floor to the horizon, a hair lower than what lies on it or is one itself."""
        height = (like.top if like is not None else 0.0) - 0.002
        rgba = FLOOR_RGBA if like is None else like.rgba[0]
        corners = np.zeros(4, VERTEX)
        corners["position"] = [(x, y, height) for x in (-1, 1) for y in (-1, 1)]
        corners["position"][:, :2] *= _FLOOR_HALF
        corners["normal"], corners["rgba"] = (0, 0, 1), rgba
        buffer = self._gl.buffer(corners.tobytes())
        index = self._gl.buffer(np.array((0, 2, 1, 1, 2, 3), np.int32).tobytes())
        self._floor_arrays = [
            self._gl.vertex_array(self.programs["floor"], [(buffer, *_SURFACE)], index),
            self._gl.vertex_array(self._depth_program, [(buffer, *_DEPTH)], index),
        ]
        self._made = [*self._floor_arrays, *self._made, buffer, index]

    def draw_shadow_casters(self, matrix: Array, *, still: bool, cell: float) -> None:
        """Draw the depth of what casts shadows, either what stands still or what may move.

        Args:
            matrix: From the world to clip space.
            still: Which of the two.
            cell: Size of what need not be told apart [m].
        """
        level = level_for(cell)
        runs = [r for r in self.geometry.runs if r.casts and not r.is_floor]
        self._draw_depth(
            matrix, [r for r in runs if r.is_still == still], lambda *_: level, living=not still
        )

    def draw_depth(self, camera: Camera) -> None:
        """Draw the depth of everything that is opaque."""
        runs = [r for r in self.geometry.runs if r.alpha >= 0.99]
        matrix = camera.projection() @ camera.view()
        self._draw_depth(matrix, runs, _level_of(camera), living=True)
        if self._floor_arrays:
            self._floor_arrays[1].render()

    def _draw_depth(
        self, matrix: Array, runs: Iterable[Run], level: Level, *, living: bool
    ) -> None:
        self._transforms.use(0)
        self._depth_program["transforms"] = 0
        self._depth_program["view_projection"].write(matrix_bytes(matrix))
        for run in runs:
            first, count = run.level(level(self._center(run), run.radius))
            self._depth_array.render(vertices=count, first=first)
        if not living:
            return
        for skin in self._skins.values():
            if skin.is_opaque:
                skin.draw(level(skin.center, skin.radius), depth_only=True)
        for lines in self._lines.values():
            lines.draw(depth_only=True)

    def draw_opaque(self, camera: Camera) -> None:
        """Draw the colours of everything that is opaque; the programs must be set up."""
        gl, level = self._gl, _level_of(camera)
        self._transforms.use(0)
        for skin in self._skins.values():
            if skin.is_opaque:
                gl.enable_only(gl.DEPTH_TEST | (gl.CULL_FACE if skin.closed else 0))
                skin.draw(level(skin.center, skin.radius), depth_only=False)
        gl.enable_only(gl.DEPTH_TEST | gl.CULL_FACE)
        for lines in self._lines.values():
            lines.draw(depth_only=False)
        for run in self.geometry.runs:
            if run.alpha < 0.99:
                continue
            gl.enable_only(gl.DEPTH_TEST | (gl.CULL_FACE if run.closed else 0))
            first, count = run.level(level(self._center(run), run.radius))
            kind = "floor" if run.is_floor and self._floor else "plastic"
            self._arrays[kind].render(vertices=count, first=first)
        gl.enable_only(gl.DEPTH_TEST)
        if self._floor_arrays:
            self._floor_arrays[0].render()

    def draw_transparent(self, camera: Camera) -> None:
        """Draw the colours of what is transparent, the farthest first."""
        gl, level = self._gl, _level_of(camera)
        runs = [r for r in self.geometry.runs if r.alpha < 0.99]
        eye = np.asarray(camera.eye)
        runs.sort(key=lambda r: -float(np.linalg.norm(self._center(r) - eye)))
        gl.enable_only(gl.DEPTH_TEST | gl.CULL_FACE | gl.BLEND)
        for run in runs:
            first, count = run.level(level(self._center(run), run.radius))
            self._arrays["plastic"].render(vertices=count, first=first)
        veils = [s for s in self._skins.values() if s.is_visible and not s.is_opaque]
        veils.sort(key=lambda s: -float(np.linalg.norm(s.center - eye)))
        for skin in veils:
            self._draw_veil(skin, level(skin.center, skin.radius))

    def _draw_veil(self, skin: SkinBuffers, level: int) -> None:
        """Draw a skin that can be seen through: its nearest layer alone."""
        gl = self._gl
        gl.enable_only(gl.DEPTH_TEST | gl.BLEND)
        gl.blend_func = gl.ZERO, gl.ONE  # of the first pass only the depth counts
        skin.draw(level, depth_only=False)
        gl.blend_func = gl.DEFAULT_BLENDING
        gl.depth_func = "<="
        skin.draw(level, depth_only=False)
        gl.depth_func = "<"

    def _center(self, run: Run) -> Floats:
        matrix = self.geometry.transforms[run.slot]
        center: Floats = matrix[:, :3] @ run.center + matrix[:, 3]
        return center

    def _release_made(self) -> None:
        for thing in self._made:
            thing.release()
        self._made = []

    def release(self) -> None:
        """Free everything."""
        self._release_made()
        things: list[Any] = [*self._skins.values(), *self._lines.values(), *self.programs.values()]
        for thing in (*things, self._depth_program):
            thing.release()


def _level_of(camera: Camera) -> Level:
    """Return what picks the level whose cells are about as small as a pixel."""
    pixel = 2 * math.tan(math.radians(camera.fov_deg) / 2) / camera.height
    eye = np.asarray(camera.eye)

    def level(center: Floats, radius: float) -> int:
        nearest = max(float(np.linalg.norm(center - eye)) - radius, camera.near)
        return level_for(_COARSENESS * nearest * pixel)

    return level


__all__ = ["GLScene"]
