"""Cartesian impedance: the tool as a damped spring towards where it should be, with bounded wrenches.

After N. Hogan, Impedance Control: An Approach to Manipulation, J. of Dynamic Systems, Measurement, and
Control 107 (1985). Spring and damper are those of the end of each physics step, after J. Tan, K. Liu and
G. Turk, Stable Proportional-Derivative Controllers, IEEE CG&A 31 (2011): the arm's mass tells how fast the
tool will be by then, and what it did in the last step beside that is taken for the push of others.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

import numba
import numpy as np

from rcare_marl.errors import ConfigError
from rcare_marl.pose import Array
from rcare_marl.tree.joint_tree import Tree, gravity_torques, jacobian, new_frames
from rcare_marl.tree.least_squares import rotation_vector, turn_frame
from rcare_marl.world import GRAVITY

from ..arm import Arm
from ..kinematics import place_chain
from .control import ToolMotion

Six = tuple[float, float, float, float, float, float]
AXES = ("x", "y", "z", "about x", "about y", "about z")
RANGE = 4.0  # times as stiff, or as little, at the ends of an action that varies it; own choice
SWEEPS = 10  # over all joints, to find what brakes them; own choice
STOPPING = 0.05  # [s] in which a joint may at most come to its limit; own choice
STILL = 2.0  # [1/s] by which joints lose speed that the tool leaves free; own choice


@dataclass(frozen=True)
class Compliance:
    """How the tool yields. Three values along, three about the axes; all defaults are our own choice.

    Attributes:
        stiffness: Of the spring [N/m] and [N·m/rad].
        damping: Of the motion of the tool [N·s/m] and [N·m·s/rad].
        wrench_limit: Greatest forces [N] and torques [N·m] of both together.
        inertia: Of the tool under `admittance` [kg] and [kg·m²]; `impedance` leaves the arm its own. The
            damping of a contact is felt a physics step late, and throws back what is lighter than half a step
            times that: 6 kg at 2,800 N·s/m, as hands of our robots have face to face.
        axes: Whose axes are meant: those of the `world`, or of the `tool`.
        varies: Whether actions set stiffness and damping as well, by twelve more values: each from a
            quarter (-1) over what is given here (0) to four times that (1).
    """

    stiffness: Six = (500.0, 500.0, 500.0, 30.0, 30.0, 30.0)
    damping: Six = (60.0, 60.0, 60.0, 3.0, 3.0, 3.0)
    wrench_limit: Six = (20.0, 20.0, 20.0, 4.0, 4.0, 4.0)
    inertia: Six = (10.0, 10.0, 10.0, 0.2, 0.2, 0.2)
    axes: Literal["world", "tool"] = "world"
    varies: bool = False

    def __post_init__(self) -> None:
        for name in ("stiffness", "damping", "wrench_limit", "inertia"):
            values, low = getattr(self, name), 1e-9 if name in ("wrench_limit", "inertia") else 0.0
            if not all(low <= value < np.inf for value in values):
                least = "above 0" if low else "0 or more"
                raise ConfigError(f"{name} must be six finite numbers, each {least}, got {values}")


class ToolImpedance(ToolMotion):
    """Six values move the rest of a spring that holds the tool, as `ToolDelta` moves its target.

    No motor is stiff: all that the arm does at its tool is the spring, its damper and its own inertia. The
    wrench is cut at its limits, so a tool that is told to go on into something presses with that limit.
    The rest stays where the spring is at its limit, and so does not wind up.

    What stands still gets no energy from it: with the rest still, the energy of spring and motion only
    falls. Where an action makes a stretched spring stiffer, its rest comes nearer by as much as keeps the
    energy in it.

    Attributes:
        compliance: How it yields.
        wrench: What spring and damper did in the last physics step, in their axes [N] and [N·m], shape [6].
    """

    needs_actuation = True

    def __init__(self, arm: Arm, compliance: Compliance) -> None:
        super().__init__()
        self.compliance, self._arm = compliance, arm
        self._stiffness = np.array(compliance.stiffness, np.float64)
        self._damping = np.array(compliance.damping, np.float64)
        self._limit = np.array(compliance.wrench_limit, np.float64)
        if compliance.varies:
            kinds = ("stiffness", "damping")
            self.names += tuple(f"tool {kind} {axis} [log4]" for kind in kinds for axis in AXES)
            self.max, self.size = np.append(self.max, np.ones(12)), 18
        self._gains = self._stiffness, self._damping
        self._ends = arm.lower, arm.upper, arm.velocity
        self._goal = np.zeros((3, 4))
        self._twist = np.zeros(6)
        self.wrench = np.zeros(6)
        self._last = np.full(
            (2, 6), np.nan
        )  # speed of the tool then, and what its wrench sped it up by

    def reset(self) -> None:
        arm = self._arm
        none = np.zeros(len(arm))
        arm.drive_velocities(none, none)
        self._goal[:] = arm.chain.tip_frame(arm.positions())
        self._gains, self._twist = (self._stiffness, self._damping), np.zeros(6)
        self._last[:] = np.nan

    def command(self, action: Array, duration: float) -> None:
        self._twist = self.max[:6] * action[:6]
        if self.compliance.varies:
            stiffness = self._stiffness * RANGE ** action[6:12]
            damping = self._damping * RANGE ** action[12:18]
            error, turn = self.stretch(self._arm.positions())
            # As much energy in a stiffer spring: it is stretched less.
            share = np.sqrt(np.minimum(self._gains[0] / np.maximum(stiffness, 1e-9), 1.0))
            self._shift((share - 1.0) * error, turn)
            self._gains = stiffness, damping

    @property
    def stiffness(self) -> Array:
        """Of the spring now, along its axes [N/m] and [N·m/rad], shape [6]."""
        return self._gains[0]

    def stretch(self, positions: Array) -> tuple[Array, Array]:
        """Return how far the rest is from the tool along the axes, shape [6], and those, shape [3, 3].

        Args:
            positions: Of the joints [rad or m], shape [n].
        """
        real = self._arm.chain.tip_frame(positions)
        turn = real[:, :3] if self.compliance.axes == "tool" else np.eye(3)
        way, angle = self._goal[:, 3] - real[:, 3], rotation_vector(self._goal, real)
        return np.concatenate((turn.T @ way, turn.T @ angle)), turn

    def _shift(self, way: Array, turn: Array) -> None:
        """Move the rest along the axes [m] and [rad], shape [6]."""
        self._goal[:, 3] += turn @ way[:3]
        turn_frame(self._goal, turn @ way[3:])

    def actuate(self) -> None:
        """Move the rest on, and pull towards it for a physics step."""
        arm, chain = self._arm, self._arm.chain
        arm.align()
        positions, velocities = arm.states()
        torques, self.wrench, weight = _pull(
            (chain.arrays, chain.tip, arm.mass_matrix(positions), self._ends),
            self._goal,
            self._last,
            positions,
            velocities,
            self._twist,
            (*self._gains, self._limit),
            arm.physics_dt,
            self.compliance.axes == "tool",
        )
        room = arm.room(weight)
        torques = np.clip(torques, -room, room)
        arm.drive_torques((torques + arm.carry(weight, np.abs(torques))).tolist())


@numba.njit(cache=True)
def stretched(arrays, tip, goal, positions, way, most, is_of_tool):  # type: ignore[no-untyped-def]
    """Move the rest of a spring, `goal` [3, 4], on by `way` [6], and back where it is stretched too far.

    Args:
        arrays: The fields of the arm's `Tree`.
        tip: Frame of the tool in its last part, shape [3, 4].
        goal: Rest of the spring.
        positions: Of the joints, shape [n].
        way: Along and about the world's axes [m] and [rad], shape [6].
        most: How far it may be stretched along its axes, shape [6].
        is_of_tool: Whether these are those of the tool.

    Returns:
        Torques that carry the arm, shape [n]; Jacobian along the axes, shape [6, n]; stretch, shape [6]; the
        axes, shape [3, 3].
    """
    tree, frames, real = Tree(*arrays), new_frames(len(positions)), np.empty((3, 4))
    place_chain(tree, tip, positions, frames, real)
    weight = gravity_torques(tree, positions, frames, GRAVITY)
    matrix = jacobian(tree, frames, len(positions) - 1, real[:, 3])
    turn = real[:, :3].copy() if is_of_tool else np.eye(3)
    goal[:, 3] += way[:3]
    turn_frame(goal, way[3:])
    back, error = turn.T.copy(), np.empty(6)
    error[:3] = back @ (goal[:, 3] - real[:, 3])
    error[3:] = back @ rotation_vector(goal, real)
    kept = np.minimum(np.maximum(error, -most), most)
    if (kept != error).any():
        goal[:, 3] += turn @ (kept[:3] - error[:3])
        turn_frame(goal, turn @ (kept[3:] - error[3:]))
    own = np.empty_like(matrix)
    own[:3], own[3:] = back @ matrix[:3], back @ matrix[3:]
    return weight, own, kept, turn


@numba.njit(cache=True)
def _pull(chain, goal, last, positions, velocities, twist, gains, dt, is_of_tool):  # type: ignore[no-untyped-def]
    """Move `goal` [3, 4], `last` [2, 6]; return torques [n], wrench along the axes [6], weight [n].

    Args:
        chain: The fields of the arm's `Tree`, the frame of the tool in its last part, the mass matrix, and
            lower limits, upper limits and greatest speeds of the joints.
        goal: Rest of the spring.
        last: Speed of the tool a step before, and what the wrench then sped it up by [1/s]; or no numbers.
        positions: Of the joints, shape [n].
        velocities: Of the joints, shape [n].
        twist: How fast the rest moves, shape [6].
        gains: Stiffness, damping and greatest wrench, each of shape [6].
        dt: Physics step [s].
        is_of_tool: Whether axes are those of the tool.
    """
    arrays, tip, mass, (lower, upper, fastest) = chain
    stiffness, damping, limit = gains
    weight, own, kept, _ = stretched(
        arrays, tip, goal, positions, dt * twist, limit / np.maximum(stiffness, 1e-9), is_of_tool
    )
    inverse = np.linalg.inv(mass)
    ease = own @ inverse @ own.T  # what the tool gains by each wrench
    speed = own @ velocities
    outside = np.zeros(6)
    if not math.isnan(last[0, 0]):
        outside[:] = (speed - last[0]) / dt - last[1]
    brake = damping + dt * stiffness
    wrench = np.linalg.solve(
        np.eye(6) + dt * brake.reshape(6, 1) * ease,
        stiffness * kept - brake * (speed + dt * outside),
    )
    for i in range(6):
        wrench[i] = min(max(wrench[i], -limit[i]), limit[i])
    last[0], last[1] = speed, ease @ wrench
    torques = own.T @ wrench - STILL * (mass @ velocities)
    up = np.minimum(fastest, np.maximum(upper - positions, 0.0) / STOPPING)
    down = np.minimum(fastest, np.maximum(positions - lower, 0.0) / STOPPING)
    return torques + _brakes(velocities, torques, inverse, -down, up, dt), wrench, weight


@numba.njit(cache=True)
def _brakes(velocities, torques, inverse, slowest, fastest, dt):  # type: ignore[no-untyped-def]
    """Return torques that keep speeds within bounds at the end of a physics step, shape [n].

    Each joint is braked by its own motor, and by no more than that takes: a brake never speeds a joint up, so
    it only takes energy. Found by projected Gauss-Seidel iterations, as physics engines find contact forces.

    Args:
        velocities: Of the joints, shape [n].
        torques: What else acts on them, shape [n].
        inverse: Of the mass matrix, shape [n, n].
        slowest: Lower bounds, not above 0, shape [n].
        fastest: Upper bounds, not below 0, shape [n].
        dt: Physics step [s].
    """
    then, brakes = velocities + dt * (inverse @ torques), np.zeros(len(velocities))
    for _ in range(SWEEPS):
        for j in range(len(then)):
            free = then[j] - dt * inverse[j, j] * brakes[j]  # without a brake of its own
            wanted = (min(max(free, slowest[j]), fastest[j]) - free) / (dt * inverse[j, j])
            then += dt * (wanted - brakes[j]) * inverse[:, j]
            brakes[j] = wanted
    return brakes
