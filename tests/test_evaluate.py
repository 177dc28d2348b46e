"""Evaluation: seeded, complete, and the same on every run."""

from __future__ import annotations

import numpy as np
import pytest

import rcare_marl
from rcare_marl.agents.people.behaviour.behaviour_tree import RandomPolicy
from rcare_marl.baselines.evaluation.episode_figure import Recorder
from rcare_marl.baselines.evaluation.evaluate import (
    Evaluation,
    evaluate,
    lead_policies,
    make_players,
    mean_interval,
    played_cast,
    run_episode,
    wilson_interval,
)
from rcare_marl.envs import CareEnv
from rcare_marl.envs.safety import NOBODY
from rcare_marl.errors import ConfigError, UnknownNameError
from rcare_marl.rendering import make_renderer


def run(policy: str, episodes: int, seed: int = 0) -> Evaluation:
    return evaluate("feeding", lead_policies("feeding", policy), episodes=episodes, seed=seed)


@pytest.fixture(scope="module")
def scripted() -> Evaluation:
    return run("scripted", 2)


def test_each_episode_has_the_next_seed(scripted: Evaluation) -> None:
    assert [episode.seed for episode in scripted.episodes] == [0, 1]


def test_every_role_has_a_return(scripted: Evaluation) -> None:
    assert scripted.to_dict()["mean_return"].keys() == {"robot", "recipient"}


def test_scripted_robot_succeeds(scripted: Evaluation) -> None:
    assert scripted.success_rate == 1.0
    assert scripted.to_dict()["time_to_mouth_s_mean"] > 0


def test_random_robot_never_succeeds() -> None:
    result = run("random", 3)
    assert result.success_rate == 0.0
    assert result.policies == {"robot": "random", "recipient": "random"}
    assert result.to_dict()["time_to_mouth_s_mean"] is None


def test_random_stands_for_all_roles_unless_one_is_named() -> None:
    chosen = lead_policies("feeding", "random", {"recipient": "cooperative"})
    assert chosen == {"robot": "random", "recipient": "cooperative", "caregiver": "random"}


def test_partners_play_beside_a_policy() -> None:
    chosen = lead_policies("feeding", "scripted")
    assert chosen == {"robot": "scripted", "recipient": "cooperative", "caregiver": "still"}


def test_random_actions_are_a_function_of_the_seed_and_fill_the_box() -> None:
    policy = RandomPolicy(6)
    policy.reset(np.random.default_rng(5))
    first = np.array([policy.act() for _ in range(200)])
    policy.reset(np.random.default_rng(5))
    np.testing.assert_array_equal(first, [policy.act() for _ in range(200)])
    assert first.shape == (200, 6)
    assert -1 <= first.min() < -0.95 and 0.95 < first.max() <= 1


def test_on_episode_hears_of_every_episode() -> None:
    heard: list[int] = []
    players = lead_policies("toileting", "scripted")
    evaluate("toileting", players, episodes=2, seed=7, on_episode=lambda e: heard.append(e.seed))
    assert heard == [7, 8]


def test_recorder_notes_every_step() -> None:
    env = rcare_marl.make("feeding")
    _, players = make_players(env, "feeding", {})
    record = Recorder()
    episode = run_episode(env, players, 0, on_step=record)
    env.close()
    count = episode.steps + 1
    assert record.time.shape == record.metric("force_n").shape == (count,)
    assert record.torques("robot").shape == (count, 7)
    assert record.time[-1] == pytest.approx(episode.duration)
    assert record.metric("distance_m")[-1] == episode.metrics["distance_m"]


def test_episode_depends_on_its_seed_alone() -> None:
    env = rcare_marl.make("feeding")
    _, players = make_players(env, "feeding", {})
    renderer = make_renderer(env.world, "software")
    first, after, filmed = Recorder(), Recorder(), Recorder()

    def film(env: CareEnv) -> None:
        filmed(env)
        if env.world.step_count % 240 == 0:
            renderer.render(env.task.view())

    episode = run_episode(env, players, 0, on_step=first)
    run_episode(env, players, 1)
    assert run_episode(env, players, 0, on_step=after) == episode
    assert run_episode(env, players, 0, on_step=film) == episode
    assert first.to_dict() == after.to_dict() == filmed.to_dict()
    renderer.close()
    env.close()


