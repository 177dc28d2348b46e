"""Many environments as one TorchRL environment, in this process and in workers."""

from __future__ import annotations

import dataclasses
import os
import signal
import subprocess
import sys
import time
from contextlib import closing
from pathlib import Path
from typing import Any

import faulty_partner
import numpy as np
import psutil
import pytest
import torch
from tensordict import TensorDictBase
from torchrl.envs import check_env_specs
from variants import few

import rcare_marl
from rcare_marl.envs.learning import BatchedEnv, EnvRecipe, LearnerEnv, station
from rcare_marl.envs.learning.station import episode_seed
from rcare_marl.errors import (
    ActionError,
    ConfigError,
    EpisodeError,
    RcareError,
    UnknownNameError,
    WorkerError,
)

FEEDING = EnvRecipe("feeding")
TOILETING = EnvRecipe("toileting")  # is made in a tenth of the time
THREE = EnvRecipe(
    "feeding", cast={"robot_0": {}, "robot_1": {}}, learners=("robot_0", "robot_1", "recipient")
)


def drawn(env: BatchedEnv, step: int) -> dict[str, torch.Tensor]:
    """Return an action for every group, a function of the step's number."""
    generator = torch.Generator().manual_seed(step)
    out = {}
    for group in env.groups:
        spec = env.full_action_spec[group, "action"]
        low, high = spec.space.low, spec.space.high
        out[group] = low + (high - low) * torch.rand(spec.shape, generator=generator)
    return out


def played(env: BatchedEnv, steps: range, scale: float = 1.0) -> list[TensorDictBase]:
    """Return what came of random actions, from where a full reset leads."""
    out, now = [], env.reset()
    for step in steps:
        for group, action in drawn(env, step).items():
            now[group, "action"] = scale * action
        done, now = env.step_and_maybe_reset(now)
        out.append(done)
    return out


def assert_equal(first: list[TensorDictBase], second: list[TensorDictBase]) -> None:
    assert len(first) == len(second)
    for step, (one, other) in enumerate(zip(first, second, strict=True)):
        assert set(one.keys(True, True)) == set(other.keys(True, True))
        for key in one.keys(True, True):
            assert torch.equal(one[key], other[key]), f"{key} differs at step {step}"


@pytest.mark.parametrize("recipe", [TOILETING, THREE], ids=["one learner", "three learners"])
def test_the_check_of_torchrl_passes(recipe: EnvRecipe) -> None:
    env = BatchedEnv(recipe, count=2)
    check_env_specs(env, seed=0)
    env.close()


@pytest.mark.slow
def test_the_check_of_torchrl_passes_with_workers() -> None:
    env = BatchedEnv(THREE, count=3, workers=2)
    check_env_specs(env, seed=0)
    env.close()


def test_keys_and_shapes_are_those_promised() -> None:
    env = BatchedEnv(THREE, count=2)
    (step,) = played(env, range(1))
    seen = LearnerEnv(THREE)
    for group, roles in {"robots": 2, "recipients": 1}.items():
        size, width = seen.layout.observation_sizes[group], seen.layout.action_sizes[group]
        assert step[group, "observation"].shape == (2, roles, size)
        assert step[group, "action"].shape == (2, roles, width)
        for key in ("reward", "cost", "done", "terminated", "truncated"):
            assert step["next", group, key].shape == (2, roles, 1), key
        assert step["next", group, "mask"].shape == (2, roles)
    assert step["next", "state"].shape == (2, seen.layout.state_size)
    for key in ("success", "done", "terminated", "truncated"):
        assert step["next", key].shape == (2, 1), key
    seen.close()
    env.close()


