"""What an episode is about."""

from __future__ import annotations

import abc
import dataclasses
import math
import re
from collections.abc import Collection, Mapping, Sequence
from typing import TYPE_CHECKING, Any, Generic, TypeVar, overload

import numpy as np
from typing_extensions import Self

from rcare_marl.agents.agent import Agent
from rcare_marl.agents.people.body.posture import PostureConfig
from rcare_marl.agents.people.human import Human
from rcare_marl.agents.robots.robot import GripperUse, Robot
from rcare_marl.attachment import Attachment
from rcare_marl.body import Body
from rcare_marl.errors import ConfigError
from rcare_marl.pose import Pose, about_z
from rcare_marl.world import World

from .devices import Wheelchair, add_stand, hang_ventilator
from .feasibility import FEASIBLE, Feasibility
from .narrowing import NarrowedRng as NarrowedRng
from .place import BareFloor, DoorSite, Place
from .reach import ReachSearch
from .rectangle import Rectangle
from .safety import NOBODY, Safety, SafetyMeter
from .state import Seen, State, Values, greatest, where
from .task_options import FORCE_LIMIT, TaskOptions

if TYPE_CHECKING:
    from rcare_marl.rendering import Camera

CONTACT_FORCE = 15.0  # [N] from which a robot gives way, where its role says nothing else

# Robots that have mounts on or beside a wheelchair and reach a person in it.
CHAIR_ROBOTS = frozenset("fetch franka_panda kinova_gen2 kinova_gen3 pr2 stretch_re1 ur5".split())
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
        contact_force: Force at a robot's tool from which it gives way in `tool_delta` [N].
        contact_torque: Torque with which that tool may turn what it holds; see `ToolDelta` [N·m].
        moves: Parts of a robot that move where the cast names none and it has them all, its main arm if
            None; of a person see `agents.people.moves`.
        speaks: Whether a person whom a script plays has `speak` among the moves: the task listens.
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
        contact_force: float = CONTACT_FORCE,
        contact_torque: float = 0.0,
        moves: Sequence[str] | None = None,
        speaks: bool = False,
    ) -> None:
        self.kind, self.default, self.optional, self.speaks = kind, default, optional, speaks
        self.posture, self.movable, self.gripper = posture, movable, gripper
        self.control, self.partner, self.moves = control, partner, moves
        self.contact_force, self.contact_torque = contact_force, contact_torque

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


# Somebody who stands by, where the cast names one.
STANDING_CAREGIVER = Role(
    Human,
    default=None,
    optional=True,
    movable=("spine1_flexion", "right_shoulder", "right_elbow_flexion"),
    partner="still",
)


