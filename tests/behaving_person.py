"""A person with a behaviour tree in an empty world, for several files of tests."""

from __future__ import annotations

from collections.abc import Callable
from typing import Literal

import numpy as np
import numpy.typing as npt
import pytest

from rcare_marl.agents.people.actuation.drive import ActuationConfig
from rcare_marl.agents.people.avatar import load_avatar, load_posture
from rcare_marl.agents.people.behaviour.avatar_tree import (
    AvatarBehaviour,
    BehaviourConfig,
    Surroundings,
    load_behaviour,
)
from rcare_marl.agents.people.human import Human
from rcare_marl.pose import Pose
from rcare_marl.world import World

Array = npt.NDArray[np.float64]
UPPER = (
    "spine1",
    "spine2",
    "neck",
    "head",
    "jaw_opening",
    "left_collar",
    "right_collar",
    "left_shoulder",
    "right_shoulder",
    "left_elbow",
    "right_elbow",
    "left_eye_smplhf",
    "right_eye_smplhf",
)


Kind = Literal["skeletal", "muscle"]
OPEN = {"skeletal": 0.3, "muscle": 0.15}  # [rad]; muscles open and close the jaw less exactly
CLOSED = {"skeletal": 0.05, "muscle": 0.08}
DRIVEN = pytest.mark.parametrize("kind", ["skeletal", "muscle"])


class Scene:
    """A person in an empty world who follows their tree."""

    def __init__(
        self,
        avatar: str = "caregiver",
        *,
        movable: tuple[str, ...] | None = UPPER,
        spoon: Callable[[], Array] | None = None,
        config: BehaviourConfig | None = None,
        kind: Kind = "skeletal",
    ) -> None:
        self.world = World()
        self.person = Human(
            "recipient",
            load_avatar(avatar),
            posture=load_posture("wheelchair"),
            movable=movable,
            actuation=ActuationConfig(kind=kind, excitation="posture"),
        )
        self.person.use_arm_rests(Pose((0.25, 0.26, 0.77)), Pose((0.25, -0.26, 0.77)))
        self.person.spawn(self.world, Pose((0, 0, 0.5)))
        around = Surroundings(lambda: self.world.time, spoon)
        self.policy = AvatarBehaviour(
            self.person, around, 0.1, config=config or load_behaviour("anybody")
        )
        self.cues = self.policy.cues
        rng = np.random.default_rng(0)
        self.person.reset(rng)
        self.policy.reset(rng)

    def run(self, seconds: float, each: Callable[[], None] | None = None) -> Scene:
        for _ in range(round(seconds * 10)):
            self.person.command(self.policy.act(), 0.1)
            for _ in range(24):
                self.person.actuate()
                self.world.step()
            self.person.sense()
            if each is not None:
                each()
        return self

    def angle(self, dof: str) -> float:
        return self.person.angle(dof)

    def answer(self) -> str:
        return self.cues.instruction.answer

    def running(self) -> set[str]:
        """Return the names of the branches below the root that did not fail in the last tick."""
        return {
            c.name for c in self.policy.root.children if c.status.name in ("RUNNING", "SUCCESS")
        }


# Each sub-tree by itself.
