"""The GLSL of the renderer, in files: a studio with a warm key light, a cool fill, a sky and a wooden floor.

Lighting is in linear colour with a GGX highlight (Walter et al. 2007, with the visibility term of
Karis 2013) and a filmic curve (Narkowicz 2015). Human skin gets wrapped diffuse light, redder
towards the shadow (after d'Eon and Luebke, GPU Gems 3, ch. 14). Ambient occlusion is in screen
space, with the estimator of McGuire et al. 2012. Shadows are percentage-closer filtered; the kernel
widens with the distance to what casts them.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any

HORIZON = (0.83, 0.85, 0.87)  # sRGB
ZENITH = (0.60, 0.68, 0.77)
_FOLDER = Path(__file__).parent / "glsl"


def make_program(gl: Any, vertex: str, fragment: str, **texts: str) -> Any:
    """Return the program of two files of `glsl`; what they include is one of `texts`, or a file."""
    return gl.program(
        vertex_shader=f"#version 330\n{_source(f'{vertex}.vert', texts)}",
        fragment_shader=f"#version 330\n{_source(f'{fragment}.frag', texts)}",
    )


def make_surface_program(gl: Any, kind: str) -> Any:
    """Return the program that draws a surface: `plastic`, `skin`, `line` or `floor`."""
    fade = _source("fade.glsl", {}) if kind == "floor" else ""
    return make_program(gl, "surface", "surface", SURFACE=_source(f"{kind}.glsl", {}), FADE=fade)


def _source(name: str, texts: Mapping[str, str]) -> str:
    """Return the text of a file with what it includes."""
    if name in texts:
        return texts[name]
    text = (_FOLDER / name).read_text(encoding="utf-8")
    return re.sub(r'#include "(.+)"\n', lambda found: _source(found[1], texts), text)
