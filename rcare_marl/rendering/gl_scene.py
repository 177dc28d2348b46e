"""The surfaces of a world on the graphics card, rigid or not, kept up to date with the physics."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np

from ..pose import Array
from ..world import Lines, Skin, World
from .camera import Camera
from .geometry import FLOOR_RGBA, LAYOUTS, VERTEX, Geometry, Part, Pass, Run, world_parts
from .gl_target import matrix_bytes
from .mesh import Floats, Ints, SmoothNormals, detail_levels, is_closed, level_for
from .shading import make_program, make_surface_program
from .shot import Labels, Light
from .stroke import TubeMesh

OPEN_EDGES = 0.003  # a person's nostrils and eyes may be open, a garment is drawn on both sides
_COARSENESS = 1.4  # [pixel], of the cells that vertices are joined in
_COARSEST = 0.008  # [m], of these cells where shapes are measured
_FLOOR_HALF = 14.0  # [m]

Level = Callable[[Floats, float], int]


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
        self.closed = is_closed(faces, vertices, faces, tolerance=OPEN_EDGES)
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


class GLScene:
    """The buffers and programs that draw a world's surfaces.

    Attributes:
        programs: By kind of surface: `plastic`, `skin`, `line`, `floor`.
        survey: The program that tells normals, depths and labels.
        geometry: What is rigid.
    """

    def __init__(self, gl: Any, world: World, *, floor: bool) -> None:
        self._gl, self._world, self._floor = gl, world, floor
        kinds = ("plastic", "skin", "line", "floor")
        self.programs = {kind: make_surface_program(gl, kind) for kind in kinds}
        self.survey = make_program(gl, "survey", "survey")
        self._depth_program = make_program(gl, "depth", "depth")
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
                labels = [
                    self._labels.of(skin.body.uid, i - 1) for i in range(skin.body.link_count + 1)
                ]
                buffers = SkinBuffers(self._gl, skin, self._passes("skin"), labels)
                self._skins[id(skin)] = buffers
            buffers.upload(vertices)
        self.update_lines()
        return moved or changed

    def _passes(self, kind: str) -> dict[Pass, Any]:
        return {
            "surface": self.programs[kind],
            "depth": self._depth_program,
            "survey": self.survey,
        }

    def update_lines(self) -> None:
        """Follow the lines alone, which may change while the world stands still."""
        present = {id(lines) for lines in self._world.lines}
        for key in [key for key in self._lines if key not in present]:
            self._lines.pop(key).release()
        for lines in self._world.lines:
            buffers = self._lines.get(id(lines))
            if buffers is None or not buffers.fits(lines):
                if buffers is not None:
                    buffers.release()
                buffers = LineBuffers(self._gl, lines, self._passes("line"))
                self._lines[id(lines)] = buffers
            buffers.upload(lines)

    def _build(self) -> None:
        gl = self._gl
        self._release_made()
        self._labels = Labels(self._world)
        parts = world_parts(self._world)
        floors = [p for p in parts if p.is_floor] if self._floor else []
        planes = [p for p in floors if p.is_plane]
        self.geometry = Geometry([p for p in parts if p not in planes])
        vertices = gl.buffer(self.geometry.vertices.tobytes() or bytes(VERTEX.itemsize))
        indices = gl.buffer(self.geometry.indices.tobytes() or bytes(12))
        self._transforms = gl.texture((3, len(self.geometry.transforms)), 4, dtype="f4")
        self._arrays = {
            kind: gl.vertex_array(program, [(vertices, *LAYOUTS[kind])], indices)
            for kind, program in self._passes("plastic").items()
        }
        self._slab_array = gl.vertex_array(
            self.programs["floor"], [(vertices, *LAYOUTS["surface"])], indices
        )
        self._made = [*self._arrays.values(), self._slab_array, vertices, indices, self._transforms]
        self._floor_arrays: dict[Pass, Any] = {}
        if self._floor:
            self._add_floor(max(floors, key=lambda part: part.area, default=None))

    def _add_floor(self, like: Part | None) -> None:
        """Draw a floor to the horizon: in place of a plane, or a hair lower than anything else."""
        height = like.top if like is not None else 0.0
        if like is None or not like.is_plane:
            height -= 0.002
        rgba = FLOOR_RGBA if like is None else like.rgba[0]
        corners = np.zeros(4, VERTEX)
        corners["position"] = [(x, y, height) for x in (-1, 1) for y in (-1, 1)]
        corners["position"][:, :2] *= _FLOOR_HALF
        corners["normal"], corners["rgba"] = (0, 0, 1), rgba
        corners["label"] = -1 if like is None else like.label
        buffer = self._gl.buffer(corners.tobytes())
        index = self._gl.buffer(np.array((0, 2, 1, 1, 2, 3), np.int32).tobytes())
        self._floor_arrays = {
            kind: self._gl.vertex_array(program, [(buffer, *LAYOUTS[kind])], index)
            for kind, program in self._passes("floor").items()
        }
        self._made = [*self._floor_arrays.values(), *self._made, buffer, index]

    def draw_shadow_casters(self, matrix: Array, light: Light, *, still: bool, cell: float) -> None:
        """Draw the depth of what casts shadows, either what stands still or what may move.

        Args:
            matrix: From the world to clip space.
            light: The light that they keep off.
            still: Which of the two.
            cell: Size of what need not be told apart [m].
        """
        level = level_for(cell)
        self._transforms.use(0)
        self._depth_program["transforms"] = 0
        self._depth_program["lid"] = min(light.height, 1e6)
        self._depth_program["view_projection"].write(matrix_bytes(matrix))
        for run in self.geometry.runs:
            casts = run.casts if light.lid is None else run.alpha >= 0.99
            if casts and not run.is_floor and run.is_still == still:
                first, count = run.level(level)
                self._arrays["depth"].render(vertices=count, first=first)
        if still:
            return
        for skin in self._skins.values():
            if skin.is_opaque:
                skin.draw("depth", level)
        for lines in self._lines.values():
            lines.draw("depth")

    def draw_opaque(self, camera: Camera, *, measured: bool) -> None:
        """Draw the colours of everything that is opaque; the programs must be set up.

        Args:
            camera: Where from.
            measured: Whether the shapes are measured too, and so must not be too coarse.
        """
        self._draw_opaque("surface", camera, coarsest=_COARSEST if measured else math.inf)

    def draw_survey(self, camera: Camera) -> None:
        """Draw normals, depths and labels of everything that is opaque."""
        matrix = camera.projection() @ camera.view()
        self.survey["transforms"] = 0
        self.survey["view_projection"].write(matrix_bytes(matrix))
        self.survey["optical"].write(matrix_bytes(camera.axes() * ((1,), (-1,), (-1,))))
        self._draw_opaque("survey", camera, coarsest=_COARSEST)

    def _draw_opaque(self, kind: Pass, camera: Camera, *, coarsest: float) -> None:
        gl, level, sees = self._gl, _level_of(camera, coarsest=coarsest), _sight_of(camera)
        self._transforms.use(0)
        for skin in self._skins.values():
            if skin.is_opaque and sees(skin.center, skin.radius):
                gl.enable_only(gl.DEPTH_TEST | (gl.CULL_FACE if skin.closed else 0))
                skin.draw(kind, level(skin.center, skin.radius))
        gl.enable_only(gl.DEPTH_TEST | gl.CULL_FACE)
        for lines in self._lines.values():
            lines.draw(kind)
        for run in self.geometry.runs:
            if run.alpha < 0.99:
                continue
            center = self._center(run)
            if run.is_one and not sees(center, run.radius):
                continue
            gl.enable_only(gl.DEPTH_TEST | (gl.CULL_FACE if run.closed else 0))
            first, count = run.level(level(center, run.radius))
            is_floor = run.is_floor and self._floor and kind == "surface"
            array = self._slab_array if is_floor else self._arrays[kind]
            array.render(vertices=count, first=first)
        gl.enable_only(gl.DEPTH_TEST)
        if self._floor_arrays:
            self._floor_arrays[kind].render()

    def draw_transparent(self, camera: Camera) -> None:
        """Draw the colours of what is transparent, the farthest first."""
        gl, level = self._gl, _level_of(camera)
        runs = [r for r in self.geometry.runs if r.alpha < 0.99]
        eye = np.asarray(camera.eye)
        runs.sort(key=lambda r: -float(np.linalg.norm(self._center(r) - eye)))
        gl.enable_only(gl.DEPTH_TEST | gl.CULL_FACE | gl.BLEND)
        for run in runs:
            first, count = run.level(level(self._center(run), run.radius))
            self._arrays["surface"].render(vertices=count, first=first)
        veils = [s for s in self._skins.values() if s.is_visible and not s.is_opaque]
        veils.sort(key=lambda s: -float(np.linalg.norm(s.center - eye)))
        for skin in veils:
            self._draw_veil(skin, level(skin.center, skin.radius))

    def _draw_veil(self, skin: SkinBuffers, level: int) -> None:
        """Draw a skin that can be seen through: its nearest layer alone."""
        gl = self._gl
        gl.enable_only(gl.DEPTH_TEST | gl.BLEND)
        gl.blend_func = gl.ZERO, gl.ONE  # of the first pass only the depth counts
        skin.draw("surface", level)
        gl.blend_func = gl.DEFAULT_BLENDING
        gl.depth_func = "<="
        skin.draw("surface", level)
        gl.depth_func = "<"

    def _center(self, run: Run) -> Floats:
        matrix = self.geometry.transforms[run.slot]
        return matrix[:, :3] @ run.center + matrix[:, 3]

    def _release_made(self) -> None:
        for thing in self._made:
            thing.release()
        self._made = []

    def release(self) -> None:
        """Free everything."""
        self._release_made()
        things: list[Any] = [*self._skins.values(), *self._lines.values(), *self.programs.values()]
        for thing in (*things, self._depth_program, self.survey):
            thing.release()


def _level_of(camera: Camera, *, coarsest: float = math.inf) -> Level:
    """Return what picks the level whose cells are about as small as a pixel, or `coarsest` [m]."""
    pixel = 1 / camera.focal[1]
    eye = np.asarray(camera.eye)

    def level(center: Floats, radius: float) -> int:
        nearest = max(float(np.linalg.norm(center - eye)) - radius, camera.near)
        return level_for(min(_COARSENESS * nearest * pixel, coarsest))

    return level


def _sight_of(camera: Camera) -> Callable[[Floats, float], bool]:
    """Return what tells whether any of a sphere may be in the picture."""
    view = camera.view()
    # The four sides, through the eye, and the near one, as planes whose normals point inwards.
    clip = camera.projection()
    sides = np.array([clip[3] + sign * clip[i] for i in (0, 1) for sign in (1, -1)])[:, :3]
    sides /= np.linalg.norm(sides, axis=1, keepdims=True)
    planes = np.vstack((sides, (0.0, 0.0, -1.0)))
    normals = planes @ view[:3, :3]
    offsets = planes @ view[:3, 3] - (0, 0, 0, 0, camera.near)

    def sees(center: Floats, radius: float) -> bool:
        return bool((normals @ center + offsets).min() >= -radius)

    return sees
