"""Promises of an environment whatever the task, shown with feeding, and its forms for other libraries."""

from __future__ import annotations

import hashlib
import inspect
import subprocess
import sys
from collections.abc import Callable
from typing import Any, cast

import gymnasium
import numpy as np
import pybullet
import pytest
from gymnasium.utils.env_checker import check_env as gymnasium_check

import rcare_marl
from rcare_marl.envs.care_env import CareEnv
from rcare_marl.errors import ActionError, ConfigError, EpisodeError, UnknownNameError


def zero(env: CareEnv) -> dict[str, Any]:
    return {role: np.zeros(env.action_space(role).shape, np.float32) for role in env.agents}


def digest() -> str:
    """Return a digest of all states of two seconds of an episode."""
    env = rcare_marl.make("feeding")
    sha = hashlib.sha256()
    env.reset(seed=11)
    rng = np.random.default_rng(0)
    while env.agents and env.world.time < 2:
        actions: Any = {
            role: rng.uniform(-0.2, 0.2, env.action_space(role).shape) for role in env.agents
        }
        env.step(actions)
        sha.update(env.state().tobytes())
    env.close()
    return sha.hexdigest()


def test_a_seed_repeats_an_episode_bit_for_bit_in_another_process() -> None:
    source = inspect.getsource(digest)
    script = f"import hashlib\nimport numpy as np\nimport rcare_marl\n{source}\nprint(digest())"
    run = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True)
    assert run.stdout.split()[-1] == digest()


def test_a_task_that_asks_the_engine_is_found_out() -> None:
    env = rcare_marl.make("feeding")
    env.reset(seed=0)
    env.close()
    with pytest.raises(pybullet.error):
        env.cast["robot"].body.base_pose()


