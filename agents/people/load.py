"""What a person's body goes through in a control step, as their physiology needs it."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numba
import numpy as np

from rcare_marl.tree.dynamics import holding_torques
from rcare_marl.world import World

from ..agent import Array
from .actuation.skeletal import SkeletalDrive
from .body.person_tree import person_tree
from .body.skeleton import DOF_INDEX, DOFS, JOINT_INDEX, JOINTS
from .physiology import Load
from .physiology_model import REGIONS, physiology_model

if TYPE_CHECKING:
    from .human import Human

TRUNK = "spine3"  # its tilt is that of the trunk
LEAVES_SUPPORT = 0.2  # [rad] from the start, where furniture carries no more; our own choice
# Up to here [rad] a limb that lies on something lies there with all its weight; an elbow that bends as fast
# as this [rad/s] does so by itself. Our own choice.
LIES, BENDS = 0.1, 0.2
# Of a limb that lies on something: what points it, what bends it, and what rolls about its own axis.
_POINTS, _BENDS, _ROLLS = 1, 2, 3
EASED = {"shoulder_abduction": _POINTS, "shoulder_flexion": _POINTS, "elbow_flexion": _BENDS}


# Columns of the kernel's table, one row a DoF.
_AGAINST, _ALONG = 0, 1  # greatest torques [N·m]
_POSTURE, _CARRIED = 2, 3  # start angle [rad], and the torque that furniture saves there [N·m]
_COUNTS_AGAINST, _COUNTS_ALONG = 4, 5  # what effort there counts for the region
_COLUMNS = 6


class LoadMeter:
    """Measures effort, contact and posture of one person at the end of a control step."""

    def __init__(self, person: Human, world: World, *, gravity: Array, posture: Array) -> None:
        """Prepare for a person who has been spawned into `world`.

        Args:
            person: Whose load it is.
            world: Where they are.
            gravity: Gravity in the frame of the pelvis [m/s²], shape [3].
            posture: Angles of the movable DoFs in the start posture [rad], shape [n].
        """
        self._person, self._world = person, world
        model = physiology_model()
        figures = [model.figure(name) for name in ("muscle_efficiency", "holding_heat")]
        self._figures = (*figures, LEAVES_SUPPORT)
        joints = [DOFS[DOF_INDEX[dof]].joint for dof in person.movable]
        posed, count = person.posture, len(joints)
        held = JOINTS if posed.supported == "all" else posed.supported
        self._table = table = np.zeros((count, _COLUMNS))
        table[:, _AGAINST], table[:, _ALONG] = person.drive.strength.T
        table[:, _POSTURE] = posture
        if count and isinstance(person.drive, SkeletalDrive):  # muscles never hold what lies
            is_held = [joint in held for joint in joints]
            tree = person_tree(person.segments, person.model.joints, person.angles, person.movable)
            weights = holding_torques(tree.arrays, posture, gravity)
            table[:, _CARRIED] = np.where(is_held, weights, 0.0)
        table[:, _COUNTS_AGAINST : _COUNTS_ALONG + 1] = 1.0
        self._regions = np.array([REGIONS.index(model.region(joint)) for joint in joints], np.int64)
        self._eased = np.zeros(count, np.int64)
        if isinstance(person.drive, SkeletalDrive):
            for i, dof in enumerate(person.movable):
                if joints[i] in posed.eased:
                    self._eased[i] = EASED.get(dof.split("_", 1)[1], _ROLLS)
        if count and isinstance(person.drive, SkeletalDrive):
            self._weigh(person.drive)
        self._out = np.zeros(len(REGIONS) + 1)
        frame = person.frames[JOINT_INDEX[TRUNK]]
        self._trunk, self._up = frame.link, frame.rotation[:, 1].tolist()

    def _weigh(self, drive: SkeletalDrive) -> None:
        """Let muscles count by what is left of them, against the best that is left in their region.

        One that is nearly lost does all it can most of the time; it tires itself, and no arm with it.
        """
        left = np.minimum(drive.strength / drive.normal_strength[:, None], 1.0)
        best = np.zeros(len(REGIONS))
        np.maximum.at(best, self._regions, left.max(axis=1))
        counts = left / np.maximum(best[self._regions], 1e-9)[:, None]
        self._table[:, _COUNTS_AGAINST : _COUNTS_ALONG + 1] = counts

    def read(self) -> Load:
        """Return the load at the end of the last physics step."""
        person = self._person
        if len(self._regions):
            motion = np.array(person.positions), np.array(person.velocities)
            torques = person.drive.muscle_torques()
            shape = self._table, self._regions, self._eased, self._figures
            _exert(*shape, torques, *motion, self._out)
        *efforts, power = self._out.tolist()
        return Load(power, efforts, self._forces(), self.upright())

    def upright(self) -> float:
        """Return the sine of the trunk's angle with the horizontal."""
        x, y, z, w = self._person.body.link_pose(self._trunk).quaternion
        ux, uy, uz = self._up  # plain numbers: arrays this short take ten times as long
        tx, ty, tz = 2 * (y * uz - z * uy), 2 * (z * ux - x * uz), 2 * (x * uy - y * ux)
        return float(uz + w * tz + x * ty - y * tx)

    def _forces(self) -> dict[str, float]:
        """Return the force of everything that can press, by segment [N].

        What stands still, such as a bed, cannot press a person but only carry them.
        """
        person, world = self._person, self._world
        if world.contact_force(person.body) == 0.0:
            return {}
        forces: dict[str, float] = {}
        for body in world.bodies:
            can_press = bool(body.joints) or body.is_movable
            if can_press and body is not person.body and body not in person.supports:
                for joint, force in person.contact_forces(body).items():
                    forces[joint] = forces.get(joint, 0.0) + force
        return forces


