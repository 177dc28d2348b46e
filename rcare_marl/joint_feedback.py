"""What the joints of a body transmit, from Bullet's joint feedback, with its errors taken off.

Bullet tells the force that a joint's parent puts on its child, about the child's centre of mass, in the
child's principal axes. Version 3.2.7 errs in three ways, found by comparing it with the masses and
accelerations of links:

- What a joint's own motor does is left out. It is added here.
- The feedback is summed over two passes of the articulated body algorithm (Featherstone 2008, chapter
  7), without and with the forces of constraints, and the Coriolis accelerations of the joints are in
  both. The second share is worked out here by that same algorithm and taken off.
- What a stop at the end of a joint's range bears is left out, and the motor of a sliding joint pushes at
  both centres of mass, which is a couple on a joint that turns before it. Both are not mended.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import TYPE_CHECKING

import numba
import numpy as np

from rcare_marl.bullet import bullet

from .pose import Array, matrix_from_quaternion
from .tree.least_squares import put

if TYPE_CHECKING:
    from .body import Body

SLOW = 1e-3  # [rad/s or m/s] of all joints, below which Coriolis forces are nothing
FREE = 1e12  # mass and inertia of a base that is held, against which nothing moves it


class JointFeedback:
    """The wrenches in the joints of one body."""

    def __init__(self, body: Body, client: int) -> None:
        """Read the tree of a body."""
        self._body, self._client = body, client
        self._felt: dict[int, tuple[Array, Array, Array, Array]] = {}
        self._links = list(range(body.link_count))
        count = len(self._links)
        self._parents = np.empty(count, np.int64)
        self._axes = np.zeros((count, 6))  # turn and slide, in principal axes
        self._inertias = np.empty((count + 1, 4))  # base first
        self.read_masses()
        for link in self._links:
            info = bullet.getJointInfo(body.uid, link, physicsClientId=client)
            self._parents[link] = info[16]
            if info[2] == bullet.JOINT_REVOLUTE:
                self._axes[link, :3] = info[13]
            elif info[2] == bullet.JOINT_PRISMATIC:
                self._axes[link, 3:] = info[13]

    def read_masses(self) -> None:
        """Read the masses and inertias of all links, once more where they have changed."""
        for link in range(-1, len(self._links)):
            mass, inertia = self._body.mass_and_inertia(link)
            self._inertias[link + 1] = (mass, *inertia)
        if not self._body.is_movable:
            self._inertias[0] = FREE

    def enable(self, links: Iterable[int]) -> None:
        """Let the joints that carry `links` feel what they transmit; nothing moves otherwise by it."""
        for link in links:
            if link in self._felt:
                continue
            bullet.enableJointForceTorqueSensor(
                self._body.uid, link, enableSensor=1, physicsClientId=self._client
            )
            at = self._body.inertial_pose(link)
            turn, centre = matrix_from_quaternion(at.quaternion), np.array(at.position)
            about, along = turn @ self._axes[link, :3], turn @ self._axes[link, 3:]
            axis = np.concatenate((along, about))
            # The motor of a sliding joint pulls at the centre of mass.
            drive = np.concatenate((along, about + np.cross(centre, along)))
            self._felt[link] = (turn, centre, axis, drive)

    def wrenches(self, links: Sequence[int]) -> Array:
        """Return force [N] and torque [N·m] that `links` put on what carries them, shape [n, 6].

        It is what their joints transmitted in the last physics step: of each link, all that it carries
        and all that touches these, given in the frame of the link at its origin, which lies on the
        joint. A weight that hangs on a link pulls down. `enable` comes first.
        """
        out = np.empty((len(links), 6))
        excess = self._excess()
        states = bullet.getJointStates(self._body.uid, links, physicsClientId=self._client)
        for row, link, state in zip(out, links, states, strict=True):
            turn, centre, _, drive = self._felt[link]
            force, torque = turn @ state[2][:3], turn @ state[2][3:]
            if excess is not None:
                own, extra = excess
                force = force - turn @ (own[link].T @ extra[link, 3:])
                torque = torque - turn @ (own[link].T @ extra[link, :3])
            row[:3] = -force
            row[3:] = -torque - np.cross(centre, force)
            if self._body.has_motor(link):
                row -= drive * state[3]
        return out

    def along_axes(self, links: Sequence[int], wrenches: Array) -> Array:
        """Return the share of `wrenches`, shape [n, 6], along the joints that carry `links`.

        Torque about the axis of a joint that turns, force along that of one that slides; shape [n].
        """
        axes = np.array([self._felt[link][2] for link in links]).reshape(-1, 6)
        return (wrenches * axes).sum(axis=1)

    def _excess(self) -> tuple[Array, Array] | None:
        """Return principal axes of all links as columns, and torque and force told twice, in the world.

        Or None where the joints hardly move.
        """
        uid, client = self._body.uid, self._client
        joints = bullet.getJointStates(uid, self._links, physicsClientId=client)
        speeds = np.array([state[1] for state in joints])
        if self._body.is_movable:
            linear, angular = bullet.getBaseVelocity(uid, physicsClientId=client)
            fastest = max(map(abs, (*linear, *angular)))
        else:
            fastest = 0.0
        if max(fastest, float(np.abs(speeds).max(initial=0.0))) < SLOW:
            return None
        states = bullet.getLinkStates(uid, self._links, 1, 1, physicsClientId=client)
        base = bullet.getBasePositionAndOrientation(uid, physicsClientId=client)
        turns = np.array([matrix_from_quaternion(q) for q in (base[1], *(s[1] for s in states))])
        places = np.array([base[0], *(s[0] for s in states)])
        rates = np.array([np.concatenate((s[7], s[6])) for s in states])
        arms = places[1:] - np.array([s[4] for s in states])
        extra = _coriolis_wrenches(
            self._parents, self._axes, self._inertias, turns, places, rates, arms, speeds
        )
        return turns[1:], extra


@numba.njit(cache=True)
def _inertia(row, turn, out) -> None:  # type: ignore[no-untyped-def]
    """Write the spatial inertia about the centre of mass in the world into zeros, shape [6, 6]."""
    for a in range(3):
        for b in range(3):
            for k in range(3):
                out[a, b] += turn[a, k] * row[1 + k] * turn[b, k]
        out[3 + a, 3 + a] = row[0]


@numba.njit(cache=True)
def _carry(arm):  # type: ignore[no-untyped-def]
    """Return what takes an acceleration to a point `arm` away, shape [6, 6]."""
    out = np.zeros((6, 6))
    for k in range(6):
        out[k, k] = 1.0
    out[3, 1], out[3, 2] = arm[2], -arm[1]
    out[4, 0], out[4, 2] = -arm[2], arm[0]
    out[5, 0], out[5, 1] = arm[1], -arm[0]
    return out


@numba.njit(cache=True)
def _cross(a, b):  # type: ignore[no-untyped-def]
    """Return the cross product, shape [3]."""
    out = np.empty(3)
    for k in range(3):
        i, j = (k + 1) % 3, (k + 2) % 3
        out[k] = a[i] * b[j] - a[j] * b[i]
    return out


@numba.njit(cache=True)
def _coriolis_wrenches(  # type: ignore[no-untyped-def]
    parents, axes, inertias, turns, places, rates, arms, speeds
):
    """Return torque and force in each joint if nothing acted but Coriolis accelerations, [n, 6].

    Featherstone's articulated body algorithm about centres of mass in world axes; base first in
    `inertias`, `turns` and `places`.
    """
    count = len(parents)
    whole = np.zeros((count + 1, 6, 6))
    bias = np.zeros((count + 1, 6))
    motion, coriolis = np.zeros((count, 6)), np.zeros((count, 6))
    _inertia(inertias[0], turns[0], whole[0])
    for i in range(count):
        _inertia(inertias[i + 1], turns[i + 1], whole[i + 1])
        about = turns[i + 1] @ axes[i, :3].copy()
        put(about, motion[i, :3])
        put(turns[i + 1] @ axes[i, 3:].copy() + _cross(about, arms[i]), motion[i, 3:])
        step = motion[i] * speeds[i]
        put(_cross(rates[i, :3], step[:3]), coriolis[i, :3])
        put(_cross(rates[i, :3], step[3:]) + _cross(rates[i, 3:], step[:3]), coriolis[i, 3:])
    reach, grip, push = np.zeros((count, 6)), np.zeros(count), np.zeros(count)
    for i in range(count - 1, -1, -1):
        put(whole[i + 1] @ motion[i], reach[i])
        grip[i] = motion[i] @ reach[i]
        push[i] = -(motion[i] @ bias[i + 1])
        passed = whole[i + 1].copy()
        force = bias[i + 1].copy()
        if grip[i] > 0:
            for a in range(6):
                for b in range(6):
                    passed[a, b] -= reach[i, a] * reach[i, b] / grip[i]
            force += reach[i] * (push[i] / grip[i])
        force += passed @ coriolis[i]
        carry = _carry(places[i + 1] - places[parents[i] + 1])
        inertia, pressed = whole[parents[i] + 1], bias[parents[i] + 1]
        inertia += carry.T @ passed @ carry
        pressed += carry.T @ force
    moved, out = np.zeros((count + 1, 6)), np.zeros((count, 6))
    put(np.linalg.solve(whole[0], -bias[:1].T)[:, 0], moved[0])
    for i in range(count):
        carry, here = _carry(places[i + 1] - places[parents[i] + 1]), moved[i + 1]
        put(carry @ moved[parents[i] + 1] + coriolis[i], here)
        if grip[i] > 0:
            here += motion[i] * ((push[i] - reach[i] @ here) / grip[i])
        put(whole[i + 1] @ here + bias[i + 1], out[i])
    return out
