"""An OpenGL context without a window, what pictures are drawn into, and the passes that finish them."""

from __future__ import annotations

import os
import sys
from collections.abc import Collection
from contextlib import suppress
from importlib import import_module
from typing import Any

import numpy as np
import numpy.typing as npt

from ..errors import MissingPackageError, RenderingError
from .camera import Camera
from .shading import make_program
from .shot import Picture

_STRENGTH = 0.8  # of the ambient occlusion
_OPENED_BY: list[int] = []  # id of the process that first used OpenGL, if one did


def check_process() -> None:
    """Raise RenderingError where OpenGL would hang: in a process forked after it was used.

    A fork copies the locks of the driver, but not its threads, which would open them.
    """
    if _OPENED_BY and _OPENED_BY[0] != os.getpid():
        raise RenderingError(
            "OpenGL was used before this process was forked, and its drivers do not survive that: "
            "make worker processes with context='spawn', or before anything is drawn, or draw in "
            "software in all of them (RCARE_MARL_RENDERER=software)"
        )


def create_context() -> Any:
    """Return a new moderngl context that draws without a window.

    Raises:
        MissingPackageError: If moderngl is not installed.
        RenderingError: If no OpenGL 3.3 context can be had, or `check_process` forbids it.
    """
    check_process()
    try:
        import moderngl  # type: ignore[import-untyped, unused-ignore]
    except ImportError as error:
        raise MissingPackageError("drawing with OpenGL", package="moderngl") from error
    # PyTorch's CUDA wheels bring Triton, and its LLVM crashes if it is loaded after Mesa's.
    with suppress(ImportError):
        import_module("triton")
    settings: dict[str, Any] = {"backend": "egl"} if sys.platform.startswith("linux") else {}
    try:
        context = moderngl.create_context(require=330, standalone=True, **settings)
    except Exception as error:  # glcontext raises Exception itself, and moderngl its own Error
        raise RenderingError(
            f"no OpenGL 3.3 without a window ({error}). "
            "On Debian and Ubuntu: apt-get install libegl1 libgl1-mesa-dri"
        ) from error
    if not _OPENED_BY:
        _OPENED_BY.append(os.getpid())
    return context


def free_context(context: Any, opened_by: int) -> None:
    """Free a context with all that was made in it, but leave one alone that a fork has copied."""
    if os.getpid() == opened_by:
        context.release()


def matrix_bytes(matrix: npt.NDArray[Any]) -> bytes:
    """Return a matrix as OpenGL wants it: by columns, in single precision."""
    return bytes(matrix.T.astype(np.float32).tobytes())


class Finisher:
    """The full-screen passes that make a picture of what was drawn into a target."""

    def __init__(self, gl: Any, *, samples: int, ambient_occlusion: bool) -> None:
        self._gl, self._occludes = gl, ambient_occlusion
        self._samples = samples
        depth = f"uniform {'sampler2DMS' if samples else 'sampler2D'} depth;\n"
        self._programs = {
            "occlusion": make_program(gl, "screen", "occlusion", DEPTH=depth),
            "blur": make_program(gl, "screen", "blur"),
            "final": make_program(gl, "screen", "final"),
        }
        self._arrays = {name: gl.vertex_array(p, []) for name, p in self._programs.items()}

    def finish(self, camera: Camera, target: Target) -> None:
        """Make the picture in a target; its `read` then returns it."""
        gl = self._gl
        gl.enable_only(gl.NOTHING)
        if self._samples:
            gl.copy_framebuffer(target.resolved, target.scene)
        if self._occludes:
            program = self._programs["occlusion"]
            target.scene_depth.use(0)
            program["depth"], program["size"] = 0, target.size
            program["projection"] = tuple(camera.projection()[(0, 1, 0, 1), (0, 1, 2, 2)])
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
    """

    def __init__(self, gl: Any, size: tuple[int, int], samples: int) -> None:
        self._gl, self.size = gl, size
        self._survey: SurveyTarget | None = None
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
        for texture in (self.picture, self.occlusion_texture, self.blurred_texture):
            texture.repeat_x = texture.repeat_y = False

    def survey(self) -> SurveyTarget:
        """Return where normals, depths and labels are drawn with the colours; with one sample only."""
        if self._survey is None:
            self._survey = SurveyTarget(self._gl, self.size, beside=self)
        return self._survey

    def read(self) -> npt.NDArray[np.uint8]:
        """Return the finished picture, shape [height, width, 3]."""
        out = np.empty((self.size[1], self.size[0], 4), np.uint8)
        self.final.read_into(out, components=4)
        return np.ascontiguousarray(out[:, :, :3])

    def release(self) -> None:
        """Free everything."""
        if self._survey is not None:
            self._survey.release()
        made = {name: thing for name, thing in vars(self).items() if name not in ("_gl", "_survey")}
        things = {id(thing): thing for thing in made.values() if hasattr(thing, "release")}
        for thing in things.values():
            thing.release()


class SurveyTarget:
    """What normals, depths and labels are drawn into, for one size of picture.

    Attributes:
        scene: The framebuffer.
    """

    def __init__(self, gl: Any, size: tuple[int, int], beside: Target | None = None) -> None:
        """Make them, to be drawn into alone or together with the colours of a target."""
        self._size = size
        self._shape = gl.texture(size, 4, dtype="f4")
        self._thing = gl.texture(size, 1, dtype="f4")
        self._made = [self._shape, self._thing]
        if beside is None:
            depth = gl.depth_renderbuffer(size)
            self.scene = gl.framebuffer(self._made, depth)
            self._made.append(depth)
        else:
            self.scene = gl.framebuffer([beside.picture, *self._made], beside.scene_depth)

    def read(self, outputs: Collection[str]) -> Picture:
        """Return those of the arrays of `Shot` that are named, from what was drawn."""
        width, height = self._size
        out: Picture = {}
        if "segmentation" in outputs:
            things = np.frombuffer(self._thing.read(), np.float32).reshape(height, width)
            out["segmentation"] = things[::-1].astype(np.int32) - 1
        if "depth" in outputs or "normals" in outputs:
            raw = np.frombuffer(self._shape.read(), np.float32).reshape(height, width, 4)
            if "depth" in outputs:
                out["depth"] = np.where(raw[::-1, :, 3] > 0, raw[::-1, :, 3], np.float32(np.inf))
            if "normals" in outputs:
                out["normals"] = raw[::-1, :, :3].copy()
        return out

    def release(self) -> None:
        """Free everything."""
        for thing in (self.scene, *self._made):
            thing.release()
