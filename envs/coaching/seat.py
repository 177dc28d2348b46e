"""Where people sit who exercise, and where the robot stands that coaches them."""

from __future__ import annotations

import dataclasses

from rcare_marl.agents.coaching.imitation import raised_sides
from rcare_marl.agents.people.body.skeleton import JOINTS, SIDES
from rcare_marl.agents.people.human import Human
from rcare_marl.agents.robots.robot import Robot
from rcare_marl.errors import ConfigError
from rcare_marl.pose import Pose
from rcare_marl.world import World

from ..devices import Wheelchair

MOVABLE = (
    "spine1",
    "neck",
    "head",
    *(
        f"{side}_{part}"
        for side in SIDES
        for part in ("shoulder", "elbow_flexion", "elbow_pronation")
    ),
)
TABLE = (0.46, 0.60, 0.72)  # [m] depth, width, height, under a small robot; our own choice


class Seat:
    """A wheelchair of one person, without armrests where an arm exercises.

    Attributes:
        person: Whose it is.
        chair: The wheelchair.
    """

    def __init__(self, person: Human) -> None:
        """Prepare the seat of a person who is not spawned yet, and let the arms hang that exercise.

        Raises:
            ConfigError: If the person does not sit in a wheelchair.
        """
        if person.posture.arms != "armrests":
            raise ConfigError(
                f"{person.name!r} must sit in the wheelchair, and is {person.posture.description}"
            )
        self.person, self._free = person, raised_sides(person.avatar.profile)
        self.chair = Wheelchair(mounts="none", without_armrest=self._free)
        self._let_arms_hang()

    def _let_arms_hang(self) -> None:
        """Let nothing hold the arms that exercise; what the person cannot raise lies on its armrest."""
        held = self.person.posture.supported
        free = {
            f"{side}_{joint}" for side in self._free for joint in ("shoulder", "elbow", "wrist")
        }
        kept = tuple(joint for joint in (JOINTS if held == "all" else held) if joint not in free)
        self.person.posture = dataclasses.replace(self.person.posture, supported=kept)

    def spawn(self, world: World, pose: Pose = Pose(), *, name: str = "") -> Pose:
        """Add the chair at a pose, and return the support on which the person is to be spawned."""
        person, chair = self.person, self.chair
        soles = person.soles(chair.frame("seat_back"))
        chair.fit_footplates(soles["left"], soles["right"])
        chair.spawn(world, pose, name=name)
        rests = {
            side: None if side in self._free else chair.frame_in_world(f"armrest_{side}")
            for side in SIDES
        }
        person.use_arm_rests(rests["left"], rests["right"])
        return chair.frame_in_world("seat_back")


def stand(world: World, robot: Robot, place: Pose) -> Pose:
    """Return where the base of a robot starts that coaches at a place on the floor.

    One that is bolted down gets a table there, to be seen from a chair.
    """
    chosen = robot.chosen_mount
    mount = "table" if robot.config.base is None else "floor"
    if chosen is not None:
        mount = chosen if isinstance(chosen, str) else "floor"
    if mount == "table":
        _add_table(world, place)
    return robot.mount(mount, place)


def _add_table(world: World, place: Pose) -> None:
    depth, width, height = TABLE
    for name, size, z in (
        ("coach_table", (depth, width, 0.03), height - 0.015),
        ("coach_table_column", (0.1, 0.1, height - 0.06), 0.5 * height),
        ("coach_table_foot", (0.36, 0.46, 0.03), 0.015),
    ):
        at = place @ Pose((0.0, 0.0, z))
        world.add_box(size, at, name=name, rgba=(0.80, 0.70, 0.56, 1.0))
