"""Batches for a learner: TorchRL's collector in this process, or its Ray collector on a cluster."""

from __future__ import annotations

import dataclasses
import math
import os
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import torch
from tensordict import TensorDictBase
from tensordict.nn import TensorDictModuleBase
from torchrl.collectors import Collector
from torchrl.collectors.distributed import RayCollector
from torchrl.envs import EnvBase

from rcare_marl.envs.learning import BatchedEnv, EnvRecipe
from rcare_marl.errors import ClusterError, ConfigError

from .cluster import Cluster

COLLECTING: dict[str, Any] = {
    "use_buffers": False,  # each batch is a new one, which a buffer may keep
    "track_traj_ids": False,  # nobody asks for them, and they cost time at every step
    "auto_register_policy_transforms": False,  # policies here have no memory to be reset
}


def make_collector(
    recipe: EnvRecipe,
    policy: TensorDictModuleBase,
    *,
    envs: int,
    workers: int | str,
    seed: int,
    frames_per_batch: int,
    total_frames: int,
    begun: int = 0,
    stage: Mapping[str, float] | None = None,
    env: BatchedEnv | None = None,
) -> Collector | RayCollector:
    """Return what steps the environments with a policy; iterate over it for batches, shape [envs, time].

    On a cluster every worker steps an equal share of the environments in its own process. All collect at
    the same time, with the weights that `policy` has when a batch is asked for, and a batch is that of
    all of them: so that on-policy learners are right too. The learner stays in this process.

    End it with `shut_down`.

    Args:
        recipe: How environments are made.
        policy: Writes the actions. No layer of it may still be lazy.
        envs: Environments, of all workers together.
        workers: Processes of this machine that step them, 0 for this one; or `ray://HOST:PORT` or
            `ray://local:N`, see `Cluster`.
        seed: Of the episodes, and on a cluster of the actions.
        frames_per_batch: Steps of all environments in a batch; a multiple of `envs`.
        total_frames: Steps after which there are no more batches; the last one is a whole one.
        begun: Steps that a resumed training did before. A cluster begins new episodes with it, instead
            of those that it had; it does not go on bit for bit.
        stage: Of the curriculum, with which environments that are made here begin.
        env: The environments, where they exist already; not for a cluster.

    Raises:
        ConfigError: If `frames_per_batch` is no multiple of `envs`, or `workers` is of no known form.
        MissingPackageError: If a cluster is asked for and Ray is not installed.
        ClusterError: If the cluster cannot be reached, or has no free core.
    """
    if envs < 1 or frames_per_batch < 1 or frames_per_batch % envs:
        raise ConfigError(
            f"frames_per_batch must be a multiple of envs, got {frames_per_batch} and {envs}"
        )
    total_frames = math.ceil(total_frames / frames_per_batch) * frames_per_batch
    if isinstance(workers, str):
        if env is not None:
            raise ConfigError("environments of this process cannot be given to a cluster")
        cluster = Cluster.parse(workers)
        return _ray_collector(
            _Share(recipe, envs, seed, begun, dict(stage or {})),
            policy,
            cluster,
            frames_per_batch,
            total_frames,
        )
    if env is None:
        env = BatchedEnv(recipe, count=envs, workers=workers, seed=seed)
        env.set_stage(stage or {})
    return Collector(
        env,
        policy,
        frames_per_batch=frames_per_batch,
        total_frames=total_frames,
        trust_policy=True,  # it is used as it is, not wrapped
        **COLLECTING,
    )


def set_stage(collector: Collector | RayCollector, stage: Mapping[str, float]) -> None:
    """Hand a stage of the curriculum to the environments, wherever they are; see `BatchedEnv.set_stage`."""
    if isinstance(collector, RayCollector):
        count = collector.num_collectors
        collector.map_fn("env.set_stage", list_of_args=[(dict(stage),)] * count)
    else:
        env: Any = collector.env  # TorchRL has any unknown attribute of it a tensor
        env.set_stage(stage)


def shut_down(collector: Collector | RayCollector, *, close_envs: bool = True) -> None:
    """End the collecting; a Ray that was started for it ends, a cluster goes on without it.

    Args:
        collector: What `make_collector` returned.
        close_envs: Whether environments of this process are closed, too.
    """
    if isinstance(collector, RayCollector):
        collector.shutdown()
    else:
        collector.shutdown(close_env=close_envs)


def _ray_collector(
    share: _Share, policy: TensorDictModuleBase, cluster: Cluster, frames: int, total_frames: int
) -> RayCollector:
    count = cluster.worker_count(share.envs)
    import ray

    if ray.is_initialized():
        raise ClusterError("this process is connected to Ray already: call ray.shutdown() before")
    os.environ.setdefault("RAY_USAGE_STATS_ENABLED", "0")  # a local Ray tells nobody about itself
    # Ray hides GPUs from workers that asked for none, and says at every start that it will not any more.
    os.environ.setdefault("RAY_ACCEL_ENV_VAR_OVERRIDE_ON_ZERO", "0")
    makers: list[Callable[..., Any] | EnvBase] = [
        dataclasses.replace(share, worker=k, workers=count) for k in range(count)
    ]
    collector = RayCollector(
        makers,
        policy,
        frames_per_batch=frames,
        total_frames=total_frames,
        sync=True,
        ray_init_config=cluster.init_options(),
        remote_configs={"num_cpus": 1, "num_gpus": 0},
        collector_kwargs=dict(COLLECTING),
        trust_policy=True,
        update_after_each_batch=True,
        postproc=_join,
    )
    try:
        collector.update_policy_weights_(policy)  # waits until all workers are there
    except BaseException:
        collector.shutdown()
        raise
    return collector


def _join(batch: TensorDictBase) -> TensorDictBase:
    """Return a batch of shape [envs, time] from one of shape [workers, envs of each, time]."""
    return batch.flatten(0, 1)


@dataclass(frozen=True)
class _Share:
    """Makes the environments of one worker, in its process."""

    recipe: EnvRecipe
    envs: int
    seed: int
    begun: int
    stage: Mapping[str, float]
    worker: int = 0
    workers: int = 1

    def __call__(self) -> EnvBase:
        torch.set_num_threads(1)
        count = self.envs // self.workers
        # Every worker has episodes of its own, and noise of its own in its actions.
        sequence = np.random.SeedSequence([self.seed, self.begun, self.worker])
        episodes, actions = (int(word) for word in sequence.generate_state(2))
        torch.manual_seed(actions)
        first = self.worker * count % max(1, len(self.recipe.variants))
        variants = self.recipe.variants[first:] + self.recipe.variants[:first]
        recipe = dataclasses.replace(self.recipe, variants=variants)
        env = BatchedEnv(recipe, count=count, workers=0, seed=episodes)
        env.set_stage(self.stage)
        return env
