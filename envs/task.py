"""What an episode is about."""

from __future__ import annotations

import abc
import dataclasses
import math
import re
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any, Generic, TypeVar, overload

import numpy as np
from typing_extensions import Self

from rcare_marl.agents.agent import Agent
from rcare_marl.agents.human import Human
from rcare_marl.body import Body
from rcare_marl.errors import ConfigError
from rcare_marl.observable import Observable
from rcare_marl.pose import Pose, quaternion_from_rpy
from rcare_marl.world import World

from .homes.rectangle import Rectangle
from .narrowed_rng import NarrowedRng
from .safety import SafetyMeter
from .task_options import TaskOptions

if TYPE_CHECKING:
    from rcare_marl.agents.robot import GripperUse, Robot
    from rcare_marl.rendering import Camera

    from .homes.built import BuiltHome
    from .homes.care_home import CareHome
    from .homes.plan import Opening
    from .homes.stage import Stage

FLOOR_FRICTION = 0.8  # [1]; own choice

BESIDE = (1.7, 1.1)  # [m] along and across, where a robot waits that has no part; our own choice

AgentT = TypeVar("AgentT", bound=Agent)


def part_name(role: str) -> str:
    """Return the part that a role plays: `robot` for `robot_0` and `robot_1`."""
    return re.sub(r"_\d+$", "", role)


class Role(Generic[AgentT]):
    """A part in a task: on the class the part itself, on a task the agent that plays it.

    Attributes:
        kind: The class of agent that can play it.
        default: Model that plays it where the cast names none; None leaves an optional role empty.
        optional: Whether the task can do without it.
        posture: How a person starts (`assets/postures`).
        movable: DoFs or joints of a person that move in this task; the others cost nothing.
        control: Control mode of a robot where the cast names none.
        partner: Policy that plays the role where another one is the only learner.
        gripper: What a robot's gripper does where the cast names no parts to move; see `Robot`.
        moves: Parts of a robot that move where the cast names none and it has them all; its main arm if
            None.
    """

    def __init__(
        self,
        kind: type[AgentT],
        *,
        default: str | None,
        optional: bool = False,
        posture: str = "standing",
        movable: Sequence[str] | None = None,
        control: str = "tool_delta",
        partner: str | None = None,
        gripper: GripperUse = "held",
        moves: Sequence[str] | None = None,
    ) -> None:
        self.kind, self.default, self.optional = kind, default, optional
        self.posture, self.movable, self.gripper = posture, movable, gripper
        self.control, self.partner, self.moves = control, partner, moves

    def __set_name__(self, owner: type[Task], name: str) -> None:
        self._name = name

    @overload
    def __get__(self, task: None, owner: type[Task]) -> Self: ...
    @overload
    def __get__(self, task: Task, owner: type[Task]) -> AgentT: ...
    def __get__(self, task: Task | None, owner: type[Task]) -> Self | AgentT:
        if task is None:
            return self
        # Where several robots play, the first of them has the part.
        agent = task.cast.get(self._name) or task.cast[f"{self._name}_0"]
        assert isinstance(agent, self.kind)
        return agent


