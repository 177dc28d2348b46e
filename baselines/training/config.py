"""What a training is: the scene, who learns, by which algorithm, and for how long."""

from __future__ import annotations

import dataclasses
from collections import deque
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field
from importlib.resources import files
from pathlib import Path
from typing import Any

from rcare_marl.config import load, plain, read_yaml
from rcare_marl.envs.learning import EnvRecipe
from rcare_marl.envs.randomise import Randomisation
from rcare_marl.envs.registry import task_class
from rcare_marl.errors import ConfigError

from .cluster import Cluster, async_count

CONFIGS = "rcare_marl.baselines.configs"
EVERYBODY = "everybody"  # folder of the configs that train with a population
VALIDATION_SEED = 1_000_000  # of the first episode that compares checkpoints; far from 0 to 99


@dataclass(frozen=True)
class Demonstrations:
    """Episodes that learning begins with: of scripted policies, or recorded ones.

    Attributes:
        episodes: How many to keep; none if 0, and all where they are recorded.
        noise: Standard deviation of what is added to each action that is carried out and kept.
        only_successful: Whether episodes without success are thrown away.
        attempts: Episodes to try at most, as a multiple of `episodes`.
        path: A dataset of recorded episodes, see `rcare_marl.envs.datasets.read`; then nothing is played,
            and nobody makes noise.
    """

    episodes: int = 0
    noise: float = 0.0
    only_successful: bool = True
    attempts: int = 5
    path: str | None = None

    @property
    def are_wanted(self) -> bool:
        """Whether there are any."""
        return bool(self.episodes or self.path)

    def __post_init__(self) -> None:
        if self.episodes < 0 or self.noise < 0 or self.attempts < 1:
            raise ConfigError(
                "demonstrations: episodes and noise must not be negative and attempts be at least 1, "
                f"got {self.episodes}, {self.noise}, {self.attempts}"
            )
        if self.path is not None and self.noise:
            raise ConfigError(f"demonstrations of {self.path} are recorded: they take no noise")


@dataclass(frozen=True)
class Stage:
    """How hard a task is; as it comes is the full stage, with all values 1.

    Attributes:
        spread: Share of the randomisation at reset, 0 to 1.
        tolerance: Times the tolerance of success of the task, from 1 on; each task says what that is.
        force: Times the force limit of the task, from 1 on.

    Raises:
        ConfigError: If a value is out of its range.
    """

    spread: float = 1.0
    tolerance: float = 1.0
    force: float = 1.0

    def __post_init__(self) -> None:
        if not 0 <= self.spread <= 1:
            raise ConfigError(f"spread must lie in [0, 1], got {self.spread}")
        for name in ("tolerance", "force"):
            if not getattr(self, name) >= 1:
                raise ConfigError(f"{name} must be at least 1, got {getattr(self, name)}")


FULL = Stage()


@dataclass(frozen=True)
class CurriculumConfig:
    """Which stages there are, and when the next one comes.

    Attributes:
        stages: The easiest first; the full one follows if it is not the last. Without any, training is
            at the full stage from the beginning.
        episodes: How many the running success is over.
        success: What it must exceed for the next stage, 0 to 1.

    Raises:
        ConfigError: If a value is out of its range.
    """

    stages: tuple[Stage, ...] = ()
    episodes: int = 50
    success: float = 0.8

    def __post_init__(self) -> None:
        if self.episodes < 1:
            raise ConfigError(f"a curriculum needs at least 1 episode, got {self.episodes}")
        if not 0 <= self.success < 1:
            raise ConfigError(
                f"success must lie in [0, 1), or it is never exceeded, got {self.success}"
            )