def test_the_end_of_an_episode_is_the_true_one_and_the_next_begins_at_once() -> None:
    env, alone = BatchedEnv(FEEDING, count=2, seed=4), LearnerEnv(FEEDING)
    steps = played(env, range(60))
    ends = torch.stack([step["next", "done"] for step in steps]).sum(0)
    place, episode = int(ends.argmax()), 0
    alone.reset(episode_seed(4, place, episode))
    for step in steps:
        assert torch.equal(
            step["robots", "observation"][place],
            torch.from_numpy(alone.observation["robots"]),
        )
        alone.step({"robots": step["robots", "action"][place].numpy()})
        assert torch.equal(
            step["next", "robots", "observation"][place],
            torch.from_numpy(alone.observation["robots"]),
        )
        assert step["next", "robots", "reward"][place, 0, 0] == alone.reward["robots"][0]
        assert step["next", "robots", "cost"][place, 0, 0] == alone.cost["robots"][0]
        assert step["next", "terminated"][place, 0] == alone.terminated
        assert step["next", "truncated"][place, 0] == alone.truncated
        assert step["next", "success"][place, 0] == alone.success
        if alone.terminated or alone.truncated:
            episode += 1
            alone.reset(episode_seed(4, place, episode))
    assert episode > 0
    alone.close()
    env.close()


def test_seeds_of_training_are_never_those_of_evaluation() -> None:
    seeds = {episode_seed(s, i, e) for s in range(3) for i in range(8) for e in range(50)}
    assert len(seeds) == 3 * 8 * 50 and min(seeds) >= 2**31 and max(seeds) < 2**32


def test_a_seed_repeats_and_another_one_differs() -> None:
    env = BatchedEnv(TOILETING, count=1, seed=1)
    first = played(env, range(5))
    env.set_seed(2)
    second = played(env, range(5))
    env.set_seed(1)
    assert_equal(first, played(env, range(5)))
    assert not torch.equal(first[0]["state"], second[0]["state"])
    env.close()


def test_a_reset_hands_over_what_has_begun_and_otherwise_begins_anew() -> None:
    env = BatchedEnv(TOILETING, count=2)
    first = env.reset()["state"]
    assert torch.equal(env.reset()["state"], first)
    (step,) = played(env, range(1))
    chosen = step["next"].clone()
    chosen["_reset"] = torch.tensor([[True], [False]])
    after = env.reset(chosen)["state"]
    assert not torch.equal(after[0], first[0])
    assert torch.equal(after[1], step["next", "state"][1])
    env.close()


def test_workers_give_what_this_process_gives() -> None:
    recipe = EnvRecipe("feeding", residual={"robot": 0.3})
    here, there = BatchedEnv(recipe, count=2), BatchedEnv(recipe, count=2, workers=1)
    assert_equal(played(here, range(10)), played(there, range(10)))
    here.close()
    there.close()


SEED, HALF, WHOLE = 13, 20, 35  # steps; in both parts an episode of the two ends


@pytest.fixture(scope="module")
def uninterrupted() -> list[TensorDictBase]:
    whole = BatchedEnv(FEEDING, count=2, seed=SEED)
    steps = played(whole, range(WHOLE))
    whole.close()
    return steps


@pytest.mark.slow
@pytest.mark.parametrize("workers", few((0, 1), 0))
def test_a_saved_batch_goes_on_bit_for_bit(
    workers: int, uninterrupted: list[TensorDictBase], tmp_path: Path
) -> None:
    expected = uninterrupted
    for part in (expected[:HALF], expected[HALF:]):
        assert sum(int(step["next", "done"].sum()) for step in part) > 0
    half = BatchedEnv(FEEDING, count=2, workers=workers, seed=SEED)
    parts = played(half, range(HALF))
    torch.save(half.state_dict(), tmp_path / "state.pt")
    half.close()
    other = BatchedEnv(FEEDING, count=2, workers=workers, seed=8)
    played(other, range(3))
    other.load_state_dict(torch.load(tmp_path / "state.pt", weights_only=True))
    assert_equal(expected, parts + played(other, range(HALF, WHOLE)))
    other.close()


