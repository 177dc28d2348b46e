"""The training loop: collect, learn, watch, save."""

from __future__ import annotations

import dataclasses
import json
import random
import time
from collections import deque
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import closing
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import torch
from tensordict import TensorDictBase

from rcare_marl.atomic_file import write_whole
from rcare_marl.baselines.algorithms import make_algorithm
from rcare_marl.baselines.algorithms.network import ActorArrays
from rcare_marl.baselines.policy_file import LearnedPolicy, PolicyFile
from rcare_marl.config import load
from rcare_marl.envs.cast import make_policy
from rcare_marl.envs.learning import BatchedEnv, LearnerEnv
from rcare_marl.envs.learning.learner_env import moved_by
from rcare_marl.errors import ConfigError, check_package
from rcare_marl.provenance import machine, versions

from ..evaluation.evaluate import Episode, run_episode
from . import checkpoint
from .cluster import ASYNC
from .collector import make_collector, set_stage, shut_down
from .config import VALIDATION_SEED, Curriculum, TrainConfig
from .demonstration import demonstrate
from .log import Reporter, TrainingLog

RECENT = 100  # finished episodes over which return and success are averaged
TRAINED_WITH = ("pybullet", "numpy", "torch", "torchrl", "tensordict")
POLICY, LAST_POLICY = "policy", "policy_last"


@dataclass(frozen=True)
class TrainResult:
    """What came of a training.

    Attributes:
        steps: Control steps of all environments together.
        minutes: Wall time, of all sittings together.
        success: Share of the evaluation episodes that succeeded, of the policy that was kept.
        reached: Whether `stop_success` was reached.
        finished: Whether it is at its end; else it can be resumed.
        policies: The policy file of each group.
    """

    steps: int
    minutes: float
    success: float
    reached: bool
    finished: bool
    policies: dict[str, Path]


@dataclass
class _Progress:
    """What a training has come to; all of it is in the checkpoint."""

    steps: int = 0
    seconds: float = 0.0
    best: tuple[float, float] = (-1.0, -np.inf)  # success and return of the kept policy
    passes: int = 0  # evaluations in a row that reached `stop_success`
    returns: deque[float] = field(default_factory=lambda: deque(maxlen=RECENT))
    successes: deque[float] = field(default_factory=lambda: deque(maxlen=RECENT))
    sums: dict[int, float] = field(default_factory=dict)  # rewards so far of each running episode

    def to_dict(self) -> dict[str, Any]:
        return {**self.__dict__, "returns": list(self.returns), "successes": list(self.successes)}

    @classmethod
    def from_dict(cls, state: dict[str, Any]) -> _Progress:
        recent = {k: deque(state[k], maxlen=RECENT) for k in ("returns", "successes")}
        return cls(**{**state, **recent, "best": tuple(state["best"])})


