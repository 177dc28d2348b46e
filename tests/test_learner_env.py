"""One environment as learners see it: recipes, groups, residuals, partners."""

from __future__ import annotations

import json
import pickle
import subprocess
import sys
from collections.abc import Mapping
from typing import Any

import numpy as np
import pytest

from rcare_marl.baselines.evaluation.evaluate import run_episode
from rcare_marl.config import load
from rcare_marl.envs.cast import find_policy
from rcare_marl.envs.learning import EnvRecipe, LearnerEnv
from rcare_marl.errors import ConfigError, UnknownNameError

SEED = 2**31 + 5
CAMERA = {"kind": "camera", "width": 16, "height": 12}


def zeros(env: LearnerEnv) -> dict[str, Any]:
    return {
        group: np.zeros((len(roles), env.layout.action_sizes[group]), np.float32)
        for group, roles in env.groups.items()
    }


def test_a_recipe_survives_json_and_pickle() -> None:
    recipe = EnvRecipe(
        "feeding",
        options={"reward": "shaped"},
        cast={"recipient": "karan", "level": 2, "home": "house_07"},
        variants=({"recipient": "kim"}, {}),
        partners={"recipient": ("still", "behaviour")},
        residual={"robot": 0.3},
    )
    assert load(EnvRecipe, json.loads(json.dumps(recipe.to_dict()))).to_dict() == (recipe.to_dict())
    assert pickle.loads(pickle.dumps(recipe)) == recipe


def test_a_variant_has_its_own_options_over_those_of_all() -> None:
    recipe = EnvRecipe("ambulating", options={"mount": "left"}, variants=({}, _RIGHT))
    for variant, mount in enumerate(("left", "right")):
        with recipe.make(variant) as env:
            assert env.task.options.mount == mount
    with pytest.raises(ConfigError, match="options of a variant must be a mapping"):
        EnvRecipe("ambulating", variants=({"options": "left"},))


_RIGHT = {"level": 2, "options": {"mount": "right"}}


def test_a_recipe_tells_what_it_cannot_write_down() -> None:
    recipe = EnvRecipe("feeding", cast={"recipient": {"policy": lambda env, role: None}})
    with pytest.raises(ConfigError, match=r"cast.recipient.policy cannot be written"):
        recipe.to_dict()


@pytest.mark.parametrize(
    ("fields", "said"),
    [
        ({"task": "feading"}, "Did you mean 'feeding'"),
        ({"learners": ("robto",)}, "Did you mean 'robot'"),
        ({"cast": {"recipeint": "kim"}}, "Did you mean 'recipient'"),
        ({"partners": {"recipient": "cooperativ"}}, "Did you mean 'cooperative'"),
        ({"partners": {"robot": "scripted"}}, "learns, and has a policy too"),
        ({"cast": {"robot": {"policy": "scripted"}}}, "learns, and has a policy too"),
        ({"partners": {"recipient": ()}}, "must be names of policies"),
        (
            {"partners": {"recipient": "still"}, "cast": {"recipient": {"policy": "still"}}},
            "two policies",
        ),
        ({"residual": {"recipient": 0.3}}, "residual is for roles that learn"),
        ({"residual": {"robot": 0.0}}, "above 0"),
        ({"bases": {"robot": "observing"}}, "residual or is taught, among bases"),
        ({"residual": {"robot": float("nan")}}, "above 0"),
        ({"residual": {"robot": [0.0, 0.0]}}, "above 0"),
        ({"residual": {"robot": [0.5, -0.1]}}, "above 0"),
        ({"hold": 0}, "from 1 on"),
        ({"hold": 2.0}, "from 1 on"),
        ({"hold": 2, "taught": True}, "hold must be 1"),
        ({"options": ["shaped"]}, "options must be a mapping"),
        ({"learners": "robot"}, "must be a list"),
    ],
)
def test_a_recipe_refuses_what_cannot_be(fields: Mapping[str, Any], said: str) -> None:
    with pytest.raises((ConfigError, UnknownNameError), match=said):
        EnvRecipe(**{"task": "feeding", **fields})


