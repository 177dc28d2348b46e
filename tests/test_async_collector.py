"""Workers at their own pace, `async://N`: what may be asked of them, and what two of them collect."""

from __future__ import annotations

import multiprocessing
import os
import signal
from typing import Any

import numpy as np
import pytest
import torch

from rcare_marl.baselines.algorithms.network import Actor, ExploringPolicy, group_shapes
from rcare_marl.baselines.training.cluster import async_count
from rcare_marl.baselines.training.collector import make_collector, shut_down
from rcare_marl.baselines.training.config import TrainConfig
from rcare_marl.baselines.training.trainer import Trainer
from rcare_marl.envs.learning import BatchedEnv, EnvRecipe
from rcare_marl.errors import ConfigError, WorkerError

ENVS, STEPS, WORKERS = 4, 5, 2  # steps of each environment in a batch


def test_the_number_of_workers_is_read() -> None:
    assert async_count("async://2", 8) == 2
    assert async_count("ray://local:2", 8) is None


@pytest.mark.parametrize("text", ["async://", "async://0", "async://two", "async://-1"])
def test_workers_without_a_number_are_refused(text: str) -> None:
    with pytest.raises(ConfigError, match="'async://N' for N processes"):
        async_count(text, 8)


def test_environments_that_do_not_divide_are_refused() -> None:
    with pytest.raises(ConfigError, match="8 environments do not divide among 3 .* 6 or 9"):
        TrainConfig(task="toileting", envs=8, workers="async://3")


def test_who_learns_from_its_present_policy_only_is_refused() -> None:
    with pytest.raises(ConfigError, match="ppo learns from what its present policy did"):
        TrainConfig(task="toileting", algo="ppo", workers="async://2")


def test_a_curriculum_is_refused() -> None:
    from rcare_marl.baselines.training.config import CurriculumConfig, Stage

    stages = CurriculumConfig(stages=(Stage(spread=0.5),))
    with pytest.raises(ConfigError, match="a curriculum cannot reach 'async://2'"):
        TrainConfig(task="toileting", curriculum=stages, workers="async://2")


def policy_for(recipe: EnvRecipe) -> ExploringPolicy:
    env = BatchedEnv(recipe, count=1)
    torch.manual_seed(0)
    actors = {name: Actor(shape, (32, 32)) for name, shape in group_shapes(env).items()}
    env.close()
    return ExploringPolicy(actors, warming=False)


def do_one_thing_only(policy: ExploringPolicy, mean: float) -> None:
    actor: Any = policy.actors["robots"]
    last = actor.layers[-1]
    with torch.no_grad():
        last.weight.zero_()
        last.bias[:6] = mean
        last.bias[6:] = -20  # without chance


@pytest.mark.slow
def test_workers_collect_by_themselves_with_new_weights_until_one_dies() -> None:
    recipe = EnvRecipe("toileting")
    policy = policy_for(recipe)
    collector: Any = make_collector(
        recipe,
        policy,
        envs=ENVS,
        workers=f"async://{WORKERS}",
        seed=0,
        frames_per_batch=ENVS * STEPS,
        total_frames=10_000,
    )
    try:
        batches = iter(collector)
        first = [next(batches) for _ in range(4 * WORKERS)]
        assert {tuple(batch.shape) for batch in first} == {(ENVS // WORKERS, STEPS)}
        # Every environment has a number of its own; no batch is handed over twice, nor written again.
        numbers = {tuple(batch["collector", "traj_ids"][:, 0].tolist()) for batch in first}
        assert len(numbers) == WORKERS
        assert len({number for row in numbers for number in row}) == ENVS
        seen = np.concatenate(
            [batch["robots", "observation"].flatten(1).numpy() for batch in first]
        )
        assert len(np.unique(seen.round(6), axis=0)) == len(seen)

        do_one_thing_only(policy, 1.0)
        for _ in range(3 * WORKERS):  # what was collected before
            batch = next(batches)
        action = batch["robots", "action"].numpy()
        assert np.abs(action - np.tanh(1.0)).max() < 0.05

        os.kill(collector.procs[0].pid, signal.SIGKILL)
        with pytest.raises(WorkerError, match=r"worker 0 \(exit code -9\).*last checkpoint"):
            for _ in range(100):
                next(batches)
    finally:
        shut_down(collector)
    assert not multiprocessing.active_children()


@pytest.mark.slow
def test_a_training_counts_the_episodes_of_all_workers_and_goes_on(
    tmp_path: Any, recwarn: pytest.WarningsRecorder
) -> None:
    def trained(steps: int) -> list[str]:
        config = TrainConfig(
            task="toileting",
            envs=4,
            workers="async://2",
            variants=({"level": 1}, {"level": 2}),  # two environments each: nothing to warn of
            steps=steps,
            interval=2000,
            evaluation_episodes=1,
            algorithm={"batch_size": 32, "update_to_data": 0.05},
        )
        assert Trainer(config, tmp_path).run().steps >= steps
        return (tmp_path / "progress.csv").read_text().splitlines()

    head, last = (line.split(",") for line in trained(2000))
    row = dict(zip(head, last, strict=True))
    assert -1000 < float(row["return"]) < 1000
    assert 0 <= float(row["success"]) <= 1
    assert len(trained(4000)) == 3
    assert not [each for each in recwarn if "shared evenly" in str(each.message)]
