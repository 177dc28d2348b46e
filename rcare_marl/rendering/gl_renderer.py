"""Pictures drawn by OpenGL without a window, on a graphics card or in software (Mesa)."""

from __future__ import annotations

import sys
from typing import Any

import numpy as np
import numpy.typing as npt

from ..errors import MissingPackageError, RenderingError, WorldError
from ..pose import Array
from ..world import Skin, World
from .camera import Camera, look, orthographic
from .geometry import Geometry, Run, world_parts
from .mesh import SmoothNormals
from .shading import (
    BACKGROUND_FRAGMENT,
    BLUR_FRAGMENT,
    DEPTH_FRAGMENT,
    DEPTH_VERTEX,
    FINAL_FRAGMENT,
    HORIZON,
    KEY_DIRECTION,
    SCREEN_VERTEX,
    ZENITH,
    occlusion_program,
    surface_program,
)

_FLOOR_RGB = (196, 170, 140)  # light oak, sRGB
_FLOOR_HALF = 14.0  # [m]


class _SkinBuffers:
    """A skin on the graphics card; made anew when its faces or colours are replaced."""

    def __init__(self, gl: Any, skin: Skin, vertex_count: int) -> None:
        self.faces, self.colors, self.vertex_count = skin.faces, skin.colors, vertex_count
        self._normals = SmoothNormals(skin.faces, vertex_count)
        self._data = np.empty((vertex_count, 6), np.float32)
        colors = np.full((vertex_count, 4), 255, np.uint8)
        colors[:, :3] = skin.colors[:, :3]
        constant = np.zeros(vertex_count, [("rgba", "u1", 4), ("slot", "u4")])
        constant["rgba"] = colors
        self.moving = gl.buffer(reserve=max(self._data.nbytes, 24), dynamic=True)
        self.constant = gl.buffer(constant.tobytes() or bytes(8))
        self.indices = gl.buffer(skin.faces.astype(np.int32).tobytes() or bytes(12))
        self.count = int(skin.faces.size)

    def fits(self, skin: Skin, vertex_count: int) -> bool:
        return (
            skin.faces is self.faces
            and skin.colors is self.colors
            and vertex_count == self.vertex_count
        )

    def upload(self, vertices: npt.NDArray[np.float32]) -> None:
        self._data[:, :3] = vertices
        self._data[:, 3:] = self._normals.compute(np.ascontiguousarray(vertices, np.float32))
        self.moving.write(self._data)

    def release(self) -> None:
        for buffer in (self.moving, self.constant, self.indices):
            buffer.release()