def test_a_recipe_from_a_file_refuses_unknown_fields() -> None:
    with pytest.raises(UnknownNameError, match="Did you mean 'partners'"):
        load(EnvRecipe, {"task": "feeding", "partner": {}})
    with pytest.raises(ConfigError, match="missing task"):
        load(EnvRecipe, {})


def test_robots_learn_where_nobody_is_named_and_others_are_played() -> None:
    env = EnvRecipe("feeding", cast={"robot_0": {}, "robot_1": {}}).make()
    assert env.possible_agents == ["robot_0", "robot_1"] and list(env.policies) == ["recipient"]
    env.close()


def test_the_learners_environment_does_without_torch() -> None:
    code = "import sys, rcare_marl.envs.learning.worker; sys.exit('torch' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0


def test_groups_hold_what_the_environment_tells_each_role() -> None:
    env = LearnerEnv(EnvRecipe("feeding", learners=("robot", "recipient")))
    care = env.care_env
    env.reset(SEED)
    env.step(zeros(env))
    assert env.groups == {"robots": ("robot",), "recipients": ("recipient",)}
    for group, (role,) in env.groups.items():
        np.testing.assert_array_equal(env.observation[group][0], care.observe(role))
        assert (
            sum(size for _, size in env.layout.observed[group])
            == env.layout.observation_sizes[group]
        )
        assert env.layout.action_sizes[group] == care.cast[role].action_size
        assert env.layout.action_lows[group] == care.cast[role].action_low
    np.testing.assert_array_equal(env.state, care.state())
    env.close()
    env.close()


def test_an_episode_repeats_by_seed_and_actions() -> None:
    env = LearnerEnv(EnvRecipe("feeding", partners={"recipient": ("cooperative", "behaviour")}))
    rng, seen = np.random.default_rng(0), []
    actions = [{"robots": rng.uniform(-1, 1, (1, 6)).astype(np.float32)} for _ in range(8)]
    for seed in (SEED, SEED + 1, SEED):
        env.reset(seed)
        for action in actions:
            env.step(action)
        seen.append(env.observation["robots"].copy())
    np.testing.assert_array_equal(seen[0], seen[2])
    assert not np.array_equal(seen[0], seen[1])
    env.close()


def test_partners_are_drawn_by_episode() -> None:
    env = LearnerEnv(EnvRecipe("feeding", partners={"recipient": ("still", "random")}))
    partner = env.care_env.policies["recipient"]
    drawn = []
    for seed in range(12):
        env.reset(SEED + seed)
        drawn.append(bool(np.any(partner.act())))
    assert {False, True} == set(drawn)
    env.reset(SEED)
    assert bool(np.any(partner.act())) == drawn[0]
    env.close()


@pytest.mark.parametrize("base", ["scripted", "observing"])
def test_a_residual_that_is_zero_is_its_base_itself(base: str) -> None:
    noisy = {"observation_noise": {"m": 0.01}}
    recipe = EnvRecipe("feeding", residual={"robot": 0.3}, bases={"robot": base}, randomise=noisy)
    env = LearnerEnv(recipe)
    assert env.layout.observed["robots"][-1] == ("scripted_action", 6)
    env.reset(SEED)
    steps = 0
    while not (env.terminated or env.truncated):
        env.step(zeros(env))
        steps += 1
    plain = EnvRecipe("feeding", randomise=noisy).make()
    script = find_policy("feeding", "robot", base)(plain, "robot")
    episode = run_episode(plain, {"robot": script}, SEED)
    assert (env.success, steps) == (episode.success, episode.steps)
    np.testing.assert_array_equal(env.state, plain.state())
    plain.close()
    env.close()


