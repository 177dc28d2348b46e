"""An infusion bag that hangs in the straight way of a tool: what a robot has to go round."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from rcare_marl.body import Body
from rcare_marl.pose import Array, Pose, Vector
from rcare_marl.world import World

from ..state import Seen
from ..task_options import TaskOptions

# All our own choices.
BAG = (0.06, 0.06, 0.16)  # [m] it is that large
HOSE = (0.012, 0.012, 0.8)  # [m] above it
SIDEWAYS, LOW = 0.34, 0.06  # [m] from where a tool starts otherwise: to the side and below
PLACES = (0.3, 0.45)  # share of the straight way from the start at which it hangs, uniform
PARKED = (0.0, 0.0, -40.0)  # [m] between episodes


@dataclass(frozen=True)
class ObstacleOptions(TaskOptions):
    """What stands in the way.

    Attributes:
        obstacle: `bag`: the tool starts at its side, and an infusion bag hangs in the straight way.
    """

    obstacle: Literal["none", "bag"] = "none"


class HangingBag:
    """The bag, if a task has one; it hangs still.

    Attributes:
        bodies: Bag and hose; none without an obstacle.
        aside: How far to the side and below a tool starts [m], shape [3].
    """

    def __init__(
        self, world: World, options: ObstacleOptions, side: Literal["left", "right"]
    ) -> None:
        """Put it into a world, out of the way; `side` is that of the robot."""
        self.bodies: tuple[Body, ...] = ()
        self.aside: Array = np.zeros(3)
        self._at: Array = np.zeros(3)
        if options.obstacle == "bag":
            parked = Pose(PARKED)
            self.bodies = (
                world.add_box(BAG, parked, name="infusion_bag", rgba=(0.85, 0.92, 1.0, 0.9)),
                world.add_box(HOSE, parked, name="infusion_hose", rgba=(0.9, 0.9, 0.9, 1.0)),
            )
            self.aside = np.array((0.0, -SIDEWAYS if side == "right" else SIDEWAYS, -LOW))

    def hang(self, start: Vector, goal: Vector, rng: np.random.Generator) -> None:
        """Hang it between a start and a goal [m], each of shape [3]; nothing is drawn without a bag."""
        if not self.bodies:
            return
        share = rng.uniform(*PLACES)
        self._at = (1 - share) * np.asarray(start) + share * np.asarray(goal)
        above = 0.5 * (BAG[2] + HOSE[2])
        for body, up in zip(self.bodies, (0.0, above), strict=True):
            body.set_base(Pose(tuple((self._at + (0.0, 0.0, up)).tolist())))

    def seen(self) -> Sequence[Seen]:
        """Return what a robot sees of it; nothing where there is none."""
        return [Seen("bag_position", "m", 3, lambda _: self._at)] if self.bodies else []