class Curriculum:
    """Where a training is in its curriculum.

    Attributes:
        level: Number of the stage, from 0 on.
    """

    def __init__(self, config: CurriculumConfig = CurriculumConfig()) -> None:
        """Begin at the first stage."""
        self._config = config
        self._stages = list(config.stages)
        if self._stages and self._stages[-1] != FULL:
            self._stages.append(FULL)
        self._recent: deque[bool] = deque(maxlen=config.episodes)
        self.level = 0

    @property
    def stage(self) -> dict[str, float]:
        """The present stage, as `BatchedEnv.set_stage` takes it; empty where there is no curriculum."""
        return asdict(self._stages[self.level]) if self._stages else {}

    @property
    def is_full(self) -> bool:
        """Whether the task is as hard as it comes."""
        return self.level >= len(self._stages) - 1

    def observe(self, finished: Sequence[bool]) -> bool:
        """Take note of episodes that ended, and return whether the next stage begins.

        The running success then begins anew: it was that of an easier task.

        Args:
            finished: Of each, whether it succeeded; in their order.
        """
        if self.is_full:
            return False
        self._recent.extend(finished)
        is_enough = len(self._recent) == self._config.episodes
        if not is_enough or sum(self._recent) <= self._config.success * self._config.episodes:
            return False
        self.level += 1
        self._recent.clear()
        return True

    def state_dict(self) -> dict[str, Any]:
        """Return what changes."""
        return {"level": self.level, "recent": list(self._recent)}

    def load_state_dict(self, state: Mapping[str, Any]) -> None:
        """Go on from there.

        Raises:
            ConfigError: If there is no such stage.
        """
        if not 0 <= state["level"] < max(len(self._stages), 1):
            raise ConfigError(
                f"the checkpoint is at stage {state['level']}, the curriculum has {len(self._stages)}"
            )
        self.level = state["level"]
        self._recent = deque(state["recent"], maxlen=self._config.episodes)


@dataclass(frozen=True)
class TrainConfig:
    """A training.

    Attributes:
        task: Name of the task.
        algo: Name of the algorithm, see `algorithms.algorithm_names`.
        algorithm: Settings of the algorithm by name; see the config class in its file.
        options: Settings of the task.
        cast: Who plays, and `home`, `level`, `room`; see `rcare_marl.make`.
        variants: Further cast entries; environment i of the batch takes the i-th, in turn.
        learners: Roles that learn; the robots if empty.
        partners: Policies of the other roles; several are drawn from, episode by episode.
        residual: For learners that correct the scripted policy: how much they may, 0 to 2, of all values of
            the action or of each.
        bases: For these, the policy that is corrected, by name or file; the scripted one if not given. For
            learners that a script teaches, that script.
        hold: Control steps that an action of the learners lasts; steps are counted in these decisions.
        physics_dt: Physics step [s] of the training.
        engine: What computes the motion, see `rcare_marl.make`.
        randomise: What is another in each episode, see `rcare_marl.make`; kept as a mapping.
        views: For learners, what their network reads of what they observe, see `ViewConfig`.
        seed: Of everything random.
        steps: Control steps of all environments together.
        envs: Environments in the batch.
        workers: Processes that step them; 0 is this one; `async://N` are N that do not wait for each
            other; `ray://...` is a cluster.
        threads: Of the learner; several pay for large batches, and round otherwise.
        demonstrations: What learning begins with.
        curriculum: Easier stages to begin with.
        interval: Steps between two checkpoints, each with an evaluation.
        evaluation_episodes: Episodes of each such evaluation.
        stop_success: Success in two evaluations in a row that ends the training early, 0 to 1.
        minutes: Wall time after which it stops at the end of an interval; it can be resumed.

    Raises:
        ConfigError: If a value is impossible.
        UnknownNameError: If there is no such task, algorithm or field.
    """

    task: str
    algo: str = "sac"
    algorithm: dict[str, Any] = field(default_factory=dict)
    options: dict[str, Any] = field(default_factory=dict)
    cast: dict[str, Any] = field(default_factory=dict)
    variants: tuple[dict[str, Any], ...] = ()
    learners: tuple[str, ...] = ()
    partners: dict[str, Any] = field(default_factory=dict)
    residual: dict[str, Any] = field(default_factory=dict)
    bases: dict[str, Any] = field(default_factory=dict)
    hold: int = 1
    physics_dt: float = 1 / 240
    engine: str = "bullet"
    randomise: Any = None
    views: dict[str, Any] = field(default_factory=dict)
    seed: int = 0
    steps: int = 50_000
    envs: int = 8
    workers: int | str = 0
    threads: int = 1
    demonstrations: Demonstrations = Demonstrations()
    curriculum: CurriculumConfig = CurriculumConfig()
    interval: int = 5_000
    evaluation_episodes: int = 20
    stop_success: float | None = None
    minutes: float | None = None

    def __post_init__(self) -> None:
        object.__setattr__(self, "randomise", Randomisation.of(self.randomise).to_dict())
        for name in ("steps", "envs", "threads", "interval", "evaluation_episodes"):
            if getattr(self, name) < 1:
                raise ConfigError(f"{name} must be at least 1, got {getattr(self, name)}")
        if not 0 <= self.seed < 2**32:  # which NumPy takes
            raise ConfigError(f"seed must be 0 to 2**32 - 1, got {self.seed}")
        if self.stop_success is not None and not 0 < self.stop_success <= 1:
            raise ConfigError(f"stop_success must lie in (0, 1], got {self.stop_success}")
        if self.minutes is not None and not self.minutes > 0:
            raise ConfigError(f"minutes must be positive, got {self.minutes}")
        if isinstance(self.workers, int) and self.workers < 0:
            raise ConfigError(f"workers must not be negative, got {self.workers}")
        self.recipe()  # refuses what is wrong with the scene
        settings = self.algorithm_config()
        if isinstance(self.workers, str):
            self._check_far(self.workers, settings)
        if self.demonstrations.are_wanted and self.taught:
            raise ConfigError(
                f"{self.algo} is shown what to do all along: leave demonstrations out "
                "(--set demonstrations.episodes=0)"
            )
        if self.demonstrations.are_wanted and self.hold > 1:
            raise ConfigError(
                f"demonstrations are of control steps, and here an action lasts {self.hold} of them: leave "
                "demonstrations out (--set demonstrations.episodes=0), or set hold to 1"
            )
        if self.demonstrations.are_wanted and getattr(settings, "cloning_updates", None) == 0:
            raise ConfigError(
                f"{self.algo} learns from its own episodes only: leave demonstrations out "
                "(--set demonstrations.episodes=0), or imitate them first "
                "(--set algorithm.cloning_updates=2000)"
            )

    def _check_far(self, workers: str, settings: Any) -> None:
        """Refuse workers of no known form, or that do not suit what is learned."""
        from rcare_marl.baselines.algorithms.on_policy import OnPolicyConfig  # it needs torch

        if async_count(workers, self.envs) is None:
            Cluster.parse(workers)
            return
        if isinstance(settings, OnPolicyConfig):
            raise ConfigError(
                f"{self.algo} learns from what its present policy did, and {workers!r} collects with "
                "earlier ones too: take a number, or ray://..."
            )
        if self.curriculum.stages:
            raise ConfigError(f"a curriculum cannot reach {workers!r}: take a number, or ray://...")

    @property
    def taught(self) -> bool:
        """Whether the algorithm learns from what a script would do."""
        return bool(getattr(self.algorithm_config(), "TAUGHT", False))

    def recipe(self) -> EnvRecipe:
        """Return how the environments are made."""
        names = [each.name for each in dataclasses.fields(EnvRecipe)]
        return EnvRecipe(**{name: getattr(self, name) for name in names})

    def algorithm_config(self) -> Any:
        """Return the settings of the algorithm, checked."""
        from rcare_marl.baselines.algorithms import config_class  # it needs torch

        return load(config_class(self.algo), self.algorithm, f"algorithm {self.algo!r}")

    def to_dict(self) -> dict[str, Any]:
        """Return plain values, from which `load_config` builds it again."""
        return plain(dataclasses.asdict(self), "config")


