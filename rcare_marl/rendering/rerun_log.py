"""An episode as a log of rerun.io: meshes once; where they are, forces, rewards and pictures over time."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from ..errors import check_package
from .scenery import Scenery

if TYPE_CHECKING:
    from ..envs.care_env import CareEnv

FORCE = 10.0  # that is drawn 10 cm long, as on the page of play [N]


class RerunLog:
    """Writes one file (.rrd), to be called after the reset and after each step; the timeline is `time` [s].

    Entities are `scene/<body>/<number>` and `scene/skin/<body>` (lines without a body by number), `forces` on
    people, `success`, `metrics/<name>`, `rewards/<role>/<term>` and `seen/<role>/<picture>`.
    """

    def __init__(self, path: Path) -> None:
        """Begin a file.

        Raises:
            MissingPackageError: If rerun-sdk is not installed.
        """
        check_package("rerun", "a log of rerun", "rerun")
        import rerun

        self._rr = rerun
        self._stream = rerun.RecordingStream("rcare_marl")
        self._stream.save(path)
        self._scenery: Scenery | None = None
        self._version, self._surfaces = -1, dict[str, int]()
        self._placed: npt.NDArray[Any] = np.empty(0)

    def __call__(self, env: CareEnv) -> None:
        """Log how an environment of `rcare_marl.make` stands now."""
        rr, task = self._rr, env.task
        if self._scenery is None:
            self._scenery = Scenery(env.world)
        self._stream.set_time("time", duration=env.world.time)
        self._bodies(self._scenery)
        self._skins(self._scenery)
        touches = [t for person in task.people for t in env.world.touches(person.body)]
        forces = [np.array(t.normal) * t.force + t.friction for t in touches]
        arrows = rr.Arrows3D(
            origins=[t.position for t in touches],
            vectors=[0.1 / FORCE * np.asarray(force) for force in forces],
            colors=[(208, 0, 0)],
        )
        self._stream.log("forces", arrows)
        numbers = {"success": float(task.succeeded())}
        numbers |= {f"metrics/{name}": float(value) for name, value in task.report().items()}
        for role in env.cast:
            paid = task.paid(role, task.state)
            numbers |= {f"rewards/{role}/{term}": float(value) for term, value in paid.items()}
            seen = env.observe(role)
            for name, array in seen.items() if isinstance(seen, Mapping) else ():
                if array.dtype == np.uint8 and array.ndim == 3:
                    self._stream.log(f"seen/{role}/{name}", rr.Image(array))
        for name, value in numbers.items():
            self._stream.log(name, rr.Scalars(value))

    def _bodies(self, scenery: Scenery) -> None:
        rr = self._rr
        scenery.read()
        geometry = scenery.geometry
        geometry.update()
        names = [f"scene/{part.body.name}/{k}" for k, part in enumerate(geometry.parts)]
        if self._version != scenery.version:
            self._stream.log("scene", rr.Clear(recursive=True))
            self._surfaces, self._version = {}, scenery.version
            self._placed = np.full(geometry.transforms.shape, np.nan)
            for name, part in zip(names, geometry.parts, strict=True):
                mesh = rr.Mesh3D(
                    vertex_positions=part.mesh.vertices,
                    triangle_indices=part.mesh.faces,
                    vertex_normals=part.mesh.normals,
                    vertex_colors=part.rgba,
                )
                self._stream.log(name, mesh)
        for k, name in enumerate(names, 1):
            now = geometry.transforms[k]
            if not np.array_equal(now, self._placed[k]):
                self._stream.log(name, rr.Transform3D(translation=now[:, 3], mat3x3=now[:, :3]))
        self._placed = geometry.transforms.copy()

    def _skins(self, scenery: Scenery) -> None:
        rr = self._rr
        for k, surface in enumerate(scenery.surfaces):
            vertices, normals = surface.now()
            name = f"scene/skin/{surface.name or k}"
            moved: dict[str, Any] = {"vertex_positions": vertices, "vertex_normals": normals}
            if self._surfaces.get(name) != surface.version:
                self._surfaces[name] = surface.version
                moved |= {"triangle_indices": surface.faces, "vertex_colors": surface.rgba}
            self._stream.log(name, rr.Mesh3D.from_fields(**moved))

    def close(self) -> None:
        """Finish the file."""
        self._stream.disconnect()
