"""A world that is built in Bullet, and moves in MuJoCo from `mark_start` on.

Bullet keeps what does not move: shapes, masses, surfaces. It is posed anew where somebody asks how far
apart bodies are, and never stepped again.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np
import pybullet as bullet

from rcare_marl.attachment import Attachment
from rcare_marl.body import Body
from rcare_marl.errors import ConfigError, WorldError
from rcare_marl.joint_feedback import JointFeedback
from rcare_marl.pose import Array, Pose, Vector
from rcare_marl.scene.scene import scene_of
from rcare_marl.soft.soft_world import SoftWorld
from rcare_marl.world import World

from .native import Ints
from .simulation import Simulation

if TYPE_CHECKING:
    from collections.abc import Mapping


Chosen = slice | Ints  # of an array


def _run(places: Ints) -> Chosen:
    """Return places of an array as a slice, if they follow each other."""
    first = int(places[0]) if len(places) else 0
    follows = np.array_equal(places, np.arange(first, first + len(places)))
    return slice(first, first + len(places)) if follows and first >= 0 else places


class MujocoBody(Body):
    """A body whose state is in MuJoCo once its world was marked."""

    _world: MujocoWorld

    def __init__(self, *args: Any) -> None:
        super().__init__(*args)
        self.sim: Simulation | None = None
        self._told: list[Callable[[], None]] = []  # what was told to motors before there were any
        self._mirrored = (-1, -1)
        self._looked_up: dict[tuple[int, ...], tuple[Chosen, Chosen, Ints | None]] = {}

    def enter(self, sim: Simulation, number: int) -> None:
        """Move in MuJoCo from now on.

        Args:
            sim: The scene.
            number: Place of the body in the world.
        """
        self.sim, self.number, self._places = sim, number, sim.places[number]
        for told in self._told:
            told()
        self._told.clear()

    def mirror(self) -> None:
        """Let Bullet know where it is, for shapes and gaps."""
        now = (self._world.step_count, self._world.teleports)
        if self.sim is None or now == self._mirrored:
            return
        if self.is_movable or now[1] != self._mirrored[1]:
            super().set_base(self.base_pose())
            self._world.teleports -= 1  # nothing moved
        self._mirrored = now
        if self.joints:
            indices = [joint.index for joint in self.joints.values()]
            found = [[position] for position in self.joint_states(indices)[0]]
            bullet.resetJointStatesMultiDof(self.uid, indices, found, physicsClientId=self._client)

    def state(self) -> Array:
        if self.sim is None:
            return super().state()
        position, turn = self.centre_pose()
        _, linear, angular = self.link_motion(-1)
        arm = np.subtract(position, self.base_pose().position)
        joints = self.joint_states(range(self.link_count))
        return np.concatenate([position, turn, linear + np.cross(angular, arm), angular, *joints])

    def joint_states(self, indices: Sequence[int]) -> tuple[list[float], list[float]]:
        if self.sim is None:
            return super().joint_states(indices)
        places, dofs, fixed = self._lookup(tuple(indices))
        positions, rates = self.sim.qpos[places], self.sim.qvel[dofs]
        if fixed is not None:
            positions[fixed] = rates[fixed] = 0.0
        return positions.tolist(), rates.tolist()

    def _lookup(self, indices: tuple[int, ...]) -> tuple[Chosen, Chosen, Ints | None]:
        """Return where joints are in `qpos` and `qvel`, as slices where they follow each other.

        And which of them are fixed, if any.
        """
        if indices not in self._looked_up:
            chosen = list(indices)
            places, dofs = self._places.positions[chosen], self._places.dofs[chosen]
            fixed = np.flatnonzero(places < 0)
            some = fixed if len(fixed) else None
            self._looked_up[indices] = _run(places), _run(dofs), some
        return self._looked_up[indices]

    def joint_torques(self, indices: Sequence[int]) -> list[float]:
        if self.sim is None:
            return super().joint_torques(indices)
        forces: list[float] = self.sim.motor_force(self._places.dofs[list(indices)]).tolist()
        return forces

    def joint_readings(self, indices: Sequence[int]) -> Sequence[tuple[Any, ...]]:
        if self.sim is None:
            return super().joint_readings(indices)
        positions, rates = self.joint_states(indices)
        torques = self.joint_torques(indices)
        return [(p, v, (), t) for p, v, t in zip(positions, rates, torques, strict=True)]

    @property
    def feedback(self) -> JointFeedback:
        raise ConfigError(
            "sensors of joint loads work on Bullet alone: leave them out, or engine='mujoco'"
        )

    def link_centre_states(self, links: Sequence[int]) -> list[tuple[tuple[float, ...], ...]]:
        if self.sim is None:
            return super().link_centre_states(links)
        found: list[tuple[tuple[float, ...], ...]] = []
        for link in links:
            pose, linear, angular = self.link_motion(link)
            centre = pose @ self.inertial_pose(link)
            speed = linear + np.cross(angular, np.subtract(centre.position, pose.position))
            found.append((centre.position, centre.quaternion, tuple(speed), tuple(angular)))
        return found

    def link_centres(self, links: Sequence[int]) -> Array:
        if self.sim is None:
            return super().link_centres(links)
        places = [(self.link_pose(i) @ self.inertial_pose(i)).position for i in links]
        return np.array(places).reshape(-1, 3)

    def own_gap(self, a: int, b: int) -> float:
        self.mirror()
        return super().own_gap(a, b)

    def bounds(self) -> tuple[Array, Array]:
        self.mirror()
        return super().bounds()

    def base_pose(self) -> Pose:
        if self.sim is None:
            return super().base_pose()
        return self.sim.pose(int(self._places.links[0]))

    def centre_pose(self) -> tuple[tuple[float, ...], tuple[float, ...]]:
        if self.sim is None:
            return super().centre_pose()
        if not self._has_offset:
            return self.sim.place_of(int(self._places.links[0]))
        pose = self.base_pose() @ self._inertial
        return pose.position, pose.quaternion

    def link_pose(self, index: int) -> Pose:
        if self.sim is None:
            return super().link_pose(index)
        return self.sim.pose(int(self._places.links[index + 1]))

    def link_motion(self, index: int) -> tuple[Pose, Array, Array]:
        if self.sim is None:
            return super().link_motion(index)
        link = int(self._places.links[index + 1])
        return self.sim.pose(link), *self.sim.motion(link)

    def link_poses(self) -> tuple[Array, Array]:
        if self.sim is None:
            return super().link_poses()
        self.sim.place()
        data, links = self.sim.data, self._places.links
        return data.xpos[links], data.xquat[links][:, (1, 2, 3, 0)]

    def wake(self) -> None:
        if self.sim is None:
            super().wake()

    def set_joints(self, indices: Sequence[int], positions: Vector) -> None:
        if self.sim is None:
            super().set_joints(indices, positions)
            return
        self._world.teleports += 1
        chosen, data = list(indices), self.sim.data
        data.qpos[self._places.positions[chosen]] = positions
        data.qvel[self._places.dofs[chosen]] = 0.0
        self.sim.moved()

    def set_base(self, pose: Pose) -> None:
        if self.sim is None:
            super().set_base(pose)
            return
        self._world.teleports += 1
        self.sim.set_base(self.number, pose)

    def _drive(self, indices: Sequence[int], rows: Sequence[Vector], forces: Vector) -> None:
        """Tell motors target, speed there, gain and greatest speed, and their greatest forces."""
        if self.sim is None:
            self._told.append(partial(self._drive, list(indices), rows, list(forces)))
            return
        for index, row, force in zip(indices, rows, forces, strict=True):
            dof = self._places.dofs[index]
            self.sim.motors[dof] = row
            self.sim.model.dof_frictionloss[dof] = force

    def drive_positions(
        self,
        indices: Sequence[int],
        targets: Vector,
        forces: Vector,
        *,
        position_gain: float = 0.1,
        velocities: Sequence[float] | None = None,
    ) -> None:
        if self.sim is None:
            super().drive_positions(
                indices, targets, forces, position_gain=position_gain, velocities=velocities
            )
        speeds = [0.0] * len(indices) if velocities is None else velocities
        pairs = zip(targets, speeds, strict=True)
        rows = [(float(t), float(v), position_gain, np.inf) for t, v in pairs]
        self._drive(indices, rows, forces)

    def drive_to(
        self,
        indices: Sequence[int],
        targets: Sequence[float],
        speeds: Sequence[float],
        forces: Sequence[float],
        gains: Sequence[float],
    ) -> None:
        if self.sim is None:
            super().drive_to(indices, targets, speeds, forces, gains)
        told = zip(targets, gains, speeds, strict=True)
        self._drive(indices, [(target, 0.0, gain, speed) for target, gain, speed in told], forces)

    def drive_velocities(self, indices: Sequence[int], targets: Vector, forces: Vector) -> None:
        if self.sim is None:
            super().drive_velocities(indices, targets, forces)
        self._drive(indices, [(0.0, float(speed), 0.0, np.inf) for speed in targets], forces)

    def drive_torques(self, indices: Sequence[int], torques: Sequence[float]) -> None:
        if self.sim is None:
            super().drive_torques(indices, torques)
            return
        self.sim.torque[self._lookup(tuple(indices))[1]] += torques

    def pushing(self, indices: Sequence[int], torques: Sequence[float]) -> Callable[[], object]:
        if self.sim is None:
            return super().pushing(indices, torques)
        dofs, push, torque = self._places.dofs[list(indices)], np.array(torques), self.sim.torque

        def apply() -> None:
            torque[dofs] += push

        return apply

    def limit_joint(self, index: int, lower: float, upper: float) -> None:
        if self.sim is None:
            super().limit_joint(index, lower, upper)
            self._told.append(partial(self.limit_joint, index, lower, upper))
            return
        self.sim.limit(int(self._places.dofs[index]), lower, upper)

    def limit_speed(self, most: float) -> None:
        """Do nothing after the start: motors whose force is limited do not overshoot here."""
        if self.sim is None:
            super().limit_speed(most)

    def apply_force(self, link: int, force: Vector, point: Vector) -> None:
        if self.sim is None:
            super().apply_force(link, force, point)
            return
        self.sim.push(int(self._places.links[link + 1]), force, point)


class MujocoWorld(World):
    """A world that moves in MuJoCo from `mark_start` on."""

    body_type = MujocoBody

    def __init__(self, *args: Any, **settings: Any) -> None:
        self.sim: Simulation | None = None
        super().__init__(*args, **settings)

    def mark_start(self) -> None:
        """Remember the present state, and go on in MuJoCo.

        Raises:
            ConfigError: If there is something that MuJoCo has not.
        """
        if self.sim is not None:
            self.sim.mark()
            self._marked = [(bond, bond.is_active) for bond in self.bonds]
            for matter in self.matter:
                matter.mark()
            return
        if any(isinstance(matter, SoftWorld) for matter in self.matter):
            raise ConfigError(
                "engine 'mujoco' has no cloth, sponge, water or flesh, and something of this scene is of "
                "them: leave it out, or use engine='bullet'"
            )
        super().mark_start()
        self.sim = Simulation(scene_of(self), self.bodies)
        self._numbers: Mapping[int, int] = {body.uid: i for i, body in enumerate(self.bodies)}
        for number, body in enumerate(self.bodies):
            if isinstance(
                body, MujocoBody
            ):  # not the plate of a marker, which goes with its carrier
                body.enter(self.sim, number)
        self.sim.mark()

    def step(self) -> None:
        if self.sim is None:
            super().step()
            return
        for matter in self.matter:
            matter.step()
        self.sim.step()
        self.step_count += 1

    @property
    def is_compiled(self) -> bool:
        return self.sim is not None and not self.matter

    def stepped(self, count: int) -> None:
        """Take note that compiled code made physics steps."""
        assert self.sim is not None
        self.sim.stepped()
        self.step_count += count

    def number(self, body: Body) -> int:
        """Return the number of a body in `Simulation.touched`."""
        return self._numbers[body.uid]

    def places(self, body: Body, indices: Sequence[int]) -> tuple[Ints, Ints]:
        """Return where joints are in MuJoCo's `qpos` and `qvel`, each of shape [n]."""
        assert self.sim is not None
        found, chosen = self.sim.places[self.number(body)], list(indices)
        return found.positions[chosen], found.dofs[chosen]

    def rewind(self) -> None:
        if self.sim is None:
            super().rewind()
            return
        self._restore_bonds()
        self.set_solver_iterations(self._marked_iterations)
        self.sim.rewind()
        for matter in self.matter:
            matter.rewind()
        self.teleports += 1
        self.step_count = 0

    def set_solver_iterations(self, count: int) -> None:
        super().set_solver_iterations(count)
        if self.sim is not None:
            self.sim.set_iterations(count)

    def attach(self, *args: Any, **settings: Any) -> Attachment:
        self._check_before("make bonds")
        return super().attach(*args, **settings)

    def detach(self, attachment: Attachment) -> None:
        super().detach(attachment)
        if self.sim is not None:
            self.sim.set_bond(self.bonds.index(attachment), False)

    def set_collision(
        self,
        a: Body,
        b: Body,
        enabled: bool,
        *,
        links_a: Iterable[int] | None = None,
        links_b: Sequence[int] | None = None,
    ) -> None:
        self._check_before("change what collides")
        super().set_collision(a, b, enabled, links_a=links_a, links_b=links_b)

    def _check_before(self, what: str) -> None:
        if self.sim is not None:
            raise WorldError(f"engine 'mujoco' cannot {what} in an episode: use engine='bullet'")

    def _points(self, a: Body, b: Body | None) -> Sequence[Any]:
        if self.sim is None:
            return super()._points(a, b)
        points = self.sim.points(self._numbers[a.uid])
        if b is not None:
            return [p for p in points if p[2] == b.uid]
        return [p for p in points if p[1] != p[2]]

    def _all_points(self) -> Sequence[Any]:
        return super()._all_points() if self.sim is None else self.sim.points(None)

    def show(self) -> None:
        self._mirror(*self.bodies)

    def separation(
        self,
        a: Body,
        b: Body,
        *,
        within: float,
        links: tuple[int, int | None] | None = None,
    ) -> float:
        self._mirror(a, b)
        return super().separation(a, b, within=within, links=links)

    def gaps(
        self,
        links: Sequence[tuple[Body, int]],
        other: Body,
        *,
        within: float,
        before: Sequence[float] = (),
    ) -> list[float]:
        if self.sim is None:
            return super().gaps(links, other, within=within, before=before)
        numbers = self._numbers
        return self.sim.gaps([(numbers[b.uid], i) for b, i in links], numbers[other.uid], within)

    def _mirror(self, *bodies: Body) -> None:
        for body in bodies:
            if isinstance(body, MujocoBody):
                body.mirror()
