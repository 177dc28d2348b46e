"""An OpenGL context without a window, and how its programs take numbers."""

from __future__ import annotations

import sys
from typing import Any

import numpy as np
import numpy.typing as npt

from ..errors import MissingPackageError, RenderingError


def create_context() -> Any:
    """Return a new moderngl context that draws without a window.

    Raises:
        MissingPackageError: If moderngl is not installed.
        RenderingError: If no OpenGL 3.3 context can be had.
    """
    try:
        import moderngl  # type: ignore[import-untyped, unused-ignore]
    except ImportError as error:
        raise MissingPackageError("drawing with OpenGL", package="moderngl") from error
    settings: dict[str, Any] = {"backend": "egl"} if sys.platform.startswith("linux") else {}
    try:
        return moderngl.create_context(require=330, standalone=True, **settings)
    except Exception as error:  # glcontext raises Exception itself, and moderngl its own Error
        raise RenderingError(
            f"no OpenGL 3.3 without a window ({error}). "
            "On Debian and Ubuntu: apt-get install libegl1 libgl1-mesa-dri"
        ) from error


def make_program(gl: Any, source: tuple[str, str]) -> Any:
    """Return the program of a vertex and a fragment source."""
    return gl.program(vertex_shader=source[0], fragment_shader=source[1])


def matrix_bytes(matrix: npt.NDArray[Any]) -> bytes:
    """Return a matrix as OpenGL wants it: by columns, in single precision."""
    return bytes(matrix.T.astype(np.float32).tobytes())


__all__ = ["create_context", "make_program", "matrix_bytes"]
