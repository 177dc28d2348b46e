"""The environment: one final class that joins a world, agents and a task."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping
from typing import TYPE_CHECKING, Any, final

import numpy as np
import numpy.typing as npt
from gymnasium import spaces
from pettingzoo import ParallelEnv

from rcare_marl.agents.agent import Agent, Array
from rcare_marl.agents.people.human import Human
from rcare_marl.agents.policy import Policy
from rcare_marl.agents.robots.robot import Robot
from rcare_marl.agents.sensing.marker import fasten
from rcare_marl.agents.sensing.suite import SensorSuite
from rcare_marl.engines import make_world
from rcare_marl.errors import ActionError, ConfigError, EpisodeError, check_name, check_type, shown
from rcare_marl.observable import Observation
from rcare_marl.world import World

from .cast import checked_policy
from .company import Company, Scene
from .copying import ByRecipe
from .randomise import Randomisation
from .randomiser import Randomiser
from .registry import PolicyFactory
from .room_meter import RoomMeter
from .stride import make_stride, substeps
from .task import Task, part_name

if TYPE_CHECKING:
    from rcare_marl.rendering import Renderer, Viewer

Action = npt.NDArray[np.float32]
Obs = Any  # a vector, or a dictionary of it and of arrays such as pictures
Outcome = tuple[
    dict[str, Obs], dict[str, float], dict[str, bool], dict[str, bool], dict[str, dict[str, Any]]
]
RENDER_MODES = ("rgb_array", "human")
OVERLAP = 0.001  # [m] that robots may overlap at the start
CLEAR = 0.001  # [m] that they keep from people then; nearer, they press in the first physics step
STARTS = 20  # that are drawn in an episode until robots are clear of people; our own choice
ROUNDING = 1e-6  # by which an excitation may leave [0, 1]
APART = 2**64  # numbers that lie between the chance of policies and all other chance of an episode


@final
class CareEnv(ByRecipe, ParallelEnv[str, Obs, Action]):
    """A PettingZoo parallel environment. Do not subclass it: write a `Task`.

    Attributes:
        task: What the episode is about.
        cast: The agents by role.
        world: The physics world.
        policies: The roles that are not learned, and who decides for them.
        possible_agents: The roles that are learned.
        agents: Those of them that are in the running episode; empty once it is over.
        is_over: Whether no episode is running.
        setup: What `rcare_marl.make` was given, but policies; empty if something else made it.
        company: People of whom another one plays in each episode, and who does now; None if all stay.
        randomiser: What is perturbed in the running episode.
        has_begun: Whether there was an episode.
        seeds: Draws the seeds of episodes for which none is given.
        seed: Seed of the running episode, which with all `commands` decides it.
        commands: The actions of all roles in the last control step, as they were obeyed.
        watchers: Called after each reset and each step; they must change nothing.
    """

    metadata = {"name": "rcare_marl_v0", "render_modes": list(RENDER_MODES), "render_fps": 10}

    def __init__(
        self,
        task: Task,
        cast: Mapping[str, Agent],
        policies: Mapping[str, PolicyFactory] | None = None,
        *,
        physics_dt: float = 1 / 240,
        render_mode: str | None = None,
        engine: str = "bullet",
        company: Company | None = None,
        randomise: Randomisation | None = None,
    ) -> None:
        """Build the scene.

        Args:
            task: The task.
            cast: An agent for each role that is played.
            policies: For roles that are not learned, what makes their policy.
            physics_dt: Physics step [s]; the control step must be a multiple of it.
            render_mode: `rgb_array`, `human` or None.
            engine: What computes the motion, one of `rcare_marl.engines.ENGINES`.
            company: People of whom another one plays in each episode; the cast is of the first.
            randomise: What is another in each episode beside the task's own chance; nothing if None.

        Raises:
            ConfigError: If the time steps do not fit, or a policy is for a role that nobody plays.
        """
        if render_mode is not None:
            check_name("render mode", render_mode, RENDER_MODES)
        self._substeps = substeps(task.control_dt, physics_dt)
        factories = dict(policies or {})
        strangers = sorted(set(factories) - set(cast))
        if strangers:
            raise ConfigError(f"policies for {strangers}, but the cast is {sorted(cast)}")
        self.render_mode = render_mode
        self.metadata = {**type(self).metadata, "render_fps": round(1 / task.control_dt)}
        self.company, self._engine, self._physics_dt = company, engine, physics_dt
        self.randomiser = Randomiser(randomise or Randomisation({}))
        self._renderer: Renderer | None = None
        self._viewer: Viewer | None = None
        self._suites: tuple[SensorSuite, ...] = ()
        self.agents: list[str] = []
        self.is_over, self.has_begun = True, False
        self.setup: Mapping[str, Any] = {}
        self.seed, self.seeds = 0, np.random.default_rng()
        self.commands: dict[str, Array] = {}
        self.watchers: list[Callable[[CareEnv], None]] = []
        self._stage(Scene(task, dict(cast), factories))
        self.possible_agents = [role for role in self.cast if role not in self.policies]

    def _stage(self, scene: Scene) -> None:
        """Build a scene in a world of its own."""
        self.task: Task = scene.task
        self.cast: dict[str, Agent] = scene.cast
        self.world: World = make_world(self._engine, self._physics_dt)
        try:
            self._build()
            self.policies: dict[str, Policy] = {
                role: checked_policy(role, make(self, role))
                for role, make in scene.policies.items()
            }
        except BaseException:
            self.close()  # a sensor may hold a renderer already
            raise

    def _change_people(self, company: Company, passed: Mapping[str, str]) -> None:
        """Build the scene anew, with those who play in the coming episode, but for who is passed over.

        An episode of them is then the same whatever was played before.

        Raises:
            ConfigError: If nobody can be cast, or who comes observes or acts otherwise than the first.
        """
        before = self._table()
        self.task.enter_stage(np.random.default_rng(0))  # the settings that were to come

        def stage(scene: Scene) -> None:
            scene.task.change_options(self.task.options)
            self.close()
            self._stage(scene)

        company.play(self.seed, stage, passed)
        self.setup = {**self.setup, "cast": company.resolved(self.setup["cast"])}
        if (now := self._table()) != before:
            self.close()
            roles = ", ".join(role for role in now if now[role] != before.get(role))
            raise ConfigError(
                f"{company.playing} cannot take turns with the others: {roles} observes or acts otherwise"
            )

    def _table(self) -> dict[str, Any]:
        """Return what each role observes and does; how strong a hand is (in brackets) may differ."""
        out: dict[str, Any] = {}
        for role, agent in self.cast.items():
            names = [name.partition(" [")[0] for name in agent.action_names]
            out[role] = self.describe(role), self.describe_arrays(role), names, agent.action_low
        return out

    def _build(self) -> None:
        self.task.cast, self.task.world = self.cast, self.world
        self.task.place.lay_floor(self.world)
        poses = self.task.furnish(self.world)
        for role, agent in self.cast.items():
            part = part_name(role)
            if role in poses or role == f"{part}_0":
                start = poses[role if role in poses else part]
            else:  # one that the task has no part for
                assert isinstance(agent, Robot)  # only robots can be cast several times
                start = self.task.beside(agent, int(role.rsplit("_", 1)[1]))
            agent.spawn(self.world, start)
        self.task.equip()
        self.task.build(self.world)
        self.task.measure()
        self._fasten_markers()
        if fault := self._overlap() or self._in_house(self.cast):
            raise ConfigError(fault)
        self._order = tuple(self.cast.values())
        sensing = [(agent, agent.sensors) for agent in self._order if agent.sensors is not None]
        for agent, suite in sensing:
            suite.bind(self.world, agent)
        self._suites = tuple(suite for _, suite in sensing)
        self._room = RoomMeter(self.task)
        self.world.mark_start()
        self.randomiser.bind(self.world, self.cast)
        watched = [suite.after_substep for suite in self._suites if suite.watches]
        self._stride = make_stride(
            self.world,
            self.cast,
            [self.task.look_at_contacts, *watched],
            None if watched else self._touching(),
        )
        self._vectors = {role: self._observation(role) for role in self.cast}
        self._spaces: dict[str, spaces.Box[np.float32]] = {
            role: spaces.Box(agent.action_low, 1, (agent.action_size,), np.float32)
            for role, agent in self.cast.items()
        }

    def _touching(self) -> list[Human] | None:
        """Return the people whose touches alone tell the task anything; None if other things do."""
        if type(self.task).after_substep is not Task.after_substep:
            return None
        return [p for p in self.task.people if p.name not in self.task.bystanders]

    def _fasten_markers(self) -> None:
        """Put markers on everybody, behind all else, and refuse two that a camera could not tell apart."""
        seen: dict[tuple[str, int], str] = {}
        for role, agent in self.cast.items():
            for marker in agent.markers:
                key = marker.dictionary, marker.id
                if key in seen:
                    raise ConfigError(
                        f"marker {marker.id} of {marker.dictionary} is on {seen[key]!r} and on {role!r}: "
                        "give each a number of its own"
                    )
                seen[key] = role
                fasten(self.world, agent, marker)

    def _in_house(self, roles: Iterable[str]) -> str | None:
        """Return who of some roles stands in walls or furniture, as an error says it; None if nobody."""
        place = self.task.place
        for role in roles:
            for name, thing in place.obstacles:
                gap = self.world.separation(self.cast[role].body, thing, within=0.01)
                if gap < -OVERLAP:
                    where = f"{role!r} stands in {name} of {place.name} by {-1e3 * gap:.0f} mm"
                    return f"{where}: choose another room, mount or posture"
        return None

    def _overlap(self) -> str | None:
        """Return which robot stands in another one or in somebody, as an error says it; None if none."""
        robots = [pair for pair in self.cast.items() if isinstance(pair[1], Robot)]
        people = [pair for pair in self.cast.items() if not isinstance(pair[1], Robot)]
        for i, (first, robot) in enumerate(robots):
            for second, other in [*robots[i + 1 :], *people]:
                gap = self.world.separation(robot.body, other.body, within=0.01)
                if gap < (-OVERLAP if isinstance(other, Robot) else CLEAR):
                    how = f"stand in each other by {-1e3 * gap:.0f} mm" if gap < 0 else "touch"
                    what = "give the robot another mount or posture"
                    return f"{first!r} and {second!r} {how}: {what}"
        return None

    def _observation(self, role: str) -> Observation:
        agent = self.cast[role]
        sensed = agent.sensors.observables() if agent.sensors is not None else ()
        told = [seen.told_by(self.task) for seen in self.task.observables(role)]
        return self.randomiser.observation(role, agent.observables(), told, sensed)

    def observation_space(self, agent: str) -> spaces.Space[Any]:
        return self._vectors[self._known(agent)].space

    def action_space(self, agent: str) -> spaces.Box[np.float32]:
        return self._spaces[self._known(agent)]

    @property
    def state_space(self) -> spaces.Box[np.float32]:
        """The space of `state`."""
        size = sum(vector.size for vector in self._vectors.values())
        return spaces.Box(-np.inf, np.inf, (size,), np.float32)

    def state(self) -> npt.NDArray[np.float32]:
        """Return the numbers that all roles observe, learned or not, one after the other, for critics.

        Arrays such as pictures are left out.
        """
        self._check_begun()
        return np.concatenate([seen.vector() for seen in self._vectors.values()])

    def observe(self, role: str) -> Obs:
        """Return what one role observes now, learned or not."""
        self._check_begun()
        return self._vectors[self._known(role)].read()

    def _check_begun(self) -> None:
        self._check_open()
        if not self.has_begun:
            raise EpisodeError("there is nothing to see yet: call reset() first")

    def _check_open(self) -> None:
        if self.world.client < 0:
            raise EpisodeError("the environment is closed: make a new one")

    def describe(self, role: str) -> list[tuple[slice, str, str]]:
        """Return (slice, name, unit) of each part of a role's observed vector."""
        return self._vectors[self._known(role)].table()

    def describe_arrays(self, role: str) -> list[tuple[tuple[int, ...], str, str]]:
        """Return (shape, name, unit) of each array that a role observes beside the vector."""
        return self._vectors[self._known(role)].arrays()

    def _known(self, role: str) -> str:
        check_name("role in this cast", role, self.cast)
        return role

    def reset(
        self, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[dict[str, Obs], dict[str, dict[str, Any]]]:
        """Begin an episode, which is a function of its seed and of the actions of all roles.

        Without a `seed` it is drawn: by chance at first, and by the last seed that was given since;
        `options` is there for PettingZoo.
        """
        self._check_open()
        check_type("options", options, (Mapping, type(None)), "a mapping or None")
        if seed is None:
            self.seed = int(self.seeds.integers(2**32))
        else:
            if isinstance(seed, bool) or not isinstance(seed, int | np.integer) or seed < 0:
                raise ConfigError(f"a seed is a whole number from 0 on, got {shown(seed)}")
            self.seed, self.seeds = int(seed), np.random.default_rng([seed, 1])
        company, passed = self.company, dict[str, str]()  # who has no clear start, and why
        if company is not None and (self.has_begun or not company.is_next(self.seed)):
            self._change_people(company, passed)
        while isinstance(rng := self._find_start(), str):
            if company is None:
                raise ConfigError(rng)
            self._change_people(company, passed := passed | {company.who(): rng})
        for suite in self._suites:
            suite.reset(rng)
        self._sense()
        self._room.begin()
        # Policies and the scene have chance of their own: the scene meets the same whoever decides.
        chance = np.random.default_rng(0)
        chance.bit_generator.state = rng.bit_generator.state
        rng.bit_generator.advance(APART)  # type: ignore[attr-defined]  # PCG64 has it
        for policy in self.policies.values():
            policy.reset(chance)
        self.commands = {}
        self.agents, self.is_over = list(self.possible_agents), False
        self.has_begun = True
        if self.render_mode == "human":
            self.render()
        for watch in self.watchers:
            watch(self)
        return (
            {role: self._vectors[role].read() for role in self.agents},
            self._infos({role: self.task.paid(role, self.task.state) for role in self.agents}),
        )

    def _find_start(self) -> np.random.Generator | str:
        """Draw starts until one is clear; return what drew it, or what is wrong with the last."""
        rng = np.random.default_rng(self.seed)
        self.randomiser.begin(self.seed, self.task.coming_spread)
        robots = [role for role, agent in self.cast.items() if isinstance(agent, Robot)]
        for _ in range(STARTS):
            self.randomiser.rewind()
            for agent in self._order:
                agent.reset(rng)
            self.task.begin(rng)
            if (fault := self._overlap() or self._in_house(robots)) is None:
                return rng
        return f"no start in {STARTS} is clear: {fault}"

    def step(self, actions: dict[str, Action]) -> Outcome:
        """Let everybody act for one control step.

        Raises:
            EpisodeError: If no episode is running.
            ActionError: If an action is missing, for nobody, misshapen or not finite; nothing has
                moved then, and `step` may be called again.
        """
        self.command(actions)
        self.advance()
        return self.outcome()

    def command(self, actions: Mapping[str, Action]) -> None:
        """Tell everybody what to do in the coming control step: the first part of `step`."""
        commands = self._checked(actions)
        for role, policy in self.policies.items():
            commands[role] = self._valid(role, policy.act())
        task, self.commands = self.task, commands
        for role, action in self.randomiser.passed_on(commands, task.control_dt).items():
            self.cast[role].command(action, task.control_dt)

    def advance(self) -> None:
        """Make the physics steps of a control step: the second part of `step`."""
        self._stride(self._substeps)

    def outcome(self) -> Outcome:
        """Sense what came of a control step and return it: the last part of `step`."""
        self._sense()
        self._room.look()
        task, roles = self.task, self.agents
        terms = {role: task.paid(role, task.state) for role in roles}
        done = bool(task.is_success(task.state) | task.failed())
        late = self.world.time >= task.time_limit - 1e-9
        observations = {role: self._vectors[role].read() for role in roles}
        infos = self._infos(terms)
        if done or late:
            self.agents, self.is_over = [], True
        if self.render_mode == "human":
            self.render()
        for watcher in self.watchers:
            watcher(self)
        rewards = {role: float(sum(terms[role].values())) for role in roles}
        ended, cut = dict.fromkeys(roles, done), dict.fromkeys(roles, late and not done)
        return observations, rewards, ended, cut, infos

    def _sense(self) -> None:
        for agent in self._order:
            agent.sense()
        for suite in self._suites:
            suite.sense()
        self.task.look()
        self.randomiser.look()

    def _infos(self, terms: Mapping[str, Mapping[str, float]]) -> dict[str, dict[str, Any]]:
        feasible = self.task.feasible.holds
        shared = {"success": self.task.succeeded(), "feasible": feasible, **self.task.report()}
        shared |= self.told() | (self.company.numbers() if self.company is not None else {})
        same = {name: float(value) for name, value in shared.items()}
        return {
            role: same | {name: float(value) for name, value in own.items()}
            for role, own in terms.items()
        }

    def told(self) -> dict[str, float]:
        """Return what is reported beside the task's report: of perturbations, and of the room."""
        return {**self.randomiser.numbers(), **self._room.numbers()}

    def _checked(self, actions: Mapping[str, Action]) -> dict[str, Array]:
        if self.is_over:
            raise EpisodeError("no episode is running: call reset() before step()")
        if not isinstance(actions, Mapping) or actions.keys() != set(self.agents):
            got = sorted(map(str, actions)) if isinstance(actions, Mapping) else actions
            raise ActionError(f"actions are for {got}, the agents are {sorted(self.agents)}")
        return {role: self._valid(role, actions[role]) for role in self.agents}

    def _valid(self, role: str, given: object) -> Array:
        """Return an action as numbers in its range; ActionError if it cannot be one."""
        wanted = self._spaces[role].shape
        try:
            action = np.asarray(given)
            action = action.astype(np.float64, casting="same_kind")
        except (TypeError, ValueError) as error:
            raise ActionError(f"action of {role!r} is no array of numbers: {error}") from error
        if action.shape != wanted:
            raise ActionError(f"action of {role!r} must have shape {wanted}, got {action.shape}")
        if not math.isfinite(sum(values := action.tolist())):
            raise ActionError(f"action of {role!r} must be finite, got {action}")
        low = self.cast[role].action_low
        if low == 0.0:  # what only pulls cannot push: a sign that the ranges were mixed up
            self._check_excitation(role, values)
        if low <= min(values, default=1.0) and max(values, default=low) <= 1.0:
            return np.array(values)
        return np.array([min(max(value, low), 1.0) for value in values])

    def _check_excitation(self, role: str, values: list[float]) -> None:
        for i, value in enumerate(values):
            if not -ROUNDING <= value <= 1.0 + ROUNDING:
                said = f"action of {role!r}: {self.cast[role].action_names[i]} is {value}"
                raise ActionError(f"{said}, but excitations lie in [0, 1]")

    def render(self) -> npt.NDArray[np.uint8] | None:
        """Return a picture, shape [height, width, 3], or bring the live page up to date.

        Raises:
            EpisodeError: If the environment was made without a render mode.
        """
        if self.render_mode is None:
            raise EpisodeError("made without a render mode: make(..., render_mode='rgb_array')")
        self._check_begun()
        from rcare_marl.rendering import Viewer, make_renderer

        if self.render_mode == "human":
            self._viewer = self._viewer or Viewer(self.world, self.task.view())
            self._viewer.update()
            return None
        self._renderer = self._renderer or make_renderer(self.world)
        return self._renderer.render(self.task.view())

    @property
    def viewer_url(self) -> str | None:
        """Address of the live page, once there is one."""
        return self._viewer.url if self._viewer is not None else None

    def close(self) -> None:
        """Free the physics client and the renderers; safe to call twice."""
        try:
            for part in (self._renderer, self._viewer, *self._suites):
                if part is not None:
                    part.close()
        finally:
            self._renderer = self._viewer = None
            self._suites = ()
            self.agents, self.is_over = [], True
            self.world.close()
