"""Plans of robots and people: a path round everything, to a posture or to a place of the hand or tool."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, TypeAlias

import numpy as np

from rcare_marl.body import Body
from rcare_marl.errors import ConfigError, PlanningError, check_name, shown
from rcare_marl.model.urdf import Follow
from rcare_marl.planning.clearance import Clearance, Keep, check_installed
from rcare_marl.planning.path import Path, timed
from rcare_marl.planning.search import PLANNERS, Level, Planner, Problem, clock, ways
from rcare_marl.pose import Array, Pose, conjugate, multiply, rotation_vector

from .agent import Agent
from .people.body.goal import Goal
from .people.body.ik import WholeBodyIk
from .people.body.skeleton import DOF_INDEX
from .people.human import Human
from .robots.arm import Arm
from .robots.control import JointDelta, JointPosition, JointVelocity, ToolMotion, ToolPose
from .robots.robot import Robot
from .robots.self_collision import touching_links

if TYPE_CHECKING:
    from .people.profile import Range

Wish: TypeAlias = Mapping[str, float] | Sequence[float] | Array | Pose | Sequence[Pose | Goal]

# All our own choices.
ACCELERATING = (
    0.2  # [s] in which a joint of a robot comes to its greatest speed, as `JointPosition` has it
)
PERSON_SPEED, PERSON_ACCELERATION = 1.5, 5.0  # [rad/s], [rad/s²] of the joints of a person at ease
REACHED = (0.003, 0.03)  # [m], [rad] by which the tool may miss a place
FOUND, ENDS = (
    12,
    4,
)  # postures that reach it: looked for, and the nearest, among which a search may choose
DEEPEST = 0.01  # [m] that a start may be in something
LOOKS = 5  # every which point of a path torques are looked at
HALF_TURN = math.pi  # [rad] of a joint that turns on and on, each way


@dataclass(frozen=True)
class Request:
    """What a path must keep, beside its goal.

    Attributes:
        avoid: Distance from some agents or bodies [m]; None lets it go through one.
        gap: Distance from everything else [m].
        planner: `rrt_connect`, or `bit_star`, which uses all its time for a shorter way.
        within_s: Time to plan on one core [s].
        tilt: By how much what the tool holds may lean from how it is now [rad]; None as far as it will.
        speed: Share of the greatest speeds and accelerations.
        seed: Of the planner's chance.
        arm: Of a robot: which arm; the main one if None.
        kind: Of a person: the `active` range, or the `passive` one in which somebody else moves them.
    """

    avoid: Mapping[Agent | Body, float | None]
    gap: float = 0.005
    planner: Planner = "rrt_connect"
    within_s: float = 2.0
    tilt: float | None = None
    speed: float = 1.0
    seed: int = 0
    arm: str | None = None
    kind: Range = "active"

    def __post_init__(self) -> None:
        check_name("planner", self.planner, PLANNERS)
        check_name("range of a person", self.kind, ("active", "passive"))
        for name, low, high in (("gap", 0.0, 1.0), ("within_s", 0.0, 600.0), ("speed", 0.0, 1.0)):
            if not low <= getattr(self, name) <= high:
                raise ConfigError(f"{name} must be {low:g} to {high:g}, got {getattr(self, name)}")
        if self.tilt is not None and not 0 < self.tilt < 0.5 * math.pi:
            raise ConfigError(f"tilt must be above 0 and below a right angle, got {self.tilt} rad")
        for body, gap in self.avoid.items():
            if gap is not None and not 0 <= gap <= 1:
                raise ConfigError(
                    f"distance from {body.name!r} must be 0 to 1 m or None, got {gap}"
                )


@dataclass(frozen=True)
class _Mover:
    """Joints that are to move, and how."""

    joints: tuple[str, ...]
    start: Array
    lower: Array
    upper: Array
    velocity: Array
    acceleration: Array
    own: frozenset[frozenset[int]]
    followers: Mapping[str, Follow]
    link: str | None = None
    load: _Load | None = None


class _Load:
    """What the motors of an arm bear, with what its hand holds."""

    def __init__(self, arm: Arm) -> None:
        self._arm, (self._mass, self._moment) = arm, arm.payload()
        self._none = np.zeros(len(arm))
        self._most = np.maximum(arm.effort, np.abs(self._weight(arm.positions())))

    def _weight(self, posture: Array) -> Array:
        """Return the torques of the motors that hold a posture [N·m or N], shape [n]."""
        chain = self._arm.chain
        own = self._none if self._arm.counterbalanced else chain.gravity_torques(posture)
        if not self._mass:
            return own
        return own + chain.load_torques(posture, self._mass, self._moment)

    def is_borne(self, posture: Array) -> bool:
        """Return whether the motors can hold a posture, or bear no more than at the start."""
        return bool((np.abs(self._weight(posture)) <= self._most + 1e-9).all())

    def share(self, positions: Array, accelerations: Array) -> float:
        """Return what accelerations need of what is left beside the weight, at most; speed terms left out.

        A tenth of the effort always counts as left, see `Arm.room`.
        """
        arm, worst = self._arm, 0.0
        for posture, acceleration in zip(positions[::LOOKS], accelerations[::LOOKS], strict=True):
            here = arm.chain.jacobian(posture)[:3]
            need = arm.inertial_torques(posture, acceleration)
            need = need + self._mass * here.T @ (here @ acceleration)
            worst = max(worst, float((np.abs(need) / arm.room(self._weight(posture))).max()))
        return worst


def plan(agent: Agent, goal: Wish, request: Request) -> Path:
    """Return a path of an agent to a goal, from where it is now; nothing moves.

    Raises:
        PlanningError: If there is none, or none was found in time.
        ConfigError: If the goal is not one for this agent.
        MissingPackageError: If the extra `plan` is not installed.
    """
    check_installed()
    begin = clock()
    mover, problem = _problem(agent, goal, request)
    _check_start(agent, problem)
    problem = replace(problem, goals=_ends(agent, goal, request, problem))
    rates = request.speed * mover.velocity, request.speed * mover.acceleration
    for way in ways(problem, request.planner, begin + request.within_s, request.seed):
        times, positions = timed(way, *rates, mover.load.share if mover.load else None)
        if problem.holds_along(positions):
            return Path(
                mover.joints,
                times,
                positions,
                clock() - begin,
                way,
                len(way) == 2,
                lambda left: _problem(agent, goal, request)[1].holds_along(left),
                lambda: plan(agent, goal, request),
            )
    raise PlanningError(
        f"{agent.name!r} finds no way to its goal in {request.within_s:g} s: give it more time "
        "(within_s), smaller distances to keep (gap, avoid), or more tilt"
    )


def follow(agent: Agent, path: Path, duration: float) -> Iterator[Array]:
    """Yield the actions that lead along a path, each as the agent is when it is asked for."""
    steps = int(math.ceil(path.duration / duration - 1e-9))
    for k in range(1, steps + 1):
        target = path.at(k * duration)
        if isinstance(agent, Human):
            yield agent.action_towards(
                dict(zip(path.joints, target.tolist(), strict=True)), duration
            )
        else:
            yield _leading(agent, path.joints, target, duration)


def _leading(agent: Agent, joints: tuple[str, ...], target: Array, duration: float) -> Array:
    """Return the action of a robot that leads one arm to `target` [rad or m], shape [n]; all else is 0."""
    assert isinstance(agent, Robot)  # who has a path is that or a person
    out, first = np.zeros(agent.action_size), 0
    for part in agent.parts.values():
        control, arm = part.control, part.joints
        own = slice(first, first + control.size)
        first = own.stop
        if not isinstance(arm, Arm) or arm.names != joints:
            continue
        if isinstance(control, JointPosition):
            out[own] = control.action_for(target)
        elif isinstance(control, JointDelta | JointVelocity):
            out[own] = (target - arm.positions()) / (control.max * duration)
        elif isinstance(control, ToolPose):
            out[own] = control.action_for(arm.chain.tip_pose(target))
        elif isinstance(control, ToolMotion):
            now, then = (arm.chain.tip_pose(posture) for posture in (arm.positions(), target))
            turn = rotation_vector(multiply(then.quaternion, conjugate(now.quaternion)))
            way = np.subtract(then.position, now.position)
            out[own] = control.action(way / duration, turn / duration)
        else:
            raise ConfigError(
                f"{type(control).__name__} cannot follow a path: choose joint_position"
            )
    return np.clip(out, -1.0, 1.0)


def posed(agent: Agent, request: Request) -> Problem:
    """Return what postures of an agent must hold in the world as it is now; it has no goals yet.

    Raises:
        MissingPackageError: If the extra `plan` is not installed.
    """
    return _problem(agent, (), request)[1]


def _problem(agent: Agent, goal: Wish, request: Request) -> tuple[_Mover, Problem]:
    """Return who is to move, and what a way must hold in the world as it is now."""
    mover = (
        _of_person(agent, goal, request) if isinstance(agent, Human) else _of_robot(agent, request)
    )
    bodies = {
        each.body if isinstance(each, Agent) else each: gap for each, gap in request.avoid.items()
    }
    keep = Keep(request.gap, bodies, mover.own)
    clear = Clearance(agent.world, agent.body, mover.joints, keep, followers=mover.followers)
    clear.allow(mover.start)
    level = None
    if request.tilt is not None:
        if mover.link is None:
            raise ConfigError(
                f"{agent.name!r} has no tool that could be kept level: tilt is for robots"
            )
        up = clear.link_turn(mover.link, mover.start).T @ (0.0, 0.0, 1.0)
        level = Level(mover.link, up, request.tilt)
    bears = mover.load.is_borne if mover.load else None
    return mover, Problem(clear, mover.start, (), mover.lower, mover.upper, level, bears)


def _of_robot(agent: Agent, request: Request) -> _Mover:
    if not isinstance(agent, Robot):
        raise ConfigError(f"{agent.name!r} is neither a robot nor a person, and has no plans")
    name = request.arm or next(iter(agent.arms), "")
    check_name(f"arm of {agent.name!r} that moves", name, agent.arms)
    arm, body = agent.arms[name], agent.body
    start = arm.positions()
    lower = np.where(np.isinf(arm.lower), start - HALF_TURN, np.minimum(arm.lower, start))
    upper = np.where(np.isinf(arm.upper), start + HALF_TURN, np.maximum(arm.upper, start))
    touching = touching_links(agent.files.model, body, agent.hands)
    apart = frozenset(
        frozenset(pair)
        for pair in itertools.combinations(body.solid_links(), 2)
        if (body.link_names[pair[0]], body.link_names[pair[1]]) not in touching
    )
    return _Mover(
        arm.names,
        start,
        lower,
        upper,
        arm.velocity,
        arm.velocity / ACCELERATING,
        apart,
        agent.assembly.followers,
        agent.assembly.tools[name],
        _Load(arm),
    )


def _of_person(person: Human, goal: Wish, request: Request) -> _Mover:
    names = tuple(goal) if isinstance(goal, Mapping) else person.movable
    for dof in names:
        check_name("movable degree of freedom", dof, person.movable)
    places = [person.movable.index(dof) for dof in names]
    limits = getattr(person, request.kind)[places]
    joints = [person.body.joint(dof).index for dof in names]
    start = np.array(person.body.joint_states(joints)[0])
    return _Mover(
        names,
        start,
        np.minimum(limits[:, 0], start),
        np.maximum(limits[:, 1], start),
        np.full(len(names), PERSON_SPEED),
        np.full(len(names), PERSON_ACCELERATION),
        frozenset(frozenset(pair) for pair in person.body.meeting),
        {},
    )


def _check_start(agent: Agent, problem: Problem) -> None:
    """Refuse to plan for who is deep in something."""
    deep = [each for each in problem.clear.too_near if each[2] < -DEEPEST]
    if deep:
        raise PlanningError(f"{agent.name!r} cannot plan: {_told(deep)} at the start")


def _told(offenders: Sequence[tuple[str, str, float]]) -> str:
    a, b, gap = offenders[0]
    how = f"is {1e3 * gap:.0f} mm from" if gap >= 0 else f"is {-1e3 * gap:.0f} mm deep in"
    return f"{a} {how} {b}"


def _ends(agent: Agent, goal: Wish, request: Request, problem: Problem) -> list[Array]:
    """Return postures that meet the goal and hold; PlanningError if there are none."""
    tried: list[Array] = []
    found: list[Array] = []
    for posture in _wished(agent, goal, request, problem):
        tried.append(posture)
        if problem.holds(posture):
            found.append(posture)
            if len(found) == FOUND:
                break
    if found:
        return sorted(found, key=lambda end: float(np.abs(end - problem.start).max()))[:ENDS]
    if not tried:
        raise PlanningError(f"{agent.name!r} cannot reach the goal, whatever stands there")
    best = tried[0]
    if problem.level is not None and not problem.level.holds(problem.clear, best):
        raise PlanningError(f"what {agent.name!r} holds would lean too far at the goal")
    if problem.bears is not None and not problem.bears(best):
        raise PlanningError(
            f"the motors of {agent.name!r} cannot hold the goal: it is too heavy there"
        )
    if offenders := problem.clear.offenders(best):
        raise PlanningError(f"{agent.name!r} cannot be at the goal: there {_told(offenders)}")
    raise PlanningError(f"the goal of {agent.name!r} is outside the limits of its joints")


def _wished(agent: Agent, goal: Wish, request: Request, problem: Problem) -> Iterator[Array]:
    """Yield postures that meet the goal, as far as it is known."""
    start = problem.start
    if isinstance(agent, Human):
        if not isinstance(goal, Mapping):
            wanted = [] if isinstance(goal, Pose) else [g for g in goal if isinstance(g, Goal)]
            if isinstance(goal, Pose) or not wanted or len(wanted) != len(goal):
                raise ConfigError(
                    f"a goal of {agent.name!r} is angles by DoF or goals of `WholeBodyIk`, "
                    f"got {shown(goal)}"
                )
            angles = agent.angles.copy()
            angles[[DOF_INDEX[dof] for dof in problem.clear.joints]] = start
            ik = WholeBodyIk.of(agent, kind=request.kind)
            solved = ik.solve(wanted, angles, agent.pelvis, seed=request.seed)
            if not solved.success:
                return
            goal = solved.wish
        yield np.array([goal[dof] for dof in problem.clear.joints], np.float64)
        return
    assert isinstance(agent, Robot)  # or there is no problem
    arm = agent.arms[request.arm or next(iter(agent.arms))]
    poses = [goal] if isinstance(goal, Pose) else [g for g in goal if isinstance(g, Pose)]
    if poses:
        arm.track()
        for together in zip(*(arm.solutions(pose, start) for pose in poses), strict=True):
            for found in together:
                if found.is_within(*REACHED):
                    near = _near(found.posture, start, arm.upper)
                    yield from same_but_for_turns(near, problem.lower, problem.upper)
        return
    if isinstance(goal, Mapping):
        for name in goal:
            check_name(f"joint of {agent.name!r}", name, arm.names)
        postures = np.array([[goal.get(n, p) for n, p in zip(arm.names, start, strict=True)]])
    else:
        postures = np.atleast_2d(np.asarray(goal, np.float64))
    if postures.shape[1:] != start.shape or not np.isfinite(postures).all():
        raise ConfigError(
            f"a posture of {agent.name!r} has {len(start)} numbers, got {shown(goal)}"
        )
    for posture in postures:
        yield _near(posture, start, arm.upper)


def same_but_for_turns(posture: Array, lower: Array, upper: Array) -> list[Array]:
    """Return all postures within limits that are the same but for full turns of joints.

    Args:
        posture: A posture [rad or m], shape [n].
        lower: Lower limits, shape [n]; finite.
        upper: Upper limits, shape [n]; finite.
    """
    turn, near = 2 * np.pi, 1e-9
    places = [
        place
        + turn
        * np.arange(
            np.ceil((low - near - place) / turn), np.floor((high + near - place) / turn) + 1
        )
        for place, low, high in zip(posture, lower, upper, strict=True)
    ]
    return [np.array(each) for each in itertools.product(*places)]


def _near(posture: Array, start: Array, upper: Array) -> Array:
    """Return a posture with joints that turn on and on less than half a turn from the start."""
    turns = np.where(np.isinf(upper), np.rint((posture - start) / (2 * np.pi)), 0.0)
    return np.asarray(posture - 2 * np.pi * turns)