class Task(abc.ABC):
    """Scene, goal and rewards. A task knows its agents by role, never by model.

    `observables`, `rewards`, `metrics`, `is_success` and `is_failure` are pure: calling them twice
    changes nothing. Only `after_substep` and `after_step` change the memory of an episode.

    Attributes:
        Options: The frozen dataclass of a task's settings.
        options: The settings of the running episode; see `set_stage`.
        cast: The agents by role; set by the environment before `furnish`.
        control_dt: Length of a control step [s].
        time_limit: Length of an episode [s].
        room_kinds: Kinds of rooms of a home that suit the task, the best first.
        footprint: The free floor that it needs, about the origin [m].
        site: What the origin is at: `door`, or a kind of furniture such as `toilet`, whose frame it
            is. Such a task builds that itself on a bare floor. Anywhere if empty.
        level: Level of accessibility of the home, or of what the task builds itself.
        stage: Where in a home it takes place; None on a bare floor.
        built: That home, once it stands in the world.
    """

    Options: type[Any]
    room_kinds: Sequence[str] = ()
    footprint: Rectangle = Rectangle(-1.1, -1.1, 1.1, 1.1)
    site: str = ""
    level: int = 1
    stage: Stage | None = None
    built: BuiltHome | None = None
    cast: Mapping[str, Agent]
    control_dt: float = 0.1
    time_limit: float = 20.0

    def __init__(self, options: Any) -> None:
        """Take settings, an instance of `Options`."""
        self.options = self._given = options
        self._next: Any = None  # settings from the next reset on, if they change
        self._meters: list[SafetyMeter] = []

    @classmethod
    def roles(cls) -> dict[str, Role[Any]]:
        """Return the parts declared in the class body, in order."""
        bodies = [vars(base).items() for base in reversed(cls.__mro__)]
        return {k: v for body in bodies for k, v in body if isinstance(v, Role)}

    @abc.abstractmethod
    def furnish(self, world: World) -> dict[str, Pose]:
        """Add what stands in the room, once, and return where each role of the cast starts.

        A robot starts with its base there; a person rests on the surface there, see
        `agents.body.posture.pelvis_pose`.
        """

    def free_floor(self) -> Rectangle:
        """Return the free floor that this cast needs, about the origin [m]; `cast` is set by then."""
        return self.footprint

    def floor_before(self, home: CareHome, opening: Opening, is_turned: bool) -> Rectangle | None:
        """Return the free floor that this cast needs before a door, see `homes.stage.FloorBefore`."""
        return None if is_turned else self.free_floor()

    def lay_floor(self, world: World) -> Body:
        """Add the floor, once: that of the home, with all that stands on it, or a bare one."""
        if self.stage is not None:
            self.built = self.stage.spawn(world)
            return self.built.floor
        floor = world.add_box((6, 6, 0.1), Pose((0, 0, -0.05)), name="floor")
        floor.set_friction([-1], lateral=FLOOR_FRICTION)
        return floor

    def view(self) -> Camera:
        """Return the view that shows the task best, from within the room where there is one."""
        camera = self.camera()
        return camera if self.stage is None else self.stage.seen_from_inside(camera)

    def frame_of(self, mount: str) -> Pose:
        """Return the frame that a robot's mount of that name is in: the world's, or a device's."""
        return Pose()

    def beside(self, robot: Robot, number: int) -> Pose:
        """Return where a robot starts that the task has no part for.

        That is at the mount that was chosen for it, or else on the floor out of the way, looking at
        the scene. It starts in its `home` posture, unless another one was chosen for it.

        Args:
            robot: The robot.
            number: Its number, 1 for `robot_1`.
        """
        if robot.chosen_mount is not None:
            named = robot.chosen_mount if isinstance(robot.chosen_mount, str) else "floor"
            return robot.mount(named, self.frame_of(named), with_posture=False)
        side, row = 1 - 2 * (number % 2), (number + 1) // 2
        place = (BESIDE[0], side * BESIDE[1] * row, 0.0)
        facing = math.atan2(-place[1], -place[0])
        stand = Pose(place, tuple(quaternion_from_rpy(0, 0, facing).tolist()))
        return robot.mount("floor", stand, with_posture=False)

    def set_stage(self, *, spread: float = 1.0, tolerance: float = 1.0, force: float = 1.0) -> None:
        """Make the task easier from the next reset on, or as hard as it was made; for a curriculum.

        Args:
            spread: Times the share of the randomisation at reset, 0 to 1.
            tolerance: Times the tolerance of success, from 1 on.
            force: Times the force limit, from 1 on.

        Raises:
            ConfigError: If a value is out of its range, or the settings of this task are no
                `TaskOptions`.
        """
        given = self._given
        if not isinstance(given, TaskOptions):
            raise ConfigError(
                f"a curriculum needs settings derived from TaskOptions, {type(self).__name__} has "
                f"{type(given).__name__}"
            )
        if not force >= 1:
            raise ConfigError(f"force must be at least 1, got {force}")
        try:
            self._next = dataclasses.replace(
                given,
                spread=given.spread * spread,
                tolerance=given.tolerance * tolerance,
                force_limit=given.force_limit * force,
            )
        except ValueError as error:
            raise ConfigError(f"no stage of a curriculum: {error}") from error

    def enter_stage(self, rng: np.random.Generator) -> np.random.Generator:
        """Take over the settings of a new episode, and return where its chance comes from.

        Args:
            rng: The generator of the environment; itself where all of the randomisation is wanted.
        """
        if self._next is not None:
            self.options, self._next = self._next, None
            for meter in self._meters:
                meter.force_limit = self.options.force_limit
        spread = self.options.spread if isinstance(self.options, TaskOptions) else 1.0
        return rng if spread == 1.0 else NarrowedRng(rng, spread)

    def measure(self, person: Human, world: World, movers: Sequence[Body]) -> SafetyMeter:
        """Return a meter of what a person goes through, with the force limit of the stage."""
        meter = SafetyMeter(person, world, movers, force_limit=self.options.force_limit)
        self._meters.append(meter)
        return meter

    @abc.abstractmethod
    def build(self, world: World) -> None:
        """Add props, once; the agents stand there already."""

    @abc.abstractmethod
    def reset(self, rng: np.random.Generator) -> None:
        """Place props for a new episode and clear any memory of the last one."""

    def after_substep(self) -> None:
        """Look at the world after each physics step (contacts are short-lived)."""

    @abc.abstractmethod
    def after_step(self) -> None:
        """Update the memory once a control step, before anything is read; `reset` calls it too."""

    @abc.abstractmethod
    def observables(self, role: str) -> Sequence[Observable]:
        """Return what the agent in `role` sees of the task."""

    @abc.abstractmethod
    def rewards(self, role: str) -> Mapping[str, float]:
        """Return the named, weighted reward terms of `role`; their sum is the reward."""

    def metrics(self) -> Mapping[str, float]:
        """Return what is worth reporting about the episode so far, always under the same names."""
        return {}

    @abc.abstractmethod
    def is_success(self) -> bool:
        """Return whether the goal is reached; the episode then terminates."""

    def is_failure(self) -> bool:
        """Return whether the goal is out of reach or someone was hurt; likewise."""
        return False

    @abc.abstractmethod
    def camera(self) -> Camera:
        """Return the view that shows the task best."""