class Task(abc.ABC):
    """Scene, goal and rewards. A task knows its agents by role, never by model.

    Once a control step `read` asks the engine and returns a `State`. `observables`, `rewards`, `metrics`,
    `is_success` and `is_failure` are functions of a state and of the options alone, and broadcast over
    leading axes of the state; see `envs.state`. Safety is measured and its limit applied without a task's
    doing.

    Attributes:
        Options: The frozen dataclass of a task's settings.
        options: The settings of the running episode; see `set_stage`.
        cast: The agents by role; set by the environment before `furnish`.
        reachable_by: Robots that reach with the default cast, from where they are put; None if silent.
        least_success: Of a hundred episodes, those the scripted robot must end well; 0 if it is silent.
        engines: What can compute its motion, see `rcare_marl.engines`.
        control_dt, time_limit: Length of a control step, and of an episode [s].
        room_kinds: Kinds of rooms of a home that suit the task, the best first.
        footprint: The free floor that it needs, about the origin [m].
        slack: How much of that it can do without on each side, where it is crowded [m].
        site: What the origin is at: `door`, or furniture as `toilet`, built on a bare floor; else empty.
        place: Where it takes place; its floor is laid before `furnish`.
        world: Where it takes place; set by the environment before `furnish`.
        state: What was read last; from the first reset on.
        chair: The wheelchair of a task that has one, on which robots can be mounted.
        tools: What robots hold, beside which they should be slow near a person; filled in `build`.
        feasible: Whether it can be done for the cast, and why not; tasks say so in `build`.
        bystanders: Roles of people whom nobody cares for, so that their safety is not measured.
        hands_touch: Whether a robot's hand may touch a person; else it is kept clear, as its arm is.
        paper_terms: Names of those terms of its reward that the RCareWorld paper's table has, if it is there.
    """

    Options: type[Any]
    room_kinds: Sequence[str] = ()
    footprint: Rectangle = Rectangle(-1.1, -1.1, 1.1, 1.1)
    slack: float = 0.35
    site: str = ""
    reachable_by: Collection[str] | None = None
    least_success: int = 0
    engines: Collection[str] = ("bullet", "mujoco")
    place: Place
    cast: Mapping[str, Agent]
    world: World
    state: Any
    chair: Wheelchair | None = None
    feasible: Feasibility = FEASIBLE
    bystanders: Sequence[str] = ("caregiver",)
    hands_touch: bool = True
    paper_terms: Collection[str] = ()
    control_dt: float = 0.1
    time_limit: float = 20.0  # 200 control steps, as in Assistive Gym

    def __init__(self, options: Any) -> None:
        """Take settings, an instance of `Options`."""
        self.options = self._given = options
        self._next: Any = None  # settings from the next reset on, if they change
        self.place = BareFloor()
        self.tools: list[Body] = []
        self._meters: dict[str, SafetyMeter] = {}
        self._arms: list[tuple[Robot, set[int]]] = []  # with their links that may touch

    @classmethod
    def roles(cls) -> dict[str, Role[Any]]:
        """Return the parts declared in the class body, in order."""
        bodies = [vars(base).items() for base in reversed(cls.__mro__)]
        return {k: v for body in bodies for k, v in body if isinstance(v, Role)}

    @abc.abstractmethod
    def furnish(self, world: World) -> dict[str, Pose]:
        """Add what stands in the room, once, and return where each role of the cast starts.

        A robot starts with its base there; a person rests on the surface there, see
        `agents.people.body.posture.pelvis_pose`.
        """

    def free_floor(self) -> Rectangle:
        """Return the free floor that this cast needs, about the origin [m]; `cast` is set by then."""
        return self.footprint

    def floor_before(self, site: DoorSite) -> Rectangle | None:
        """Return the free floor that this cast needs before a door, see `place.FloorBefore`."""
        return None if site.is_turned else self.free_floor()

    def view(self) -> Camera:
        """Return the view that shows the task best, from within the room where there is one."""
        return self.place.view(self.camera())

    def frame_of(self, mount: str) -> Pose:
        """Return the frame that a robot's mount of that name is in: the world's, or a device's."""
        if self.chair is not None and mount.startswith("wheelchair"):
            return self.chair.pose
        return Pose()

    @property
    def people(self) -> list[Human]:
        """The people of the cast."""
        return [agent for agent in self.cast.values() if isinstance(agent, Human)]

    def equip(self) -> None:
        """Hang what the recipient lives by on the wheelchair that they sit in, if it stands still."""
        chair, person = self.chair, self.cast.get("recipient")
        if not isinstance(person, Human) or person.avatar.profile.ventilator_rate is None:
            return
        stands = isinstance(chair, Wheelchair) and not chair.body.is_movable
        if chair is not None and stands and person.posture.arms == "armrests":
            hang_ventilator(self.world, chair, person)

    def let_overlap(self, *things: Body) -> None:
        """Let people pass through what their posture fits, and a robot through the chair it is mounted on."""
        for person in self.people:
            for thing in things:
                person.ignore(thing)
        if self.chair is not None and self.chair.carries_robot:
            self.world.set_collision(self._first_robot().body, self.chair.body, False)

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
        stand = Pose(place, about_z(math.atan2(-place[1], -place[0])))
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
            self.change_options(
                dataclasses.replace(
                    given,
                    spread=given.spread * spread,
                    tolerance=given.tolerance * tolerance,
                    force_limit=given.force_limit * force,
                )
            )
        except ValueError as error:
            raise ConfigError(f"no stage of a curriculum: {error}") from error

    def change_options(self, options: Any) -> None:
        """Take over settings, an instance of `Options`, at the next reset."""
        self._next = options

    def enter_stage(self, rng: np.random.Generator) -> np.random.Generator:
        """Take over the settings of a new episode, and return where its chance comes from.

        Args:
            rng: The generator of the environment; itself where all of the randomisation is wanted.
        """
        spread = self.coming_spread
        if self._next is not None:
            self.options, self._next = self._next, None
        return rng if spread == 1.0 else NarrowedRng(rng, spread)

    @property
    def coming_spread(self) -> float:
        """Share of the randomisation that the next reset leaves, 0 to 1."""
        coming = self.options if self._next is None else self._next
        return coming.spread if isinstance(coming, TaskOptions) else 1.0

    def need(self, posture: PostureConfig, fits: bool, what: str) -> None:
        """Refuse a recipient whose posture does not fit.

        Raises:
            ConfigError: It says what they must do.
        """
        if not fits:
            raise ConfigError(f"the recipient must {what}, and is {posture.description}")

    def search(self, world: World, **limits: Any) -> ReachSearch:
        """Return how to search for the start of the robot, clear of all people; see `ReachSearch`.

        Args:
            world: Where all stand.
            **limits: Further fields of `ReachSearch`.
        """
        return ReachSearch(world, self._first_robot(), self.people, self.place.floor, **limits)

    def _first_robot(self) -> Robot:
        """Return the robot that has the part, the first one."""
        return next(agent for agent in self.cast.values() if isinstance(agent, Robot))

    def mounted(self, robot: Robot, mount: str) -> Pose:
        """Return where a robot's base is at a mount of it, and set it on a stand if it needs one."""
        base = robot.mount(mount, self.frame_of(mount))
        if robot.mount_named(mount).stand:
            add_stand(self.world, base)
        return base

    def take_tool(self, robot: Robot, tool: Body, in_tool: Pose) -> Attachment:
        """Let a robot hold a tool, as `Robot.grasp` does, and watch its speed near people; for `build`."""
        self.tools.append(tool)
        return robot.grasp(tool, in_tool)

    @abc.abstractmethod
    def build(self, world: World) -> None:
        """Add props, once; the agents stand there already."""

    def settle(self, steps: int) -> None:
        """Let everybody hold still for physics steps, so that things come to rest; for `build`."""
        for _ in range(steps):
            for agent in self.cast.values():
                agent.actuate()
            self.world.step()

    def measure(self) -> None:
        """Begin to measure the safety of everybody who is cared for, once, after `build`.

        Raises:
            ConfigError: If a robot or its tool touches one of them.
        """
        robots = [agent.body for agent in self.cast.values() if not isinstance(agent, Human)]
        for agent in self.cast.values():
            if isinstance(agent, Robot):
                hands = {link for arm in agent.arms.values() for link in arm.hand}
                self._arms.append((agent, hands if self.hands_touch else set()))
        for role, person in self.cast.items():
            if not isinstance(person, Human) or role in self.bystanders:
                continue
            self._meters[role] = SafetyMeter(person, self.world, [*self.tools, *robots])
            for body in (*self.tools, *robots):
                if self.world.contact_force(person.body, body) > 0:
                    raise ConfigError(
                        f"{body.name!r} touches {role!r} before the episode begins: choose another mount "
                        "or posture"
                    )

    @abc.abstractmethod
    def reset(self, rng: np.random.Generator) -> None:
        """Place props for a new episode, and draw its goal."""

    def after_substep(self) -> None:
        """Look at the world after each physics step (contacts are short-lived)."""

    def look_at_contacts(self) -> None:
        """Measure what touches people, and `after_substep`; after each physics step."""
        for meter in self._meters.values():
            meter.after_substep()
        self.after_substep()

    def begin(self, rng: np.random.Generator) -> None:
        """Begin an episode: new settings, `reset`, and no memory of the last one.

        Args:
            rng: The generator of the environment.
        """
        self.reset(self.enter_stage(rng))
        for meter in self._meters.values():
            meter.reset()
        self.state = None

    def look(self) -> None:
        """Read the state once, after the physics of a control step or of a reset.

        Robots are told where their arms are near people, to be kept clear of them; hands too, unless
        they may touch.
        """
        before = self.state
        safety = {
            role: meter.read(Safety() if before is None else before.safety[role], self.control_dt)
            for role, meter in self._meters.items()
        }
        for robot, hands in self._arms:
            near = [n for meter in self._meters.values() for n in meter.near(robot.body, hands)]
            for part in robot.parts.values():
                part.control.near = near
        self.state = self.read(State(self.world.time, safety), before)

    @abc.abstractmethod
    def read(self, now: State, before: Any) -> State:
        """Return the task's own state; the only place that asks the engine after the physics.

        What is to be remembered of an episode is carried over from the state before. The scene may answer
        here, as when food that was eaten is taken away.

        Args:
            now: What every task reads: `MyState(**vars(now), ...)` takes it over.
            before: The state before, of the task's own kind; None at the beginning of an episode.
        """

    @abc.abstractmethod
    def observables(self, role: str) -> Sequence[Seen]:
        """Return what the agent in `role` sees of the task."""

    @abc.abstractmethod
    def rewards(self, role: str, state: Any) -> Mapping[str, Values]:
        """Return the named, weighted reward terms of `role`; their sum is the reward."""

    def literal(self, role: str, state: Any) -> Mapping[str, Values]:
        """Return the terms of the RCareWorld paper's table alone; all of a task that is not in it."""
        terms = self.rewards(role, state)
        return {name: terms[name] for name in self.paper_terms or terms if name in terms}

    def paid(self, role: str, state: Any) -> Mapping[str, Values]:
        """Return the terms of the reward that the options name."""
        is_literal = getattr(self.options, "reward", "") == "paper_literal"
        return (self.literal if is_literal else self.rewards)(role, state)

    def metrics(self, state: Any) -> Mapping[str, Values]:
        """Return what is worth reporting beside safety, always under the same names."""
        return {}

    @abc.abstractmethod
    def is_success(self, state: Any) -> Values:
        """Return whether the goal is reached; if nothing failed, the episode ends well."""

    def is_failure(self, state: Any) -> Values:
        """Return whether the goal is out of reach; too much force on a person is a failure anyway."""
        return False

    def failed(self, state: Any = None) -> Values:
        """Return whether the episode has failed: `is_failure`, or too much force on a person."""
        state = self.state if state is None else state
        return (state.peak_force > self.force_limit) | self.is_failure(state)

    def succeeded(self, state: Any = None) -> Values:
        """Return whether the goal is reached, and nothing has failed."""
        state = self.state if state is None else state
        return where(self.failed(state), False, self.is_success(state))

    def report(self, state: Any = None) -> dict[str, Values]:
        """Return metrics, those of safety first: of several people the greatest."""
        state = self.state if state is None else state
        found = [each.metrics(self.force_limit) for each in state.safety.values()]
        if len(found) != 1:
            found = [{key: greatest([each[key] for each in found]) for key in NOBODY}]
        return {**found[0], **self.metrics(state)}

    @property
    def force_limit(self) -> float:
        """Force on a person that ends the episode as a failure [N]."""
        return self.options.force_limit if isinstance(self.options, TaskOptions) else FORCE_LIMIT

    def for_the_rest(self, state: Any, condition: Values, reward: Values) -> Values:
        """Return a reward of one control step for all that are left where a condition holds, else 0.

        An episode that ends is so paid, or charged, as if it had gone on.
        """
        left = (self.time_limit - state.time) / self.control_dt
        return where(condition, reward * where(left > 0, left, 0.0), 0.0)

    def contact_force(self) -> Seen:
        """Return the observable of the force on the person [N], of several the greatest."""
        return Seen("contact_force", "N", 1, lambda state: state.force)

    def time_left(self) -> Seen:
        """Return the observable of how long there is still to go [s]."""
        return Seen("time_left", "s", 1, lambda state: self.time_limit - state.time)

    @abc.abstractmethod
    def camera(self) -> Camera:
        """Return the view that shows the task best."""
