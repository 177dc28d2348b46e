"""Batches for a learner from TorchRL's collectors: in this process, in asynchronous ones, or on Ray."""

from __future__ import annotations

import dataclasses
import math
import os
import signal
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from typing import Any, TypeAlias

import numpy as np
import torch
from tensordict import TensorDictBase
from tensordict.nn import TensorDictModuleBase
from torchrl.collectors import Collector, MultiAsyncCollector
from torchrl.collectors.distributed import RayCollector
from torchrl.envs import EnvBase
from torchrl.weight_update import SharedMemWeightSyncScheme

from rcare_marl.envs.learning import BatchedEnv, EnvRecipe
from rcare_marl.errors import ClusterError, ConfigError, WorkerError

from .cluster import Cluster, async_count

AnyCollector: TypeAlias = Collector | MultiAsyncCollector | RayCollector

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
) -> AnyCollector:
    """Return what steps the environments with a policy; iterate over it for batches, shape [envs, time].

    On a cluster every worker steps an equal share of the environments in its own process. All collect at
    the same time, with the weights that `policy` has when a batch is asked for, and a batch is that of
    all of them: so that on-policy learners are right too. The learner stays in this process.

    Asynchronous workers have equal shares too, and go on while the learner learns; a batch is of that one
    which was ready first, and ("collector", "traj_ids") in it tells the episodes of all apart. Its actions
    are by the weights that were there when the worker began it.

    End it with `shut_down`.

    Args:
        recipe: How environments are made.
        policy: Writes the actions. No layer of it may still be lazy.
        envs: Environments, of all workers together.
        workers: Processes of this machine that step them, 0 for this one; or `async://N`; or
            `ray://HOST:PORT` or `ray://local:N`, see `Cluster`.
        seed: Of the episodes, and with `async://` and on a cluster of the actions.
        frames_per_batch: Steps of all environments in a batch, a multiple of `envs`; of asynchronous
            workers a batch holds the share of one.
        total_frames: Steps after which there are no more batches; the last one is a whole one.
        begun: Steps that a resumed training did before. Asynchronous workers and a cluster begin new
            episodes with it, instead of those that they had; they do not go on bit for bit.
        stage: Of the curriculum, with which environments that are made here begin.
        env: The environments, where they exist already; for `workers` in numbers only.

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
            raise ConfigError(f"environments of this process cannot be given to {workers!r}")
        share = _Share(recipe, envs, seed, begun, dict(stage or {}))
        if (count := async_count(workers, envs)) is not None:
            return _async_collector(share, policy, count, frames_per_batch // count, total_frames)
        cluster = Cluster.parse(workers)
        return _ray_collector(share, policy, cluster, frames_per_batch, total_frames)
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
    """Hand a stage of the curriculum to the environments; see `BatchedEnv.set_stage`.

    Asynchronous workers cannot be told: TorchRL's `map_fn` waits for ever for one that has a batch ready.
    """
    if isinstance(collector, RayCollector):
        count = collector.num_collectors
        collector.map_fn("env.set_stage", list_of_args=[(dict(stage),)] * count)
    else:
        env: Any = collector.env  # TorchRL has any unknown attribute of it a tensor
        env.set_stage(stage)


def shut_down(collector: AnyCollector, *, close_envs: bool = True) -> None:
    """End the collecting; a Ray that was started for it ends, a cluster goes on without it.

    Args:
        collector: What `make_collector` returned.
        close_envs: Whether environments of this process are closed, too.
    """
    if isinstance(collector, RayCollector | MultiAsyncCollector):
        collector.shutdown()
    else:
        collector.shutdown(close_env=close_envs)


def _async_collector(
    share: _Share, policy: TensorDictModuleBase, count: int, frames: int, total_frames: int
) -> MultiAsyncCollector:
    return _AsyncCollector(
        [dataclasses.replace(share, worker=k, workers=count) for k in range(count)],
        policy,
        frames_per_batch=frames,
        total_frames=total_frames,
        num_threads=1,
        init_fn=_ignore_interrupts,
        use_buffers=True,  # shared memory that is filled again, and from which a batch is copied
        auto_register_policy_transforms=False,
        trust_policy=True,
    )


def _ignore_interrupts() -> None:
    """Leave Ctrl-C to the learner, who ends the workers."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)


class _AsyncCollector(MultiAsyncCollector):
    """Writes new weights to the memory that the workers' policies lie in, and tells nobody.

    TorchRL's `update_at_each_batch` has each worker acknowledge each update, which takes longer than a
    batch does: 44 ms for six of them on two busy cores. A worker may read while they are written; it
    explores anyway.
    """

    def __init__(self, makers: list[_Share], policy: TensorDictModuleBase, **options: Any) -> None:
        self._learned, self._memory = policy, SharedMemWeightSyncScheme()
        super().__init__(makers, policy, weight_sync_schemes={"policy": self._memory}, **options)  # type: ignore[no-untyped-call]

    def iterator(self) -> Iterator[TensorDictBase]:
        transport: Any = self._memory.shared_transport
        names = [tuple(name.split(".")) for name in self._learned.state_dict()]
        places = {}  # the list has an entry for each worker, whose tensors are all in the same place
        for weights in transport.unique_weights:
            values = [weights[name] for name in names]
            places[values[0].data_ptr()] = values
        batches = super().iterator()
        while True:
            with torch.no_grad():
                for values in places.values():
                    torch._foreach_copy_(values, list(self._learned.state_dict().values()))
            if (batch := self._next(batches)) is None:
                return
            yield batch

    def _next(self, batches: Iterator[TensorDictBase]) -> TensorDictBase | None:
        try:
            return next(batches, None)
        except (RuntimeError, ValueError) as error:
            # One of them is gone; the others are ended, and one that takes its time cannot be closed yet.
            said = str(error) if isinstance(error, RuntimeError) else self._gone()
            raise WorkerError(
                f"{said} What they said stands above; a training goes on from its last checkpoint when it "
                "is started again"
            ) from error

    def _gone(self) -> str:
        ended = (-signal.SIGTERM, None)  # by us, or not yet
        codes = [(k, p.exitcode) for k, p in enumerate(self.procs) if not p._closed]
        gone = [f"worker {k} (exit code {code})" for k, code in codes if code not in ended]
        return f"At least one process failed: {', '.join(gone) or 'nobody knows which'}."

    def shutdown(self, *arguments: Any, **options: Any) -> None:
        super().shutdown(*arguments, **options)
        self._memory.shutdown()  # left to the end of Python, it starts a thread, and waits for it for ever


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
        variants = (self.recipe.variants[first:] + self.recipe.variants[:first])[:count]
        recipe = dataclasses.replace(self.recipe, variants=variants)
        env = BatchedEnv(recipe, count=count, workers=0, seed=episodes)
        env.set_stage(self.stage)
        return env