# Actions held for 1.5 s reach the person. Random torques are left out: 1800 N go 3 cm deep.
@pytest.mark.parametrize(
    ("control", "held", "steps"),
    [
        pytest.param("tool_delta", 1, 10_000, marks=pytest.mark.slow),
        pytest.param("tool_delta", 15, 1_000, marks=pytest.mark.slow),
        ("tool_delta", 15, 450),
        pytest.param("joint_velocity", 15, 1_000, marks=pytest.mark.slow),
    ],
)
def test_random_actions_stay_sane(control: str, held: int, steps: int) -> None:
    psutil = pytest.importorskip("psutil")
    env = rcare_marl.make("feeding", robot={"control": control})
    rng, process = np.random.default_rng(0), psutil.Process()
    robot, spoon = (b for b in env.world.bodies if b.name in ("robot", "spoon"))
    person = next(b for b in env.world.bodies if b.name == "recipient")
    distances, used, look = list[float](), [], env.task.after_substep

    def measure() -> None:
        look()
        touching = [*env.world.contacts(robot, person), *env.world.contacts(spoon, person)]
        distances.extend(contact.distance for contact in touching)

    env.task.after_substep = measure  # type: ignore[method-assign]
    env.reset(seed=0)
    actions: Any = {}
    for step in range(steps):
        if env.is_over:
            env.reset(seed=step)
        if step % held == 0:
            actions = {r: rng.uniform(-1, 1, env.action_space(r).shape) for r in env.agents}
        observations, rewards, _, _, infos = env.step(actions)
        assert all(np.isfinite(value).all() for value in observations.values())
        assert all(np.isfinite(value) for value in rewards.values())
        assert all(np.isfinite(list(info.values())).all() for info in infos.values())
        if step in (steps // 5, steps - 1):
            used.append(process.memory_info().rss)
    env.close()
    assert held == 1 or distances, "nothing reached the person"
    assert min(distances, default=0.0) > -0.01
    assert used[1] - used[0] < 2e6


def test_an_env_can_be_made_and_closed_many_times() -> None:
    for _ in range(3):
        env = rcare_marl.make("feeding")
        env.reset(seed=0)
        env.close()
        env.close()
    with pytest.raises(EpisodeError, match="closed"):
        env.reset()


def test_a_step_before_reset_or_after_the_end_is_refused() -> None:
    env = rcare_marl.make("feeding", policies={"robot": "scripted", "recipient": "cooperative"})
    with pytest.raises(EpisodeError, match="reset"):
        env.step({})
    env.reset(seed=0)
    while not env.is_over:
        env.step({})
    with pytest.raises(EpisodeError, match="reset"):
        env.step({})
    env.reset(seed=0)
    env.step({})
    env.close()


@pytest.mark.parametrize(
    ("call", "error", "message"),
    [
        (lambda: rcare_marl.make("feedin"), UnknownNameError, "Did you mean 'feeding'"),
        (lambda: rcare_marl.make("feeding", robt="kinova_gen3"), UnknownNameError, "'robot'"),
        (lambda: rcare_marl.make("feeding", robot="kinova"), UnknownNameError, "kinova_gen3"),
        (lambda: rcare_marl.make("feeding", recipient="karen"), UnknownNameError, "'karan'"),
        (lambda: rcare_marl.make("feeding", recipient=None), ConfigError, "cannot do without"),
        (lambda: rcare_marl.make("feeding", robot=cast(Any, 3)), ConfigError, "expected a name"),
        (
            lambda: rcare_marl.make("feeding", robot={"control": "tool"}),
            UnknownNameError,
            "tool_delta",
        ),
        (
            lambda: rcare_marl.make("feeding", robot={"controll": "tool_delta"}),
            UnknownNameError,
            "'control'",
        ),
        (
            lambda: rcare_marl.make("feeding", recipient={"movable": ["elbow"]}),
            UnknownNameError,
            "left_elbow",
        ),
        (
            lambda: rcare_marl.make("feeding", policies={"robot": "skripted"}),
            UnknownNameError,
            "'scripted'",
        ),
        (lambda: rcare_marl.make("feeding", policies={"robot": 3}), ConfigError, "policy"),
        (
            lambda: rcare_marl.make("feeding", policies={"nurse": "still"}),
            UnknownNameError,
            "nurse",
        ),
        (
            lambda: rcare_marl.make("feeding", options={"rewrd": "paper"}),
            UnknownNameError,
            "reward",
        ),
        (
            lambda: rcare_marl.make("feeding", options={"reward": "papr"}),
            UnknownNameError,
            "'paper'",
        ),
        (lambda: rcare_marl.make("feeding", options={"force_limit": -1}), ConfigError, "positive"),
        (lambda: rcare_marl.make("feeding", physics_dt=0.03), ConfigError, "multiple"),
        (lambda: rcare_marl.make("feeding", render_mode="rgb"), UnknownNameError, "rgb_array"),
    ],
)
def test_a_wrong_argument_of_make_is_named(
    call: Callable[[], Any], error: type[Exception], message: str
) -> None:
    with pytest.raises(error, match=message):
        call()


class Broken:
    """A policy whose action is not finite."""

    def reset(self, rng: np.random.Generator) -> None:
        pass

    def act(self) -> np.ndarray:
        return np.full(9, np.nan)


def test_a_policy_with_a_bad_action_is_named_and_nothing_moves() -> None:
    env = rcare_marl.make("feeding", policies={"recipient": lambda env, role: Broken()})
    env.reset(seed=0)
    before = env.state()
    with pytest.raises(ActionError, match="recipient"):
        env.step(zero(env))
    np.testing.assert_array_equal(before, env.state())
    env.close()


@pytest.mark.parametrize(
    ("kwargs", "message"),
    [
        ({"recipient": {"posture": "standing"}}, "must sit in the wheelchair"),
        ({"recipient": {"posture": "bed_supine"}}, "must sit in the wheelchair"),
        (
            {"recipient": {"movable": ["head"]}, "policies": {"recipient": "cooperative"}},
            "jaw_opening",
        ),
        (
            {"recipient": {"policy": "still"}, "policies": {"recipient": "cooperative"}},
            "two policies",
        ),
        ({"options": [1]}, "options must be a mapping"),
        ({"policies": ["still"]}, "policies must be a mapping"),
        ({"physics_dt": "fast"}, "positive number"),
    ],
)
def test_a_scene_that_cannot_be_played_is_refused(kwargs: Any, message: str) -> None:
    with pytest.raises(ConfigError, match=message):
        rcare_marl.make("feeding", **kwargs)


def test_there_is_nothing_to_see_before_the_first_reset_and_after_closing() -> None:
    env = rcare_marl.make("feeding", render_mode="rgb_array")
    for look in (env.state, env.render, lambda: env.observe("robot")):
        with pytest.raises(EpisodeError, match="reset"):
            look()
    env.reset(seed=0)
    env.close()
    for look in (env.state, env.render):
        with pytest.raises(EpisodeError, match="closed"):
            look()


def test_the_gymnasium_form_keeps_the_policy_of_the_cast() -> None:
    env: Any = gymnasium.make("rcare_marl/Feeding-v0", recipient={"policy": "still"}).unwrapped
    assert type(env.care_env.policies["recipient"]).__name__ == "StayStill"
    env.close()


# The other ways in.


@pytest.mark.parametrize("role", ["robot", pytest.param("recipient", marks=pytest.mark.slow)])
def test_the_gymnasium_form_passes_both_checkers(role: str) -> None:
    from stable_baselines3.common.env_checker import check_env as baselines3_check

    env = gymnasium.make("rcare_marl/Feeding-v0", role=role)
    gymnasium_check(env.unwrapped, skip_render_check=True)
    baselines3_check(env.unwrapped)
    env.close()


def test_the_gymnasium_form_needs_one_learner() -> None:
    with pytest.raises(ConfigError, match="one role must be left"):
        gymnasium.make("rcare_marl/Feeding-v0", policies={"robot": "scripted"})


@pytest.mark.parametrize("policies", [{}, {"recipient": "cooperative"}, {"robot": "scripted"}])
def test_the_torchrl_form_passes_its_check(policies: dict[str, str]) -> None:
    from torchrl.envs import check_env_specs

    from rcare_marl.envs.torchrl import make_env

    env = make_env("feeding", policies=policies)
    check_env_specs(env)
    rollout = env.rollout(5)
    assert rollout.batch_size[0] >= 1
    env.close()


def test_torchrl_groups_are_kinds_of_agents() -> None:
    from rcare_marl.envs.torchrl import group_map

    env = rcare_marl.make("feeding", caregiver="caregiver")
    assert group_map(env) == {
        "robots": ["robot"],
        "recipients": ["recipient"],
        "caregivers": ["caregiver"],
    }
    env.close()
