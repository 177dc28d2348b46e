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
from rcare_marl.pose import Array

from ..body.skeleton import DOF_INDEX, SIDES
from .clip import Motion
from .gait import SIDE_STEP, STEP_LENGTH, STEP_TIME, STEP_TURN, Gait, Station, Step, sizes
from .kneel import DURATION, plan_kneel

if TYPE_CHECKING:
    from ..human import Human

LEAST = 0.05  # share of the greatest speed below which nothing is asked for; our own choice
UPRIGHT = 0.02  # share of the way down to the floor below which one stands again; our own choice
WALK_NAMES = (
    f"walk forward [{STEP_LENGTH / STEP_TIME:.3g} m/s]",
    f"walk left [{SIDE_STEP / (2 * STEP_TIME):.3g} m/s]",
    f"turn left [{sum(STEP_TURN) / (2 * STEP_TIME):.3g} rad/s]",
)
KNEEL_NAMES = tuple(f"kneel on the {side} knee [{1 / DURATION:.3g} 1/s]" for side in SIDES)


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
        share = min(max(before + rate * self._dt / DURATION, 0.0), 1.0)
        if abs(rate) < LEAST or share == before:
            return
        if not before:
            self._motion = plan_kneel(self._person, side, self._gait.standing)
        elif rate < 0 and share < UPRIGHT:
            share = 0.0
        self.kneeling[side] = share
        assert self._motion is not None
        self._show(self._motion, share * DURATION)

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
