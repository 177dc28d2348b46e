"""A leg of a seated person: the way of a garment along it, and how it is lifted off its footplate."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Iterator, Sequence

import numpy as np
import numpy.typing as npt

from rcare_marl.agents.people.actuation.muscular import LIGAMENT_ZONE
from rcare_marl.agents.people.avatar import seated
from rcare_marl.agents.people.body.posture import calf_back, soles
from rcare_marl.agents.people.body.skeleton import JOINT_INDEX, SIDES
from rcare_marl.agents.people.human import Human
from rcare_marl.pose import Array, Pose, rotate
from rcare_marl.world import World

from ..devices import Wheelchair

# All our own choices.
TOES = 0.09  # [m] that toes reach beyond the ball of the foot
KNEE = 0.06  # [m] before and behind the knee where the front turns from shank to thigh
# How it is lifted. Hip flexion beside that at rest, and knee flexion: straight enough
# that the knee does not buckle, the thigh hardly off the seat.
LIFT = ((math.radians(-5), math.radians(35)), (math.radians(-7), math.radians(6)))
ON_SEAT = math.radians(86)  # hip flexion from which on down the thigh lies on the seat
LIFT_SPREAD = (math.radians(1), math.radians(3))  # of both, uniform, each way
CALF = 0.06  # [m] from the seat to the calf of who is short: three fingers, from memory
ASIDE_DEG = 14.0  # [deg] that the other leg is held aside, else the shorts catch on its knee
BENT = ("hip_flexion", "knee_flexion")
STIFF_DEG = 3.0  # [deg] that a hip bends less than in the posture, from where the knee does too
BACK = 0.03  # [m] that such a plate is farther back, so that the heel stands on it
CLEAR = 0.005  # [m] from such a foot to its plate, and from a thigh to a cushion that gave way
FOOT_HOLD = 0.07  # [m] from the ankle to the toes, where it is grasped
SLID = 0.02  # [m] over the floor from which on a foot stands elsewhere


class LegPath:
    """The middle line of a leg, from the toes over ankle and knee to the hip, as it is now.

    Attributes:
        side: `left` or `right`.
        points: Toes, ankle, knee and hip in the world [m], shape [4, 3].
        shank: From ankle to knee [m].
        thigh: From knee to hip [m].
        radii: Of shank and thigh [m].
    """

    def __init__(self, person: Human, side: str) -> None:
        """Take a spawned person and a side, `left` or `right`."""
        self._person, self.side = person, side
        shank, thigh = (person.segments[f"{side}_{j}"].shapes[0] for j in ("knee", "hip"))
        self.radii = (float(shank.size[1]), float(thigh.size[1]))
        self.points = np.zeros((4, 3))
        self.look()
        self.shank = float(np.linalg.norm(self.points[2] - self.points[1]))
        self.thigh = float(np.linalg.norm(self.points[3] - self.points[2]))

    def look(self) -> None:
        """See where the leg is now."""
        ankle = self._person.joint_pose(f"{self.side}_ankle")
        ball = self._person.joint_pose(f"{self.side}_foot")
        forward = rotate(ball.quaternion, (0.0, 0.0, 1.0))
        self.points[0] = np.add(ball.position, TOES * forward)
        self.points[1] = ankle.position
        for row, joint in ((2, "knee"), (3, "hip")):
            self.points[row] = self._person.joint_pose(f"{self.side}_{joint}").position

    def at(self, along: float) -> Array:
        """Return the point of the line so far from the ankle towards the hip [m], shape [3]."""
        _, ankle, knee, hip = self.points
        if along <= self.shank:
            return np.asarray(ankle + along / self.shank * (knee - ankle))
        return np.asarray(knee + (along - self.shank) / self.thigh * (hip - knee))

    def direction(self, along: float) -> Array:
        """Return where the line goes there, towards the hip, a unit vector, shape [3]."""
        _, ankle, knee, hip = self.points
        way = knee - ankle if along <= self.shank else hip - knee
        return np.asarray(way / np.linalg.norm(way))

    def front(self, along: float) -> Array:
        """Return where the front of the leg looks there, a unit vector, shape [3]."""
        share = min(max((along - self.shank) / (2 * KNEE) + 0.5, 0.0), 1.0)
        shank, thigh = self.direction(0.0), self.direction(self.shank + self.thigh)
        front = np.cross((0.0, 1.0, 0.0), (1 - share) * shank + share * thigh)
        return np.asarray(front / np.linalg.norm(front))

    def place(self, point: Array) -> float:
        """Return how far from the ankle the line is nearest to a point in the world [m]."""
        found: list[tuple[float, float]] = []
        for start, end, before in self._parts():
            way = end - start
            length = float(np.linalg.norm(way))
            share = min(max(float((point - start) @ way) / length**2, 0.0), 1.0)
            gap = float(np.linalg.norm(start + share * way - point))
            found.append((gap, before + share * length))
        return min(found)[1]

    def _parts(self) -> Iterator[tuple[Array, Array, float]]:
        """Return start and end of foot, shank and thigh, and how far from the ankle each begins [m]."""
        foot = float(np.linalg.norm(self.points[1] - self.points[0]))
        return zip(self.points[:-1], self.points[1:], (-foot, 0.0, self.shank), strict=True)

    def crossings(self, ring: Array) -> tuple[int, float]:
        """Return how often the line goes through a ring of cloth, and where first.

        The ring is closed by a fan of triangles about its middle, and crossings count with their sign, so
        the number is how often the ring winds round the leg.

        Args:
            ring: Its particles in order [m], shape [n, 3].

        Returns:
            The winding number, and how far from the ankle the line goes through [m]; where the middle is
            nearest to the line if it does not.
        """
        middle, after = ring.mean(axis=0), np.roll(ring, -1, axis=0)
        count, places = 0, []
        for start, end, before in self._parts():
            signs, shares = pierced(start, end, middle, ring, after)
            count += int(signs.sum())
            places += (before + shares * np.linalg.norm(end - start)).tolist()
        return count, min(places, default=self.place(middle))


class LiftableLeg(LegPath):
    """The middle line of a leg, and the poses of the foot while it is lifted.

    Attributes:
        rest: Angles of the moving DoFs where the leg stands [rad], by name.
        stood: Where the foot is held when it stands [m], shape [3].
        way: Poses of the foot while it is lifted, in turn.
    """

    def __init__(self, person: Human, side: str) -> None:
        """Take a spawned person who has come to rest, and a side, `left` or `right`."""
        super().__init__(person, side)
        self.rest = dict(zip(person.movable, person.positions, strict=True))
        self.stood = self.foot_hold()
        self.way: Sequence[Pose] = ()
        self.plan(np.zeros(2))

    def plan(self, shift: Array) -> None:
        """Say how the leg will be lifted, and put it back to where it stands.

        Args:
            shift: Added to hip and knee flexion [rad], shape [2].
        """
        self.way = [self.put(*np.add(angles, shift).tolist()) for angles in LIFT]
        self.stand()

    def put(self, hip: float, knee: float) -> Pose:
        """Teleport the leg to a hip flexion beside that at rest, and a knee flexion [rad].

        Returns:
            The pose of the foot.
        """
        flexed = f"{self.side}_hip_flexion"
        lowest = min(self.rest[flexed], ON_SEAT)
        turned = {flexed: max(self.rest[flexed] + hip, lowest), f"{self.side}_knee_flexion": knee}
        self._person.set_angles(turned)
        self.look()
        return self._person.joint_pose(f"{self.side}_ankle")

    def lift(self) -> None:
        """Teleport the leg to where it is held."""
        self.put(*LIFT[-1])

    def stand(self) -> None:
        """Teleport the leg to where it stands."""
        self._person.set_angles(self.rest)
        self.look()

    def foot_hold(self) -> Array:
        """Return the middle of the foot where it is grasped [m], shape [3]."""
        toes, ankle = self.points[:2]
        return np.asarray(ankle + FOOT_HOLD * (toes - ankle) / np.linalg.norm(toes - ankle))

    def slid(self) -> Array:
        """Return how far over the floor the foot stands from where it did [m], shape [2].

        One that trembles slides back on its plate. Zero below `SLID`.
        """
        way = (self.foot_hold() - self.stood)[:2]
        return way if np.linalg.norm(way) > SLID else np.zeros(2)

    def to_lifted(self) -> Array:
        """Return the way from the ankle to where it is when the leg is up [m], shape [3]."""
        return np.subtract(self.way[-1].position, self.points[1])


def fit_chair(chair: Wheelchair, person: Human, side: str) -> dict[str, Array]:
    """Fit seat and footplates to who is going to sit there, and hold the other leg aside.

    Who cannot bend a hip as far as the posture has it has that foot farther ahead, as on legrests that are
    raised: the shank leans as much as everybody's. Under a steeper one the plate, which rises ahead, jams
    the foot against the hip's limit, and does so for a millimetre: so it stays clear of the sole.

    Who is driven by muscles sits where no ligament of the hip is taut: that would press the foot on its plate
    harder than anybody lifts it.

    Args:
        chair: The chair, not spawned yet.
        person: Who will sit there.
        side: Of the leg that moves.

    Returns:
        Where the plates are, by side [m].
    """
    stiff, held = [], {f"{'left' if side == 'right' else 'right'}_hip_abduction": ASIDE_DEG}
    angles, limits = person.posture.angles_deg, person.avatar.profile.limits("passive")
    for foot in SIDES:
        hip, knee = (angles.get(f"{foot}_{d}", angles.get(d, 0.0)) for d in BENT)
        most = math.degrees(limits[f"{foot}_hip_flexion"][1])
        if person.actuation.kind == "muscle":
            most -= math.degrees(LIGAMENT_ZONE)
            held[f"{foot}_hip_flexion"] = min(hip, most)
        short = hip - most
        if short > STIFF_DEG:
            stiff.append(foot)
            held[f"{foot}_knee_flexion"] = knee - short
    person.posture = dataclasses.replace(person.posture, angles_deg={**angles, **held})
    sitting = seated(person.avatar, person.posture, chair.frame("seat_back"))
    up = rotate(chair.frame(f"footplate_{side}").quaternion, (0.0, 0.0, 1.0))
    plates = soles(*sitting, up)
    for foot in stiff:
        plates[foot] += (-BACK, 0.0, BACK * up[0] / up[2] - CLEAR)
    chair.fit_seat(calf_back(*sitting) - CALF)
    chair.fit_footplates(plates["left"], plates["right"])
    return plates


def let_leg_stand(world: World, person: Human, chair: Wheelchair, side: str) -> None:
    """Let a leg stand on its footplate and lie on the seat; the rest passes through the chair already.

    Args:
        world: Where they are.
        person: Who sits there.
        chair: The chair.
        side: Of the leg.
    """
    thigh, shank = (person.frames[JOINT_INDEX[f"{side}_{j}"]].link for j in ("hip", "knee"))
    below = person.body.carried_by(shank)
    world.set_collision(person.body, chair.body, True, links_a=below)
    # The thigh, which the armrest is not to touch, has a seat of its own inside the cushion.
    f, seat = chair.model.figure, chair.frame_in_world("seat")
    size = (f("seat_depth") - 0.01, f("seat_width") - 0.03, 0.5 * f("cushion"))
    level = Pose((0, 0, -0.5 * size[2] - 0.001))
    top = world.add_box(size, seat @ level, name="seat")
    near = world.nearest(person.body, top, within=CLEAR)
    deep = -min((c.distance for c in near if c.link_a == thigh), default=0.0)
    if deep > 0:  # it gives way, as a cushion does, to a hip that cannot
        top.set_base(seat @ Pose((0, 0, -deep - CLEAR)) @ level)
    others = [k for k in range(-1, person.body.link_count) if k not in (thigh, *below)]
    world.set_collision(person.body, top, False, links_a=others)
    for body in world.bodies:
        if body not in (person.body, top) and (body.joints or body.is_movable):
            world.set_collision(body, top, False)


def pierced(
    start: Array, end: Array, apex: Array, first: Array, second: Array
) -> tuple[npt.NDArray[np.int64], Array]:
    """Return the crossings of a segment and a fan of triangles: signs, and places from 0 to 1.

    Args:
        start: Of the segment [m], shape [3].
        end: Of the segment.
        apex: Of the fan.
        first: Second corner of each triangle, shape [n, 3].
        second: Third corner of each.
    """
    a, b = first - apex, second - apex
    normals = np.cross(a, b)
    fall = normals @ (end - start)
    steep = np.where(np.abs(fall) < 1e-15, 1e-15, fall)
    share = normals @ (apex - start) / steep
    hit = start + share[:, None] * (end - start) - apex
    area = np.einsum("na,na->n", normals, normals)
    u = np.einsum("na,na->n", np.cross(hit, b), normals) / np.maximum(area, 1e-18)
    v = np.einsum("na,na->n", np.cross(a, hit), normals) / np.maximum(area, 1e-18)
    # Half-open, so that what goes through an edge counts once.
    met = (share >= 0) & (share < 1) & (u >= 0) & (v > 0) & (u + v <= 1)
    return np.sign(fall[met]).astype(np.int64), share[met]