class GLRenderer:
    """Draws a world with OpenGL: soft shadows, ambient occlusion, antialiased edges.

    Bodies that a skin of the world stands for are drawn as that skin. Bodies added later appear by
    themselves; after a change of colours call `refresh`. The physics is read, never changed.
    """

    def __init__(
        self,
        world: World,
        *,
        samples: int = 4,
        shadow_size: int = 1024,
        ambient_occlusion: bool = True,
        floor: bool = True,
    ) -> None:
        """Open an OpenGL context of its own.

        Args:
            world: What to draw.
            samples: Samples a pixel against jagged edges; 0 is fastest.
            shadow_size: Edge of the shadow map [pixel]; 0 draws no shadows.
            ambient_occlusion: Whether corners and contacts are darkened.
            floor: Whether to draw a wooden floor: in place of a wide slab, or at z = 0 without one.

        Raises:
            MissingPackageError: If moderngl is not installed.
            RenderingError: If no OpenGL 3.3 context can be had.
        """
        self._world = world
        self._gl: Any = _create_context()
        with self._gl:
            self._samples = min(samples, self._gl.max_samples)
            self._occlusion, self._floor = ambient_occlusion, floor
            self._shadow_size = shadow_size
            self._targets: dict[tuple[int, int], _Targets] = {}
            self._skins: dict[int, _SkinBuffers] = {}
            self._known: tuple[tuple[int, ...], ...] = ()
            self._made: list[Any] = []
            self._shadow_key: tuple[float, ...] = ()
            self._compile()

    def _compile(self) -> None:
        gl = self._gl
        screen = SCREEN_VERTEX
        self._surface = {k: _program(gl, *surface_program(k)) for k in ("plastic", "skin", "floor")}
        self._depth_program = _program(gl, DEPTH_VERTEX, DEPTH_FRAGMENT)
        passes = {
            "background": (screen, BACKGROUND_FRAGMENT),
            "occlusion": occlusion_program(multisampled=self._samples > 0),
            "blur": (screen, BLUR_FRAGMENT),
            "final": (screen, FINAL_FRAGMENT),
        }
        self._pass = {name: _program(gl, *source) for name, source in passes.items()}
        self._pass_array = {k: gl.vertex_array(p, []) for k, p in self._pass.items()}
        size = (max(self._shadow_size, 1),) * 2
        self._shadow = [gl.depth_texture(size) for _ in range(2)]
        # Depth is copied along with colour only, so each has a colour that nothing writes.
        self._unused = [gl.renderbuffer(size, 1) for _ in range(2)]
        self._shadow_target = [
            gl.framebuffer([c], d) for c, d in zip(self._unused, self._shadow, strict=True)
        ]
        for target in self._shadow_target:
            target.color_mask = False, False, False, False
        for texture in self._shadow:
            texture.repeat_x = texture.repeat_y = False
        self._shadow[1].compare_func = "<="
        self._raw_depth = gl.sampler(repeat_x=False, repeat_y=False, filter=(gl.NEAREST, gl.NEAREST))

    def refresh(self) -> None:
        """Read the shapes and colours of all bodies again."""
        self._known = ()

    def render(self, camera: Camera) -> npt.NDArray[np.uint8]:
        """Return the picture that `camera` takes, shape [height, width, 3].

        Raises:
            WorldError: If the renderer or the world is closed.
        """
        self._check_open()
        with self._gl:
            target = self._target(camera)
            self._prepare(camera)
            target.scene.use()
            target.scene.clear(*HORIZON, depth=1.0)
            self._draw_surfaces(camera)
            return self._finish(camera, target)

    def depth(self, camera: Camera) -> npt.NDArray[np.float32]:
        """Return the distance along the line of sight [m], shape [height, width]; inf for nothing.

        Raises:
            WorldError: If the renderer or the world is closed.
        """
        self._check_open()
        with self._gl:
            target = self._target(camera)
            self._prepare(camera)
            target.depth_only.use()
            target.depth_only.clear(depth=1.0)
            self._gl.enable_only(self._gl.DEPTH_TEST)
            matrix = camera.projection() @ camera.view()
            self._draw_depth(matrix, [r for r in self._geometry.runs if r.alpha > 0.99])
            if self._floor_array is not None:
                self._floor_depth.render()
            raw = np.frombuffer(target.depth_texture.read(), np.float32)
        z = raw.reshape(camera.height, camera.width)[::-1] * 2 - 1
        near, far = camera.near, camera.far
        out = 2 * near * far / (near + far - z * (far - near))
        return np.where(z < 1, out, np.inf).astype(np.float32)

    def close(self) -> None:
        """Free everything on the graphics card; safe to call twice."""
        if self._gl is None:
            return
        with self._gl:
            for target in self._targets.values():
                target.release()
            for skin in self._skins.values():
                skin.release()
            for thing in (
                *self._made,
                *self._pass_array.values(),
                *self._pass.values(),
                *self._surface.values(),
                self._depth_program,
                *self._shadow_target,
                *self._shadow,
                *self._unused,
                self._raw_depth,
            ):
                thing.release()
        self._gl.release()
        self._gl = None

    def _check_open(self) -> None:
        if self._gl is None:
            raise WorldError("this renderer is closed: make a new one")
        if self._world.client < 0:
            raise WorldError("the world of this renderer is closed")

    def _target(self, camera: Camera) -> _Targets:
        size = (camera.width, camera.height)
        if size not in self._targets:
            if len(self._targets) >= 8:
                self._targets.pop(next(iter(self._targets))).release()
            self._targets[size] = _Targets(self._gl, size, self._samples)
        return self._targets[size]

    def _prepare(self, camera: Camera) -> None:
        """Bring buffers, transforms, skins and the shadow map up to date."""
        world = self._world
        known = tuple((b.uid,) for b in world.bodies), tuple((id(s.body),) for s in world.skins)
        if self._known != known:
            self._known = known
            self._build()
        moved = self._geometry.update()
        self._transforms.write(self._geometry.transforms.tobytes())
        self._update_skins()
        self._draw_shadows(camera, moved)

    def _build(self) -> None:
        gl = self._gl
        for thing in self._made:
            thing.release()
        parts = world_parts(self._world)
        floors = [p for p in parts if p.is_floor] if self._floor else []
        flat = [p for p in floors if np.ptp(p.mesh.vertices[:, 2]) < 0.002]
        self._geometry = geometry = Geometry([p for p in parts if p not in flat])
        vertices = gl.buffer(geometry.vertices.tobytes() or bytes(32))
        indices = gl.buffer(geometry.indices.tobytes() or bytes(12))
        self._transforms = gl.texture((3, len(geometry.transforms)), 4, dtype="f4")
        layout = (vertices, "3f 3f 4f1 1u4", "in_position", "in_normal", "in_rgba", "in_slot")
        self._array = {
            kind: gl.vertex_array(p, [layout], indices) for kind, p in self._surface.items()
        }
        depth_layout = (vertices, "3f 16x 1u4", "in_position", "in_slot")
        self._depth_array = gl.vertex_array(self._depth_program, [depth_layout], indices)
        self._made = [*self._array.values(), self._depth_array, vertices, indices, self._transforms]
        self._floor_array = None
        if self._floor and len(flat) == len(floors):
            # A hair below, so that rugs and thin slabs at floor height stay visible.
            self._add_floor(flat[0].shape.pose.position[2] if flat else -0.002)
        self._shadow_key = ()

    def _add_floor(self, height: float) -> None:
        corners = np.zeros(4, [("position", "f4", 3), ("normal", "f4", 3), ("rgba", "u1", 4), ("slot", "u4")])
        corners["position"] = [(x, y, height) for x in (-1, 1) for y in (-1, 1)]
        corners["position"][:, :2] *= _FLOOR_HALF
        corners["normal"], corners["rgba"] = (0, 0, 1), (*_FLOOR_RGB, 255)
        buffer = self._gl.buffer(corners.tobytes())
        index = self._gl.buffer(np.array((0, 2, 1, 1, 2, 3), np.int32).tobytes())
        layout = (buffer, "3f 3f 4f1 1u4", "in_position", "in_normal", "in_rgba", "in_slot")
        self._floor_array = self._gl.vertex_array(self._surface["floor"], [layout], index)
        depth_layout = (buffer, "3f 16x 1u4", "in_position", "in_slot")
        self._floor_depth = self._gl.vertex_array(self._depth_program, [depth_layout], index)
        self._made += [self._floor_array, self._floor_depth, buffer, index]

    def _update_skins(self) -> None:
        present = {id(skin) for skin in self._world.skins}
        for key in [key for key in self._skins if key not in present]:
            self._skins.pop(key).release()
        for skin in self._world.skins:
            vertices = skin.vertices()
            buffers = self._skins.get(id(skin))
            if buffers is None or not buffers.fits(skin, len(vertices)):
                if buffers is not None:
                    buffers.release()
                buffers = self._skins[id(skin)] = _SkinBuffers(self._gl, skin, len(vertices))
                moving, constant, index = buffers.moving, buffers.constant, buffers.indices
                buffers.array = self._gl.vertex_array(
                    self._surface["skin"],
                    [(moving, "3f 3f", "in_position", "in_normal"), (constant, "4f1 1u4", "in_rgba", "in_slot")],
                    index,
                )
                buffers.depth_array = self._gl.vertex_array(
                    self._depth_program,
                    [(moving, "3f 12x", "in_position"), (constant, "4x 1u4", "in_slot")],
                    index,
                )
            buffers.upload(vertices)

    def _draw_depth(self, matrix: Array, runs: list[Run], *, skins: bool = True) -> None:
        self._transforms.use(0)
        self._depth_program["transforms"] = 0
        self._depth_program["view_projection"].write(_bytes(matrix))
        for run in runs:
            self._depth_array.render(vertices=run.count, first=run.first)
        if skins:
            for skin in self._skins.values():
                skin.depth_array.render(vertices=skin.count)

    def _draw_shadows(self, camera: Camera, moved: bool) -> None:
        """Draw the shadow map; what stands still is kept from picture to picture."""
        distance = float(np.linalg.norm(np.subtract(camera.target, camera.eye)))
        radius = min(max(round(1.6 * distance) / 2, 1.5), 4.0)
        center = np.round(np.asarray(camera.target) * 4) / 4
        axes = _light_axes()
        self._light = orthographic(radius, 0.0, 2 * radius + 8) @ look(
            axes, center + axes[2] * (radius + 4)
        )
        self._shadow_texel = 2 * radius / max(self._shadow_size, 1)
        if not self._shadow_size:
            return
        gl = self._gl
        gl.enable_only(gl.DEPTH_TEST)
        casting = [r for r in self._geometry.runs if r.casts and not r.is_floor]
        key = (radius, *center)
        still, live = self._shadow_target
        if moved or key != self._shadow_key:
            self._shadow_key = key
            still.use()
            still.clear(depth=1.0)
            self._draw_depth(self._light, [r for r in casting if r.is_still], skins=False)
        gl.copy_framebuffer(live, still)
        live.use()
        self._draw_depth(self._light, [r for r in casting if not r.is_still])

    def _draw_surfaces(self, camera: Camera) -> None:
        gl = self._gl
        view_projection = camera.projection() @ camera.view()
        self._transforms.use(0)
        self._shadow[1].use(1)
        self._shadow[1].use(2)
        self._raw_depth.use(2)
        for kind, program in self._surface.items():
            _set(program, "view_projection", _bytes(view_projection))
            _set(program, "light_matrix", _bytes(self._light))
            values = {
                "transforms": 0,
                "shadow": 1,
                "shadow_depth": 2,
                "shadow_texel": self._shadow_texel,
                "shadow_texel_uv": 1 / max(self._shadow_size, 1),
                "eye": tuple(camera.eye),
                "key": tuple(_light_axes()[2]),
            }
            if kind == "floor":
                values |= {"horizon": HORIZON, "middle": tuple(camera.target)}
            for name, value in values.items():
                program[name] = value
        opaque = [r for r in self._geometry.runs if r.alpha > 0.99]
        for skin in self._skins.values():
            gl.enable_only(gl.DEPTH_TEST)
            skin.array.render(vertices=skin.count)
        for run in opaque:
            gl.enable_only(gl.DEPTH_TEST | (gl.CULL_FACE if run.closed else 0))
            kind = "floor" if run.is_floor and self._floor else "plastic"
            self._array[kind].render(vertices=run.count, first=run.first)
        gl.enable_only(gl.DEPTH_TEST)
        if self._floor_array is not None:
            self._floor_array.render()
        self._draw_background(view_projection)
        clear = [r for r in self._geometry.runs if r.alpha <= 0.99]
        clear.sort(key=lambda r: -self._distance(r, camera))
        if clear:
            gl.enable_only(gl.DEPTH_TEST | gl.CULL_FACE | gl.BLEND)
            for run in clear:
                self._array["plastic"].render(vertices=run.count, first=run.first)
        self._raw_depth.clear(2)

    def _distance(self, run: Run, camera: Camera) -> float:
        return float(np.linalg.norm(self._geometry.transforms[run.slot, :, 3] - camera.eye))

    def _draw_background(self, view_projection: Array) -> None:
        program = self._pass["background"]
        program["from_clip"].write(_bytes(np.linalg.inv(view_projection)))
        program["horizon"], program["zenith"] = HORIZON, ZENITH
        self._gl.depth_func = "<="
        self._pass_array["background"].render(vertices=3)
        self._gl.depth_func = "<"

    def _finish(self, camera: Camera, target: _Targets) -> npt.NDArray[np.uint8]:
        gl = self._gl
        gl.enable_only(gl.NOTHING)
        if self._samples:
            gl.copy_framebuffer(target.resolved, target.scene)
        if self._occlusion:
            program = self._pass["occlusion"]
            half = float(np.tan(np.radians(camera.fov_deg) / 2))
            target.scene_depth.use(0)
            program["depth"] = 0
            program["lens"] = (half * camera.aspect, half)
            program["planes"] = (camera.near, camera.far)
            program["size"] = target.size
            target.occlusion.use()
            self._pass_array["occlusion"].render(vertices=3)
            target.occlusion_texture.use(0)
            self._pass["blur"]["raw"] = 0
            target.blurred.use()
            self._pass_array["blur"].render(vertices=3)
        final = self._pass["final"]
        target.picture.use(0)
        target.blurred_texture.use(1)
        final["picture"], final["occlusion"] = 0, 1
        final["strength"] = 0.85 if self._occlusion else 0.0
        target.final.use()
        self._pass_array["final"].render(vertices=3)
        raw = target.final.read(components=4)
        pixels = np.frombuffer(raw, np.uint8).reshape(camera.height, camera.width, 4)
        return np.ascontiguousarray(pixels[:, :, :3])


