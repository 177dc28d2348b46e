"""What to know of a trained policy before it is used: how it came about, how good it is, its limits.

Example:
    >>> card = ModelCard.of("baselines/trained/feeding.npz", record)
    >>> print(card.markdown())
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import yaml

from rcare_marl.console import markdown_table
from rcare_marl.envs.registry import task_class

from ..policy_file import PolicyFile
from .protocol import digest

LIMITS = (
    "For research in simulation. It must not move a robot near a person: nothing in its training or "
    "evaluation shows that it would be safe there.",
    "It observes what only a simulator knows exactly, without noise or delay, unless it was trained with "
    "sensors or randomised.",
    "It is shown to work with the people, the robots, the room and the settings named here. With others it "
    "may press, spill or stop, though it accepts them where they observe and move alike.",
    "Success and force are those of rigid bodies and simplified tissue; forces on a real person would be "
    "others.",
)
FORCES = ("peak_force_n", "mean_force_n", "prom_violation_deg_s", "pain")  # shown of an evaluation


@dataclass(frozen=True)
class ModelCard:
    """A card of a policy file.

    Attributes:
        name: Of the file, without its ending.
        task: What it was trained to do.
        roles: Whom it plays.
        sha256: Of the file.
        network: Sizes of its layers, its number of parameters, and the bytes of the file.
        training: How it was trained: algorithm, reward, demonstrations, seed, steps, minutes, machine.
        trained_on: Task settings, cast and partners that it met.
        evaluation: What it reached, and all policies that were trained alike; empty without a record.
        limits: What it is not for.
    """

    name: str
    task: str
    roles: tuple[str, ...]
    sha256: str
    network: Mapping[str, Any]
    training: Mapping[str, Any]
    trained_on: Mapping[str, Any]
    evaluation: Mapping[str, Any]
    limits: tuple[str, ...] = LIMITS

    @classmethod
    def of(
        cls,
        path: str | Path,
        record: Mapping[str, Any] | None = None,
        alone: Mapping[str, Any] | None = None,
    ) -> ModelCard:
        """Return the card of a policy file.

        Args:
            path: The file.
            record: An evaluation of it, perhaps beside others, see `protocol.read_record`.
            alone: A later one of it alone, whose success counts then.

        Raises:
            ConfigError: If the file cannot be read.
        """
        file, place = PolicyFile.read(path), Path(path)
        sizes = [file.observation_size, *(len(biases) for _, biases in file.layers)]
        learned = beginning(file.residual, file.training)
        learned += f", a decision every {file.hold} control steps" if file.hold > 1 else ""
        given = {
            key: value
            for key, value in file.recipe.items()
            if key not in ("task", "residual", "hold", "physics_dt", "views", "taught") and value
        }
        return cls(
            name=place.stem,
            task=file.task,
            roles=file.roles,
            sha256=digest(place),
            network={
                "layers": sizes,
                "parameters": sum(w.size + b.size for w, b in file.layers),
                "bytes": place.stat().st_size,
                "learned": learned,
                "observes": [name for name, _ in file.observed],
            },
            training=dict(file.training),
            trained_on={"default_cast": default_cast(file.task), **given},
            evaluation=_evaluation(digest(place), record, alone),
        )

    def to_yaml(self) -> str:
        """Return the card as YAML."""
        plain = {**asdict(self), "roles": list(self.roles), "limits": list(self.limits)}
        return str(yaml.safe_dump(plain, sort_keys=False, allow_unicode=True, width=100))

    def markdown(self) -> str:
        """Return the card as a section in Markdown, without its limits, which are those of all."""
        rows = [
            ("Task", f"{self.task}, as {', '.join(self.roles)}"),
            ("Learned", f"{self.network['learned']}, {_told(self.training)}"),
            ("Trained on", _told(self.trained_on)),
            (
                "Network",
                f"{' - '.join(map(str, self.network['layers']))}, {self.network['parameters']:,} "
                f"parameters, {self.network['bytes'] / 1000:.0f} kB",
            ),
            ("Observes", ", ".join(f"`{name}`" for name in self.network["observes"])),
            ("Evaluation", _shown(self.evaluation)),
        ]
        return f"## {self.name}\n\n{markdown_table(('', ''), rows)}\n"


def beginning(residual: float | Sequence[float] | None, training: Mapping[str, Any]) -> str:
    """Return what the learning of a policy began with.

    Args:
        residual: How much it may correct the scripted policy; None if it does not.
        training: How it was trained, see `PolicyFile.training`.
    """
    if residual is not None:
        scales = residual if isinstance(residual, Sequence) else (residual,)
        return f"residual of scale {' '.join(f'{scale:g}' for scale in scales)}"
    if training.get("algorithm") == "dagger":
        return "by imitating a script on its own episodes"
    return "from demonstrations" if training.get("demonstrations") else "from scratch"


def default_cast(task: str) -> dict[str, str]:
    """Return the model that plays each role of a task where nobody else is named."""
    roles = task_class(task).roles().items()
    return {name: role.default for name, role in roles if role.default is not None}


def _evaluation(
    sha256: str, record: Mapping[str, Any] | None, alone: Mapping[str, Any] | None
) -> dict[str, Any]:
    """Return what records say of one policy, and of all beside it."""
    if record is None:
        return {}
    summary, plan = record["summary"], record["plan"]
    out: dict[str, Any] = {
        "policies": len(record["policies"]),
        "episodes_each": plan["episodes"],
        "seeds": [plan["seed"], plan["seed"] + plan["episodes"] - 1],
        "all_success": {key: summary["success"][key] for key in ("mean", "interval_95", "iqm")},
        "all_measures": {
            name: {key: summary[name][key] for key in ("mean", "interval_95", "max")}
            for name in FORCES
            if name in summary
        },
    }
    for entry in [*record["policies"], *(alone["policies"] if alone else ())]:
        if entry["file"] is not None and entry["file"]["sha256"] == sha256:
            out["success"] = entry["success_rate"]
            out["success_interval_95"] = entry["success_interval_95"]
    return out


def _shown(evaluation: Mapping[str, Any]) -> str:
    if not evaluation:
        return "none"
    first, last = evaluation["seeds"]
    texts = []
    if "success" in evaluation:
        texts.append(
            f"this policy {_rate(evaluation['success'], evaluation['success_interval_95'])}"
        )
    everyone = evaluation["all_success"]
    texts.append(
        f"{evaluation['policies']} training seeds {_rate(everyone['mean'], everyone['interval_95'])}"
    )
    for name, numbers in evaluation["all_measures"].items():
        texts.append(f"`{name}` {numbers['mean']:.3g}, at most {numbers['max']:.3g}")
    return f"seeds {first} to {last}: {'; '.join(texts)}"


def _rate(rate: float, interval: tuple[float, float]) -> str:
    low, high = interval
    return f"{100 * rate:.1f} % (95 %: {100 * low:.1f} to {100 * high:.1f})"


def _told(facts: Mapping[str, Any]) -> str:
    """Return facts as a text, without versions."""
    texts = []
    for name, value in facts.items():
        if name == "versions":
            continue
        shown = f"({_told(value)})" if isinstance(value, Mapping) else value
        texts.append(f"{name.replace('_', ' ')} {shown}")
    return ", ".join(texts) or "not recorded"
