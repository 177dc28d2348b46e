"""The figures of the physiological model, and what an injury of the spinal cord takes away."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

from rcare_marl import assets
from rcare_marl.config import load
from rcare_marl.errors import ConfigError, check_name

from .body.skeleton import JOINTS, SIDES
from .profile import SPINAL_LEVELS

REGIONS = ("neck", "trunk", "left_arm", "right_arm", "left_leg", "right_leg")


@dataclass(frozen=True)
class Figure:
    """A number of the model.

    Attributes:
        value: In the unit.
        unit: SI but for mmHg, °C, ml and min, as clinicians write them.
        source: Where it comes from.
    """

    value: float
    unit: str
    source: str


@dataclass(frozen=True)
class Level:
    """A segment of the spinal cord with a meaning.

    Attributes:
        value: Such as `T6`.
        source: Where it comes from.
    """

    value: str
    source: str

    def __post_init__(self) -> None:
        level_index(self.value)


@dataclass(frozen=True)
class Part:
    """A part of the body.

    Attributes:
        pain_force: Force where pain begins [N].
        level: Segment of the cord that feels most of it.
        tires: Group of `fatigue`: neck, trunk, arm or leg.
    """

    pain_force: float
    level: str
    tires: str

    def __post_init__(self) -> None:
        level_index(self.level)
        if not self.pain_force > 0:
            raise ConfigError(f"pain_force must be positive, got {self.pain_force} N")


@dataclass(frozen=True)
class FatigueRates:
    """Rates of the three-compartment model.

    Attributes:
        fatigue: Of active muscle becoming tired [1/s].
        recovery: Of tired muscle becoming rested [1/s].
        source: Where they come from.
    """

    fatigue: float
    recovery: float
    source: str

    def __post_init__(self) -> None:
        if not (self.fatigue > 0 and self.recovery > 0):
            raise ConfigError("rates of fatigue and recovery must be positive")


@dataclass(frozen=True)
class PhysiologyModel:
    """All figures of the model (`assets/clinical/physiology.yaml`).

    Attributes:
        figures: Time constants, gains and thresholds.
        levels: Segments of the cord with a meaning.
        parts: Parts of the body by SMPL-X joint without side and without the number of a finger's bone.
        fatigue: Rates by group.
    """

    figures: dict[str, Figure]
    levels: dict[str, Level]
    parts: dict[str, Part]
    fatigue: dict[str, FatigueRates]

    def figure(self, name: str) -> float:
        """Return a figure; UnknownNameError if there is none."""
        check_name("physiological figure", name, self.figures)
        return self.figures[name].value

    def level(self, name: str) -> int:
        """Return the index of a meaningful level; UnknownNameError if there is none."""
        check_name("meaningful level", name, self.levels)
        return level_index(self.levels[name].value)

    def part(self, joint: str) -> Part:
        """Return the part of an SMPL-X joint; UnknownNameError if there is none."""
        name = part_name(joint)
        check_name("part of the body", name, self.parts)
        return self.parts[name]

    def region(self, joint: str) -> str:
        """Return which of `REGIONS` a joint belongs to."""
        group = self.part(joint).tires
        return f"{side_name(joint)}_{group}" if group in ("arm", "leg") else group


@lru_cache(maxsize=1)
def physiology_model() -> PhysiologyModel:
    """Return the model's figures."""
    model = load(PhysiologyModel, assets.find("clinical", "physiology"))
    for joint in JOINTS:
        check_name("group of fatigue", model.part(joint).tires, model.fatigue)
    return model


def level_index(level: str) -> int:
    """Return how far down the cord a segment lies, 0 for C1; UnknownNameError if there is none."""
    check_name("spinal level", level, SPINAL_LEVELS)
    return SPINAL_LEVELS.index(level)


def side_name(joint: str) -> str:
    """Return `left`, `right` or `axial`, as profiles call the sides."""
    side = joint.split("_")[0]
    return side if side in SIDES else "axial"


def part_name(joint: str) -> str:
    """Return an SMPL-X joint without its side and without the number of a finger's bone."""
    bare = joint.removeprefix("left_").removeprefix("right_")
    return bare if bare.startswith("spine") else bare.rstrip("123")


@dataclass(frozen=True)
class Autonomy:
    """What a level of injury leaves of the nerves that run the body by themselves.

    Attributes:
        injury: Index of the lowest segment that still works; None without injury.
        heart: Share of the heart's sympathetic nerves that are left, 0 to 1.
        outflow: Share of all sympathetic nerves that are left, 0 to 1.
        is_dysreflexic: Whether a noxious stimulus below the injury raises the pressure.
        is_ventilated: Whether a machine breathes.
    """

    injury: int | None
    heart: float
    outflow: float
    is_dysreflexic: bool
    is_ventilated: bool

    def is_below(self, level: str) -> bool:
        """Return whether a segment is cut off from the brain."""
        return self.injury is not None and level_index(level) > self.injury


def autonomy(injury_level: str | None, model: PhysiologyModel) -> Autonomy:
    """Return what an injury leaves; shares are those of the segments from T1 on that lie above it."""
    if injury_level is None:
        return Autonomy(None, 1.0, 1.0, False, False)
    injury, first = level_index(injury_level), level_index("T1")

    def left(last: int) -> float:
        return min(max((injury - first + 1) / (last - first + 1), 0.0), 1.0)

    return Autonomy(
        injury,
        left(model.level("heart")),
        left(model.level("outflow")),
        injury <= model.level("dysreflexia_at_or_above"),
        injury <= model.level("ventilated_at_or_above"),
    )