class _Targets:
    """The framebuffers for one size of picture."""

    def __init__(self, gl: Any, size: tuple[int, int], samples: int) -> None:
        self.size = size
        half = (size[0] + 1) // 2, (size[1] + 1) // 2
        self.picture = gl.texture(size, 4)
        self.scene_depth = gl.depth_texture(size, samples=samples)
        if samples:
            self._color = gl.renderbuffer(size, 4, samples=samples)
        else:
            self._color = self.picture
        self.scene = gl.framebuffer([self._color], self.scene_depth)
        self.resolved = gl.framebuffer([self.picture])
        self.occlusion_texture = gl.texture(half, 2, dtype="f2")
        self.blurred_texture = gl.texture(half, 1)
        self.occlusion = gl.framebuffer([self.occlusion_texture])
        self.blurred = gl.framebuffer([self.blurred_texture])
        self._final_texture = gl.texture(size, 4)
        self.final = gl.framebuffer([self._final_texture])
        self.depth_texture = gl.depth_texture(size)
        self.depth_only = gl.framebuffer(depth_attachment=self.depth_texture)
        self.picture.repeat_x = self.picture.repeat_y = False
        self.blurred_texture.repeat_x = self.blurred_texture.repeat_y = False

    def release(self) -> None:
        """Free everything."""
        things = {id(thing): thing for thing in vars(self).values() if hasattr(thing, "release")}
        for thing in things.values():
            thing.release()


