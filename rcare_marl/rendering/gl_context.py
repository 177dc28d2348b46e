"""An OpenGL context without a window, and how its programs take numbers."""

from __future__ import annotations

import os
import sys
from typing import Any

import numpy as np
import numpy.typing as npt

from ..errors import MissingPackageError, RenderingError
from .shading import HEAD

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


def make_program(gl: Any, source: tuple[str, str]) -> Any:
    """Return the program of a vertex and a fragment source."""
    return gl.program(vertex_shader=HEAD + source[0], fragment_shader=HEAD + source[1])


def matrix_bytes(matrix: npt.NDArray[Any]) -> bytes:
    """Return a matrix as OpenGL wants it: by columns, in single precision."""
    return bytes(matrix.T.astype(np.float32).tobytes())
