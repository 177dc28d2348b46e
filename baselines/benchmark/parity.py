"""The command `bench parity`: how nearly MuJoCo does what Bullet does, each figure with its bound.

Both engines play the same task with the same seeds and actions. Nothing was chosen by the outcome on these
seeds: what there was to choose was chosen on others.

- `link_pose_m`: greatest distance of any link after a reset;
- `mass_matrix`, `gravity`: greatest difference as a share of the greatest entry, of all bodies that are
  fixed to the ground;
- `arm_rad`, `person_rad`: greatest difference of any joint in 1 s of the same small random actions;
- `press_mean`, `press_peak`: of feeding, the spoon is led to the mouth and pressed on it for 6 s in twenty
  postures. Force is the sum of all normal forces in a physics step; the mean is over steps in touch.
  Both are means over the postures, and the figure is by what share MuJoCo's differs from Bullet's;
- `success_X`, `force_X`, where episodes are asked for: see `engine_episodes`.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import ExitStack, closing, contextmanager
from typing import Any, NamedTuple

import numpy as np

from rcare_marl.agents.people.human import Human
from rcare_marl.agents.robots.robot import Robot
from rcare_marl.body import Body
from rcare_marl.console import console, table
from rcare_marl.engines import ENGINES
from rcare_marl.engines.mujoco_world import MujocoWorld
from rcare_marl.envs import make
from rcare_marl.envs.care_env import CareEnv
from rcare_marl.envs.tasks.feeding import Feeding
from rcare_marl.pose import Array
from rcare_marl.world import GRAVITY

from ..workers import one_count
from . import engine_episodes

BOUNDS = {
    "link_pose_m": 1e-6,
    "mass_matrix": 1e-3,
    "gravity": 1e-3,
    "arm_rad": 0.005,
    "person_rad": 0.001,
    "press_mean": 0.15,
    "press_peak": 0.25,
}
RESETS = 5  # with which the engines are compared step by step
POSTURES = 20
# Seed. On 0 to 5, 100 to 119, 200 to 219 and 300 to 319 it was chosen how contacts are solved.
FIRST_PRESS = 400
ACTION_SCALE = 0.1  # of the action range
LED, PRESSED = 12, 48  # control steps to the mouth, and against it
SPEED, PRESS = 0.6, (-0.3, 0.0, 0.0)  # of the action range
RISE = 1e-5  # [rad or m] by which joints are moved to find what gravity asks of them


class Press(NamedTuple):
    """What pressed on a person.

    Attributes:
        peak: Greatest force of a physics step [N].
        mean: Mean over physics steps in touch [N].
        touch: Time in touch [s].
    """

    peak: float
    mean: float
    touch: float


def bench(
    task: str = "feeding",
    seed: int = 0,
    postures: int = POSTURES,
    episodes: int = 0,
    processes: str = "1",
    policy: str | None = None,
    level: int | None = None,
) -> dict[str, Any]:
    """Return all figures, as plain values for JSON.

    Args:
        task: The task; one that runs on both engines.
        seed: First seed of all but the presses.
        postures: How many are pressed in.
        episodes: Of each shipped policy on each engine.
        processes: How many play these side by side.
        policy: Which of them; all if None.
        level: Of the furniture or door, see `rcare_marl.make`.

    Raises:
        ConfigError: If the count of processes is none.
        UnknownNameError: If there is no such policy.
    """
    side_by_side = one_count("parity", processes)
    with ExitStack() as stack:
        bullet, mujoco = pair = tuple(
            stack.enter_context(closing(make(task, engine=name, level=level))) for name in ENGINES
        )
        values = {"link_pose_m": 0.0, "arm_rad": 0.0, "person_rad": 0.0}
        for number in range(seed, seed + RESETS):
            for env in pair:
                env.reset(seed=number)
            values["link_pose_m"] = max(values["link_pose_m"], _poses_apart(bullet, mujoco))
            if number == seed:
                values |= _dynamics_apart(bullet, mujoco)
                for env in pair:
                    env.reset(seed=number)
            apart = _drift(bullet, mujoco, np.random.default_rng(number))
            values |= {key: max(values[key], value) for key, value in apart.items()}
    result: dict[str, Any] = {"task": task, "level": level, "seed": seed, "resets": RESETS}
    if task == "feeding":
        seeds = range(FIRST_PRESS, FIRST_PRESS + postures)
        pressed = [presses(name, seeds) for name in ENGINES]
        result["presses"] = {"first_seed": FIRST_PRESS, "postures": postures}
        for key in ("mean", "peak", "touch"):
            ours, theirs = (float(np.mean([getattr(p, key) for p in x])) for x in pressed)
            unit = "s" if key == "touch" else "n"
            result["presses"] |= {f"bullet_{key}_{unit}": ours, f"mujoco_{key}_{unit}": theirs}
            if key != "touch":
                values[f"press_{key}"] = abs(theirs / ours - 1.0)
    result["figures"] = {
        key: {"value": values[key], "bound": bound, "met": bool(values[key] <= bound)}
        for key, bound in BOUNDS.items()
        if key in values
    }
    if episodes:
        told, figures = engine_episodes.compare(task, episodes, seed, side_by_side, policy, level)
        result |= {"episodes": episodes, "policies": told, "processes": side_by_side}
        result["figures"] |= figures
    return result | {"met": all(figure["met"] for figure in result["figures"].values())}


def _poses_apart(bullet: CareEnv, mujoco: CareEnv) -> float:
    pairs = zip(bullet.world.bodies, mujoco.world.bodies, strict=True)
    return max(float(np.abs(a.link_poses()[0] - b.link_poses()[0]).max()) for a, b in pairs)


def _dynamics_apart(bullet: CareEnv, mujoco: CareEnv) -> dict[str, float]:
    """Return by what share mass matrices and the weight on joints differ."""
    world = mujoco.world
    assert isinstance(world, MujocoWorld) and world.sim is not None
    found = {"mass_matrix": 0.0, "gravity": 0.0}
    matrix, weights = world.sim.at_rest()
    for number, body in enumerate(bullet.world.bodies):
        if body.is_movable or not body.joints:
            continue
        indices = [joint.index for joint in body.joints.values()]
        dofs = world.sim.places[number].dofs[indices]
        angles = body.joint_states(indices)[0]
        ours = body.mass_matrix(angles)
        theirs = matrix[np.ix_(dofs, dofs)]
        found["mass_matrix"] = max(found["mass_matrix"], _share(theirs, ours))
        found["gravity"] = max(found["gravity"], _share(weights[dofs], _weights(body, angles)))
    return found


def _share(theirs: Array, ours: Array) -> float:
    return float(np.abs(theirs - ours).max() / max(np.abs(ours).max(), 1.0))


def _weights(body: Body, angles: Sequence[float]) -> Array:
    """Return what gravity asks of each joint in Bullet [N·m or N], by a difference of energy."""
    indices, links = [j.index for j in body.joints.values()], range(body.link_count)
    masses = np.array([body.mass(link) for link in links])

    def energy(place: int, way: float) -> float:
        body.set_joints(indices, [a + way * (i == place) for i, a in enumerate(angles)])
        return float(GRAVITY * masses @ body.link_centres(links)[:, 2])

    both = [(energy(i, RISE), energy(i, -RISE)) for i in range(len(indices))]
    body.set_joints(indices, angles)
    return np.array([(up - down) / (2 * RISE) for up, down in both])


def _drift(bullet: CareEnv, mujoco: CareEnv, rng: np.random.Generator) -> dict[str, float]:
    """Return how far joints are apart at most during 1 s of the same actions."""
    apart = {"arm_rad": 0.0, "person_rad": 0.0}
    for _ in range(round(1.0 / bullet.task.control_dt)):
        actions = {
            role: (ACTION_SCALE * rng.uniform(-1, 1, bullet.action_space(role).shape))
            for role in bullet.agents
        }
        for env in (bullet, mujoco):
            env.step({role: action.astype(np.float32) for role, action in actions.items()})
        for role, agent in bullet.cast.items():
            other = mujoco.cast[role]
            if isinstance(agent, Robot) and isinstance(other, Robot):
                key, gaps = (
                    "arm_rad",
                    [
                        arm.positions() - other.arms[name].positions()
                        for name, arm in agent.arms.items()
                    ],
                )
            elif isinstance(agent, Human) and isinstance(other, Human):
                key, gaps = "person_rad", [np.subtract(agent.positions, other.positions)]
            else:
                continue
            apart[key] = max([apart[key], *(float(np.abs(gap).max(initial=0.0)) for gap in gaps)])
        if bullet.is_over or mujoco.is_over:
            break
    return apart


def presses(engine: str, seeds: Sequence[int], *, solver_iterations: int = 0) -> list[Press]:
    """Return what presses the mouth of feeding's recipient, in a posture for each seed.

    Args:
        engine: What computes it.
        seeds: Of the episodes.
        solver_iterations: Of the physics; as usual if 0.
    """
    with closing(make("feeding", engine=engine, options={"force_limit": 1000.0})) as env:
        with _forces(env) as forces:
            return [_press(env, seed, forces, solver_iterations) for seed in seeds]


@contextmanager
def _forces(env: CareEnv) -> Iterator[list[float]]:
    """Write down the force on the recipient in each physics step."""
    assert isinstance(task := env.task, Feeding)
    body, real = task.recipient.body, task.after_substep
    forces: list[float] = []

    def look() -> None:
        real()
        forces.append(env.world.contact_force(body))

    look_on: Callable[[], None] = look
    task.after_substep = look_on  # type: ignore[method-assign]
    try:
        yield forces
    finally:
        task.after_substep = real  # type: ignore[method-assign]


def _press(env: CareEnv, seed: int, forces: list[float], solver_iterations: int) -> Press:
    assert isinstance(task := env.task, Feeding)
    env.reset(seed=seed)
    if solver_iterations:
        env.world.set_solver_iterations(solver_iterations)
    forces.clear()
    for i in range(LED + PRESSED):
        if env.is_over:
            break
        actions = {r: np.zeros(env.action_space(r).shape, np.float32) for r in env.agents}
        if i < LED:
            gap = task.state.mouth - task.state.bowl
            way = SPEED * gap / max(float(np.linalg.norm(gap)), 0.05)
            actions["robot"][:3] = np.clip(way, -1, 1)
        else:
            actions["robot"][:3] = PRESS
        env.step(actions)
    found = np.array(forces)
    touching = found[found > 0.0]
    mean = float(touching.mean()) if len(touching) else 0.0
    return Press(float(found.max(initial=0.0)), mean, len(touching) * env.world.physics_dt)


def show(result: Mapping[str, Any]) -> None:
    """Print what `bench` returned as a table."""
    rows = [
        (key, f"{figure['value']:.3g}", f"{figure['bound']:.3g}", "yes" if figure["met"] else "no")
        for key, figure in result["figures"].items()
    ]
    title = f"{result['task']}: MuJoCo beside Bullet"
    console().print(table(title, ("figure", "value", "bound", "met"), rows))
