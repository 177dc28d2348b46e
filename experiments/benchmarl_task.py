"""A care task as a task of BenchMARL, so that its algorithms can be compared on it.

BenchMARL 1.5.2 refuses TorchRL 0.12 and newer, so it needs a virtual environment of its own; see
`docs/other_libraries.md` for the commands. Measured with torch 2.13.0, torchrl 0.11.1, tensordict 0.11.0.

Run there: python experiments/benchmarl_task.py [TASK] [ALGORITHM] [STEPS]
"""

from __future__ import annotations

import sys
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import benchmarl.algorithms  # type: ignore[import-not-found]
from benchmarl.environments.common import TaskClass  # type: ignore[import-not-found]
from benchmarl.experiment import Experiment, ExperimentConfig  # type: ignore[import-not-found]
from benchmarl.models.mlp import MlpConfig  # type: ignore[import-not-found]
from torchrl.data import Composite
from torchrl.envs import EnvBase

from rcare_marl.envs.registry import task_class
from rcare_marl.envs.torchrl import make_env


class CareTask(TaskClass):  # type: ignore[misc]  # unknown without BenchMARL
    """A task of this package; `config` holds further arguments of `rcare_marl.make`."""

    def get_env_fun(
        self, num_envs: int, continuous_actions: bool, seed: int | None, device: str
    ) -> Callable[[], EnvBase]:
        def make() -> EnvBase:
            env = make_env(self.name.lower(), device=device, **self.config)
            env.set_seed(seed)
            return env

        return make

    def supports_continuous_actions(self) -> bool:
        return True

    def supports_discrete_actions(self) -> bool:
        return False

    def max_steps(self, env: EnvBase) -> int:
        task = task_class(self.name.lower())
        return round(task.time_limit / task.control_dt)

    def has_render(self, env: EnvBase) -> bool:
        return False

    def group_map(self, env: EnvBase) -> dict[str, list[str]]:
        groups: Any = env.group_map
        return dict(groups)

    def observation_spec(self, env: EnvBase) -> Composite:
        return self._only("observation", env)

    def info_spec(self, env: EnvBase) -> Composite:
        return self._only("info", env)

    def state_spec(self, env: EnvBase) -> Composite:
        return Composite(state=env.observation_spec["state"].clone())

    def action_spec(self, env: EnvBase) -> Composite:
        return env.full_action_spec

    def action_mask_spec(self, env: EnvBase) -> None:
        return None

    def _only(self, key: str, env: EnvBase) -> Composite:
        """Return the specs of one key of each group."""
        specs = env.observation_spec
        groups = {
            group: Composite({key: specs[group, key].clone()}, shape=specs[group].shape)
            for group in self.group_map(env)
        }
        return Composite(groups)

    @staticmethod
    def env_name() -> str:
        return "rcare_marl"


def make_experiment(
    task: str, algorithm: str, steps: int, folder: Path, **settings: Any
) -> Experiment:
    """Return an experiment of BenchMARL.

    Args:
        task: Name of the task.
        algorithm: Name of an algorithm of BenchMARL in small letters, such as `mappo`.
        steps: Control steps to train for.
        folder: Where BenchMARL writes its logs.
        **settings: Further fields of its `ExperimentConfig`.
    """
    config = ExperimentConfig.get_from_yaml()
    config.loggers, config.save_folder = ["csv"], str(folder)
    config.max_n_frames, config.evaluation, config.render = steps, False, False
    config.on_policy_n_envs_per_worker = config.off_policy_n_envs_per_worker = 1
    config.on_policy_collected_frames_per_batch = 2000
    for name, value in settings.items():
        setattr(config, name, value)
    return Experiment(
        task=CareTask(task.upper(), config={}),
        algorithm_config=getattr(
            benchmarl.algorithms, f"{algorithm.capitalize()}Config"
        ).get_from_yaml(),
        model_config=MlpConfig.get_from_yaml(),
        critic_model_config=MlpConfig.get_from_yaml(),
        seed=0,
        config=config,
    )


def main() -> None:
    """Train; BenchMARL shows the mean return as it goes."""
    task = sys.argv[1] if len(sys.argv) > 1 else "feeding"
    algorithm = sys.argv[2] if len(sys.argv) > 2 else "mappo"
    steps = int(sys.argv[3]) if len(sys.argv) > 3 else 20_000
    make_experiment(task, algorithm, steps, Path(tempfile.mkdtemp(prefix="benchmarl_"))).run()


if __name__ == "__main__":
    main()
