"""What the eye sees of a world, as meshes of one colour in the frames of links."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from rcare_marl.rendering.geometry import world_parts
from rcare_marl.rendering.mesh import Floats, Ints
from rcare_marl.rendering.piece import SkinCuts, split_by_color
from rcare_marl.world import World

from .scene import Place, link_name


class Drawn(NamedTuple):
    """Faces of one colour.

    Attributes:
        vertices: In the frame of their link [m], shape [n, 3].
        faces: Shape [m, 3].
        rgba: sRGB colour and opacity, each in [0, 1].
    """

    vertices: Floats
    faces: Ints
    rgba: tuple[float, ...]

    def obj(self) -> str:
        """Return them as a Wavefront file; MuJoCo wants four points at least."""
        points = np.pad(self.vertices, ((0, max(0, 4 - len(self.vertices))), (0, 0)), "mean")
        rows = [f"v {x:.6g} {y:.6g} {z:.6g}" for x, y, z in points.tolist()]
        rows += [f"f {a} {b} {c}" for a, b, c in (self.faces + 1).tolist()]
        return "\n".join(rows) + "\n"


def drawn(world: World) -> dict[Place, list[Drawn]]:
    """Return what is drawn of each link; skins as rigid pieces that were cut where they are now."""
    found: dict[Place, list[Drawn]] = {}
    for part in world_parts(world):
        place = (part.body.name, link_name(part.body, part.shape.link))
        mesh = part.mesh.moved(part.shape.pose)
        for piece in split_by_color(mesh.faces.astype(np.int32), part.rgba[:, :3]):
            rgba = (*(value / 255 for value in piece.rgb), part.alpha)
            vertices = mesh.vertices[piece.source].astype(np.float32)
            found.setdefault(place, []).append(Drawn(vertices, piece.faces, rgba))
    cuts = SkinCuts(world)
    for skin in world.skins:
        for link, vertices, _, piece in cuts.of(skin):
            rgba = (*(value / 255 for value in piece.rgb), 1.0)
            place = (skin.body.name, link_name(skin.body, link))
            found.setdefault(place, []).append(Drawn(vertices, piece.faces, rgba))
    return found