def load_config(source: str | Path | Mapping[str, Any]) -> TrainConfig:
    """Return a training from a YAML file or a mapping.

    Raises:
        ConfigError: If a value is impossible, or the file cannot be read.
        UnknownNameError: If a field, task or algorithm does not exist.
    """
    return load(TrainConfig, source)


def everybody_config(task: str) -> dict[str, Any]:
    """Return the fields of the config with which a policy for everybody is trained.

    Raises:
        ConfigError: If none ships for the task.
        UnknownNameError: If there is no such task.
    """
    task_class(task)
    folder = Path(str(files(CONFIGS).joinpath(EVERYBODY)))
    known = sorted(file.stem for file in folder.glob("*.yaml"))
    if task not in known:
        raise ConfigError(
            f"no config {EVERYBODY!r} ships for {task!r}; there are: {', '.join(known)}"
        )
    return read_yaml(folder / f"{task}.yaml")


def default_config(task: str, level: int | None = None) -> dict[str, Any]:
    """Return the fields of the config that ships for a task, as a mapping to change and to load.

    Args:
        task: Name of the task.
        level: Level of accessibility; a config of its own if there is one for it.

    Raises:
        UnknownNameError: If there is no such task.
    """
    task_class(task)
    names = [f"{task}_level{level}"] if level is not None else []
    for name in (*names, task):
        file = Path(str(files(CONFIGS).joinpath(f"{name}.yaml")))
        if file.is_file():
            found = read_yaml(file)
            if level is not None:
                found["cast"] = {**found.get("cast", {}), "level": level}
            return found
    return {"task": task, **({"cast": {"level": level}} if level is not None else {})}