def test_a_scene_of_mujoco_keeps_no_trace_and_so_is_never_made_anew(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(station, "RENEWAL", 1)
    recipe = dataclasses.replace(FEEDING, engine="mujoco")
    env = BatchedEnv(recipe, count=1, seed=SEED)
    steps = played(env, range(3 * WHOLE))
    number = int(torch.stack([step["next", "done"] for step in steps]).sum())
    state = env.state_dict()
    env.close()
    assert number > 0 and state["environments"][0]["past"] == []
    with closing(LearnerEnv(recipe)) as fresh:  # has seen none of the episodes before
        fresh.reset(episode_seed(SEED, 0, number))
        for row in state["environments"][0]["actions"]:
            fresh.step({"robots": row.numpy()[None]})
        np.testing.assert_array_equal(fresh.state, state["environments"][0]["state"])


@pytest.mark.slow
@pytest.mark.parametrize("task", rcare_marl.task_names())
def test_every_task_goes_on_bit_for_bit(task: str, tmp_path: Path) -> None:
    recipe, long = EnvRecipe(task), 60
    whole = BatchedEnv(recipe, count=1)
    expected = played(whole, range(2 * long), 0.3)
    whole.close()
    half = BatchedEnv(recipe, count=1)
    parts = played(half, range(long), 0.3)
    torch.save(half.state_dict(), tmp_path / "state.pt")
    half.close()
    other = BatchedEnv(recipe, count=1)
    other.load_state_dict(torch.load(tmp_path / "state.pt", weights_only=True))
    assert_equal(expected, parts + played(other, range(long, 2 * long), 0.3))
    other.close()


def test_a_replay_that_leads_elsewhere_is_told() -> None:
    env = BatchedEnv(TOILETING, count=1)
    played(env, range(3))
    state = env.state_dict()
    state["environments"][0]["state"] += 1e-3
    with pytest.warns(RuntimeWarning, match="do not replay alike"):
        env.load_state_dict(state)
    env.close()


def test_a_state_that_does_not_fit_is_refused() -> None:
    one, two = BatchedEnv(TOILETING, count=1), BatchedEnv(TOILETING, count=2)
    played(one, range(2))
    with pytest.raises(ConfigError, match="of 1 environments, here are 2"):
        two.load_state_dict(one.state_dict())
    two.close()
    other = BatchedEnv(FEEDING, count=1)
    with pytest.raises(ConfigError, match="another recipe"):
        other.load_state_dict(one.state_dict())
    one.close()
    other.close()


def test_a_stage_begins_with_the_next_episode_and_is_saved() -> None:
    env = BatchedEnv(FEEDING, count=1)
    env.set_stage({"spread": 0.0})
    first = played(env, range(1))[0]["state"]
    env.set_stage({})
    second = env.reset()["state"]
    env.set_stage({"spread": 0.0})
    third = played(env, range(2))[0]["state"]  # begun before the stage was set
    state = env.state_dict()
    fourth = env.reset()["state"]
    assert torch.allclose(first, fourth, atol=1e-5)
    assert torch.equal(second, third) and not torch.allclose(first, second, atol=1e-3)
    assert state["stage"] == {"spread": 0.0} and state["environments"][0]["stage"] == {}
    with pytest.raises(UnknownNameError, match="Did you mean 'spread'"):
        env.set_stage({"spraed": 1.0})
    with pytest.raises(ConfigError, match="finite"):
        env.set_stage({"spread": float("nan")})
    with pytest.raises(ConfigError, match="spread"):
        env.set_stage({"spread": 3.0})
    env.close()


def test_variants_take_turns_and_must_have_equal_spaces() -> None:
    recipe = EnvRecipe("feeding", variants=({"recipient": "karan"}, {"recipient": "kim"}))
    env, lone = BatchedEnv(recipe, count=2), LearnerEnv(recipe, 1)
    lone.reset(episode_seed(0, 1, 0))
    assert torch.equal(env.reset()["state"][1], torch.from_numpy(lone.state))
    env.close()
    lone.close()
    odd = EnvRecipe("feeding", variants=({}, {"robot": {"control": "joint_delta"}}))
    with pytest.raises(ConfigError, match=r"variants must have equal spaces.*variant 1"):
        BatchedEnv(odd, count=2)


def test_who_is_taught_may_meet_people_by_angles_and_by_muscles() -> None:
    muscles = {"recipient": {"model": "karan", "actuation": "muscle"}}
    recipe = EnvRecipe("feeding", variants=({}, muscles))
    with pytest.raises(ConfigError, match="state_size of variant 1"):
        BatchedEnv(recipe, count=2)
    env = BatchedEnv(dataclasses.replace(recipe, taught=True), count=2)
    state = env.reset()["state"]
    env.close()
    assert torch.isfinite(state).all()
    assert not torch.equal(state[0], state[1])


@pytest.mark.parametrize(
    ("numbers", "said"),
    [
        ({"count": 0}, "count must be a whole number from 1 on"),
        ({"count": 2.0}, "count must be a whole number"),
        ({"workers": -1}, "workers must be a whole number from 0 on"),
        ({"seed": -1}, "seed must be a whole number from 0 on"),
        ({"count": 2, "workers": 3}, "3 workers for 2 environments"),
    ],
)
def test_impossible_numbers_are_refused(numbers: dict[str, Any], said: str) -> None:
    with pytest.raises(ConfigError, match=said):
        BatchedEnv(TOILETING, **numbers)


def test_actions_that_are_no_numbers_move_nobody() -> None:
    env = BatchedEnv(TOILETING, count=2)
    begun = env.reset()
    before = begun["state"].clone()
    begun["robots", "action"] = torch.full((2, 1, 6), float("nan"))
    with pytest.raises(ActionError, match="finite"):
        env.step(begun)
    assert torch.equal(env.reset()["state"], before)
    env.close()


def test_a_closed_batch_says_so_and_closes_twice() -> None:
    env = BatchedEnv(TOILETING, count=1)
    env.close()
    env.close()
    for use in (env.reset, env.state_dict, lambda: env.set_stage({})):
        with pytest.raises(EpisodeError, match="closed"):
            use()


@pytest.mark.slow
@pytest.mark.parametrize(
    ("policy", "said"),
    [
        (faulty_partner.raising, "(?s)worker 0 failed.*act.*the partner cannot count to four"),
        (faulty_partner.dying, "worker 0 died, exit code 7"),
    ],
    ids=["raises", "dies"],
)
def test_a_worker_that_fails_tells_why_and_leaves_nothing(policy: Any, said: str) -> None:
    recipe = EnvRecipe("feeding", cast={"recipient": {"policy": policy}})
    before = set(psutil.Process().children(recursive=True))
    env = BatchedEnv(recipe, count=1, workers=1)
    with pytest.raises(WorkerError, match=said):
        played(env, range(5))
    left = set(psutil.Process().children(recursive=True)) - before
    assert not [process for process in left if "resource_tracker" not in str(process.cmdline())]
    env.close()


def test_bad_input_is_the_same_error_from_a_worker() -> None:
    recipe = EnvRecipe("feeding", cast={"recipient": "nobody"})
    with pytest.raises(RcareError) as here:
        BatchedEnv(recipe, count=1)
    with pytest.raises(type(here.value)) as there:
        BatchedEnv(recipe, count=1, workers=1)
    assert str(there.value) == str(here.value)


SCRIPT = """
from rcare_marl.envs.learning import BatchedEnv, EnvRecipe
if __name__ == "__main__":
    env = BatchedEnv(EnvRecipe("feeding"), count=2, workers=2)
    print("ready", flush=True)
    env.rollout(100_000, break_when_any_done=False)
"""


@pytest.mark.slow
@pytest.mark.parametrize("sign", [signal.SIGINT, signal.SIGTERM, signal.SIGKILL])
def test_no_process_outlives_the_learner(sign: signal.Signals, tmp_path: Path) -> None:
    (tmp_path / "learn.py").write_text(SCRIPT)
    learner = subprocess.Popen(
        [sys.executable, tmp_path / "learn.py"],
        stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL,
        start_new_session=True,
    )
    assert learner.stdout is not None
    while b"ready" not in learner.stdout.readline():
        assert learner.poll() is None
    workers = psutil.Process(learner.pid).children(recursive=True)
    assert len(workers) >= 2
    if sign != signal.SIGKILL:  # as a terminal or a scheduler does, to everybody
        os.killpg(learner.pid, sign)
    else:
        learner.send_signal(sign)
    learner.wait(30)
    learner.stdout.close()
    until = time.monotonic() + 30
    while any(w.is_running() and w.status() != psutil.STATUS_ZOMBIE for w in workers):
        assert time.monotonic() < until, "a worker is left"
        time.sleep(0.1)


def test_numbers_of_a_batch_are_copies() -> None:
    env = BatchedEnv(TOILETING, count=1)
    first, second = played(env, range(2))
    kept = np.array(first["next", "state"])
    played(env, range(2, 4))
    np.testing.assert_array_equal(first["next", "state"], kept)
    assert torch.equal(second["state"], first["next", "state"])
    env.close()