def test_a_residual_is_added_within_the_range_of_actions() -> None:
    env = LearnerEnv(EnvRecipe("feeding", residual={"robot": 0.5}))
    given: list[Any] = []
    real = env.care_env.command
    env.care_env.command = lambda actions: given.append(actions["robot"]) or real(actions)  # type: ignore[method-assign, func-returns-value]
    env.reset(SEED)
    base = env.observation["robots"][0, -6:].copy()
    push = np.full((1, 6), 1.0, np.float32)
    env.step({"robots": push})
    np.testing.assert_allclose(given[0], np.clip(base + 0.5, -1, 1), atol=1e-6)
    assert np.any(base + 0.5 > 1) or np.any(given[0] < 1)
    env.close()


def test_a_residual_has_a_scale_for_each_value_and_decides_about_those_above_zero_only() -> None:
    scales = (0.5, 0.0, 0.0, 0.0, 0.0, 0.5)
    env = LearnerEnv(EnvRecipe("feeding", residual={"robot": scales}))
    given: list[Any] = []
    real = env.care_env.command
    env.care_env.command = lambda actions: given.append(actions["robot"]) or real(actions)  # type: ignore[method-assign, func-returns-value]
    env.reset(SEED)
    base = env.observation["robots"][0, -6:].copy()
    assert env.layout.action_sizes == {"robots": 2}
    env.step({"robots": np.full((1, 2), -1.0, np.float32)})
    np.testing.assert_allclose(given[0], np.clip(base - scales, -1, 1), atol=1e-6)
    env.close()
    with pytest.raises(ConfigError, match="2 scales, and an action 6 values"):
        LearnerEnv(EnvRecipe("feeding", residual={"robot": (0.5, 0.5)}))


def test_an_action_that_is_held_is_as_if_it_were_given_so_often_and_sums_what_it_pays() -> None:
    held, plain = (LearnerEnv(EnvRecipe("feeding", hold=hold)) for hold in (3, 1))
    for env in (held, plain):
        env.reset(SEED)
    for action in np.linspace(-0.4, 0.4, 4):
        push = {"robots": np.full((1, 6), action, np.float32)}
        held.step(push)
        paid = np.zeros(1, np.float32)
        for _ in range(3):
            plain.step(push)
            paid += plain.reward["robots"]
        np.testing.assert_allclose(held.reward["robots"], paid, rtol=1e-6)
        np.testing.assert_array_equal(held.state, plain.state)
    held.close()
    plain.close()


def test_demonstrators_are_scripts_and_default_partners() -> None:
    env = LearnerEnv(EnvRecipe("feeding", learners=("robot", "recipient")))
    shown = env.demonstrators()
    assert {role: type(policy).__name__ for role, policy in shown.items()} == {
        "robot": "ScriptedFeeding",
        "recipient": "BehaviourTree",
    }
    env.close()
    env = LearnerEnv(EnvRecipe("feeding", residual={"robot": 0.3}))
    assert not env.demonstrators()["robot"].act().any()
    env.close()


def test_pictures_are_refused_by_name() -> None:
    with pytest.raises(ConfigError, match=r"'robot' observes arrays: camera.*torchrl.make_env"):
        LearnerEnv(EnvRecipe("feeding", cast={"robot": {"sensors": [CAMERA]}}))


def test_a_stage_makes_the_episode_easier_until_it_is_lifted() -> None:
    env = LearnerEnv(EnvRecipe("feeding"))
    env.reset(SEED)
    full, limit = env.state.copy(), env.care_env.task.options.force_limit
    env.reset(SEED, {"spread": 0.0, "force": 2.0})
    eased = env.state.copy()
    assert env.care_env.task.options.force_limit == 2 * limit
    env.reset(SEED + 1, {"spread": 0.0})
    narrowed = env.state.copy()
    env.reset(SEED)
    np.testing.assert_array_equal(env.state, full)
    assert env.care_env.task.options.force_limit == limit
    assert not np.array_equal(eased, full)
    np.testing.assert_allclose(narrowed, eased, atol=1e-5)
    with pytest.raises(UnknownNameError, match="Did you mean 'tolerance'"):
        env.reset(SEED, {"tolerence": 2.0})
    with pytest.raises(ConfigError, match="spread"):
        env.reset(SEED, {"spread": 2.0})
    env.close()
