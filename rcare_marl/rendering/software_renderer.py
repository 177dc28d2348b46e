"""Pictures drawn by PyBullet's own rasteriser, for machines on which no OpenGL loads.

It draws in a physics client of its own, so that the world's saved states stay restorable.
"""

from __future__ import annotations

import weakref
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from rcare_marl.bullet import bullet

from ..body import Body
from ..errors import WorldError
from ..pose import Array, Pose, Vector
from ..world import Skin, World
from .camera import Camera
from .geometry import FLOOR_RGBA, world_parts
from .mesh import Floats
from .piece import Piece, SkinCuts, split_by_color
from .renderer import Renderer
from .shading import HORIZON
from .shot import Labels, Light, Picture, Shot
from .stroke import paint, skin_opacity

_BEND = 2e-3  # relative change of slope from pixel to pixel above which there may be an edge
_AGREEMENT = 1e-3  # relative distance from the plane of a neighbour below which a pixel is on it
_AROUND = tuple((i, j) for i in (-1, 0, 1) for j in (-1, 0, 1) if i or j)
_FLOOR_HALF = 6.0  # [m]
_OPAQUE = 0.5  # a skin that is less opaque is not drawn
_CLEAR = 0.99  # a shape that is less opaque is seen by colours alone
_OUT_OF_SIGHT = Pose((0.0, 0.0, -1e4))


