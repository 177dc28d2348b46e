"""What a picture is drawn into, and the passes that finish it: occlusion, resolve, turning over."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import numpy.typing as npt

from .camera import Camera
from .gl_context import make_program
from .shading import BLUR_FRAGMENT, FINAL_FRAGMENT, SCREEN_VERTEX, occlusion_program

_STRENGTH = 0.8  # of the ambient occlusion


class Finisher:
    """The full-screen passes that make a picture of what was drawn into a target."""

    def __init__(self, gl: Any, *, samples: int, ambient_occlusion: bool) -> None:
        self._gl, self._occludes = gl, ambient_occlusion
        self._samples = samples
        self._programs = {
            "occlusion": make_program(gl, occlusion_program(multisampled=samples > 0)),
            "blur": make_program(gl, (SCREEN_VERTEX, BLUR_FRAGMENT)),
            "final": make_program(gl, (SCREEN_VERTEX, FINAL_FRAGMENT)),
        }
        self._arrays = {name: gl.vertex_array(p, []) for name, p in self._programs.items()}

    def finish(self, camera: Camera, target: Target) -> npt.NDArray[np.uint8]:
        """Return the picture in a target, shape [height, width, 3]."""
        gl = self._gl
        gl.enable_only(gl.NOTHING)
        if self._samples:
            gl.copy_framebuffer(target.resolved, target.scene)
        if self._occludes:
            program = self._programs["occlusion"]
            half = math.tan(math.radians(camera.fov_deg) / 2)
            target.scene_depth.use(0)
            program["depth"], program["size"] = 0, target.size
            program["lens"] = half * camera.aspect, half
            program["planes"] = camera.near, camera.far
            self._run("occlusion", target.occlusion)
            target.occlusion_texture.use(0)
            self._programs["blur"]["raw"] = 0
            self._run("blur", target.blurred)
        final = self._programs["final"]
        target.picture.use(0)
        target.blurred_texture.use(1)
        final["picture"], final["occlusion"] = 0, 1
        final["strength"] = _STRENGTH if self._occludes else 0.0
        self._run("final", target.final)
        out = np.empty((camera.height, camera.width, 4), np.uint8)
        target.final.read_into(out, components=4)
        return np.ascontiguousarray(out[:, :, :3])

    def _run(self, name: str, framebuffer: Any) -> None:
        framebuffer.use()
        self._arrays[name].render(vertices=3)

    def release(self) -> None:
        """Free everything."""
        for thing in (*self._arrays.values(), *self._programs.values()):
            thing.release()


class Target:
    """The framebuffers for one size of picture.

    Attributes:
        size: Width and height [pixel].
        scene: Where the scene is drawn, with several samples a pixel.
        scene_depth: Its depth.
        depth_only: Where only distances are drawn.
    """

    def __init__(self, gl: Any, size: tuple[int, int], samples: int) -> None:
        self.size = size
        half = (size[0] + 1) // 2, (size[1] + 1) // 2
        self.picture = gl.texture(size, 4)
        self.scene_depth = gl.depth_texture(size, samples=samples)
        self._color = gl.renderbuffer(size, 4, samples=samples) if samples else self.picture
        self.scene = gl.framebuffer([self._color], self.scene_depth)
        self.resolved = gl.framebuffer([self.picture])
        self.occlusion_texture = gl.texture(half, 2, dtype="f2")
        self.blurred_texture = gl.texture(half, 1)
        self.occlusion = gl.framebuffer([self.occlusion_texture])
        self.blurred = gl.framebuffer([self.blurred_texture])
        self._final_color = gl.renderbuffer(size, 4)
        self.final = gl.framebuffer([self._final_color])
        self.depth_texture = gl.depth_texture(size)
        self.depth_only = gl.framebuffer(depth_attachment=self.depth_texture)
        for texture in (self.picture, self.occlusion_texture, self.blurred_texture):
            texture.repeat_x = texture.repeat_y = False

    def release(self) -> None:
        """Free everything."""
        things = {id(thing): thing for thing in vars(self).values() if hasattr(thing, "release")}
        for thing in things.values():
            thing.release()


__all__ = ["Finisher", "Target"]
