"""A walk over the floor: footsteps along a path, and the legs that take them.

A synthetic gait of our own, not a recorded one: it plans where feet go, moves the pelvis smoothly between
them, and finds the legs by inverse kinematics, so a foot that stands does not slide. Its figures are our
own choices, near an unhurried walk.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from rcare_marl.errors import ConfigError
from rcare_marl.pose import (
    Pose,
    matrix_from_quaternion,
    quaternion_from_axis_angle,
    quaternion_from_matrix,
)

from ..body.goal import Goal, Orientation, Position
from ..body.ik import WholeBodyIk, present_angles
from ..body.skeleton import DOF_INDEX, JOINT_INDEX, SIDES, forward_kinematics
from ..human import Human
from .clip import Motion, heading_of, leg_length
from .trajectory import minimum_jerk

Array = npt.NDArray[np.float64]

RATE = 60.0  # frames a second
STEP_LENGTH, STEP_TURN, STEP_TIME = 0.45, math.radians(30), 0.6  # [m], [rad], [s] of one step
SWING = (0.12, 0.88)  # share of a step in which the foot is in the air
LIFT = 0.06  # [m] that a foot is lifted
HEEL_RISE = math.radians(30)  # of a foot that has been left behind
HEEL_UP = 0.35  # share of the other foot's step in which the heel begins to rise
HEEL_DOWN = 1.0  # share of its own swing in which it is level again
ANKLE_SPARE, _EASING = (
    math.radians(2),
    6,
)  # of the ankle's range; rounds that find the tip of a foot
STRAIGHT = 0.98  # of the leg's length: a knee is never locked
ARM_SWING = math.radians(14)  # of a shoulder at a full step, each way; the elbow bends half as much
SMOOTHED = 0.08  # [s] each way over which the height of the pelvis is smoothed
UPRIGHT_WITHIN = math.radians(25)  # of the trunk, for somebody who can begin to walk
# What must be movable.
NEEDED = tuple(
    f"{side}_{dof}"
    for side in SIDES
    for dof in (
        "hip_flexion", "hip_abduction", "hip_external_rotation", "knee_flexion",
        "ankle_dorsiflexion",
    )
)  # fmt: skip
LEGS = tuple(f"{side}_{joint}" for side in SIDES for joint in ("hip", "ankle")) + tuple(
    f"{side}_{dof}" for side in SIDES for dof in ("knee_flexion", "foot_extension")
)


@dataclass(frozen=True)
class Station:
    """A place to stand: position on the floor [m] and heading from the x axis [rad]."""

    x: float
    y: float
    heading: float

    def at(self, forward: float, left: float) -> tuple[float, float]:
        """Return the point so far ahead and to the left [m]."""
        c, s = math.cos(self.heading), math.sin(self.heading)
        return self.x + c * forward - s * left, self.y + s * forward + c * left


def stations(
    start: Station, points: Sequence[tuple[float, float]], heading: float
) -> list[Station]:
    """Return where a walker stands after each step: turning on the spot, walking, turning.

    Args:
        start: Where the walk begins.
        points: Corners of the path on the floor, the last one its end [m].
        heading: At the end [rad].
    """
    out = [start]

    def turn_to(goal: float) -> None:
        here = out[-1]
        change = math.remainder(goal - here.heading, 2 * math.pi)
        count = math.ceil(abs(change) / STEP_TURN - 1e-9)
        for k in range(1, count + 1):
            out.append(Station(here.x, here.y, here.heading + change * k / count))

    for x, y in points:
        here = out[-1]
        distance = math.hypot(x - here.x, y - here.y)
        if distance > 0.5 * STEP_LENGTH:  # shorter ways need no turn: a step aside does
            turn_to(math.atan2(y - here.y, x - here.x))
            here = out[-1]
        count = math.ceil(distance / STEP_LENGTH - 1e-9)
        for k in range(1, count + 1):
            share = k / count
            out.append(
                Station(here.x + share * (x - here.x), here.y + share * (y - here.y), here.heading)
            )
    turn_to(heading)
    return out


@dataclass(frozen=True)
class _Foot:
    """How a foot stands below the pelvis: forward, left and up of the ankle [m], its turn."""

    forward: float
    left: float
    height: float
    rotation: Array  # of the ankle, against the heading


class Walk:
    """The plan of a walk from where a person stands.

    Attributes:
        stations: Where the person stands after each step, the first at the start.
        motion: The walk: all DoFs and the pelvis over time.
    """

    def __init__(
        self,
        person: Human,
        points: Sequence[tuple[float, float]],
        heading: float,
        *,
        step_time: float = STEP_TIME,
        swings_arms: bool = True,
    ) -> None:
        """Plan the walk of a spawned person who stands.

        Args:
            person: Who walks; the DoFs in `NEEDED` must be movable.
            points: Corners of the path on the floor, the last one its end [m]. Nothing looks for
                obstacles.
            heading: Where the person faces at the end, from the x axis [rad].
            step_time: Time for one step [s].
            swings_arms: Whether the arms swing; not while they carry something.

        Raises:
            ConfigError: If the legs cannot move, the person does not stand, or numbers are not
                finite.
        """
        numbers = [heading, step_time, *(value for point in points for value in point)]
        if not points or not np.isfinite(numbers).all() or step_time <= 0:
            raise ConfigError(
                f"a walk needs points [m], a heading [rad] and a positive step time [s], all finite; "
                f"got {list(points)}, {heading}, {step_time}"
            )
        missing = [dof for dof in NEEDED if dof not in person.movable]
        if missing:
            raise ConfigError(
                f"to walk, {person.name!r} needs {', '.join(missing)} among the movable DoFs"
            )
        self._person, self._step_time, self._swings = person, step_time, swings_arms
        self._angles = present_angles(person)
        self._pelvis = person.body.base_pose()
        self._joints = person.model.joints
        self._leg = leg_length(self._joints)
        self._check_upright()
        self._feet = {side: self._foot(side) for side in SIDES}
        x, y, _ = self._pelvis.position
        self.stations = stations(Station(x, y, heading_of(self._pelvis)), points, heading)
        self._plan()
        self.motion = self._solve()

    def _check_upright(self) -> None:
        up = matrix_from_quaternion(self._pelvis.quaternion)[2, 1]
        _, positions = forward_kinematics(self._joints, self._angles)
        drops = [
            positions[JOINT_INDEX[f"{s}_hip"], 1] - positions[JOINT_INDEX[f"{s}_ankle"], 1]
            for s in SIDES
        ]
        if up < math.cos(UPRIGHT_WITHIN) or min(drops) < 0.8 * self._leg:
            raise ConfigError(f"{self._person.name!r} does not stand, so cannot walk")

    def _foot(self, side: str) -> _Foot:
        rotations, positions = forward_kinematics(self._joints, self._angles)
        base = self._pelvis.matrix()
        j = JOINT_INDEX[f"{side}_ankle"]
        place = base[:3, :3] @ positions[j] + base[:3, 3]
        turn = _yaw(-heading_of(self._pelvis))
        offset = turn @ (place - base[:3, 3])
        return _Foot(offset[0], offset[1], place[2], turn @ base[:3, :3] @ rotations[j])

    def _plan(self) -> None:
        """Say which foot goes to which station in which step."""
        ways = self.stations
        first = "left"
        if len(ways) > 1:  # the foot on the side that the way bends to goes first
            turn = ways[1].heading - ways[0].heading
            aside = ways[0].heading
            dx, dy = ways[1].x - ways[0].x, ways[1].y - ways[0].y
            left = -math.sin(aside) * dx + math.cos(aside) * dy
            first = "right" if turn < -1e-6 or left < -1e-3 else "left"
        order = [first, "right" if first == "left" else "left"]
        self._steps: list[tuple[str, Station, Station]] = []  # foot, from, to
        at = {side: ways[0] for side in SIDES}
        for k, goal in enumerate([*ways[1:], ways[-1]] if len(ways) > 1 else []):
            side = order[k % 2]
            self._steps.append((side, at[side], goal))
            at[side] = goal

    @property
    def duration(self) -> float:
        """How long the walk takes [s]."""
        return len(self._steps) * self._step_time

    def stance(self, side: str, time: float) -> bool:
        """Return whether a foot stands on the floor at a time [s]."""
        k, share = self._step_at(time)
        return k >= len(self._steps) or self._steps[k][0] != side or not SWING[0] < share < SWING[1]

    def _step_at(self, time: float) -> tuple[int, float]:
        k = int(min(max(time / self._step_time, 0.0), max(len(self._steps) - 1e-9, 0.0)))
        return k, min(time / self._step_time - k, 1.0)

    def _ankle(self, side: str, time: float) -> tuple[Array, Array, float]:
        """Return place [m], rotation and heel rise [rad] of an ankle at a time [s]."""
        k, share = self._step_at(time)
        foot, here = self._feet[side], self.stations[0]
        for n, (moved, _, goal) in enumerate(self._steps):
            if n < k and moved == side:
                here = goal
        heading, spot, lift, rise = here.heading, here.at(foot.forward, foot.left), 0.0, 0.0
        way = 0.0  # [m] of this foot's coming or present step: short ones raise no heel
        if k < len(self._steps):
            moved, start, goal = self._steps[k]
            if moved == side:
                a, b = start.at(foot.forward, foot.left), goal.at(foot.forward, foot.left)
                passed = (share - SWING[0]) / (SWING[1] - SWING[0])
                gone = minimum_jerk(passed)
                spot = (a[0] + gone * (b[0] - a[0]), a[1] + gone * (b[1] - a[1]))
                heading = start.heading + gone * (goal.heading - start.heading)
                lift = LIFT * math.sin(math.pi * min(max(passed, 0.0), 1.0)) ** 2
                way = math.dist(a, b)
                rise = 1 - minimum_jerk(passed / HEEL_DOWN)
                early = (
                    1 - HEEL_UP if k else 0.0
                )  # nothing has been left behind before the first step
                rise *= minimum_jerk((share + early) / (early + SWING[0]))
            elif k + 1 < len(self._steps):  # the other foot swings; this one is left behind
                _, start, goal = self._steps[k + 1]
                way = math.hypot(goal.x - start.x, goal.y - start.y)
                rise = minimum_jerk((share - HEEL_UP) / (1 - HEEL_UP + SWING[0]))
        rise *= HEEL_RISE * min(way / (2 * STEP_LENGTH), 1.0)
        rotation = _yaw(heading) @ foot.rotation
        ball = (
            self._joints[JOINT_INDEX[f"{side}_foot"]] - self._joints[JOINT_INDEX[f"{side}_ankle"]]
        )
        place = np.array((*spot, foot.height + lift))
        tipped = rotation @ _about_left(rise)  # about the ball of the foot, which stays
        return place + rotation @ ball - tipped @ ball, tipped, rise

    def _eased(
        self, side: str, hip: Array, place: Array, rotation: Array, rise: float
    ) -> tuple[Array, Array, float]:
        """Tip a foot further onto its ball where its ankle would have to bend beyond its range.

        Thigh and shank count as equally long: the shank then leans by half the knee's flexion.
        """
        names = [f"{side}_{part}" for part in ("ankle", "foot")]
        ankle, toes = (self._joints[JOINT_INDEX[name]] for name in names)
        index = self._person.movable.index(f"{side}_ankle_dorsiflexion")
        most = float(self._person.passive[index, 1]) - ANKLE_SPARE
        for _ in range(_EASING):
            way = rotation.T @ (hip - place)
            bent = math.acos(min(float(np.linalg.norm(way)) / self._leg, 1.0))
            excess = math.atan2(way[2], way[1]) + bent - most
            if excess <= 0:
                break
            tipped = rotation @ _about_left(excess)
            place = place + rotation @ (toes - ankle) - tipped @ (toes - ankle)
            rotation, rise = tipped, rise + excess
        return place, rotation, rise

    def _ground(self, time: float) -> Station:
        """Return the pelvis over the floor: a quadratic B-spline over the stations."""
        if not self._steps:
            return self.stations[0]
        k, u = self._step_at(time)
        ways = [self.stations[0], *self.stations, self.stations[-1]]
        a, b, c = 0.5 * (1 - u) ** 2, 0.5 * (1 + 2 * u - 2 * u * u), 0.5 * u * u
        p, q, r = ways[k], ways[k + 1], ways[min(k + 2, len(ways) - 1)]
        return Station(
            a * p.x + b * q.x + c * r.x,
            a * p.y + b * q.y + c * r.y,
            a * p.heading + b * q.heading + c * r.heading,
        )

    def _heights(self, times: Array) -> Array:
        """Return the height of the pelvis [m]: as high as the legs reach, smoothed."""
        _, positions = forward_kinematics(self._joints, self._angles)
        level = _yaw(-heading_of(self._pelvis)) @ matrix_from_quaternion(self._pelvis.quaternion)
        standing = self._pelvis.position[2]
        out = np.full(len(times), standing)
        for i, time in enumerate(times):
            ground = self._ground(time)
            for side in SIDES:
                hip = _yaw(ground.heading) @ level @ positions[JOINT_INDEX[f"{side}_hip"]]
                place, _, _ = self._ankle(side, time)
                gap = math.hypot(place[0] - ground.x - hip[0], place[1] - ground.y - hip[1])
                reach = math.sqrt(max((STRAIGHT * self._leg) ** 2 - gap * gap, 0.0))
                out[i] = min(out[i], place[2] + reach - hip[2])
        width = max(round(SMOOTHED * RATE), 1)
        padded = np.pad(out, 2 * width, mode="edge")
        lows = np.lib.stride_tricks.sliding_window_view(padded, 2 * width + 1).min(axis=1)
        smooth = np.lib.stride_tricks.sliding_window_view(lows, 2 * width + 1).mean(axis=1)
        # Begin and end as tall as the person stands.
        ramp = np.minimum(times, times[-1] - times) / (0.5 * self._step_time)
        share = np.array([minimum_jerk(value) for value in ramp])
        return np.asarray(np.minimum(standing + share * (smooth - standing), standing))

    def _solve(self) -> Motion:
        """Find the posture of every frame."""
        person = self._person
        count = max(math.ceil(self.duration * RATE), 1) + 1
        times = np.linspace(0.0, max(self.duration, 1 / RATE), count)
        heights = self._heights(times)
        legs = [dof for dof in person.movable if dof.split("_")[1] in ("hip", "knee", "ankle")]
        ik = WholeBodyIk.of(person, kind="passive", movable=legs)
        turn = matrix_from_quaternion(self._pelvis.quaternion)
        heading = heading_of(self._pelvis)
        hips = {side: self._joints[JOINT_INDEX[f"{side}_hip"]] - self._joints[0] for side in SIDES}
        angles, poses, now = [], [], self._angles
        for time, height in zip(times, heights, strict=True):
            ground = self._ground(time)
            rotation = _yaw(ground.heading - heading) @ turn
            pelvis = Pose(
                (ground.x, ground.y, float(height)),
                tuple(quaternion_from_matrix(rotation).tolist()),
            )
            goals: list[Goal] = []
            rises = {}
            for side in SIDES:
                hip = rotation @ hips[side] + pelvis.position
                place, foot, rises[side] = self._eased(side, hip, *self._ankle(side, time))
                goals.append(Position(f"{side}_ankle", place))
                goals.append(Orientation(f"{side}_ankle", quaternion_from_matrix(foot)))
            found = ik.solve(goals, now, pelvis, rest=self._angles, fallback=False)
            now = found.angles
            angles.append(self._with_arms(now, rises, time))
            poses.append(pelvis)
        return Motion(
            rate=(count - 1) / float(times[-1]),
            angles=np.array(angles),
            pelvis=np.array([pose.position for pose in poses]),
            quaternions=np.array([pose.quaternion for pose in poses]),
        )

    def _with_arms(self, angles: Array, rises: dict[str, float], time: float) -> Array:
        """Return a posture with bent toes, and arms that swing against the legs."""
        out = angles.copy()
        for side in SIDES:
            out[DOF_INDEX[f"{side}_foot_extension"]] += rises[side]
        if not self._swings:
            return out
        ground = self._ground(time)
        for side, other in zip(SIDES, SIDES[::-1], strict=True):
            place, _, _ = self._ankle(other, time)
            c, s = math.cos(ground.heading), math.sin(ground.heading)
            ahead = (
                c * (place[0] - ground.x) + s * (place[1] - ground.y) - self._feet[other].forward
            )
            share = max(-1.0, min(ahead / STEP_LENGTH, 1.0))
            out[DOF_INDEX[f"{side}_shoulder_flexion"]] += ARM_SWING * share
            out[DOF_INDEX[f"{side}_elbow_flexion"]] += 0.5 * ARM_SWING * max(share, 0.0)
        return out


def _yaw(angle: float) -> Array:
    return matrix_from_quaternion(quaternion_from_axis_angle((0, 0, 1), angle))


def _about_left(angle: float) -> Array:
    """Return the turn of a foot that raises its heel: about its x axis, which points left."""
    return matrix_from_quaternion(quaternion_from_axis_angle((1, 0, 0), angle))