def _create_context() -> Any:
    try:
        import moderngl
    except ImportError as error:
        raise MissingPackageError("drawing with OpenGL", "view") from error
    settings = {"backend": "egl"} if sys.platform.startswith("linux") else {}
    try:
        return moderngl.create_context(require=330, standalone=True, **settings)
    except Exception as error:  # glcontext raises Exception itself, moderngl its Error
        raise RenderingError(
            f"no OpenGL 3.3 context without a window: {error}. "
            "On Debian and Ubuntu: apt-get install libegl1 libgl1-mesa-dri"
        ) from error


def _program(gl: Any, vertex: str, fragment: str) -> Any:
    return gl.program(vertex_shader=vertex, fragment_shader=fragment)


def _set(program: Any, name: str, value: bytes) -> None:
    program[name].write(value)


def _bytes(matrix: Array) -> bytes:
    return matrix.T.astype(np.float32).tobytes()  # OpenGL's matrices are stored by columns


def _light_axes() -> Array:
    back = np.asarray(KEY_DIRECTION, np.float64)
    back = back / np.linalg.norm(back)
    right = np.cross((0.0, 0.0, 1.0), back)
    right /= np.linalg.norm(right)
    return np.array((right, np.cross(back, right), back))


__all__ = ["GLRenderer"]
