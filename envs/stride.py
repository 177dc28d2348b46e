"""The physics steps of a control step.

On Bullet, and wherever something must be decided or looked at in Python between two steps, they are a loop
of Python. On MuJoCo all steps until somebody is touched run as one piece of compiled code, where torques
alone drive people and robots push steadily.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numba
import numpy as np

from rcare_marl.agents.agent import Agent
from rcare_marl.agents.people.actuation.skeletal import ANGLES, OUT, RATES, STATE, torques_of
from rcare_marl.agents.people.body.end_stops import stop
from rcare_marl.agents.people.human import Human
from rcare_marl.agents.robots.control.tool_delta import ToolDelta
from rcare_marl.agents.robots.robot import Robot
from rcare_marl.engines.bullet_rows import physics_step
from rcare_marl.errors import ConfigError, check_type, shown
from rcare_marl.tree.least_squares import put
from rcare_marl.world import World

Call = Callable[[], None]
Stride = Callable[[int], None]
MOST_SUBSTEPS = 1000  # our own choice: beyond that a step would seem never to end


def make_stride(
    world: World,
    cast: Mapping[str, Agent],
    looks: Sequence[Call],
    touching: Sequence[Human] | None,
) -> Stride:
    """Return what makes physics steps, given how many.

    Args:
        world: The world, whose start is marked.
        cast: Everybody who acts.
        looks: What is called after each physics step.
        touching: Of whom alone touches tell `looks` anything; None if something else does.
    """
    acting = [agent for agent in cast.values() if agent.needs_actuation]
    if touching is not None and world.is_compiled:
        people = [agent for agent in acting if isinstance(agent, Human)]
        pushes = [_steady(agent) for agent in acting if isinstance(agent, Robot)]
        driven = [person.compiled() for person in people]
        if None not in driven and None not in pushes:
            steady = [control for push in pushes for control in push or ()]
            return _CompiledStride(world, people, driven, steady, looks, touching)
    acts = tuple(  # of robots their parts: a call less in every physics step
        act for a in acting for act in (a.acting if isinstance(a, Robot) else (a.actuate,))
    )
    return _plain_stride(world.step, acts, tuple(looks))


def _plain_stride(step: Call, acts: tuple[Call, ...], looks: tuple[Call, ...]) -> Stride:
    def take(steps: int) -> None:
        for _ in range(steps):
            for act in acts:
                act()
            step()
            for look in looks:
                look()

    return take


def _steady(robot: Robot) -> list[ToolDelta] | None:
    """Return what pushes steadily between two commands, None if something else acts too."""
    controls = [part.control for part in robot.parts.values()]
    steady = [c for c in controls if isinstance(c, ToolDelta) and c.is_steady]
    return steady if len(steady) == len(robot.acting) else None


class _CompiledStride:
    """Makes physics steps in MuJoCo, as many at once as nobody is touched in."""

    def __init__(
        self,
        world: Any,
        people: Sequence[Human],
        driven: Sequence[Any],
        steady: Sequence[ToolDelta],
        looks: Sequence[Call],
        touching: Sequence[Human],
    ) -> None:
        """Take a `MujocoWorld`, people with what drives them, and what robots push with."""
        self._world, self._sim, self._looks = world, world.sim, tuple(looks)
        places = [world.places(person.body, person.joint_indices) for person in people]
        self._people = tuple((*d, *where) for d, where in zip(driven, places, strict=True)) or None
        arms = [(control, control.steady[0]) for control in steady]
        self._arms = [(c, world.places(arm.body, arm.indices)[1]) for c, arm in arms]
        self._watched = np.array([world.number(p.body) for p in touching], np.int64)
        self._hold, self._before = np.zeros((2, self._sim.model.nv))

    def __call__(self, steps: int) -> None:
        hold, before = self._hold, self._before
        hold[:] = 0.0
        for control, dofs in self._arms:
            hold[dofs] += control.steady[1]
        while steps > 0:
            made = _advance(steps, self._sim.compiled, self._people, hold, before, self._watched)
            self._world.stepped(made)
            for control, dofs in self._arms:
                control.pass_steps(made, before[dofs])
            for look in self._looks:
                look()
            steps -= made


@numba.njit(cache=True, nogil=True, error_model="numpy")
def _advance(steps, scene, people, hold, before, watched):  # type: ignore[no-untyped-def]
    """Make physics steps until one in which a watched body is touched, and return how many.

    Args:
        steps: At most so many.
        scene: See `Simulation.compiled`.
        people: Of each what drives it, ends of joints, and places of the joints in `qpos` and `qvel`; None
            for nobody.
        hold: What robots push each degree of freedom with [N·m or N], shape [nv].
        before: Of each the speed before the last step, shape [nv], written.
        watched: Numbers of bodies.
    """
    places, state, inertia, rules, near, kept, felt, touched = scene
    positions, velocities, applied = state[0], state[1], state[2]
    for step in range(steps):
        put(velocities, before)
        if people is not None:
            for person in people:
                drive, ends, at, dofs = person
                angles, rates, torques = drive[STATE][ANGLES], drive[STATE][RATES], drive[OUT]
                for i in range(len(at)):
                    angles[i], rates[i] = positions[at[i]], velocities[dofs[i]]
                stop(ends, angles, rates)
                torques_of(drive)
                for i in range(len(at)):
                    positions[at[i]], velocities[dofs[i]] = angles[i], rates[i]
                    applied[dofs[i]] += torques[i]
        applied += hold
        physics_step(places, state, inertia, rules, near, kept, felt, touched)
        applied[:] = 0.0
        for body in watched:
            if touched[body]:
                return step + 1
    return steps


def substeps(control_dt: float, physics_dt: float) -> int:
    """Return how many physics steps a control step has; ConfigError if that is no possible number."""
    seconds = f"a positive number of seconds, {control_dt / MOST_SUBSTEPS:g} to {control_dt:g}"
    check_type("physics_dt", physics_dt, (int, float), seconds)
    if not control_dt / MOST_SUBSTEPS <= physics_dt <= control_dt:
        raise ConfigError(f"physics_dt must be {seconds}, got {shown(physics_dt)}")
    count = round(control_dt / physics_dt)
    if abs(count * physics_dt - control_dt) > 1e-9:
        raise ConfigError(f"control_dt {control_dt} s is no multiple of physics_dt {physics_dt} s")
    return count
