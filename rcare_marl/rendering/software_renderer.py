"""Pictures drawn by PyBullet's own rasteriser, for machines on which no OpenGL loads.

It draws in a physics client of its own, so that the world's saved states stay restorable.
"""

from __future__ import annotations

import weakref
from typing import Any

import numpy as np
import numpy.typing as npt
import pybullet as bullet

from ..body import Body
from ..errors import WorldError
from ..pose import Pose, matrix_from_quaternion
from ..world import Skin, World
from .camera import Camera
from .geometry import FLOOR_RGBA, world_parts
from .mesh import Floats, Ints, SmoothNormals
from .piece import split_by_color
from .shading import HORIZON, KEY_DIRECTION
from .stroke import paint, skin_opacity

_FLOOR_HALF = 6.0  # [m]
_OPAQUE = 0.5


class SoftwareRenderer:
    """Draws a world with PyBullet's TinyRenderer: slow and plain, but it works everywhere.

    Skins are drawn as rigid pieces that follow the links of their body, each of one colour; they
    are cut where the skin lies at the first picture, or at `refresh`. Bullet never frees a mesh
    (7 MB for a coarse person), so they are not cut anew for each picture. It knows no translucent
    mesh either: a skin of an opacity below one half is left out. Lines are painted onto the picture.
    """

    def __init__(self, world: World, *, shadows: bool = True, floor: bool = True) -> None:
        """Open a second physics client that holds copies of what is seen.

        Args:
            world: What to draw.
            shadows: Whether to draw shadows; without them it is twice as fast.
            floor: Whether to draw a floor at z = 0 where the world has none.

        Raises:
            WorldError: If PyBullet has no client left.
        """
        self._world, self._shadows, self._floor = world, shadows, floor
        self._client: int = bullet.connect(bullet.DIRECT)
        if self._client < 0:
            raise WorldError("PyBullet has no physics client left for the software renderer")
        self._closer = weakref.finalize(self, _disconnect, self._client)
        self._known: tuple[tuple[int, ...], ...] = ()
        self._copies: list[tuple[Body, int, Pose, int]] = []

    def refresh(self) -> None:
        """Read the shapes and colours of all bodies again."""
        self._known = ()

    def render(self, camera: Camera) -> npt.NDArray[np.uint8]:
        """Return the picture that `camera` takes, shape [height, width, 3].

        Raises:
            WorldError: If the renderer or the world is closed.
        """
        image = self._image(camera)
        seen = np.reshape(np.asarray(image[2], np.uint8), (camera.height, camera.width, 4))
        out = np.ascontiguousarray(seen[:, :, :3])
        distance = _distances(image, camera)
        out[np.isinf(distance)] = np.round(np.multiply(HORIZON, 255))
        for lines in self._world.lines:
            paint(lines, camera, out, distance)
        return out

    def depth(self, camera: Camera) -> npt.NDArray[np.float32]:
        """Return the distance along the line of sight [m], shape [height, width]; inf for nothing.

        Raises:
            WorldError: If the renderer or the world is closed.
        """
        distance = _distances(self._image(camera), camera)
        unseen = np.empty((*distance.shape, 3), np.uint8)
        for lines in self._world.lines:
            paint(lines, camera, unseen, distance)
        return distance

    def close(self) -> None:
        """Free the second client; safe to call twice."""
        self._closer()
        self._client = -1

    def _image(self, camera: Camera) -> tuple[Any, ...]:
        if self._client < 0:
            raise WorldError("this renderer is closed: make a new one")
        if self._world.client < 0:
            raise WorldError("the world of this renderer is closed")
        known = (
            tuple(body.uid for body in self._world.bodies),
            tuple(id(part) for skin in self._world.skins for part in (skin, skin.faces)),
        )
        if self._known != known:
            self._known = known
            self._build()
        self._follow()
        image: tuple[Any, ...] = bullet.getCameraImage(
            camera.width,
            camera.height,
            viewMatrix=camera.view().T.ravel().tolist(),
            projectionMatrix=camera.projection().T.ravel().tolist(),
            lightDirection=KEY_DIRECTION,
            lightColor=(1, 1, 1),
            lightDistance=6.0,
            lightAmbientCoeff=0.55,
            lightDiffuseCoeff=0.5,
            lightSpecularCoeff=0.1,
            shadow=int(self._shadows),
            flags=bullet.ER_NO_SEGMENTATION_MASK,
            renderer=bullet.ER_TINY_RENDERER,
            physicsClientId=self._client,
        )
        return image

    def _build(self) -> None:
        bullet.resetSimulation(physicsClientId=self._client)
        self._copies = []
        parts = world_parts(self._world)
        if self._floor and not any(part.is_floor for part in parts):
            self._add_floor(-0.002)
        for part in parts:
            if part.is_plane:
                self._add_floor(part.top)
                continue
            colors = part.rgba[:, :3]
            for piece in split_by_color(part.mesh.faces, colors):
                vertices = part.mesh.vertices[piece.source]
                normals = part.mesh.normals[piece.source]
                uid = self._add(vertices, normals, piece.faces, (*piece.rgb, part.alpha * 255))
                self._copies.append((part.body, part.shape.link, part.shape.pose, uid))
        for skin in self._world.skins:
            if skin_opacity(skin) >= _OPAQUE:
                self._add_skin(skin)

    def _add_skin(self, skin: Skin) -> None:
        """Cut a skin, as it lies now, into pieces that follow a link each."""
        vertices = skin.vertices()
        normals = SmoothNormals(skin.faces, len(vertices)).compute(vertices)
        positions, quaternions = skin.body.link_poses()
        for link, _, chosen in skin.rest_pieces():
            # Neighbouring pieces overlap by a row of faces, so that no gap opens where they bend.
            inside = np.zeros(len(vertices), np.bool_)
            inside[skin.faces[chosen]] = True
            faces = skin.faces[inside[skin.faces].any(axis=1)]
            turn = matrix_from_quaternion(quaternions[link + 1])
            for piece in split_by_color(faces, skin.colors[:, :3]):
                local = (vertices[piece.source] - positions[link + 1]) @ turn
                uid = self._add(
                    local.astype(np.float32),
                    (normals[piece.source] @ turn).astype(np.float32),
                    piece.faces,
                    (*piece.rgb, 255),
                )
                self._copies.append((skin.body, link, Pose(), uid))

    def _add(
        self,
        vertices: Floats,
        normals: Floats,
        faces: Ints,
        rgba: tuple[float, float, float, float],
    ) -> int:
        visual = bullet.createVisualShape(
            bullet.GEOM_MESH,
            vertices=vertices.tolist(),
            indices=faces.ravel().tolist(),
            normals=normals.tolist(),
            rgbaColor=[value / 255 for value in rgba],
            physicsClientId=self._client,
        )
        uid: int = bullet.createMultiBody(0, -1, visual, physicsClientId=self._client)
        return uid

    def _add_floor(self, height: float) -> None:
        visual = bullet.createVisualShape(
            bullet.GEOM_BOX,
            halfExtents=(_FLOOR_HALF, _FLOOR_HALF, 0.01),
            rgbaColor=[value / 255 for value in FLOOR_RGBA],
            physicsClientId=self._client,
        )
        bullet.createMultiBody(0, -1, visual, (0, 0, height - 0.01), physicsClientId=self._client)

    def _follow(self) -> None:
        """Move the copies to where their links are."""
        poses: dict[int, tuple[npt.NDArray[np.float64], npt.NDArray[np.float64]]] = {}
        for body, link, local, uid in self._copies:
            if body.uid not in poses:
                poses[body.uid] = body.link_poses()
            positions, quaternions = poses[body.uid]
            at = Pose(tuple(positions[link + 1]), tuple(quaternions[link + 1])) @ local
            bullet.resetBasePositionAndOrientation(
                uid, at.position, at.quaternion, physicsClientId=self._client
            )


def _distances(image: tuple[Any, ...], camera: Camera) -> Floats:
    raw = np.reshape(np.asarray(image[3], np.float64), (camera.height, camera.width))
    near, far = camera.near, camera.far
    out = 2 * near * far / (near + far - (raw * 2 - 1) * (far - near))
    out[out > 0.999 * far] = np.inf  # an empty pixel is a hair nearer than `far`
    return out.astype(np.float32)


def _disconnect(client: int) -> None:
    if bullet.isConnected(client):
        bullet.disconnect(client)


__all__ = ["SoftwareRenderer"]
