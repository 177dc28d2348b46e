"""One joint of a person with all else held, as an examiner holds it: seconds of motion in milliseconds.

The dynamics of one axis that is fixed in the pelvis are exact and short: a constant inertia, and a
weight that turns as a sine of the angle. The drive is the person's own, stepped at the rate of the world.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Mapping
from typing import NamedTuple

import numpy as np

from rcare_marl.pose import Array
from rcare_marl.tree.dynamics import holding_torques
from rcare_marl.world import GRAVITY

from ..actuation.actuation import Actuation
from ..actuation.drive import ActuationConfig, make_drive
from ..actuation.muscular import MuscleDrive
from ..avatar import AvatarConfig, body_model, body_segments, load_posture
from ..body.person_tree import person_tree
from ..body.skeleton import DOF_INDEX, DOFS

PHYSICS_DT = 1.0 / 240.0  # [s]
CONTROL_STEPS = 24  # physics steps of one command


class Motion(NamedTuple):
    """What a joint did.

    Attributes:
        angles: After each physics step [rad], shape [k].
        rates: [rad/s], shape [k].
        torques: Of the drive [N·m], shape [k].
    """

    angles: Array
    rates: Array
    torques: Array


class SingleJoint:
    """A degree of freedom of a person, the others held by an examiner."""

    def __init__(
        self,
        avatar: AvatarConfig,
        dof: str,
        config: ActuationConfig,
        *,
        angles: Array,
        gravity: Array,
    ) -> None:
        """Prepare the drive.

        Args:
            avatar: Who it is.
            dof: What moves.
            config: What drives it.
            angles: Where all DoFs are held [rad], shape [112]; `dof` starts there.
            gravity: A unit vector in the frame of the pelvis, shape [3], or zeros: none.
        """
        body = avatar.body_path()
        segments = body_segments(body, avatar.height_m, avatar.mass_kg, avatar.sex)
        joints = body_model(body, avatar.height_m).joints
        chain = person_tree(segments, joints, angles, [dof])
        i = DOF_INDEX[dof]
        active, passive = (avatar.profile.limits(kind)[dof] for kind in ("active", "passive"))
        self.dof, self.passive = DOFS[i], passive
        lying = dataclasses.replace(load_posture("standing"), supported=(), carried=())
        self.active = min(active[0], angles[i]), max(active[1], angles[i])
        self.drive: Actuation = make_drive(
            avatar,
            chain,
            config,
            lying=lying,
            posture=angles[[i]],
            limits=np.array([self.active]),
            passive=np.array([passive]),
            physics_dt=PHYSICS_DT,
        )
        self.gravity = GRAVITY * np.asarray(gravity, np.float64)
        self.inertia = float(chain.mass_matrix(np.zeros(1))[0, 0])
        self._weight = tuple(
            float(holding_torques(chain.arrays, np.array([at]), self.gravity)[0])
            for at in (0.0, 0.5 * math.pi, math.pi)
        )
        self.start = float(angles[i])
        self.angle, self.rate = self.start, 0.0
        self.drive.reset(np.random.default_rng(0), self.gravity)

    def weight(self, angle: float) -> float:
        """Return the torque that holds the limb against gravity [N·m] at an angle [rad]."""
        ahead, across, behind = self._weight
        middle = 0.5 * (ahead + behind)  # of what the axis itself does not turn: 0
        return (
            middle + 0.5 * (ahead - behind) * math.cos(angle) + (across - middle) * math.sin(angle)
        )

    def put(self, angle: float) -> None:
        """Bring the joint to an angle [rad], at rest, as where it was put."""
        self.angle, self.rate = angle, 0.0
        self.drive.target[0] = angle

    def move(
        self,
        seconds: float,
        *,
        towards: float | None = None,
        effort: float = 0.0,
        held: bool = False,
        load: float | Callable[[float, float], float] = 0.0,
    ) -> Motion:
        """Let the joint move.

        Args:
            seconds: For how long.
            towards: Angle that the person tries to reach [rad]; None leaves the muscles as they are.
            effort: Sign of the motion that is made with all might; 0 for none.
            held: Whether the joint is kept where it is.
            load: Torque of somebody else [N·m], or what gives it at an angle and a rate.
        """
        steps = round(seconds / PHYSICS_DT)
        out = np.zeros((3, steps))
        low, high = self.passive
        wish: Mapping[str, float] = {} if towards is None else {self.dof.name: towards}
        duration = CONTROL_STEPS * PHYSICS_DT
        for step in range(steps):
            if wish and step % CONTROL_STEPS == 0:
                self.drive.command(self.drive.action_towards(wish, duration), duration)
            elif effort and step % CONTROL_STEPS == 0:
                self.drive.command(self._might(effort), duration)
            torque = self.drive.torques([self.angle], [self.rate], self.gravity)[0]
            other = load(self.angle, self.rate) if callable(load) else load
            net = torque + other - self.weight(self.angle)
            self.rate = 0.0 if held else self.rate + PHYSICS_DT * net / self.inertia
            self.angle += PHYSICS_DT * self.rate
            if not low <= self.angle <= high:  # the hard stop of the physics engine
                self.angle, self.rate = min(max(self.angle, low), high), 0.0
            out[:, step] = self.angle, self.rate, torque
        return Motion(*out)

    def _might(self, sign: float) -> Array:
        """Return the action of all might in one direction."""
        if not isinstance(self.drive, MuscleDrive):
            return np.array([sign])
        arms = self.drive.model.moment_arms(np.array([self.angle]))[:, 0]
        return np.where(sign * arms > 0.0, 1.0, 0.0)
