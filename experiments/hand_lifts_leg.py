"""A hand, as a headset would tell of it, that lifts the leg in dressing; the robot plays its script.

The law looks at what the page is told, and goes by the simulation's clock. Usage:

    python experiments/hand_lifts_leg.py 7100 7101
    python experiments/hand_lifts_leg.py 7100 --late 2 --tremor 0.005
    python experiments/hand_lifts_leg.py --answer      # one answer a line for each line that a page is told
"""

from __future__ import annotations

import argparse
import json
import sys
from collections import deque
from collections.abc import Mapping
from typing import Any

import numpy as np

from rcare_marl.baselines.teleoperation.stage import Scenario, Stage, parse
from rcare_marl.pose import Array, quaternion_from_matrix

# All our own choices, tuned on seeds 0 to 3; PULL, MOST_PULLED and PATIENCE tried on seed 0 alone.
STAND, STOP, SHARE, STILL = 0.57, 0.12, 0.35, 1.2  # [m] from the ankle, [m], of the walk, [s]
TURN, TURNED = 0.8, 1.3  # of the fingers, from hanging to ahead [rad/s] and in all
FAST, SLOW, RAISE, LEAD = 0.35, 0.2, 0.15, 0.2  # [m/s], and [m] before the palm
PULL, MOST_PULLED = 0.8, 0.12  # how the hand makes up for where the palm stays behind [1/s], [m]
AHEAD, FLAT = 0.04, 0.4  # [m] that the foot is short of, before it is raised; how steep until then
PATIENCE = 4.0  # with a way or a grasp that does not come about, before it begins anew [s]


class Lift:
    """The law, of an episode."""

    def __init__(self) -> None:
        self._phase, self._since, self._turn, self._time = "walk", 0.0, 0.0, 0.0
        self._at: Array = np.zeros(3)
        self._pulled: Array = np.zeros(3)
        self._stand: float | None = None
        self._head: list[float] | None = None

    def __call__(self, told: Mapping[str, Any]) -> dict[str, Any]:
        """Return what a headset would say to a scene."""
        seen, palm = told["seen"], np.array(told["body"]["palms"]["left"])
        ankle, walk, kneel = np.array(seen["ankle_position"]), 0.0, 0
        dt, self._time = told["time"] - self._time, told["time"]
        if self._stand is None:
            self._stand = float(ankle[0]) + STAND
            self._head = _looking(told["body"]["eyes"], told["body"]["ahead"])
        foot = ankle + (0.07, 0.0, 0.0)
        if self._phase == "walk":
            is_there = told["body"]["pelvis"][0] - self._stand <= STOP
            walk = 0.0 if is_there else SHARE
            self._since = self._since if is_there else self._time
            if self._time - self._since > STILL:
                self._begin("kneel")
        elif self._phase == "kneel":
            kneel = 1
            if seen["kneeling"][0] > 0.999:
                self._begin("before")
        if self._phase in ("walk", "kneel"):
            self._at = palm
        else:
            self._turn = min(self._turn + TURN * dt, TURNED)
        if self._phase == "before":
            self._go(palm, foot + (0.12, -0.195, 0.05), FAST * dt, 0.12 + dt, "grip")
        elif self._phase == "grip":
            self._go(palm, foot + (0.0, -0.065, 0.0), SLOW * dt, 0.05, "take")
        elif self._phase == "take" and seen["left_hand_holds"][0]:
            self._begin("lift")
            self._at = palm
        elif self._phase == "lift" and not seen["left_hand_holds"][0]:
            self._begin("before")
        if self._phase == "lift":
            self._raise(palm, np.array(seen["foot_to_lifted"]), dt)
        elif self._phase in ("grip", "take") and self._time - self._since > PATIENCE:
            self._begin("before")
        turn = [0.0, float(np.sin(self._turn / 2)), 0.0, float(np.cos(self._turn / 2))]
        grasp = float(self._phase in ("take", "lift"))
        hand = {"place": [*self._at.tolist(), *turn], "clutch": True, "grasp": grasp}
        return {
            "type": "tracked",
            "seen": told["number"],
            "head": self._head,
            "left": hand,
            "right": None,
            "walk": [walk, 0, 0],
            "kneel": [kneel, 0],
        }

    def _begin(self, phase: str) -> None:
        self._phase, self._since = phase, self._time
        if phase == "before":
            self._pulled = np.zeros(3)

    def _go(self, palm: Array, goal: Array, step: float, near: float, then: str) -> None:
        """Lead the palm to a goal: where it stays behind, farther that way."""
        off = goal - palm
        self._pulled = _short(self._pulled + PULL * step / SLOW * off, MOST_PULLED)
        self._at = self._at + _short(goal + self._pulled - self._at, step)
        if np.linalg.norm(off) < near:
            self._begin(then)

    def _raise(self, palm: Array, left: Array, dt: float) -> None:
        """Draw the foot out, then up."""
        far = float(np.linalg.norm(left))
        way = left * (1.0, 1.0, FLAT) if np.linalg.norm(left[:2]) > AHEAD else left
        step = way / max(float(np.linalg.norm(way)), 1e-9) * min(RAISE, far) * dt
        if far > 0.03 and np.linalg.norm(self._at + step - palm) < LEAD:
            self._at = self._at + step


def _short(way: Array, most: float) -> Array:
    """Return a way, no longer than `most` [m]."""
    return np.asarray(way * min(1.0, most / max(float(np.linalg.norm(way)), 1e-9)))


def _looking(eyes: Any, ahead: Any) -> list[float]:
    """Return the pose of a head that looks level, as WebXR's viewer: x right, y up."""
    face = np.array([ahead[0], ahead[1], 0.0]) / np.hypot(ahead[0], ahead[1])
    up = np.array([0.0, 0.0, 1.0])
    turn = quaternion_from_matrix(np.stack([np.cross(face, up), up, -face], axis=1))
    return [*map(float, eyes), *map(float, turn)]


def lift(seed: int, late: int, tremor: float) -> tuple[bool, str]:
    """Play an episode without a browser, and return whether the leg was dressed, and what came of it."""
    rng = np.random.default_rng([seed, 26])
    stage, law = Stage(Scenario("dressing", ["caregiver"], seed=seed)), Lift()
    said: deque[dict[str, Any]] = deque(maxlen=late + 1)
    while not stage.is_over:
        now = law(stage.seen("caregiver"))
        place = np.array(now["left"]["place"])
        place[:3] += tremor * rng.standard_normal(3)
        said.append({**now, "left": {**now["left"], "place": place.tolist()}})
        stage.step({"caregiver": parse(json.dumps(said[0]))})  # type: ignore[dict-item]
    done, outcome = stage.seen("caregiver")["success"], stage.outcome()
    stage.close()
    return done, outcome


def main() -> None:
    """Read the command line and say what came of each seed."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("seeds", type=int, nargs="*")
    parser.add_argument("--late", type=int, default=0, help="control steps until the hand follows")
    parser.add_argument("--tremor", type=float, default=0.0, help="of the hand, deviation [m]")
    parser.add_argument("--answer", action="store_true", help="to standard input, line by line")
    given = parser.parse_args()
    if given.answer:
        law = Lift()
        for line in sys.stdin:
            print(json.dumps(law(json.loads(line))), flush=True)
        return
    done = []
    for seed in given.seeds:
        success, outcome = lift(seed, given.late, given.tremor)
        done.append(success)
        print(outcome, flush=True)
    print(f"{sum(done)} of {len(done)} dressed")


if __name__ == "__main__":
    main()
