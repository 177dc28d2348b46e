"""Pictures drawn by OpenGL without a window, on a graphics card or in software (Mesa)."""

from __future__ import annotations

import os
import weakref
from collections import Counter
from collections.abc import Sequence
from typing import Any

import numpy as np

from ..pose import Array
from ..world import World
from .camera import Camera, look, orthographic
from .gl_scene import GLScene
from .gl_target import (
    Finisher,
    SurveyTarget,
    Target,
    check_process,
    create_context,
    free_context,
    matrix_bytes,
)
from .renderer import Renderer
from .shading import HORIZON, ZENITH, make_program
from .shot import Light, Look, Picture, Shot

_TARGETS_KEPT = 16


class GLRenderer(Renderer):
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
        super().__init__(world)
        self._gl: Any = create_context()
        self._process = os.getpid()
        # For who forgets to close it; at the end of the process the driver may be gone already.
        self._closer = weakref.finalize(self, free_context, self._gl, self._process)
        self._closer.atexit = False
        with self._gl as gl:
            self._samples: dict[Look, int] = {"full": min(samples, gl.max_samples), "plain": 0}
            self._targets: dict[tuple[Any, ...], Target | SurveyTarget] = {}
            self._scene = GLScene(gl, world, floor=floor)
            self._shadows = {"full": _ShadowMap(gl, shadow_size), "plain": _ShadowMap(gl, 0)}
            self._finishers = {
                look: Finisher(
                    gl, samples=count, ambient_occlusion=ambient_occlusion and look == "full"
                )
                for look, count in self._samples.items()
            }
            self._background = make_program(gl, "screen", "background")
            self._background_array = gl.vertex_array(self._background, [])
        self._seen: tuple[Any, ...] = ()
        self._is_shadow_stale = True

    def refresh(self) -> None:
        """Read the shapes and colours of all bodies again."""
        self._scene.refresh()
        self._seen = ()

    def _look_anew(self) -> None:
        self._seen = ()

    def read(self, shots: Sequence[Shot]) -> list[Picture]:
        """Return what each of several cameras sees, as every renderer.

        The scene is sent to the graphics card once for all, and not at all if no time has passed,
        nothing was teleported and nothing was added since the last picture.
        """
        self._check_open()
        check_process()
        out: list[Picture] = [{} for _ in shots]
        with self._gl:
            self._follow()
            # Draw all, then read all: to read one waits until it is drawn.
            drawn: list[Target | SurveyTarget | None] = []
            used: Counter[tuple[Any, ...]] = Counter()
            for shot in shots:
                target = self._draw(shot, used) if shot.wants_rgb else None
                drawn.append(target)
                drawn.append(self._survey(shot, target, used) if shot.wants_shape else None)
            for i, (picture, shot) in enumerate(zip(out, shots, strict=True)):
                colors, survey = drawn[2 * i : 2 * i + 2]
                if isinstance(colors, Target):
                    picture["rgb"] = colors.read()
                if isinstance(survey, SurveyTarget):
                    picture.update(survey.read(shot.outputs))
            while len(self._targets) > _TARGETS_KEPT:
                self._targets.pop(next(iter(self._targets))).release()
        return out

    def close(self) -> None:
        """Free everything on the graphics card; safe to call twice."""
        if self._gl is None:
            return
        if self._process == os.getpid():  # else a fork has copied it, and another process draws
            with self._gl:
                for thing in (
                    *self._targets.values(),
                    self._scene,
                    *self._shadows.values(),
                    *self._finishers.values(),
                    self._background_array,
                    self._background,
                ):
                    thing.release()
        self._closer()
        self._gl = None

    @property
    def _is_closed(self) -> bool:
        return self._gl is None

    def _follow(self) -> None:
        """Bring the scene up to date with the world, if it may have changed."""
        if self._moment() == self._seen:
            self._scene.update_lines()
            return
        self._is_shadow_stale |= self._scene.update()
        self._seen = self._moment()  # a skin may have given itself new colours on the way

    def _moment(self) -> tuple[Any, ...]:
        world = self._world
        skins = [(id(skin), id(skin.faces), id(skin.colors)) for skin in world.skins]
        return (world.step_count, world.teleports, len(world.bodies), *skins)

    def _draw(self, shot: Shot, used: Counter[tuple[Any, ...]]) -> Target:
        """Draw colours into a target that nothing else of this reading is drawn into."""
        camera, look = shot.camera, shot.look
        size, samples = (camera.width, camera.height), self._samples[look]
        target = self._target((Target, size, samples), used)
        assert isinstance(target, Target)
        shadow = self._shadows[look]
        if look == "full":
            shadow.draw(self._scene, camera, shot.light, changed=self._is_shadow_stale)
            self._is_shadow_stale = False
        scene = target.survey().scene if self._measures(shot) else target.scene
        scene.use()
        scene.clear(0.0, 0.0, 0.0, 0.0, depth=1.0)
        self._light_up(camera, shot.light, shadow)
        self._scene.draw_opaque(camera, measured=self._measures(shot))
        target.scene.use()
        self._draw_background(camera)
        self._scene.draw_transparent(camera)
        shadow.unbind()
        self._finishers[look].finish(camera, target)
        return target

    def _measures(self, shot: Shot) -> bool:
        """Whether shapes are measured while colours are drawn: both have one sample a pixel."""
        return shot.wants_shape and not self._samples[shot.look]

    def _survey(
        self, shot: Shot, colored: Target | None, used: Counter[tuple[Any, ...]]
    ) -> SurveyTarget:
        """Return normals, depths and labels, drawn with the colours or into a target of their own."""
        if colored is not None and self._measures(shot):
            return colored.survey()
        camera = shot.camera
        target = self._target((SurveyTarget, (camera.width, camera.height)), used)
        assert isinstance(target, SurveyTarget)
        target.scene.use()
        target.scene.clear(0.0, 0.0, 0.0, 0.0, depth=1.0)
        self._scene.draw_survey(camera)
        return target

    def _target(
        self, kind: tuple[Any, ...], used: Counter[tuple[Any, ...]]
    ) -> Target | SurveyTarget:
        """Return a target made by `kind`, a class and its arguments, that is not yet used."""
        key = (*kind, used[kind])
        used[kind] += 1
        target = self._targets.pop(key, None)
        if target is None:
            make, *arguments = kind
            target = make(self._gl, *arguments)
        self._targets[key] = target  # the last used stands last
        return target

    def _light_up(self, camera: Camera, light: Light, shadow: _ShadowMap) -> None:
        """Give every surface program the camera and the lights."""
        shadow.bind(1, 2)
        matrix = matrix_bytes(camera.projection() @ camera.view())
        values: dict[str, Any] = {
            "transforms": 0,
            "shadow": 1,
            "shadow_depth": 2,
            "shadow_texel": shadow.texel,
            "shadow_texel_uv": shadow.texel_uv,
            "eye": tuple(camera.eye),
            "optical": tuple((camera.axes() * ((1,), (-1,), (-1,))).T.ravel().tolist()),
            "key": tuple(light.axes()[2]),
            "powers": (light.key, light.fill, light.bounce),
        }
        for kind, program in self._scene.programs.items():
            program["view_projection"].write(matrix)
            program["light_matrix"].write(matrix_bytes(shadow.matrix))
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
        self._key: tuple[Any, ...] = ()
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

    def draw(self, scene: GLScene, camera: Camera, light: Light, *, changed: bool) -> None:
        """Draw the map around what the camera looks at."""
        distance = float(np.linalg.norm(np.subtract(camera.target, camera.eye)))
        radius = light.reach
        if light.lid is None:
            radius = min(max(round(1.6 * distance) / 2, 1.0), radius)
        center = np.round(np.asarray(camera.target) * 4) / 4
        axes = light.axes()
        depth_range = 2 * radius + 8
        eye = center + axes[2] * (depth_range / 2)
        self.matrix = orthographic(radius, 0.0, depth_range) @ look(axes, eye)
        self.texel = 2 * radius * self.texel_uv
        if not self._size:
            return
        self._gl.enable_only(self._gl.DEPTH_TEST)
        # Walls would shade themselves in stripes where light grazes them.
        self._gl.polygon_offset = (0.0, 0.0) if light.lid is None else (2.0, 2.0)
        still, live = self._targets
        key = (radius, *center.tolist(), light.direction, light.lid)
        if changed or key != self._key:
            self._key = key
            still.use()
            still.clear(depth=1.0)
            scene.draw_shadow_casters(self.matrix, light, still=True, cell=1.5 * self.texel)
        self._gl.copy_framebuffer(live, still)
        live.use()
        scene.draw_shadow_casters(self.matrix, light, still=False, cell=1.5 * self.texel)
        self._gl.polygon_offset = 0.0, 0.0

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
