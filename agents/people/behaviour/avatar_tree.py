"""The tree of each avatar: which reusable pieces, in which order, with which thresholds."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np
from py_trees.behaviour import Behaviour

from rcare_marl import assets
from rcare_marl.config import load
from rcare_marl.errors import ConfigError

from ...agent import Array
from ...policy import Policy
from ..human import Human
from .behaviour_tree import OPENING, BehaviourTree
from .cue import GESTURES, Cues
from .leaves import Actor, LetGo, first_of, together
from .subtree import (
    cough,
    flinch,
    hold_still,
    instructed,
    limbs,
    look,
    mouth,
    refuse,
    relax,
    rest_when_tired,
)

Reaction = Literal["cough", "flinch", "refuse", "rest"]
Activity = Literal["look", "mouth", "limbs"]


@dataclass(frozen=True)
class BehaviourConfig:
    """How a person behaves (`assets/behaviours/<avatar>.yaml`).

    What somebody cannot do is left out of their tree by itself: the profile and the DoFs that move say so.

    Attributes:
        description: In a sentence, and why.
        reactions: What interrupts everything below it, first the strongest.
        activities: What goes on side by side when nothing interrupts.
        watches: What the eyes follow first, if the scene has it: the spoon or another person.
        flinches_from: Pain, of ten, that makes them withdraw.
        opens_within: Distance of the spoon at which the mouth opens [m].
        opening: Share of the active range that the mouth opens.
        tired_from: Fatigue at which they rest.
        rested_below: Fatigue at which they go on.
    """

    description: str
    reactions: tuple[Reaction, ...] = ("cough", "flinch", "refuse", "rest")
    activities: tuple[Activity, ...] = ("look", "mouth", "limbs")
    watches: Literal["spoon", "people"] = "spoon"
    flinches_from: float = 3.0
    opens_within: float = 0.20
    opening: float = OPENING
    tired_from: float = 0.6
    rested_below: float = 0.3

    def __post_init__(self) -> None:
        for key in ("reactions", "activities"):
            if len(set(getattr(self, key))) != len(getattr(self, key)):
                raise ConfigError(f"{key} names something twice: {getattr(self, key)}")
        if not self.activities:
            raise ConfigError("activities must name one at least")
        for key, most in (("flinches_from", "10"), ("opens_within", "1 m"), ("opening", "1")):
            if not 0 < getattr(self, key) <= float(most.split()[0]):
                raise ConfigError(f"{key} must lie in 0..{most}, got {getattr(self, key)}")
        if not 0 <= self.rested_below <= self.tired_from <= 1:
            raise ConfigError(
                f"fatigue must satisfy 0 <= rested_below <= tired_from <= 1, got "
                f"{self.rested_below} and {self.tired_from}"
            )


@dataclass(frozen=True)
class Surroundings:
    """What a scene lets a person know.

    Attributes:
        clock: Returns the simulated time [s].
        spoon: Returns where the spoon's bowl is in the world [m]; None where there is none.
        partner: Returns where somebody else's face is in the world [m]; None without company.
        is_full: Returns whether something is in the person's mouth.
        chokes: Returns whether something went the wrong way in the last control step.
        job: Who decides what the person does in this scene when nothing else is to be done, such as to
            lift a leg or to let a limb be taken; nobody if None, and they keep the limbs at rest.
    """

    clock: Callable[[], float]
    spoon: Callable[[], Array] | None = None
    partner: Callable[[], Array] | None = None
    is_full: Callable[[], bool] = lambda: False
    chokes: Callable[[], bool] = lambda: False
    job: Policy | None = None


def load_behaviour(name: str | Path) -> BehaviourConfig:
    """Return the behaviour of that name, or from that YAML file."""
    return load(BehaviourConfig, assets.find("behaviours", name))


def behaviour_of(person: Human) -> BehaviourConfig:
    """Return the behaviour that ships for a person's avatar, or the general one."""
    name = person.avatar.name.lower().replace(" ", "_")
    return load_behaviour(name if name in assets.names("behaviours") else "anybody")


def make_tree(actor: Actor, config: BehaviourConfig, around: Surroundings) -> Behaviour:
    """Return the tree of a person.

    Highest first: reactions in the order of `config`, then `hold still` and `relax` when asked, then
    all activities side by side. Who can do none of them in this scene is still.
    """
    person, spoon = actor.person, around.spoon
    gap: Callable[[], float] | None = None
    if spoon is not None:

        def gap() -> float:
            return float(np.linalg.norm(spoon() - person.mouth_position()))

    choices = (spoon, around.partner) if config.watches == "spoon" else (around.partner, spoon)
    made: dict[str, Behaviour | None] = {
        "cough": cough(actor),
        "flinch": flinch(actor, pain=config.flinches_from),
        "refuse": refuse(actor, spoon),
        # Who has a job rests as the job says.
        "rest": None
        if around.job is not None
        else rest_when_tired(actor, tired=config.tired_from, rested=config.rested_below),
        "look": look(actor, choices[0] or choices[1]),
        "mouth": mouth(
            actor,
            gap,
            opens_within=config.opens_within,
            opening=config.opening,
            is_full=around.is_full,
        ),
        "limbs": limbs(actor, has_job=around.job is not None),
    }
    reactions = [branch for key in config.reactions if (branch := made[key]) is not None]
    does = tuple(config.activities)
    if around.job is not None:  # whoever has one does it, whatever else they do
        does = (*(key for key in does if key != "limbs"), "limbs")
    activities = [branch for key in does if (branch := made[key]) is not None]
    engage = together("engage", *activities) if activities else LetGo("be still", actor.intent)
    return first_of(
        person.avatar.name,
        *reactions,
        instructed(actor, "hold still", hold_still(actor)),
        instructed(actor, "relax", relax(actor)),
        engage,
    )


class AvatarBehaviour(BehaviourTree):
    """A person who behaves as their tree says.

    Attributes:
        root: The tree.
        cues: What reaches them from outside; settable between control steps, forgotten at a reset.
        config: How they behave.
    """

    def __init__(
        self,
        person: Human,
        around: Surroundings,
        control_dt: float,
        *,
        config: BehaviourConfig | None = None,
    ) -> None:
        """Build the tree for a person who has been spawned.

        Args:
            person: Who acts.
            around: What the scene lets them know.
            control_dt: Length of a control step [s].
            config: How they behave; what ships for the avatar if None.
        """
        self.config = config or behaviour_of(person)
        actor = Actor(person, around.clock)
        self.cues: Cues = actor.cues
        self._chokes, self._job = around.chokes, around.job
        root = make_tree(actor, self.config, around)
        possible = {node.name for node in root.iterate()}
        actor.cues.instruction.possible = frozenset(possible & GESTURES.keys())
        super().__init__(person, actor.intent, root, control_dt, actor.deed)

    def reset(self, rng: np.random.Generator) -> None:
        super().reset(rng)
        self.cues.clear()
        if self._job is not None:
            self._job.reset(rng)

    def act(self) -> Array:
        self.cues.must_cough = self.cues.must_cough or self._chokes()
        return super().act()

    def _moving(self) -> Array:
        if self._job is not None and self._deed.works:
            return np.array(self._job.act())
        return super()._moving()
