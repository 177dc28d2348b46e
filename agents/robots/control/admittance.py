"""Cartesian admittance: the tool moves as a mass on a damped spring would under the wrench that is felt.

After W. S. Newman, Stability and Performance Limits of Interaction Controllers, J. of Dynamic Systems,
Measurement, and Control 114 (1992), and C. Ott, R. Mukherjee and Y. Nakamura, Unified Impedance and
Admittance Control, ICRA 2010.
"""

from __future__ import annotations

import numba
import numpy as np

from rcare_marl.own_load import OwnMotion, OwnWeight
from rcare_marl.pose import Array, matrix_from_quaternion
from rcare_marl.tree.least_squares import bounded_step
from rcare_marl.world import GRAVITY

from ..arm import Arm
from ..robot_config import BASE_JOINTS
from .impedance import Compliance, ToolImpedance, stretched
from .tool_delta import DAMPING, FEW_JOINTS_TURN, HEADROOM

# [m/s], [rad/s] by which motors may lag behind what they are told: Bullet's slip a little. Own choice.
LEASH = np.array((0.1,) * 3 + (0.5,) * 3)


class ToolAdmittance(ToolImpedance):
    """`ToolImpedance` for arms whose motors are stiff: these move the tool as mass, spring and damper would.

    A six-axis sensor in the last joint of the arm feels what is done to the hand and to what it holds; weight
    and inertia of the hand, and the weight of what it holds, are taken off. What touches the arm before that
    joint is not felt. The spring keeps to the limit, and the damper to as much again: it takes the speed from
    a tool that something has thrown back.

    Attributes:
        outside: What was done to the tool in the last physics step, in the world, about the tool's origin
            [N] and [N·m], shape [6].
    """

    def __init__(self, arm: Arm, compliance: Compliance) -> None:
        super().__init__(arm, compliance)
        self._mass = np.array(compliance.inertia, np.float64)
        self._wrist = arm.indices[-1]
        arm.body.feedback.enable([self._wrist])
        self._weight = OwnWeight(arm.body, [self._wrist])
        self._motion = OwnMotion(arm.body, arm.hand)
        self._is_base = np.array([name in BASE_JOINTS for name in arm.names])
        self._turn_weight = 1.0 if np.sum(~self._is_base) >= 6 else FEW_JOINTS_TURN
        self.outside = np.zeros(6)

    def reset(self) -> None:
        super().reset()
        self._motion.reset()
        self._told = np.zeros(6)
        self._begun = self._arm.world.step_count
        self._load = 0.0, np.zeros(3)
        self.outside = np.zeros(6)

    def command(self, action: Array, duration: float) -> None:
        super().command(action, duration)
        self._load = self._arm.payload()

    def _feel(self, real: Array) -> Array:
        """Return `outside`.

        Args:
            real: Frame of the tool, shape [3, 4].
        """
        body, wrist = self._arm.body, self._wrist
        self._motion.after_substep()
        if self._arm.world.step_count - self._begun < 2:  # no change of motion is known
            return np.zeros(6)
        place = body.link_pose(wrist)
        felt = body.feedback.wrenches([wrist])[0] - self._weight.wrenches()[0]
        felt += self._motion.wrench(place, self._arm.physics_dt)
        turn = matrix_from_quaternion(place.quaternion)
        force, torque = turn @ felt[:3], turn @ felt[3:]
        mass, moment = self._load
        down = np.array((0.0, 0.0, -GRAVITY))
        torque += np.cross(place.position - real[:, 3], force) - np.cross(
            real[:, :3] @ moment, down
        )
        return np.concatenate((force - mass * down, torque))

    def actuate(self) -> None:
        """Move the rest on, and the tool, for a physics step."""
        arm, chain = self._arm, self._arm.chain
        arm.align()
        positions, velocities = arm.states()
        self.outside = self._feel(chain.tip_frame(positions))
        step, self.wrench, load, forces = _move(
            (chain.arrays, chain.tip, (arm.lower, arm.upper, arm.velocity, arm.effort)),
            self._goal,
            positions,
            velocities,
            self._told,
            self._twist,
            (*self._gains, self._limit, self._mass),
            self.outside,
            (arm.physics_dt, self._turn_weight),
            self.compliance.axes == "tool",
        )
        forces = np.minimum(forces, arm.room(load))
        forces = np.where(self._is_base, arm.effort, forces)  # it has the whole robot to speed up
        arm.drive_velocities(step / arm.physics_dt, forces)
        arm.drive_torques(arm.carry(load, forces).tolist())


@numba.njit(cache=True)
def _move(chain, goal, positions, velocities, told, twist, gains, outside, rules, is_of_tool):  # type: ignore[no-untyped-def]
    """Move `goal` [3, 4], `told` [6]; return joint steps [n], wrench along the axes [6] and two torques [n].

    These are what carries the arm's weight and bears what pushes the tool, and the most of motors beside.

    Args:
        chain: The fields of the arm's `Tree`, the frame of the tool in its last part, and lower limits, upper
            limits, greatest speeds and greatest torques of the joints.
        goal: Rest of the spring.
        positions: Of the joints, shape [n].
        velocities: Of the joints, shape [n].
        told: Velocity that the tool was told along its axes [m/s] and [rad/s], shape [6]; told anew.
        twist: How fast the rest moves, shape [6].
        gains: Stiffness, damping, greatest wrench and inertia, each of shape [6].
        outside: What is done to the tool, in the world, shape [6].
        rules: Physics step [s], weight of a radian against a metre.
        is_of_tool: Whether axes are those of the tool.
    """
    arrays, tip, (lower, upper, fastest, effort) = chain
    stiffness, damping, limit, inertia = gains
    dt, turn_weight = rules
    weight, matrix, kept, turn = stretched(
        arrays, tip, goal, positions, dt * twist, limit / np.maximum(stiffness, 1e-9), is_of_tool
    )
    back, push, real = turn.T.copy(), np.empty(6), matrix @ velocities
    speed = np.minimum(np.maximum(told, real - LEASH), real + LEASH)
    push[:3], push[3:] = back @ outside[:3], back @ outside[3:]
    brake = damping + dt * stiffness
    # The spring keeps to the limit by how far it may be stretched; the damper has as much again.
    gain = 1.0 + dt * brake / inertia
    slowing = brake * (real + dt * (stiffness * kept + push) / inertia) / gain
    wrench = stiffness * kept - np.minimum(np.maximum(slowing, -limit), limit)
    told[:] = speed + dt * (wrench + push) / inertia
    wanted = dt * told
    forces = np.empty_like(positions)
    for j in range(len(positions)):
        forces[j] = min(HEADROOM * np.abs(matrix[:, j]) @ limit + 0.1 * effort[j], effort[j])
    # Motors that bear nothing do not slip.
    weight -= matrix.T @ np.minimum(np.maximum(push, -limit), limit)
    wanted[3:] *= turn_weight
    matrix[3:] *= turn_weight
    most = fastest * dt
    lower, upper = np.minimum(lower, positions), np.maximum(upper, positions)
    step = bounded_step(matrix, wanted, positions, lower, upper, np.zeros_like(positions), DAMPING)
    part = 1.0
    for j in range(len(step)):
        part = min(part, most[j] / max(abs(step[j]), 1e-12))
    return part * step, wrench, weight, forces
