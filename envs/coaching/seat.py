"""Where people sit who exercise, and where the robot stands that coaches them."""

from __future__ import annotations

import dataclasses
import math

import numpy as np

from rcare_marl.agents.coaching.imitation import raised_sides
from rcare_marl.agents.people.avatar import body_model, body_segments
from rcare_marl.agents.people.body.posture import pelvis_pose
from rcare_marl.agents.people.body.segment import Shape as Solid
from rcare_marl.agents.people.body.self_contact import clear_arms
from rcare_marl.agents.people.body.skeleton import DOF_INDEX, DOFS, JOINTS, SIDES
from rcare_marl.agents.people.human import Human
from rcare_marl.agents.robots.robot import Robot
from rcare_marl.errors import ConfigError
from rcare_marl.pose import Pose, matrix_from_quaternion
from rcare_marl.world import World

from ..devices import Wheelchair
from ..devices.device_model import DeviceModel

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
        """Let nothing hold the arms that exercise; what the person cannot raise lies on its armrest.

        Hands lie on the wheels or in the lap between repetitions: hanging arms tire nobody.
        """
        held = self.person.posture.supported
        joints = JOINTS if held == "all" else held
        kept = tuple(joint for joint in joints if joint not in self.hanging)
        self.person.posture = dataclasses.replace(
            self.person.posture, supported=kept, eased=self.hanging
        )

    def spawn(self, world: World, pose: Pose = Pose(), *, name: str = "") -> Pose:
        """Add the chair at a pose, and return the support on which the person is to be spawned.

        Arms that would hang in the wheels or the cushion hang beside them.
        """
        person, chair = self.person, self.chair
        soles = person.soles(chair.frame("seat_back"))
        chair.fit_footplates(soles["left"], soles["right"])
        chair.spawn(world, pose, name=name)
        rests = {
            side: None if side in self._free else chair.frame_in_world(f"armrest_{side}")
            for side in SIDES
        }
        person.use_arm_rests(rests["left"], rests["right"])
        self._hang_beside()
        return chair.frame_in_world("seat_back")

    def _hang_beside(self) -> None:
        """Turn the arms that hang out of the chair: how wide it is against a person, no posture knows."""
        avatar, posture = self.person.avatar, self.person.posture
        model = body_model(avatar.body_path(), avatar.height_m)
        segments = body_segments(avatar.body_path(), avatar.height_m, avatar.mass_kg, avatar.sex)
        limits = avatar.profile.limits("passive")
        angles = posture.angles(limits)
        root = pelvis_pose(posture, model, angles, self.chair.frame("seat_back")).inverse()
        solids = _solids(self.chair.model, root)
        clear = clear_arms(self._free, angles, segments, model.joints, limits, solids)
        arms = [dof for dof in DOFS if dof.joint in self.hanging]
        found = {
            dof.name: math.degrees(clear[DOF_INDEX[dof.name]] + dof.clinical_zero) for dof in arms
        }
        self.person.posture = dataclasses.replace(
            posture, angles_deg={**posture.angles_deg, **found}
        )

    @property
    def hanging(self) -> tuple[str, ...]:
        """Shoulders, elbows and wrists of the arms that hang."""
        return tuple(
            f"{side}_{joint}" for side in self._free for joint in ("shoulder", "elbow", "wrist")
        )


def _solids(chair: DeviceModel, root: Pose) -> list[Solid]:
    """Return what of a chair collides, in the frame of somebody's root; `root` is the chair there."""
    out = []
    for name, link in chair.links.items():
        for shape in link.collision:
            at = root @ chair.link_pose(name) @ shape.pose()
            size = shape.size if shape.kind == "box" else (shape.span(), shape.radius)
            kind = "capsule" if shape.kind == "sphere" else shape.kind
            turn = matrix_from_quaternion(at.quaternion)
            out.append(Solid(kind, size, np.array(at.position), turn))  # type: ignore[arg-type]
    return out


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