class SoftwareRenderer(Renderer):
    """Draws a world with PyBullet's TinyRenderer: slow and plain, but it works everywhere.

    Skins are drawn as rigid pieces that follow the links of their body, each of one colour; they
    are cut where the skin lies when the renderer is made, or first meets it. Bullet never frees a mesh
    (7 MB for a coarse person), so they are not cut anew for each picture. It knows no translucent
    mesh either: a skin of an opacity below one half is left out. Lines are painted onto the picture.
    """

    def __init__(
        self,
        world: World,
        *,
        floor: bool = True,
        cuts: SkinCuts | None = None,
    ) -> None:
        """Open a second physics client that holds copies of what is seen.

        Args:
            world: What to draw.
            floor: Whether to draw a floor at z = 0 where the world has none.
            cuts: The pieces of its skins, measured earlier; where they lie now if None.

        Raises:
            WorldError: If PyBullet has no client left.
        """
        super().__init__(world)
        self._floor = floor
        self._client: int = bullet.connect(bullet.DIRECT)
        if self._client < 0:
            raise WorldError("PyBullet has no physics client left for the software renderer")
        self._closer = weakref.finalize(self, _disconnect, self._client)
        self._known: tuple[tuple[int, ...], ...] = ()
        self._copies: list[_Copy] = []
        self._cuts = SkinCuts(world) if cuts is None else cuts
        self._labels = np.full(1, -1, np.int32)  # of each copy by its id, the last one for nothing

    def refresh(self) -> None:
        """Read the shapes and colours of all bodies again."""
        self._known = ()
        self._cuts.forget()

    def read(self, shots: Sequence[Shot]) -> list[Picture]:
        self._check_open()
        self._update()
        out = []
        for shot in shots:
            picture: Picture = {}
            if shot.wants_rgb:
                self._follow(transparent=True)
                picture["rgb"] = self._colors(shot)
            if shot.wants_shape:
                self._follow(transparent=False)
                picture.update(self._survey(shot))
            out.append(picture)
        return out

    def _colors(self, shot: Shot) -> npt.NDArray[np.uint8]:
        camera = shot.camera
        image = self._image(camera, shot.light, shadows=shot.look == "full")
        seen = np.reshape(np.asarray(image[2], np.uint8), (camera.height, camera.width, 4))
        out = np.ascontiguousarray(seen[:, :, :3])
        distance = _distances(image, camera)
        out[np.isinf(distance)] = np.round(np.multiply(HORIZON, 255))
        for lines in self._world.lines:
            paint(lines, camera, out, distance)
        return out

    def _survey(self, shot: Shot) -> Picture:
        camera = shot.camera
        image = self._image(camera, shot.light, shadows=False)
        depth = _distances(image, camera)
        copies = np.reshape(np.asarray(image[4], np.int64), depth.shape)
        labels = np.where(np.isinf(depth), -1, self._labels[copies])
        if self._world.lines:
            unseen, before = np.empty((*depth.shape, 3), np.uint8), depth.copy()
            for lines in self._world.lines:
                paint(lines, camera, unseen, depth)
            labels[depth != before] = -1
        out: Picture = {"depth": depth, "segmentation": labels.astype(np.int32)}
        if "normals" in shot.outputs:
            out["normals"] = normals_from_depth(camera, depth, copies)
        return {output: array for output, array in out.items() if output in shot.outputs}

    def close(self) -> None:
        """Free the second client; safe to call twice."""
        self._closer()
        self._client = -1

    @property
    def _is_closed(self) -> bool:
        return self._client < 0

    def _update(self) -> None:
        """Make the copies anew if there is anything new in the world."""
        known = (
            tuple(body.uid for body in self._world.bodies),
            tuple(id(part) for skin in self._world.skins for part in (skin, skin.faces)),
        )
        if self._known != known:
            self._known = known
            self._build()

    def _image(self, camera: Camera, light: Light, *, shadows: bool) -> tuple[Any, ...]:
        # It samples pixels at their lower left corner: the picture is shifted so that these are the middles.
        return bullet.getCameraImage(
            camera.width,
            camera.height,
            viewMatrix=camera.view().T.ravel().tolist(),
            projectionMatrix=camera.shifted(-0.5, 0.5).projection().T.ravel().tolist(),
            lightDirection=light.direction,
            lightColor=(1, 1, 1),
            lightDistance=6.0,
            lightAmbientCoeff=0.55 * light.fill,
            lightDiffuseCoeff=0.5 * light.key,
            lightSpecularCoeff=0.1 * light.key,
            shadow=int(shadows),
            renderer=bullet.ER_TINY_RENDERER,
            physicsClientId=self._client,
        )

    def _build(self) -> None:
        bullet.resetSimulation(physicsClientId=self._client)
        self._copies = []
        labels, numbers = Labels(self._world), dict[int, int]()
        parts = world_parts(self._world)
        if self._floor and not any(part.is_floor for part in parts):
            self._add_floor(-0.002)
        for part in parts:
            if part.is_plane:
                numbers[self._add_floor(part.top)] = part.label
                continue
            link, at = part.shape.link, part.shape.pose
            for piece in split_by_color(part.mesh.faces, part.rgba[:, :3]):
                vertices = part.mesh.vertices[piece.source]
                normals = part.mesh.normals[piece.source]
                uid = self._add_piece(vertices, normals, piece, part.alpha)
                self._copies.append(_Copy(uid, part.body, link, at, part.alpha < _CLEAR))
                numbers[uid] = part.label
        for skin in self._world.skins:
            if skin_opacity(skin) >= _OPAQUE:
                self._add_skin(skin, labels, numbers)
        self._labels = np.full(max(numbers, default=0) + 2, -1, np.int32)
        self._labels[list(numbers)] = list(numbers.values())

    def _add_skin(self, skin: Skin, labels: Labels, numbers: dict[int, int]) -> None:
        is_clear = skin_opacity(skin) < 1
        for link, vertices, normals, piece in self._cuts.of(skin):
            uid = self._add_piece(vertices, normals, piece, 1.0)
            self._copies.append(_Copy(uid, skin.body, link, Pose(), is_clear))
            numbers[uid] = labels.of(skin.body.uid, link)

    def _add_piece(self, vertices: Floats, normals: Floats, piece: Piece, alpha: float) -> int:
        mesh = {"vertices": vertices.tolist(), "indices": piece.faces.ravel().tolist()}
        mesh["normals"] = normals.tolist()
        return self._add(bullet.GEOM_MESH, mesh, (*piece.rgb, alpha * 255))

    def _add_floor(self, height: float) -> int:
        slab = {"halfExtents": (_FLOOR_HALF, _FLOOR_HALF, 0.01)}
        return self._add(bullet.GEOM_BOX, slab, FLOOR_RGBA, (0, 0, height - 0.01))

    def _add(
        self, kind: int, geometry: dict[str, Any], rgba: Sequence[float], at: Vector = (0, 0, 0)
    ) -> int:
        color, client = [value / 255 for value in rgba], self._client
        visual = bullet.createVisualShape(kind, **geometry, rgbaColor=color, physicsClientId=client)
        return bullet.createMultiBody(0, -1, visual, at, physicsClientId=client)

    def _follow(self, *, transparent: bool) -> None:
        """Move the copies to where their links are; what is transparent, perhaps out of sight."""
        poses: dict[int, tuple[npt.NDArray[np.float64], npt.NDArray[np.float64]]] = {}
        for copy in self._copies:
            if copy.is_clear and not transparent:
                at = _OUT_OF_SIGHT
            else:
                if copy.body.uid not in poses:
                    poses[copy.body.uid] = copy.body.link_poses()
                positions, quaternions = poses[copy.body.uid]
                link = copy.link + 1
                at = Pose(tuple(positions[link]), tuple(quaternions[link])) @ copy.pose
            bullet.resetBasePositionAndOrientation(
                copy.uid, at.position, at.quaternion, physicsClientId=self._client
            )


@dataclass(frozen=True)
class _Copy:
    """A mesh in the second client, and what it follows."""

    uid: int
    body: Body
    link: int
    pose: Pose  # in the frame of the link
    is_clear: bool


