"""What acts and observes in a world."""

from __future__ import annotations

import abc
from collections.abc import Iterator, Mapping, Sequence
from types import MappingProxyType
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from rcare_marl.body import Body
from rcare_marl.observable import Observable
from rcare_marl.pose import Pose
from rcare_marl.world import World

if TYPE_CHECKING:
    from rcare_marl.planning.path import Path
    from rcare_marl.planning.search import Planner

    from .people.profile import Range
    from .planning import Wish
    from .sensing.marker import MarkerConfig
    from .sensing.suite import SensorSuite

Array = npt.NDArray[np.float64]


class Agent(abc.ABC):
    """An actor with a body. It holds handles and set-points; its state is in the world.

    Attributes:
        name: The role that it plays.
        body: Its body, once spawned.
        world: The world that it was spawned into.
        sensors: What it senses with beyond its own state.
        markers: Fiducial markers on its links.
        rides: Whether something that moves on a level floor carries it: its base is free then, to be
            bonded to that. Set it before `spawn`.
    """

    name: str
    body: Body
    world: World
    rides: bool = False
    sensors: SensorSuite | None = None
    markers: tuple[MarkerConfig, ...] = ()

    def equip(self, sensors: SensorSuite | None, markers: Sequence[MarkerConfig] = ()) -> None:
        """Give it sensors and fiducial markers, before `spawn`."""
        self.sensors, self.markers = sensors, tuple(markers)

    def kept_links(self) -> tuple[str, ...]:
        """Return the links that must stay links of their own, since sensors or markers sit there."""
        sensed = self.sensors.links(self) if self.sensors is not None else ()
        carried = (marker.on for marker in self.markers if marker.on != "world")
        return (*sensed, *carried)

    @property
    @abc.abstractmethod
    def action_size(self) -> int:
        """Number of action values, each in [action_low, 1]."""

    @property
    def action_low(self) -> float:
        """Least value of an action: -1, or 0 for what only pulls."""
        return -1.0

    @property
    @abc.abstractmethod
    def action_names(self) -> tuple[str, ...]:
        """What each action value moves, with its unit, one a value."""

    @abc.abstractmethod
    def spawn(self, world: World, pose: Pose) -> None:
        """Load the body into `world` with its base at `pose`, once."""

    @abc.abstractmethod
    def reset(self, rng: np.random.Generator) -> None:
        """Take a start posture and clear every set-point."""

    @abc.abstractmethod
    def command(self, action: Array, duration: float) -> None:
        """Accept an action, shape [action_size], for the coming control step of `duration` [s]."""

    @property
    def needs_actuation(self) -> bool:
        """Whether `actuate` must be called before every physics step; asked once, after `spawn`."""
        return True

    def actuate(self) -> None:
        """Apply forces for the coming physics step; nothing where motors hold their targets."""

    def sense(self) -> None:
        """Read the body's state once, for all observables, after the physics of a control step."""

    @abc.abstractmethod
    def observables(self) -> Sequence[Observable]:
        """Return what the agent senses of itself."""

    def describe(self) -> dict[str, str]:
        """Return facts worth showing to a person, such as the model and where it came from."""
        return {}

    def plan(
        self,
        goal: Wish,
        *,
        avoid: Mapping[Agent | Body, float | None] = MappingProxyType({}),
        gap: float = 0.005,
        planner: Planner = "rrt_connect",
        within_s: float = 2.0,
        tilt: float | None = None,
        speed: float = 1.0,
        seed: int = 0,
        arm: str | None = None,
        kind: Range = "active",
    ) -> Path:
        """Return a path to a goal, round everything, from where the agent is now; nothing moves.

        It takes from hundredths of a second to `within_s`: `Path.planning_s` says how long. Call it
        between control steps.

        Args:
            goal: Joints [rad or m] by name; or, of a robot, the whole posture of the arm, shape [n], or
                several, shape [k, n], or the pose of its tool in the world, or several, of which one is
                enough; or, of a person, goals as `WholeBodyIk` has them.
            avoid: Distance from some agents or bodies [m]; None lets it go through one.
            gap: Distance from everything else [m].
            planner: `rrt_connect`, or `bit_star`, which uses all its time for a shorter way.
            within_s: Time to plan on one core [s].
            tilt: By how much what a tool holds may lean from how it is now [rad]; None: as it likes.
            speed: Share of the greatest speeds and accelerations.
            seed: Of the planner's chance.
            arm: Of a robot: which arm; the main one if None.
            kind: Of a person: the `active` range, or the `passive` one, where somebody else moves them.

        Raises:
            PlanningError: If there is no path, or none was found in time.
            ConfigError: If the goal is not one for this agent, or a number is impossible.
            MissingPackageError: If the extra `plan` is not installed.
        """
        from .planning import (
            Request,
            plan,
        )  # which knows robots and people, and takes long to import

        wishes = Request(avoid, gap, planner, within_s, tilt, speed, seed, arm, kind)
        return plan(self, goal, wishes)

    def follow(self, path: Path, duration: float) -> Iterator[Array]:
        """Yield the actions that lead along a path of `plan`, each as the agent is when it is asked for.

        Tool modes lead the tool along it; a redundant arm may then hold its elbow otherwise.

        Args:
            path: The path.
            duration: Length of the control step [s].

        Raises:
            ConfigError: If the control mode of a robot cannot follow one.
        """
        from .planning import follow

        return follow(self, path, duration)
