"""The inside of somebody's mouth: two rows of teeth, lips and cheeks, as a toothbrush feels them.

The rigid shapes of a head have no mouth. So a brush that enters between open lips passes through them, and
meets this instead: crowns along two arches, which go with head and jaw, and soft limits where lips, cheeks
and throat are. All of it yields by springs. Its forces push brush and person alike, and count as contacts
of any other kind.

Arches have the form of a beta function (S. Braun et al., The form of the human dental arch, Angle
Orthodontist 68, 1998), with widths and depths at the first molars of 58 and 32 mm above, 54 and 28 mm below
(M. Mina et al., Odontology 105, 2017: 57.9, 31.6, 54.2, 28.1), for a face of `FACE`. All other figures are
our own choices.
"""

from __future__ import annotations

import math
import weakref
from dataclasses import dataclass
from typing import Literal, get_args

import numba
import numpy as np

from rcare_marl.agents.people.body.skeleton import JOINT_INDEX
from rcare_marl.agents.people.human import Human
from rcare_marl.body import Body
from rcare_marl.contact import Contact
from rcare_marl.pose import Array
from rcare_marl.world import World

Quadrant = Literal["upper_left", "upper_right", "lower_left", "lower_right"]
QUADRANTS: tuple[Quadrant, ...] = get_args(Quadrant)

# [m] of the beta function over the outer side of the crowns: width and depth, above and below. They pass
# through the first molars of Mina et al.
WIDTHS, DEPTHS = (0.0615, 0.0575), (0.038, 0.034)
FACE = 0.093  # [m] from the joint of the jaw ahead to the lips, of an adult; others are scaled by theirs
BEHIND_LIPS = 0.013  # [m] from the lips back to the front teeth
LEVELS = (0.007, -0.005)  # [m] of the crowns over the gap of closed lips, above and below
CROWN = 0.004  # [m] half the thickness of a crown, and of its height: crowns are tubes
NODES = 61  # of an arch: a tooth has four
BRISTLES = 0.006  # [m] from the axis of the head of a brush to the end of the bristles
POINTS = 7  # along the bristles
STIFFNESS, DAMPING = 500.0, 1.0  # [N/m], [N·s/m] of bristles on teeth, all points together
FRICTION, SLIDING = 0.3, 0.02  # of bristles on teeth; [m/s] from which it is full
FROM_SIDE = (
    0.5  # cosine of the way in to the outer side of a crown: else the brush is inside, or on top
)
MIDDLE = 0.008  # [m] to a side, where a quadrant begins
# Lips, cheeks and throat: how far they give way freely [m], and what they push with beyond.
HALF_WIDTH, LIP_STRETCH = 0.034, 0.012  # of the mouth with drawn corners; up and down
CHEEK, THROAT = 0.040, 0.075  # from the midline to a side, from the lips to the back
SOFT = 80.0  # [N/m]
ENTRY, LEFT = 0.015, 0.025  # [m] before the lips, where a brush has come in; where it is out again
PASSED = ("head", "jaw", "neck", "spine3")  # whose rigid shapes a brush in the mouth goes through
CLEAR = 0.002  # [m] between brush and face, from where that is rigid again
NEAR = 0.12  # [m] from the lips, beyond which nothing is looked at


@dataclass(frozen=True, eq=False)
class Arch:
    """A row of crowns, in the frame of the joint that it moves with.

    Attributes:
        joint: `head` or `jaw`.
        nodes: Along the middle of the crowns from the person's right to the left [m], shape [n, 3].
        outward: Out of the mouth there, unit vectors in the plane of the arch, shape [n, 3].
    """

    joint: str
    nodes: Array
    outward: Array

    def beside(self, side: float, back: float) -> tuple[Array, Array]:
        """Return a place on the middle of the crowns [m] and the way outward there, each of shape [3].

        Args:
            side: 1 for the person's left, -1 for the right.
            back: How far it is behind the foremost crown, as a share of the arch's depth.
        """
        depth = self.nodes[:, 2].max() - self.nodes[:, 2]
        there = np.flatnonzero(self.nodes[:, 0] * side > 0)
        node = there[np.argmin(abs(depth[there] - back * depth.max()))]
        return self.nodes[node], self.outward[node]