def test_unknown_role_is_refused_with_the_known_ones() -> None:
    with pytest.raises(UnknownNameError, match="Did you mean 'recipient'"):
        lead_policies("feeding", "scripted", {"recipent": "still"})


def test_unknown_policy_is_refused_with_a_suggestion() -> None:
    with pytest.raises(UnknownNameError, match="Did you mean 'scripted'"):
        run("scriptd", 1)


def test_role_without_policy_is_refused() -> None:
    env = rcare_marl.make("feeding")
    with pytest.raises(ConfigError, match="no policy for"):
        run_episode(env, {}, 0)
    env.close()


@pytest.mark.parametrize(("episodes", "seed"), [(0, 0), (1, -1)])
def test_impossible_numbers_are_refused(episodes: int, seed: int) -> None:
    with pytest.raises(ConfigError):
        run("random", episodes, seed)


def test_wilson_interval_matches_published_values() -> None:
    # Newcombe (1998), Statistics in Medicine 17, table I, method 3: 81/263, 15/148, 0/20, 1/29.
    for successes, count, low, high in (
        (81, 263, 0.2553, 0.3662),
        (15, 148, 0.0624, 0.1605),
        (0, 20, 0.0, 0.1611),
        (1, 29, 0.0061, 0.1718),
    ):
        assert wilson_interval(successes, count) == pytest.approx((low, high), abs=5e-5)


def test_interval_of_a_mean_is_that_of_student() -> None:
    # Two-sided 95 % quantile of Student's t with 4 degrees of freedom: 2.776, as in any table.
    low, high = mean_interval([1.0, 2.0, 3.0, 4.0, 5.0]) or (0.0, 0.0)
    assert (low, high) == pytest.approx((3 - 2.776 / 2**0.5, 3 + 2.776 / 2**0.5), abs=1e-3)
    assert mean_interval([7.0]) is None and mean_interval([]) is None
    assert mean_interval([2.0, 2.0]) == [2.0, 2.0]


def test_all_measures_have_an_interval_about_their_mean(scripted: Evaluation) -> None:
    numbers = scripted.to_dict()
    for name in (*NOBODY, "distance_m"):
        low, high = numbers[f"{name}_interval_95"]
        assert low <= numbers[f"{name}_mean"] <= high
    for what in ("mean_return", "mean_cost"):
        for role in ("robot", "recipient"):
            low, high = numbers[f"{what}_interval_95"][role]
            assert low <= numbers[what][role] <= high


def test_cost_of_an_episode_is_the_sum_of_its_steps() -> None:
    env = rcare_marl.make("feeding", policies={"recipient": "still"})
    _, players = make_players(env, "feeding", {"robot": "random"})
    seen: list[float] = []
    episode = run_episode(env, players, 3, on_step=lambda e: seen.append(e.task.report()["cost"]))
    assert episode.costs == {"robot": pytest.approx(sum(seen[1:]))}
    assert episode.to_dict()["costs"] == episode.costs
    env.close()


def test_scripts_of_people_with_muscles_act_through_posture_where_nothing_else_is_said() -> None:
    person = {"model": "karan", "actuation": "muscle"}
    played = played_cast("feeding", {"recipient": person, "home": "house_07"}, {})
    fields = {**person, "excitation": "posture", "moves": ["speak"]}
    assert played == {"recipient": fields, "home": "house_07"}
    by_group = {"recipient": {**person, "excitation": "group"}}
    assert played_cast("feeding", by_group, {}) == by_group
    learned = {"recipient": "policy.npz"}
    assert played_cast("feeding", {"recipient": person}, learned) == {"recipient": person}


def test_who_refuses_is_heard() -> None:
    played = evaluate(
        "feeding", {"recipient": "refusing"}, episodes=1, cast={"recipient": "morgan"}
    )
    assert played.success_rate == 1.0 and played.values("refusals") == [3.0]