class Trainer:
    """Trains one config in one folder, and goes on where an earlier sitting ended.

    Attributes:
        stop_requested: Set it, from a signal say, to save and to end at the next interval.
    """

    def __init__(
        self,
        config: TrainConfig,
        folder: str | Path,
        *,
        resume: str = "auto",
        reporter: Reporter | None = None,
    ) -> None:
        """Open the folder, and look for a checkpoint there.

        Args:
            config: What is trained.
            folder: Where checkpoint, logs and policies go; made if need be.
            resume: `auto` goes on from a checkpoint in the folder if there is one, `never` refuses a
                folder that holds one.
            reporter: Who is told of the progress.

        Raises:
            ConfigError: If the checkpoint is of another config, or is not wanted.
            MissingPackageError: If it needs a package that is not installed.
        """
        if resume not in ("auto", "never"):
            raise ConfigError(f"resume is 'auto' or 'never', got {resume!r}")
        if str(config.workers).startswith("ray:"):
            check_package("ray", f"workers {config.workers}", "dist")
        if config.engine == "mujoco":
            check_package("mujoco", "the engine 'mujoco'", "batch")
        self.config, self.folder = config, Path(folder)
        self._reporter = reporter
        self.stop_requested = False
        self._last = self.folder / checkpoint.LAST
        if resume == "never" and self._last.is_file():
            raise ConfigError(
                f"{self.folder} holds a training already: resume it, or choose another folder"
            )

    def run(self) -> TrainResult:
        """Train to the end, or until a limit of time or a request to stop.

        Raises:
            ConfigError: If the scene cannot be built or the demonstrations fail.
        """
        config = self.config
        torch.set_num_threads(1)  # small networks are slower on several, and rounding would differ
        random.seed(config.seed)
        np.random.seed(config.seed)
        torch.manual_seed(config.seed)
        count, workers, recipe = config.envs, config.workers, config.recipe()
        if not isinstance(
            workers, int
        ):  # elsewhere: here one that only tells what there is to learn
            count, workers = 1, 0
            recipe = dataclasses.replace(recipe, variants=recipe.variants[:1])
        self._say(
            f"making {count} environment{'s' if count > 1 else ''} of {config.task}; what was never "
            "compiled on this machine is compiled now, which takes up to a minute"
        )
        made = BatchedEnv(recipe, count=count, workers=workers, seed=config.seed)
        with closing(made) as env:
            try:
                return self._run(env)
            finally:
                if self._collecting is not None:
                    shut_down(self._collecting.result(), close_envs=False)

    def _run(self, env: BatchedEnv) -> TrainResult:
        config = self.config
        settings = config.algorithm_config()
        self._begun, self._env = time.monotonic(), env
        self._collecting: Future[Any] | None = None  # what starts while demonstrations are played
        self._copied: dict[str, float] = {}  # figures of what was copied from demonstrations
        self._algorithm = algorithm = make_algorithm(config.algo, settings, env, seed=config.seed)
        self._curriculum = curriculum = Curriculum(config.curriculum)
        is_begun = self._last.is_file()
        saved = checkpoint.load(self._last, config=config.to_dict()) if is_begun else None
        self._evaluator = _Evaluator(config)
        if saved is None:
            self._progress = _Progress()
            env.set_stage(curriculum.stage)
            if config.demonstrations.are_wanted:
                self._take_demonstrations()
            self._write_beginnings()  # what cannot begin leaves no trace
        else:
            self._say("playing again what led to the checkpoint")
            algorithm.load_state_dict(saved["algorithm"])
            curriculum.load_state_dict(saved["curriculum"])
            env.set_stage(curriculum.stage)
            self._progress = _Progress.from_dict(saved["progress"])
            if isinstance(config.workers, int):
                env.load_state_dict(saved["env"])
            else:
                self._progress.sums = {}  # new episodes begin
            checkpoint.restore_rng(saved)
        self._log = TrainingLog(self.folder, at_step=self._progress.steps)
        if self._reporter is not None:
            self._reporter.start(config, config.steps, self._progress.steps)
        try:
            return self._loop()
        finally:
            self._log.close()
            if self._reporter is not None:
                self._reporter.close()

    def _take_demonstrations(self) -> None:
        """Take them; asynchronous workers start at the same time, which takes them longer."""
        wanted, workers = self.config.demonstrations, self.config.workers
        with ThreadPoolExecutor(1) as pool:
            if isinstance(workers, str) and workers.startswith(ASYNC):
                self._collecting = pool.submit(self._collector)
            doing = "playing" if wanted.path is None else f"reading {wanted.path}:"
            self._say(f"{doing} {wanted.episodes or 'all'} demonstrations")
            with closing(LearnerEnv(self.config.recipe())) as shown:
                found = demonstrate(shown, wanted, self.config.seed)
            self._say("learning from the demonstrations")
            self._copied = self._algorithm.add_demonstrations(found)

    def _loop(self) -> TrainResult:
        config, progress, algorithm = self.config, self._progress, self._algorithm
        begun, before = self._begun, progress.seconds
        reached = progress.passes >= 2
        if progress.steps >= config.steps or reached:
            return self._result(reached)
        collector = self._collecting.result() if self._collecting else self._collector()
        torch.set_num_threads(config.threads)  # now: who makes environments takes one
        tally = _Tally(self._env)
        progress.seconds = before + time.monotonic() - begun
        if self._copied:
            self._say("evaluating what copying alone came to")
            self._tell(0, self._assess())
        self._say(f"learning; an evaluation and a checkpoint every {config.interval:,} steps")
        next_save = (progress.steps // config.interval + 1) * config.interval
        learned = 0.0
        metrics: dict[str, float] = {}
        since, since_steps, updates = time.monotonic(), progress.steps, algorithm.updates
        try:
            for batch in collector:
                progress.steps += batch.numel()
                tally.count(batch, progress)
                start = time.monotonic()
                figures = algorithm.learn(batch)
                figures.pop("updates", None)  # told as a rate
                metrics |= figures
                learned += time.monotonic() - start
                if self._curriculum.observe(tally.finished):
                    set_stage(collector, self._curriculum.stage)
                last = progress.steps >= config.steps
                if progress.steps < next_save and not last:
                    if self._reporter is not None:
                        self._reporter.report(progress.steps, tally.means(progress))
                    continue
                next_save += config.interval
                now = time.monotonic()
                spent = max(now - since, 1e-9)
                metrics |= {
                    **tally.means(progress),
                    "steps_per_second": (progress.steps - since_steps) / spent,
                    "updates_per_second": (algorithm.updates - updates) / spent,
                    "learner_share": learned / spent,
                    "stage": float(self._curriculum.level),
                }
                former = progress.best
                progress.seconds = before + now - begun
                metrics |= self._assess()
                progress.seconds = before + time.monotonic() - begun
                reached = progress.passes >= 2
                metrics["minutes"] = progress.seconds / 60
                self._tell(progress.steps, metrics)
                is_best = (metrics["eval_success"], metrics["eval_return"]) >= former
                self._save(is_best=is_best)
                late = config.minutes is not None and time.monotonic() - begun > 60 * config.minutes
                if last or reached or late or self.stop_requested:
                    break
                learned = 0.0
                since, since_steps, updates = time.monotonic(), progress.steps, algorithm.updates
        finally:
            if self._collecting is None:
                shut_down(collector, close_envs=False)
        return self._result(reached)

    def _collector(self) -> Any:
        """Return what collects the steps that are left."""
        config = self.config
        frames = config.algorithm_config().rollout * config.envs
        return make_collector(
            config.recipe(),
            self._algorithm.policy(),
            envs=config.envs,
            workers=config.workers,
            seed=config.seed,
            frames_per_batch=frames,
            total_frames=config.steps
            - self._progress.steps
            + frames,  # it closes them after its last
            begun=self._progress.steps,
            stage=self._curriculum.stage,
            env=self._env if isinstance(config.workers, int) else None,
        )

    def _say(self, what: str) -> None:
        if self._reporter is not None:
            self._reporter.tell(what)

    def _tell(self, step: int, metrics: dict[str, float]) -> None:
        self._log.write(step, metrics)
        if self._reporter is not None:
            self._reporter.report(step, metrics)

    def _assess(self) -> dict[str, float]:
        """Evaluate the policy as it is now, and keep it if it is the best so far."""
        files, progress = self._policy_files(), self._progress
        episodes = self._evaluator.evaluate(files)
        success = float(np.mean([e.success for e in episodes]))
        returned = float(np.mean([float(np.mean(list(e.returns.values()))) for e in episodes]))
        if (success, returned) >= progress.best:
            progress.best = (success, returned)
            self._write(files, POLICY)
        self._write(files, LAST_POLICY)
        wanted = self.config.stop_success
        progress.passes = progress.passes + 1 if wanted is not None and success >= wanted else 0
        return {"eval_success": success, "eval_return": returned}

    def _policy_files(self) -> dict[str, PolicyFile]:
        config, progress = self.config, self._progress
        training = {
            "algorithm": config.algo,
            "reward": config.options.get("reward", "paper"),
            "residual": bool(config.residual),
            "demonstrations": config.demonstrations.episodes,
            "seed": config.seed,
            "steps": progress.steps,
            "minutes": round(progress.seconds / 60, 3),
            "versions": self._versions(),
            "machine": machine()["processor"],
        }
        return {
            group: self._evaluator.policy_file(group, arrays, training)
            for group, arrays in self._algorithm.actor_arrays().items()
        }

    def _versions(self) -> dict[str, str]:
        engine = self.config.engine
        return versions((*TRAINED_WITH, *([engine] if engine == "mujoco" else [])))

    def _write(self, files: dict[str, PolicyFile], name: str) -> None:
        for group, file in files.items():
            file.save(self._path(name, group, len(files)))

    def _path(self, name: str, group: str, groups: int) -> Path:
        return self.folder / (f"{name}.npz" if groups == 1 else f"{name}_{group}.npz")

    def _save(self, *, is_best: bool) -> None:
        state = {
            "algorithm": self._algorithm.state_dict(),
            "env": self._env.state_dict(),
            "curriculum": self._curriculum.state_dict(),
            "progress": self._progress.to_dict(),
        }
        checkpoint.save(self._last, state, config=self.config.to_dict(), is_best=is_best)

    def _write_beginnings(self) -> None:
        import yaml

        text = yaml.safe_dump(self.config.to_dict(), sort_keys=False)
        write_whole(self.folder / "config.yaml", text.encode())
        found = json.dumps(self._versions(), indent=2)
        write_whole(self.folder / "versions.json", found.encode() + b"\n")

    def _result(self, reached: bool) -> TrainResult:
        groups, progress = list(self._algorithm.actor_arrays()), self._progress
        return TrainResult(
            steps=progress.steps,
            minutes=progress.seconds / 60,
            success=progress.best[0],
            reached=reached,
            finished=reached or progress.steps >= self.config.steps,
            policies={group: self._path(POLICY, group, len(groups)) for group in groups},
        )


class _Tally:
    """Sums up the episodes that end in the batches."""

    def __init__(self, env: BatchedEnv) -> None:
        self._groups = list(env.group_map)
        self.finished: list[bool] = []

    def count(self, batch: TensorDictBase, progress: _Progress) -> None:
        """Take a batch, shape [N, T]."""
        rewards = [
            batch["next", group, "reward"].mean(dim=(-2, -1)).numpy() for group in self._groups
        ]
        reward = np.mean(rewards, axis=0)
        done = batch["next", "done"][..., 0].numpy()
        success = batch["next", "success"][..., 0].numpy()
        self.finished = []
        numbers = batch.get(("collector", "traj_ids"), None)  # of episodes, by asynchronous workers
        for step, row in np.ndindex(reward.shape[1], reward.shape[0]):
            number = row if numbers is None else int(numbers[row, step])
            total = progress.sums.pop(number, 0.0) + float(reward[row, step])
            if done[row, step]:
                progress.returns.append(total)
                progress.successes.append(float(success[row, step]))
                self.finished.append(bool(success[row, step]))
            else:
                progress.sums[number] = total

    def means(self, progress: _Progress) -> dict[str, float]:
        """Return mean return and success of the latest episodes; nothing before the first ended."""
        if not progress.returns:
            return {}
        return {
            "return": float(np.mean(progress.returns)),
            "success": float(np.mean(progress.successes)),
        }


class _Evaluator:
    """Plays the policies as they are, on seeds that neither train nor count in the end.

    Each evaluation has a new scene, which keeps no trace of the one before.
    """

    def __init__(self, config: TrainConfig) -> None:
        self._config = config
        env = LearnerEnv(config.recipe())
        self._groups, self._observed = env.groups, env.layout.observed
        self._flags = env.layout.flags
        if config.taught:  # a teacher's action is no longer there when it is played
            self._observed = {group: parts[:-1] for group, parts in self._observed.items()}
        self._actions = {
            group: tuple(env.care_env.cast[roles[0]].action_names)
            for group, roles in env.groups.items()
        }
        env.close()

    def policy_file(self, group: str, arrays: ActorArrays, training: dict[str, Any]) -> PolicyFile:
        """Return the policy file of a group."""
        config = self._config
        residual = config.recipe().residual.get(self._groups[group][0])
        layers = arrays.layers
        if isinstance(residual, tuple):  # what is left to the script has no output yet
            *hidden, (weights, biases) = layers
            rows = np.zeros((len(residual), weights.shape[1] + 1), np.float32)
            rows[moved_by(residual)] = np.column_stack((weights, biases))
            layers = (*hidden, (rows[:, :-1], rows[:, -1]))
        return PolicyFile(
            task=config.task,
            group=group,
            roles=self._groups[group],
            observed=self._observed[group],
            action_size=len(self._actions[group]),
            memory=len(layers[-1][1]) - len(self._actions[group]),
            flags=self._flags[group],
            action_low=arrays.low,
            layers=layers,
            mean=arrays.mean,
            scale=arrays.scale,
            residual=residual,
            hold=config.hold,
            actions=self._actions[group],
            recipe=config.recipe().to_dict(),
            view=config.recipe().views.get(self._groups[group][0], {}),
            training=training,
        )

    def evaluate(self, files: dict[str, PolicyFile]) -> list[Episode]:
        """Return what came of the episodes."""
        with closing(LearnerEnv(self._config.recipe())) as learner:
            env = learner.care_env
            task = self._config.task
            players = {
                role: make_policy(env, task, role, partial(LearnedPolicy, file=files[group]))
                for group, roles in learner.groups.items()
                for role in roles
            }
            count = self._config.evaluation_episodes
            return [run_episode(env, players, VALIDATION_SEED + i) for i in range(count)]


def train(source: Any, folder: str | Path, *, reporter: Reporter | None = None) -> TrainResult:
    """Train a config, or a mapping of its fields, in a folder; see `Trainer`.

    Example:
        >>> train({"task": "toileting", "algo": "sac", "steps": 20_000}, "runs/toileting")
    """
    config = source if isinstance(source, TrainConfig) else load(TrainConfig, source)
    return Trainer(config, folder, reporter=reporter).run()