def _distances(image: tuple[Any, ...], camera: Camera) -> Floats:
    raw = np.reshape(np.asarray(image[3], np.float64), (camera.height, camera.width))
    near, far = camera.near, camera.far
    out = 2 * near * far / (near + far - (raw * 2 - 1) * (far - near))
    out[out > 0.999 * far] = np.inf  # an empty pixel is a hair nearer than `far`
    return out.astype(np.float32)


def _disconnect(client: int) -> None:
    if bullet.isConnected(client):
        bullet.disconnect(client)


def normals_from_depth(camera: Camera, depth: npt.NDArray[Any], labels: npt.NDArray[Any]) -> Floats:
    """Return unit normals in the optical frame, shape [height, width, 3]; zero for nothing.

    On each axis both neighbours of the same label count, or the one across which the slope changes
    less where there is an edge. A pixel where that does not tell either takes the normal of a pixel
    around it in whose plane it lies.

    Args:
        camera: Who took the picture.
        depth: Along the optical axis [m], shape [height, width]; inf for nothing.
        labels: What is seen, shape [height, width]: neighbours count where they are the same.
    """
    points = camera.rays() * np.where(np.isfinite(depth), depth, np.nan)[:, :, None]
    across, bend_across = _slope(points, depth, labels, axis=1)
    down, bend_down = _slope(points, depth, labels, axis=0)
    normals = np.cross(down, across)
    with np.errstate(invalid="ignore", divide="ignore"):
        normals /= np.linalg.norm(normals, axis=2, keepdims=True)
        normals *= -np.sign(np.einsum("ijk,ijk->ij", normals, points))[:, :, None]
        is_sure = np.maximum(bend_across, bend_down) * depth < _BEND
    normals = _borrowed(normals, points, labels, is_sure)
    return np.nan_to_num(normals, nan=0.0).astype(np.float32)


def _slope(
    points: Array, depth: npt.NDArray[Any], labels: npt.NDArray[Any], axis: int
) -> tuple[Array, Array]:
    """Return the step to the next pixel along an axis, on the better side, and how it bends there."""
    with np.errstate(divide="ignore"):
        inverse = 1 / depth.astype(np.float64)  # linear across a flat thing
    steps, bends = [], []
    for side in (-1, 1):
        step = side * (_beside(points, side, axis) - points)
        lost = _beside(labels, side, axis) != labels
        lost |= _is_edge(depth.shape, axis, side)
        alone = _beside(labels, 2 * side, axis) != labels
        alone |= _is_edge(depth.shape, axis, 2 * side)
        bend = _beside(inverse, 2 * side, axis) - 2 * _beside(inverse, side, axis) + inverse
        steps.append(np.where(lost[:, :, None], np.nan, step))
        bends.append(np.where(lost, np.inf, np.where(alone, 1e6, np.abs(bend))))
    with np.errstate(invalid="ignore"):
        is_smooth = np.maximum(*bends) * depth < _BEND
    is_first = bends[0] < bends[1]
    step = np.where(is_first[:, :, None], *steps)
    step = np.where(is_smooth[:, :, None], 0.5 * (steps[0] + steps[1]), step)
    return step, np.where(is_first, *bends)


def _borrowed(
    normals: Array, points: Array, labels: npt.NDArray[Any], is_sure: npt.NDArray[np.bool_]
) -> Array:
    """Return normals in which unsure pixels have taken those of sure ones whose plane they lie in."""
    rows, columns = np.nonzero(~is_sure & np.isfinite(points[:, :, 2]))
    best = np.full(len(rows), _AGREEMENT)
    out = normals.copy()
    here, label = points[rows, columns], labels[rows, columns]
    for down, right in _AROUND:
        r = np.clip(rows + down, 0, labels.shape[0] - 1)
        c = np.clip(columns + right, 0, labels.shape[1] - 1)
        off = np.abs(np.einsum("ij,ij->i", normals[r, c], here - points[r, c])) / here[:, 2]
        taken = is_sure[r, c] & (labels[r, c] == label) & (off < best)
        best[taken] = off[taken]
        out[rows[taken], columns[taken]] = normals[r[taken], c[taken]]
    return out


def _beside(array: npt.NDArray[Any], steps: int, axis: int) -> npt.NDArray[Any]:
    """Return for each pixel the value that many pixels on."""
    return np.roll(array, -steps, axis)


def _is_edge(shape: tuple[int, ...], axis: int, steps: int) -> npt.NDArray[np.bool_]:
    """Return which pixels have no other that many pixels on."""
    place = np.arange(shape[axis]) + steps
    out = (place < 0) | (place >= shape[axis])
    return np.broadcast_to(out if axis == 1 else out[:, None], shape)
