"""The legs as parts that actions move: `walk` and `kneel`.

Legs and pelvis are a puppet's: they go where gait and kneeling have them, whatever touches them, and report
no velocity while they do. A step that has begun is finished; what is asked for when it begins decides where
it goes.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from rcare_marl.observable import Observable
from rcare_marl.pose import Array, Pose, matrix_from_quaternion, quaternion_from_matrix

from ..body.goal import Goal, Orientation, Position
from ..body.ik import WholeBodyIk
from ..body.skeleton import DOF_INDEX, JOINT_INDEX, SIDES, forward_kinematics
from .clip import Motion
from .gait import SIDE_STEP, STEP_LENGTH, STEP_TIME, STEP_TURN, Gait, Station, Step, sizes
from .trajectory import minimum_jerk

if TYPE_CHECKING:
    from ..human import Human

LEAST = 0.05  # share of the greatest speed below which nothing is asked for; our own choice
UPRIGHT = 0.02  # share of the way down to the floor below which one stands again; our own choice
# Of kneeling: one foot stays, the other leg goes back until its knee is on the floor, the pelvis between.
KNEEL_RATE, KNEEL_TIME = 30.0, 1.8  # frames a second; [s]
# Where the kneeling leg ends: thigh upright, toes tucked under.
KNEELING_DEG = {
    "hip_flexion": 0.0,
    "hip_abduction": 3.0,
    "hip_external_rotation": 0.0,
    "knee_flexion": 104.0,
    "ankle_dorsiflexion": 8.0,
    "foot_extension": 50.0,
}
# Where the search for the front leg begins: from straight, least squares would not know which way to bend.
BENT = {"hip_flexion": math.radians(80), "knee_flexion": math.radians(90)}
THIGH_BACK = 0.92  # of the front thigh's length that the pelvis goes back
WALK_NAMES = (
    f"walk forward [{STEP_LENGTH / STEP_TIME:.3g} m/s]",
    f"walk left [{SIDE_STEP / (2 * STEP_TIME):.3g} m/s]",
    f"turn left [{sum(STEP_TURN) / (2 * STEP_TIME):.3g} rad/s]",
)
KNEEL_NAMES = tuple(f"kneel on the {side} knee [{1 / KNEEL_TIME:.3g} 1/s]" for side in SIDES)


class Legs:
    """Moves legs and pelvis of a person who stands, as actions ask.

    Attributes:
        dofs: The DoFs of the legs, which nothing else moves.
        station: Where the person stands, or will when the step that has begun is done.
        next_side: The foot that takes the next step; empty where either may.
        kneeling: How far down on each knee the person is, 0 to 1, by side.
    """

    def __init__(self, person: Human, dt: float) -> None:
        """Take a spawned person in the posture of the start, and the length of a physics step [s].

        Raises:
            ConfigError: If the legs cannot move, or the person does not stand.
        """
        self._person, self._dt, self._gait = person, dt, Gait(person)
        parts = ("hip", "knee", "ankle", "foot")
        self.dofs = tuple(dof for dof in person.movable if dof.split("_")[1] in parts)
        self._columns = [DOF_INDEX[dof] for dof in self.dofs]
        self._places = [person.movable.index(dof) for dof in self.dofs]
        self._joints = person.body.indices(self.dofs)
        low, high = person.passive[self._places].T
        self._low, self._high = low, high
        self.reset()

    def reset(self) -> None:
        """Stand where the person is."""
        self.station = self._last = Station.below(self._person.pelvis)
        self.kneeling = dict.fromkeys(SIDES, 0.0)
        self._step: Step | None = None
        self._motion: Motion | None = None
        self._passed = 0  # physics steps of the motion
        self._walk, self._kneel = np.zeros(3), np.zeros(2)
        self.next_side = ""

    def command(self, walk: Array, kneel: Array) -> None:
        """Accept speeds as shares of the greatest, in [-1, 1].

        Args:
            walk: Forward, left, turning left.
            kneel: Down on each knee, left and right; below zero rises.

        Either may be empty: then nothing is asked for.
        """
        self._walk = walk.copy() if len(walk) else np.zeros(3)
        self._kneel = kneel.copy() if len(kneel) else np.zeros(2)

    @property
    def stands(self) -> bool:
        """Whether both feet stand side by side, and no knee is down."""
        return self._step is None and self.next_side == "" and not any(self.kneeling.values())

    def advance(self) -> None:
        """Put legs and pelvis where the coming physics step wants them."""
        if self._step is None and not any(self.kneeling.values()):
            self._begin()
        if self._step is not None:
            self._passed += 1
            assert self._motion is not None
            self._show(self._motion, self._passed * self._dt)
            if self._passed * self._dt >= STEP_TIME - 1e-9:
                self._step = None
        else:
            self._go_down()

    def _begin(self) -> None:
        """Begin a step, if one is asked for or the feet are apart."""
        wanted = bool(np.abs(self._walk).max() >= LEAST)
        if not wanted and not self.next_side:
            return
        if not self.next_side:  # from standing
            self.station = self._last = Station.below(self._person.pelvis)
            self._motion = None
            aside = self._walk[2] if abs(self._walk[2]) >= LEAST else self._walk[1]
            self.next_side = "right" if aside < 0 else "left"
        side, here, goal = self.next_side, self.station, self.station
        if wanted:
            greatest = sizes(side, self._walk.tolist())
            forward, left, turn = (self._walk * np.array(greatest)).tolist()
            goal = Station(*here.at(forward, left), here.heading + turn)
        self._step = Step(side, self._last, here, goal)
        start = self._gait.standing if self._motion is None else self._motion.angles[-1]
        height = self._person.pelvis.position[2]
        self._motion, self._passed = self._gait.plan(self._step, start, height), 0
        self._last, self.station = here, goal
        self.next_side = "" if self._step.ends else SIDES[1 - SIDES.index(side)]

    def _go_down(self) -> None:
        """Go further down on a knee, or up."""
        down = [side for side in SIDES if self.kneeling[side] > 0]
        chosen = int(np.argmax(self._kneel)) if not down else SIDES.index(down[0])
        side, rate = SIDES[chosen], float(self._kneel[chosen])
        before = self.kneeling[side]
        share = min(max(before + rate * self._dt / KNEEL_TIME, 0.0), 1.0)
        if abs(rate) < LEAST or share == before:
            return
        if not before:
            self._motion = plan_kneel(self._person, side, self._gait.standing)
        elif rate < 0 and share < UPRIGHT:
            share = 0.0
        self.kneeling[side] = share
        assert self._motion is not None
        self._show(self._motion, share * KNEEL_TIME)

    def _show(self, motion: Motion, time: float) -> None:
        angles, pelvis = motion.at(time)
        person = self._person
        person.place(pelvis)
        chosen = np.clip(angles[self._columns], self._low, self._high)
        person.body.set_joints(self._joints, chosen)
        person.drive.target[self._places] = chosen

    def observables(self, moves: Sequence[str]) -> list[Observable]:
        """Return what the person senses of it."""
        person = self._person
        out = [Observable("pelvis_position", "m", 3, lambda: person.pelvis.position)]
        if "walk" in moves:
            out.append(Observable("heading", "1", 2, self._heading))
            out.append(Observable("step", "1", 2, self._phase))
        if "kneel" in moves:
            out.append(Observable("kneeling", "1", 2, lambda: tuple(self.kneeling.values())))
        return out

    def _heading(self) -> tuple[float, float]:
        """Return cosine and sine of where the pelvis faces, from the x axis."""
        heading = Station.below(self._person.pelvis).heading
        return math.cos(heading), math.sin(heading)

    def _phase(self) -> tuple[float, float]:
        """Return the share of a step that is done, and the side of the foot that steps: 1 is left."""
        if self._step is None:
            return 0.0, {"": 0.0, "left": 1.0, "right": -1.0}[self.next_side]
        sign = 1.0 if self._step.side == "left" else -1.0
        return self._passed * self._dt / STEP_TIME, sign


def plan_kneel(person: Human, knee: str, standing: Array) -> Motion:
    """Return how a person goes down on one knee, from where they stand: legs and pelvis.

    Args:
        person: Who kneels, spawned.
        knee: The side whose knee goes to the floor.
        standing: The posture in which the person stands [rad], shape [112].
    """
    front = SIDES[1 - SIDES.index(knee)]
    legs = [
        dof
        for dof in person.movable
        if dof.startswith(front) and dof.split("_")[1] in ("hip", "knee", "ankle")
    ]
    ik = WholeBodyIk.of(person, kind="passive", movable=legs)
    start = person.pelvis
    kneeling, end = _end(person, knee, standing)
    base = start.matrix()
    rotations, positions = forward_kinematics(person.model.joints, standing)
    ankle = JOINT_INDEX[f"{front}_ankle"]
    place = base[:3, :3] @ positions[ankle] + base[:3, 3]
    foot = quaternion_from_matrix(base[:3, :3] @ rotations[ankle])
    goals: list[Goal] = [Position(f"{front}_ankle", place), Orientation(f"{front}_ankle", foot)]
    count = math.ceil(KNEEL_TIME * KNEEL_RATE) + 1
    angles, places, now = [standing], [np.array(start.position)], standing
    for share in (minimum_jerk(k / (count - 1)) for k in range(1, count)):
        pelvis = (1 - share) * np.array(start.position) + share * end
        now = now.copy()
        for name in KNEELING_DEG:
            i = DOF_INDEX[f"{knee}_{name}"]
            now[i] = (1 - share) * standing[i] + share * kneeling[i]
        for name, angle in BENT.items():
            now[DOF_INDEX[f"{front}_{name}"]] = share * angle
        pose = Pose(tuple(pelvis.tolist()), start.quaternion)
        now = ik.solve(goals, now, pose, rest=now, fallback=False).angles
        angles.append(now)
        places.append(pelvis)
    return Motion(
        rate=(count - 1) / KNEEL_TIME,
        angles=np.array(angles),
        pelvis=np.array(places),
        quaternions=np.tile(start.quaternion, (count, 1)),
    )


def _end(person: Human, knee: str, standing: Array) -> tuple[Array, Array]:
    """Return the angles of the kneeling leg [rad] and where the pelvis ends [m]."""
    angles, joints, start = standing.copy(), person.model.joints, person.pelvis
    limits = person.avatar.profile.limits("passive")
    for name, degrees in KNEELING_DEG.items():
        dof = f"{knee}_{name}"
        if dof in person.movable:
            angles[DOF_INDEX[dof]] = np.clip(math.radians(degrees), *limits[dof])
    turn = matrix_from_quaternion(start.quaternion)
    rotations, positions = forward_kinematics(joints, standing)
    surface = person.model.posed(rotations, positions)
    floor = start.position[2] + float((surface @ turn.T)[:, 2].min())
    hip, bent = (JOINT_INDEX[f"{knee}_{part}"] for part in ("hip", "knee"))
    _, positions = forward_kinematics(joints, angles)
    radius = person.segments[f"{knee}_knee"].shapes[0].size[1]
    ahead = turn[:, 2] * (1.0, 1.0, 0.0)  # where the person looks
    end = np.array(start.position) - THIGH_BACK * np.linalg.norm(joints[bent] - joints[hip]) * ahead
    end[2] = floor + radius - (turn @ positions[bent])[2]
    return angles, end
