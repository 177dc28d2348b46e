"""A hand, as a headset would tell of it, that lifts the leg in dressing; the robot plays its script.

The law looks at what the page is told. Usage:

    python experiments/hand_lifts_leg.py 5100 5101
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Mapping
from typing import Any

import numpy as np

from rcare_marl.baselines.teleoperation.stage import Scenario, Stage, parse
from rcare_marl.pose import Array

# All our own choices, tuned on seeds 0 to 3.
STAND, STOP, SHARE, STILL = 0.57, 0.12, 0.35, 12  # [m] from the ankle, [m], of the walk, steps
TURN, TURNED = 0.08, 1.3  # of the fingers, from hanging to ahead [rad] a step and in all
FAST, SLOW, RAISE, LEAD = 0.035, 0.02, 0.015, 0.2  # [m] a step, and before the palm
AHEAD, FLAT = 0.04, 0.4  # [m] that the foot is short of, before it is raised; how steep until then


class Lift:
    """The law, of an episode."""

    def __init__(self) -> None:
        self._phase, self._still, self._turn = "walk", 0, 0.0
        self._at: Array = np.zeros(3)
        self._stand: float | None = None

    def __call__(self, told: Mapping[str, Any]) -> dict[str, Any]:
        """Return what a headset would say to a scene."""
        seen, palm = told["seen"], np.array(told["body"]["palms"]["left"])
        ankle, walk, kneel = np.array(seen["ankle_position"]), 0.0, 0
        if self._stand is None:
            self._stand = float(ankle[0]) + STAND
        foot = ankle + (0.07, 0.0, 0.0)
        if self._phase in ("walk", "kneel"):
            self._at = palm
        if self._phase == "walk":
            is_there = told["body"]["pelvis"][0] - self._stand <= STOP
            walk, self._still = 0.0 if is_there else SHARE, self._still + is_there
            self._phase = "kneel" if self._still > STILL else "walk"
        elif self._phase == "kneel":
            kneel = 1
            self._phase = "before" if seen["kneeling"][0] > 0.999 else "kneel"
        if self._phase == "before":
            self._phase = self._go(palm, foot + (0.12, -0.195, 0.05), FAST, 0.12, "grip")
        if self._phase == "grip":
            self._phase = self._go(palm, foot + (0.0, -0.065, 0.0), SLOW, 0.05, "take")
        if self._phase == "take" and seen["left_hand_holds"][0]:
            self._phase, self._at = "lift", palm
        if self._phase == "lift":
            self._raise(palm, np.array(seen["foot_to_lifted"]))
        if self._phase not in ("walk", "kneel"):
            self._turn = min(self._turn + TURN, TURNED)
        turn = [0.0, float(np.sin(self._turn / 2)), 0.0, float(np.cos(self._turn / 2))]
        grasp = float(self._phase in ("take", "lift"))
        hand = {"place": [*self._at.tolist(), *turn], "clutch": True, "grasp": grasp}
        return {
            "type": "tracked",
            "seen": told["number"],
            "head": None,
            "left": hand,
            "right": None,
            "walk": [walk, 0, 0],
            "kneel": [kneel, 0],
        }

    def _go(self, palm: Array, goal: Array, step: float, near: float, then: str) -> str:
        way = goal - self._at
        self._at = self._at + way * min(1.0, step / max(float(np.linalg.norm(way)), 1e-9))
        return then if np.linalg.norm(palm - goal) < near else self._phase

    def _raise(self, palm: Array, left: Array) -> None:
        """Draw the foot out, then up."""
        far = float(np.linalg.norm(left))
        way = left * (1.0, 1.0, FLAT) if np.linalg.norm(left[:2]) > AHEAD else left
        step = way / max(float(np.linalg.norm(way)), 1e-9) * min(RAISE, 0.1 * far)
        if far > 0.03 and np.linalg.norm(self._at + step - palm) < LEAD:
            self._at = self._at + step


def main() -> None:
    """Read the command line and say what came of each seed."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("seeds", type=int, nargs="+")
    done = []
    for seed in parser.parse_args().seeds:
        stage, law = Stage(Scenario("dressing", ["caregiver"], seed=seed)), Lift()
        while not stage.is_over:
            told = stage.seen("caregiver")
            stage.step({"caregiver": parse(json.dumps(law(told)))})  # type: ignore[dict-item]
        done.append(stage.seen("caregiver")["success"])
        print(stage.outcome(), flush=True)
        stage.close()
    print(f"{sum(done)} of {len(done)} dressed")


if __name__ == "__main__":
    main()