@numba.njit(cache=True)
def _away(angle, reach) -> float:  # type: ignore[no-untyped-def]
    """Return 0 where a joint has hardly left [rad] the start, to 1 where nothing carries its limb."""
    return min(max((abs(angle) - LIES) / (reach - LIES), 0.0), 1.0)


@numba.njit(cache=True)
def _exert(table, regions, eased, figures, torques, positions, velocities, out) -> None:  # type: ignore[no-untyped-def]
    """Write the effort of each region, and last the metabolic power above rest [W].

    The drive lets a strong person hold themselves up; who sits in a chair does not tire of it. So the
    weight that furniture carries near the start posture is taken off; of a limb that lies on something
    (`eased`), all effort, whichever way its elbow and axis have come to lie.
    """
    efficiency, holding, reach = figures
    out[:] = 0.0
    last = out.shape[0] - 1
    works = np.zeros(last)  # share of the effort of a limb that lies on something which is its own
    for i in range(table.shape[0]):
        if eased[i] == _POINTS:
            works[regions[i]] = max(
                works[regions[i]], _away(positions[i] - table[i, _POSTURE], reach)
            )
    for i in range(table.shape[0]):
        row, torque = table[i], torques[i]
        near = max(1.0 - abs(positions[i] - row[_POSTURE]) / reach, 0.0)
        carried = near * row[_CARRIED]
        if torque > 0.0:
            torque = max(torque - max(carried, 0.0), 0.0)
        else:
            torque = min(torque - min(carried, 0.0), 0.0)
        if eased[i] == _BENDS:
            torque *= max(works[regions[i]], min(abs(velocities[i]) / BENDS, 1.0))
        elif eased[i]:
            torque *= works[regions[i]]
        strength = row[_ALONG] if torque > 0.0 else row[_AGAINST]
        counts = row[_COUNTS_ALONG] if torque > 0.0 else row[_COUNTS_AGAINST]
        if strength > 0.0:  # a muscle without strength makes no effort
            share = min(abs(torque) / strength, 1.0)
            out[regions[i]] = max(out[regions[i]], share * counts)
            out[last] += max(torque * velocities[i], 0.0) / efficiency + holding * abs(torque)
