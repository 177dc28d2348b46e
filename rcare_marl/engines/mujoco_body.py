"""A body whose state is in MuJoCo once its world was marked."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from functools import cached_property, partial
from typing import TYPE_CHECKING, Any

import numba
import numpy as np
import pybullet as bullet

from rcare_marl.body import Body
from rcare_marl.body_part import State
from rcare_marl.pose import Array, Pose, Vector

from .joint_loads import JointLoads
from .native import Ints
from .row_order import END, GEAR
from .simulation import Simulation

if TYPE_CHECKING:
    from .mujoco_world import MujocoWorld

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
        self._centres: dict[tuple[int, ...], tuple[Ints, Ints, Array]] = {}
        self._looked_up: dict[tuple[int, ...], tuple[Chosen, Chosen, Ints | None]] = {}
        self._world.row_order.load(self, self._client)

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
        positions, rates = self._states_at(indices, self.sim)
        return positions.tolist(), rates.tolist()

    def _states_at(self, indices: Sequence[int], sim: Simulation) -> tuple[Array, Array]:
        places, dofs, fixed = self._lookup(tuple(indices))
        positions, rates = sim.qpos[places].copy(), sim.qvel[dofs].copy()
        if fixed is not None:
            positions[fixed] = rates[fixed] = 0.0
        return positions, rates

    def _torques_at(self, indices: Sequence[int], sim: Simulation) -> Array:
        _, dofs, fixed = self._lookup(tuple(indices))
        torques = sim.motor_forces[dofs].copy()
        if fixed is not None:
            torques[fixed] = 0.0
        return torques

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
        torques: list[float] = self._torques_at(indices, self.sim).tolist()
        return torques

    def joint_readings(self, indices: Sequence[int]) -> tuple[Array, ...]:
        if self.sim is None:
            return super().joint_readings(indices)
        return *self._states_at(indices, self.sim), self._torques_at(indices, self.sim)

    @cached_property
    def feedback(self) -> JointLoads:
        """What the joints transmit."""
        return JointLoads(self, self._client)

    def feel(self) -> None:
        """Let joint loads be worked out after each physics step."""
        self._world.feel()

    def numbers(self, links: Sequence[int]) -> Ints:
        """Return MuJoCo's numbers of links."""
        found: Ints = self._places.links[[link + 1 for link in links]]
        return found

    def centre_state(self, link: int) -> State:
        return super().centre_state(link) if self.sim is None else self.centre_states((link,))[0]

    def centre_states(self, links: Sequence[int]) -> Sequence[State]:
        if self.sim is None:
            return super().centre_states(links)
        self.sim.time()
        return self._states_of(tuple(links), self.sim)

    def centre_places(self, links: Sequence[int]) -> Sequence[State]:
        if self.sim is None:
            return super().centre_places(links)
        self.sim.place()  # speeds may be old
        return [state[:7] for state in self._states_of(tuple(links), self.sim)]

    def _states_of(self, links: tuple[int, ...], sim: Simulation) -> list[State]:
        if links not in self._centres:
            poses = [self.inertial_pose(link) for link in links]
            own = np.array([(*pose.position, *pose.quaternion) for pose in poses]).reshape(-1, 7)
            rows = self.numbers(links)
            self._centres[links] = rows, sim.model.body_rootid[rows].astype(np.int64), own
        data, out = sim.data, np.empty((len(links), 13))
        tables = data.xpos, data.xquat, data.cvel, data.subtree_com
        write_centres(*self._centres[links], *tables, out)
        return list(map(tuple, out.tolist()))

    def own_gap(self, a: int, b: int) -> float:
        self.mirror()
        return super().own_gap(a, b)

    def bounds(self, links: Iterable[int] | None = None) -> tuple[Array, Array]:
        self.mirror()
        return super().bounds(links)

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
        dofs = self._lookup(tuple(indices))[1]
        self.sim.motors[dofs], self.sim.motor_limits[dofs] = rows, forces

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

    def gear(self, leader: int, follower: int, multiplier: float, force: float) -> None:
        super().gear(leader, follower, multiplier, force)
        self._world.row_order.add((GEAR, self, follower))

    def limit_joint(self, index: int, lower: float, upper: float) -> None:
        if self.sim is None:
            super().limit_joint(index, lower, upper)
            self._told.append(partial(self.limit_joint, index, lower, upper))
            if (END, self, index) not in self._world.row_order:
                self._world.row_order.add((END, self, index))
            return
        self.sim.limit(int(self._places.dofs[index]), lower, upper)

    def limit_speed(self, most: float) -> None:
        if self.sim is None:
            super().limit_speed(most)
            self._told.append(partial(self.limit_speed, most))
            return
        chosen = self._places.dofs[self._places.dofs >= 0]
        self.sim.caps[chosen] = most
        if self._places.free is not None:
            first = self._places.free[1]
            self.sim.caps[first : first + 6] = most

    def apply_force(self, link: int, force: Vector, point: Vector) -> None:
        if self.sim is None:
            super().apply_force(link, force, point)
            return
        self.sim.push(int(self._places.links[link + 1]), force, point)


@numba.njit(cache=True)
def write_centres(  # type: ignore[no-untyped-def]
    rows, roots, own, positions, quaternions, speeds, middles, out
):
    """Write how centres of mass of links are and move, see `Body.centre_state`.

    Args:
        rows: MuJoCo's numbers of the links, shape [n].
        roots: Of the first links of their trees.
        own: Centres in the frames of the links, position and quaternion, shape [n, 7].
        positions: `xpos`.
        quaternions: `xquat`.
        speeds: `cvel`, about the centre of the whole tree.
        middles: `subtree_com`.
        out: Shape [n, 13].
    """
    arm = np.empty(3)
    for i in range(len(rows)):
        row, at, state = rows[i], own[i], out[i]
        w, x, y, z = quaternions[row]
        for k in range(3):  # v + 2 w (u x v) + 2 u x (u x v)
            a, b = (k + 1) % 3, (k + 2) % 3
            arm[k] = quaternions[row, 1 + a] * at[b] - quaternions[row, 1 + b] * at[a]
        for k in range(3):
            a, b = (k + 1) % 3, (k + 2) % 3
            turned = quaternions[row, 1 + a] * arm[b] - quaternions[row, 1 + b] * arm[a]
            state[k] = positions[row, k] + at[k] + 2.0 * (w * arm[k] + turned)
        state[3] = w * at[3] + x * at[6] + y * at[5] - z * at[4]
        state[4] = w * at[4] - x * at[5] + y * at[6] + z * at[3]
        state[5] = w * at[5] + x * at[4] - y * at[3] + z * at[6]
        state[6] = w * at[6] - x * at[3] - y * at[4] - z * at[5]
        for k in range(3):
            arm[k] = state[k] - middles[roots[i], k]
            state[10 + k] = speeds[row, k]
        for k in range(3):
            a, b = (k + 1) % 3, (k + 2) % 3
            state[7 + k] = speeds[row, 3 + k] + speeds[row, a] * arm[b] - speeds[row, b] * arm[a]
