"""Pictures drawn by OpenGL without a window, on a graphics card or in software (Mesa)."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

from ..errors import WorldError
from ..pose import Array
from ..world import World
from .camera import Camera, look, orthographic
from .gl_context import create_context, make_program, matrix_bytes
from .gl_scene import GLScene
from .gl_target import Finisher, Target
from .shading import BACKGROUND_FRAGMENT, HORIZON, KEY_DIRECTION, SCREEN_VERTEX, ZENITH

_SIZES_KEPT = 8


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
        self._gl: Any = create_context()
        with self._gl as gl:
            samples = min(samples, gl.max_samples)
            self._samples = samples
            self._targets: dict[tuple[int, int], Target] = {}
            self._scene = GLScene(gl, world, floor=floor)
            self._shadow = _ShadowMap(gl, shadow_size)
            self._finisher = Finisher(gl, samples=samples, ambient_occlusion=ambient_occlusion)
            self._background = make_program(gl, (SCREEN_VERTEX, BACKGROUND_FRAGMENT))
            self._background_array = gl.vertex_array(self._background, [])

    def refresh(self) -> None:
        """Read the shapes and colours of all bodies again."""
        self._scene.refresh()

    def render(self, camera: Camera) -> npt.NDArray[np.uint8]:
        """Return the picture that `camera` takes, shape [height, width, 3].

        Raises:
            WorldError: If the renderer or the world is closed.
        """
        self._check_open()
        with self._gl:
            self._shadow.draw(self._scene, camera, changed=self._scene.update())
            target = self._target(camera)
            target.scene.use()
            target.scene.clear(*HORIZON, depth=1.0)
            self._light_up(camera)
            self._scene.draw_opaque(camera)
            self._draw_background(camera)
            self._scene.draw_transparent(camera)
            self._shadow.unbind()
            return self._finisher.finish(camera, target)

    def depth(self, camera: Camera) -> npt.NDArray[np.float32]:
        """Return the distance along the line of sight [m], shape [height, width]; inf for nothing.

        Raises:
            WorldError: If the renderer or the world is closed.
        """
        self._check_open()
        with self._gl as gl:
            self._scene.update()
            self._shadow.forget()
            target = self._target(camera)
            target.depth_only.use()
            target.depth_only.clear(depth=1.0)
            gl.enable_only(gl.DEPTH_TEST)
            self._scene.draw_depth(camera)
            raw = np.frombuffer(target.depth_texture.read(), np.float32)
        z = raw.reshape(camera.height, camera.width)[::-1] * 2 - 1
        near, far = camera.near, camera.far
        distance = 2 * near * far / (near + far - z * (far - near))
        return np.where(z < 1, distance, np.inf).astype(np.float32)

    def close(self) -> None:
        """Free everything on the graphics card; safe to call twice."""
        if self._gl is None:
            return
        with self._gl:
            for thing in (
                *self._targets.values(),
                self._scene,
                self._shadow,
                self._finisher,
                self._background_array,
                self._background,
            ):
                thing.release()
        self._gl.release()
        self._gl = None

    def _check_open(self) -> None:
        if self._gl is None:
            raise WorldError("this renderer is closed: make a new one")
        if self._world.client < 0:
            raise WorldError("the world of this renderer is closed")

    def _target(self, camera: Camera) -> Target:
        size = (camera.width, camera.height)
        if size not in self._targets:
            if len(self._targets) >= _SIZES_KEPT:
                self._targets.pop(next(iter(self._targets))).release()
            self._targets[size] = Target(self._gl, size, self._samples)
        return self._targets[size]

    def _light_up(self, camera: Camera) -> None:
        """Give every surface program the camera and the lights."""
        self._shadow.bind(1, 2)
        matrix = matrix_bytes(camera.projection() @ camera.view())
        values: dict[str, Any] = {
            "transforms": 0,
            "shadow": 1,
            "shadow_depth": 2,
            "shadow_texel": self._shadow.texel,
            "shadow_texel_uv": self._shadow.texel_uv,
            "eye": tuple(camera.eye),
            "key": tuple(_light_axes()[2]),
        }
        for kind, program in self._scene.programs.items():
            program["view_projection"].write(matrix)
            program["light_matrix"].write(matrix_bytes(self._shadow.matrix))
            if kind == "floor":
                program["horizon"], program["middle"] = HORIZON, tuple(camera.target)
            for name, value in values.items():
                program[name] = value

    def _draw_background(self, camera: Camera) -> None:
        matrix = np.linalg.inv(camera.projection() @ camera.view())
        self._background["from_clip"].write(matrix_bytes(matrix))
        self._background["horizon"], self._background["zenith"] = HORIZON, ZENITH
        self._gl.depth_func = "<="
        self._background_array.render(vertices=3)
        self._gl.depth_func = "<"


class _ShadowMap:
    """How far the key light sees; what stands still is kept from picture to picture.

    Attributes:
        matrix: From the world to the light's clip space, shape [4, 4].
        texel: Width of a pixel of the map [m].
        texel_uv: Width of a pixel of the map in texture coordinates.
    """

    def __init__(self, gl: Any, size: int) -> None:
        self._gl, self._size = gl, size
        self._key: tuple[float, ...] = ()
        self.matrix: Array = np.eye(4)
        self.texel, self.texel_uv = 0.0, 1 / max(size, 1)
        shape = (max(size, 1),) * 2
        # Depth is copied along with colour only, so each has a colour that nothing writes.
        self._unused = [gl.renderbuffer(shape, 1) for _ in range(2)]
        self._depths = [gl.depth_texture(shape) for _ in range(2)]
        self._targets = [
            gl.framebuffer([c], d) for c, d in zip(self._unused, self._depths, strict=True)
        ]
        for depth, target in zip(self._depths, self._targets, strict=True):
            depth.repeat_x = depth.repeat_y = False
            target.color_mask = False, False, False, False
            target.clear(depth=1.0)
        self._depths[1].compare_func = "<="
        nearest = (gl.NEAREST, gl.NEAREST)
        self._raw = gl.sampler(repeat_x=False, repeat_y=False, filter=nearest)

    def draw(self, scene: GLScene, camera: Camera, *, changed: bool) -> None:
        """Draw the map around what the camera looks at."""
        distance = float(np.linalg.norm(np.subtract(camera.target, camera.eye)))
        radius = min(max(round(1.6 * distance) / 2, 1.0), 4.0)
        center = np.round(np.asarray(camera.target) * 4) / 4
        axes = _light_axes()
        depth_range = 2 * radius + 8
        eye = center + axes[2] * (depth_range / 2)
        self.matrix = orthographic(radius, 0.0, depth_range) @ look(axes, eye)
        self.texel = 2 * radius * self.texel_uv
        if not self._size:
            return
        self._gl.enable_only(self._gl.DEPTH_TEST)
        still, live = self._targets
        key = (radius, *center.tolist())
        if changed or key != self._key:
            self._key = key
            still.use()
            still.clear(depth=1.0)
            scene.draw_shadow_casters(self.matrix, still=True, cell=1.5 * self.texel)
        self._gl.copy_framebuffer(live, still)
        live.use()
        scene.draw_shadow_casters(self.matrix, still=False, cell=1.5 * self.texel)

    def forget(self) -> None:
        """Draw also what stands still the next time."""
        self._key = ()

    def bind(self, compared: int, raw: int) -> None:
        """Bind the map to two texture units: one compares depths, one gives them."""
        self._depths[1].use(compared)
        self._depths[1].use(raw)
        self._raw.use(raw)

    def unbind(self) -> None:
        """Give the texture units back."""
        self._gl.clear_samplers()

    def release(self) -> None:
        """Free everything."""
        for thing in (*self._targets, *self._depths, *self._unused, self._raw):
            thing.release()


def _light_axes() -> Array:
    back = np.asarray(KEY_DIRECTION, np.float64)
    back = back / np.linalg.norm(back)
    right = np.cross((0.0, 0.0, 1.0), back)
    right /= np.linalg.norm(right)
    return np.array((right, np.cross(back, right), back))


__all__ = ["GLRenderer"]