def arches_of(person: Human) -> tuple[Arch, Arch]:
    """Return the upper and the lower arch of a person."""
    joints, mouth = person.model.joints, person.model.mouth
    scale = (mouth[2] - joints[JOINT_INDEX["jaw"]][2]) / FACE
    made = []
    for joint, width, depth, level in zip(("head", "jaw"), WIDTHS, DEPTHS, LEVELS, strict=True):
        curve = scale * _crowns(width, depth)
        curve[:, 1] = scale * level
        curve[:, 2] -= scale * (BEHIND_LIPS + depth)
        along = np.gradient(curve, axis=0)
        outward = np.cross(along, (0.0, 1.0, 0.0))
        outward /= np.linalg.norm(outward, axis=1)[:, None]
        outward *= np.sign(outward[NODES // 2, 2])  # ahead, at the front
        middle = curve - CROWN * outward + mouth - joints[JOINT_INDEX[joint]]
        made.append(Arch(joint, np.ascontiguousarray(middle), np.ascontiguousarray(outward)))
    return made[0], made[1]


def _crowns(width: float, depth: float) -> Array:
    """Return the outer side of an arch [m], evenly spaced, ends first and last, shape [n, 3]."""
    x = 0.5 * np.sin(np.linspace(-0.5 * math.pi, 0.5 * math.pi, 801))
    y = 0.25**-0.8 * (0.25 - x * x) ** 0.8
    curve = np.column_stack((width * x, np.zeros_like(x), depth * y))
    way = np.concatenate(([0.0], np.cumsum(np.linalg.norm(np.diff(curve, axis=0), axis=1))))
    even = np.linspace(0.0, way[-1], NODES)
    return np.column_stack([np.interp(even, way, curve[:, k]) for k in range(3)])


class MouthInside:
    """What a brush meets in a mouth; it goes on with the world and is rewound with it.

    Attributes:
        arches: The upper and the lower one.
        is_inside: Whether the brush has come in between the lips.
        outside: Force of the bristles on the outer side of each of `QUADRANTS` in the last physics step
            [N], shape [4].
        push: Force on the brush in it, in the world [N], shape [3].
    """

    def __init__(
        self, world: World, person: Human, brush: Body, bristles: tuple[float, float]
    ) -> None:
        """Take who has the mouth, and a brush that is straight along z.

        Args:
            world: Where they are; it has to be told of this by `world.matter`.
            person: Whose mouth it is; spawned.
            brush: The brush.
            bristles: From where to where they go along z in the frame of the brush [m].
        """
        self._world: World = weakref.proxy(world)
        self._person, self._brush = person, brush
        self.arches = arches_of(person)
        self.is_inside = self._passes = False
        self.outside = np.zeros(len(QUADRANTS))
        self.push = np.zeros(3)
        # The rigid trunk of who is heavy reaches up into the floor of the mouth.
        frames = {joint: person.frames[JOINT_INDEX[joint]] for joint in PASSED}
        self._passed = sorted({frame.link for frame in frames.values()})
        self._links = [frames[arch.joint].link for arch in self.arches]
        self._locals = []
        for arch in self.arches:
            local = np.eye(4)
            local[:3, :3], local[:3, 3] = frames[arch.joint].rotation, frames[arch.joint].offset
            self._locals.append(local)
        mouth, joints = person.model.mouth, person.model.joints
        self._lips = [mouth - joints[JOINT_INDEX[arch.joint]] for arch in self.arches]
        self._scale = float(mouth[2] - joints[JOINT_INDEX["jaw"]][2]) / FACE
        self._bristles = np.zeros((POINTS, 3))
        self._bristles[:, 2] = np.linspace(*bristles, POINTS)
        self._before: list[Array] = []
        self._contacts: list[tuple[int, Array, Array, float]] = []

    def frame(self, which: int) -> Array:
        """Return where an arch's joint is in the world, 0 the upper, a matrix of shape [4, 4]."""
        pose = self._person.body.link_pose(self._links[which])
        return np.asarray(pose.matrix() @ self._locals[which])

    def step(self) -> None:
        """Push brush and person for the coming physics step."""
        self._contacts.clear()
        self.outside[:] = 0.0
        self.push[:] = 0.0
        brush = self._brush.base_pose().matrix()
        tip = brush[:3, :3] @ self._bristles[-1] + brush[:3, 3]
        head = self.frame(0)
        lips = head[:3, :3] @ self._lips[0] + head[:3, 3]
        apart = tip - lips
        if apart @ apart > NEAR * NEAR:
            self._leave()
            return
        frames = [head, self.frame(1)]
        points = self._bristles @ brush[:3, :3].T + brush[:3, 3]
        self._enter_or_leave(frames, head[:3, :3].T @ apart)
        if not self.is_inside:
            return
        local = [(points - frame[:3, 3]) @ frame[:3, :3] for frame in frames]
        for k, (arch, frame) in enumerate(zip(self.arches, frames, strict=True)):
            before = self._before[k] if self._before else local[k]
            dt = self._world.physics_dt
            found = _press(local[k], before, arch.nodes, arch.outward, dt)
            if found[6] > 0:
                self._push(k, frame, found[:3], found[3:6], float(found[6]))
                self.outside[2 * k : 2 * k + 2] += found[7:9]
        self._before = local
        self._soft_parts(frames, local[0][-1], brush)

    def _enter_or_leave(self, frames: list[Array], tip: Array) -> None:
        """See whether the tip, from the upper lip in axes of the head [m], is in the mouth now."""
        if self.is_inside:
            if tip[2] > LEFT:
                self._leave()
            return
        self._leave()
        low = self._lower_lip(frames)
        is_open = low < -LIP_STRETCH * 0.25
        fits = low - LIP_STRETCH < tip[1] < LIP_STRETCH and abs(tip[0]) < HALF_WIDTH * self._scale
        if is_open and fits and 0.0 < tip[2] < ENTRY:
            self.is_inside = True
            self._pass(True)

    def _lower_lip(self, frames: list[Array]) -> float:
        """Return how high the lower lip is over the upper one, in axes of the head [m]."""
        low = frames[1][:3, :3] @ self._lips[1] + frames[1][:3, 3]
        place = frames[0][:3, :3].T @ (low - frames[0][:3, 3])
        return float(place[1] - self._lips[0][1])

    def _leave(self) -> None:
        """Be out of the mouth; the face is rigid again once the brush is clear of it."""
        self.is_inside = False
        self._before = []
        if self._passes:
            person = self._person.body
            if self._world.separation(self._brush, person, within=CLEAR) >= CLEAR:
                self._pass(False)

    def _pass(self, passes: bool) -> None:
        """Let the brush through the rigid face, or not."""
        if passes != self._passes:
            self._passes = passes
            links = self._passed
            self._world.set_collision(self._brush, self._person.body, not passes, links_b=links)

    def _soft_parts(self, frames: list[Array], tip: Array, brush: Array) -> None:
        """Let lips, cheeks and throat push the brush where they cannot give way any more."""
        head, scale = frames[0], self._scale
        tip = tip - self._lips[0]
        if tip[2] >= 0.0:
            return
        beyond = np.zeros(3)
        beyond[0] = tip[0] - np.clip(tip[0], -CHEEK * scale, CHEEK * scale)
        beyond[2] = min(tip[2] + THROAT * scale, 0.0)
        self._push_soft(head, -SOFT * beyond, tip + self._lips[0])
        axis = head[:3, :3].T @ brush[:3, 2]
        if axis[2] > -0.1:
            return
        at = tip - axis * (tip[2] / axis[2])  # where the neck of the brush is between the lips
        wide, low = HALF_WIDTH * scale, self._lower_lip(frames) - LIP_STRETCH
        kept = np.array((np.clip(at[0], -wide, wide), np.clip(at[1], low, LIP_STRETCH), at[2]))
        self._push_soft(head, SOFT * (kept - at), at + self._lips[0])

    def _push_soft(self, frame: Array, force: Array, place: Array) -> None:
        size = float(np.linalg.norm(force))
        if size > 0.0:
            self._push(0, frame, force, place, size)

    def _push(self, which: int, frame: Array, force: Array, place: Array, size: float) -> None:
        """Push the brush by a force [N] at a place [m] in the frame of an arch, and the person back."""
        at, push = frame[:3, :3] @ place + frame[:3, 3], frame[:3, :3] @ force
        self.push += push
        self._brush.apply_force(-1, push.tolist(), at.tolist())
        self._person.body.apply_force(self._links[which], (-push).tolist(), at.tolist())
        self._contacts.append(
            (self._links[which], at, push / max(float(np.linalg.norm(push)), 1e-9), size)
        )

    def contacts(self, a: Body, b: Body | None = None) -> list[Contact]:
        """Return where the brush pressed on the person in the last step, seen from either."""
        brush, person = self._brush, self._person.body
        pair = {brush.uid, person.uid}
        if a.uid not in pair or (b is not None and {a.uid, b.uid} != pair):
            return []
        side = 1.0 if a.uid == brush.uid else -1.0
        made = []
        for link, at, push, size in self._contacts:
            links = (-1, link) if side > 0 else (link, -1)
            place, normal = tuple(at.tolist()), tuple((side * push).tolist())
            made.append(Contact(*links, place, normal, 0.0, size))
        return made

    def mark(self) -> None:
        """Nothing is kept of a brush that is out of the mouth, as at every start."""

    def rewind(self) -> None:
        """Return to a brush that is out of the mouth."""
        self.is_inside = False
        self._pass(False)
        self._before = []
        self._contacts.clear()
        self.outside[:] = 0.0
        self.push[:] = 0.0


@numba.njit(cache=True)
def _press(points, before, nodes, outward, dt):  # type: ignore[no-untyped-def]
    """Return what an arch does to bristles in its frame, shape [9].

    That is the force [N] and its place [m], [3] each; the sum of normal forces [N]; of these those on outer
    sides, to the person's left and right.
    """
    out = np.zeros(9)
    count, reach = points.shape[0], CROWN + BRISTLES
    for i in range(count):
        p = points[i]
        best, nearest = 1e9, 0
        for j in range(nodes.shape[0]):
            x, y, z = p[0] - nodes[j, 0], p[1] - nodes[j, 1], p[2] - nodes[j, 2]
            gap = x * x + y * y + z * z
            if gap < best:
                best, nearest = gap, j
        gap = math.sqrt(best)
        if gap >= reach or gap < 1e-6:
            continue
        normal = (p - nodes[nearest]) / gap
        speed = (p - before[i]) / dt
        approach = -(speed @ normal)
        force = (STIFFNESS * (reach - gap) + DAMPING * approach) / count
        if force <= 0:
            continue
        slip = speed + approach * normal
        drag = FRICTION * force / max(math.sqrt(slip @ slip), SLIDING)
        out[:3] += force * normal - drag * slip
        out[3:6] += force * (nodes[nearest] + CROWN * normal)
        out[6] += force
        if normal @ outward[nearest] > FROM_SIDE:
            if nodes[nearest, 0] > MIDDLE:
                out[7] += force
            elif nodes[nearest, 0] < -MIDDLE:
                out[8] += force
    if out[6] > 0:
        out[3:6] /= out[6]
    return out
