"""Pictures of a world: by OpenGL, by PyBullet's software rasteriser, or live on a web page."""

from __future__ import annotations

import logging
import os
from typing import Literal

from ..errors import ConfigError, MissingPackageError, RenderingError
from ..world import World
from .camera import Camera
from .gl_renderer import GLRenderer
from .gl_target import check_process
from .piece import SkinCuts
from .renderer import Renderer
from .shot import LOOKS, OUTPUTS, Light, Look, Output, Picture, Shot
from .software_renderer import SoftwareRenderer
from .viewer import Viewer

BACKENDS = ("auto", "gl", "software")
VARIABLE = "RCARE_MARL_RENDERER"

_LOG = logging.getLogger(__name__)
_WARNED: set[str] = set()


def chosen_backend(backend: str = "auto") -> str:
    """Return what `backend` means with the environment variable RCARE_MARL_RENDERER.

    Raises:
        ConfigError: If the backend, or the value of the variable, is unknown.
    """
    chosen, where = backend, "backend"
    if backend == "auto" and VARIABLE in os.environ:
        chosen, where = os.environ[VARIABLE], VARIABLE
    if chosen not in BACKENDS:
        raise ConfigError(f"{where} must be one of {', '.join(BACKENDS)}, got {chosen!r}")
    return chosen


def make_renderer(
    world: World,
    backend: Literal["auto", "gl", "software"] = "auto",
    *,
    cuts: SkinCuts | None = None,
    floor: bool = True,
    samples: int = 4,
    ambient_occlusion: bool = True,
) -> Renderer:
    """Return a renderer of `world`.

    Args:
        world: What to draw.
        backend: `gl` is fast and good-looking, `software` works everywhere; `auto` tries the first
            and falls back to the second with one warning a process. The environment variable
            RCARE_MARL_RENDERER decides what `auto` means. In a process forked after OpenGL was
            used `auto` does not fall back: its pictures would look unlike those of its parent.
        cuts: How `software` cuts people into rigid pieces; where they are now if None.
        floor: Whether to draw a floor at z = 0 where the world has none.
        samples: Samples a pixel of `gl` against jagged edges; 0 is fastest.
        ambient_occlusion: Whether `gl` darkens corners and contacts.

    Raises:
        ConfigError: If the backend, or the value of the variable, is unknown.
        RenderingError: If `gl` is asked for and there is none, or OpenGL was used before this
            process was forked.
        MissingPackageError: If `gl` is asked for and moderngl is not installed.
    """
    chosen = chosen_backend(backend)
    if chosen == "software":
        return SoftwareRenderer(world, cuts=cuts, floor=floor)

    def with_gl() -> GLRenderer:
        return GLRenderer(world, floor=floor, samples=samples, ambient_occlusion=ambient_occlusion)

    if chosen == "gl":
        return with_gl()
    check_process()
    try:
        return with_gl()
    except (RenderingError, MissingPackageError) as error:
        if "fallback" not in _WARNED:
            _WARNED.add("fallback")
            _LOG.warning("drawing in software, slowly and plainly, since there is %s", error)
        return SoftwareRenderer(world, cuts=cuts, floor=floor)


__all__ = [
    "BACKENDS",
    "LOOKS",
    "OUTPUTS",
    "VARIABLE",
    "Camera",
    "GLRenderer",
    "Light",
    "Look",
    "Output",
    "Picture",
    "Renderer",
    "Shot",
    "SoftwareRenderer",
    "Viewer",
    "chosen_backend",
    "make_renderer",
]
