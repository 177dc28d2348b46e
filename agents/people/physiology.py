"""Vital signs of a person: read at any time, set at any time, and moved by what the body goes through.

Each value approaches a steady state exponentially. The steady state follows from the load on the body
(effort, contact, posture) and from the surroundings, never from another value, so that a control step
is exact and its length does not matter while the load stays the same. The pressures of untreated
dysreflexia add a slow part of their own. The fatigue of a region is the
three-compartment model of Xia & Frey-Law (J. Biomech. 2008) whose active compartment follows the
effort at once. Figures and their sources: `assets/clinical/physiology.yaml`.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple

from rcare_marl.errors import ConfigError, UnknownNameError, check_name
from rcare_marl.observable import Observable

from .avatar import AvatarConfig
from .physiology_model import (
    REGIONS,
    Autonomy,
    PhysiologyModel,
    autonomy,
    physiology_model,
    side_name,
)
from .profile import is_number

if TYPE_CHECKING:
    from .human import Human

WORST_PAIN = 10.0  # of the numerical rating scale


class Load(NamedTuple):
    """What a body goes through.

    Attributes:
        power: Metabolic power of the muscles above rest [W].
        efforts: Greatest share of strength in use by region, 0 to 1, in the order of `REGIONS`.
        forces: Normal force on each touched segment [N], by SMPL-X joint.
        upright: Sine of the trunk's angle with the horizontal: 0 lying, 1 upright.
    """

    power: float = 0.0
    efforts: Sequence[float] = (0.0,) * len(REGIONS)
    forces: Mapping[str, float] = {}
    upright: float = 1.0


@dataclass(frozen=True)
class Quantity:
    """A value that can be read and set.

    Attributes:
        unit: Its unit.
        low: Least value allowed.
        high: Greatest value allowed.
    """

    unit: str
    low: float
    high: float


QUANTITIES: dict[str, Quantity] = {
    "heart_rate": Quantity("1/min", 20, 230),
    "systolic": Quantity("mmHg", 40, 300),
    "diastolic": Quantity("mmHg", 20, 200),
    "respiration_rate": Quantity("1/min", 2, 70),
    "temperature": Quantity("°C", 28, 44),
    "pain": Quantity("1", 0, WORST_PAIN),
    "comfort": Quantity("1", 0, 1),
    "fatigue": Quantity("1", 0, 1),
}
SURROUNDINGS: dict[str, Quantity] = {
    "ambient": Quantity("°C", -30, 55),
    "bladder": Quantity("1", 0, 1),
}
LEAST_PULSE = 10.0  # [mmHg] between the pressures at rest in any state; our own choice
PRESSURES = ("systolic", "diastolic")
_LAGS = tuple(name for name in QUANTITIES if name != "fatigue")
_VITALS = _LAGS[:5]
_INDEX = {name: i for i, name in enumerate(_LAGS)}
_BLADDER_LEVEL = "S2"  # of the cord, where a full bladder reports


class Value:
    """A quantity of `Physiology` as an attribute: read as a number, set within its range."""

    def __set_name__(self, owner: type, name: str) -> None:
        self._name = name

    def __get__(self, physiology: Physiology, owner: type) -> float:
        return physiology.get(self._name)

    def __set__(self, physiology: Physiology, value: float) -> None:
        physiology.set({self._name: value})


class Physiology:
    """The vital signs of one person, and how they feel.

    The vital signs of the profile are those at rest in the posture that the person starts in.

    Attributes:
        heart_rate: [1/min].
        systolic: Blood pressure [mmHg].
        diastolic: Blood pressure [mmHg].
        respiration_rate: [1/min].
        temperature: Core temperature [°C].
        pain: As felt, from 0 (none) to 10 (worst).
        comfort: From 0 (none) to 1.
        fatigue: From 0 to 1, of the most tired region; to set it sets every region.
        ambient: Temperature of the room [°C].
        bladder: How full the bladder is, from 0 to 1: a stimulus that no contact makes.
    """

    heart_rate, systolic, diastolic = Value(), Value(), Value()
    respiration_rate, temperature = Value(), Value()
    pain, comfort, fatigue = Value(), Value(), Value()
    ambient, bladder = Value(), Value()

    def __init__(self, avatar: AvatarConfig, *, model: PhysiologyModel | None = None) -> None:
        """Begin at rest.

        Args:
            avatar: Whose body it is.
            model: The figures; those that ship if None.
        """
        self._model = model = model or physiology_model()
        self._avatar = avatar
        self._nerves = autonomy(avatar.profile.injury_level, model)
        self._figures = f = {name: figure.value for name, figure in model.figures.items()}
        self._segments: dict[str, tuple[float, float, bool]] = {}
        vitals = avatar.profile.vitals
        self._rest = {name: float(getattr(vitals, name)) for name in _VITALS}
        rate = avatar.profile.ventilator_rate
        if rate is not None:
            self._rest["respiration_rate"] = rate
        self._is_ventilated = self._nerves.is_ventilated or rate is not None
        self._greatest_power, self._greatest_rate = self._capacity()
        stems = {"systolic": "pressure", "diastolic": "pressure", "respiration_rate": "respiration"}
        self._times = []  # of rise and fall
        for stem in (stems.get(name, name) for name in _LAGS):
            same = f.get(f"{stem}_time")
            self._times.append(
                (f[f"{stem}_rise"], f[f"{stem}_fall"]) if same is None else (same, same)
            )
        groups = [model.fatigue[region.split("_")[-1]] for region in REGIONS]
        self._rates = [(group.fatigue, group.recovery) for group in groups]
        self.reset()

    def _capacity(self) -> tuple[float, float]:
        """Return the greatest metabolic power above rest [W] and the greatest heart rate [1/min]."""
        f, avatar, nerves = self._figures, self._avatar, self._nerves
        able = f[f"greatest_oxygen_{avatar.sex}"]
        able += f["oxygen_per_year"] * max(avatar.age_years - 20, 0)
        cut = f["greatest_oxygen_tetraplegia"]
        oxygen = max(cut + nerves.outflow * (able - cut), 2 * f["oxygen_at_rest"])
        power = (oxygen - f["oxygen_at_rest"]) / 60 * f["oxygen_energy"] * avatar.mass_kg
        rate = f["greatest_heart_rate"] + f["heart_rate_per_year"] * avatar.age_years
        without = min(f["greatest_heart_rate_tetraplegia"], rate)
        rate = without + nerves.heart * (rate - without)
        return power, max(rate, self._rest["heart_rate"])

    def __setattr__(self, name: str, value: object) -> None:
        if not name.startswith("_") and name not in QUANTITIES and name not in SURROUNDINGS:
            raise UnknownNameError("physiological quantity", name, [*QUANTITIES, *SURROUNDINGS])
        object.__setattr__(self, name, value)

    # Reading and setting.

    def get(self, name: str) -> float:
        """Return a quantity by name; UnknownNameError if there is none."""
        if name in _INDEX:
            value = self._now[_INDEX[name]]
            return value if self._surge == 0 or name not in PRESSURES else self._surged(name, value)
        if name == "fatigue":
            return max(self._tired)
        check_name("physiological quantity", name, [*SURROUNDINGS, *QUANTITIES])
        return self._around[name]

    def _surged(self, name: str, value: float) -> float:
        """Return a pressure with what untreated dysreflexia adds to it [mmHg]."""
        return min(value + self._surge * self._figures[f"surge_{name}"], QUANTITIES[name].high)

    def set(self, values: Mapping[str, float]) -> None:
        """Set quantities by name, all or none; from there they go on as the model says.

        Raises:
            UnknownNameError: If a name is none of a quantity.
            ConfigError: If a value is no number in its range, or the diastolic pressure would not
                stay below the systolic one.
        """
        known = QUANTITIES | SURROUNDINGS
        for name, value in values.items():
            check_name("physiological quantity", name, known)
            _check(name, value, known[name])
        systolic = values.get("systolic", self.systolic)
        diastolic = values.get("diastolic", self.diastolic)
        if not diastolic < systolic:
            raise ConfigError(
                f"diastolic pressure must stay below systolic pressure, got {systolic}/{diastolic} "
                "mmHg: set both at once with set()"
            )
        for name, value in values.items():
            if name in _INDEX:
                added = self._surge * self._figures[f"surge_{name}"] if name in PRESSURES else 0.0
                self._now[_INDEX[name]] = float(value) - added
            elif name == "fatigue":
                self._tired = [float(value)] * len(REGIONS)
            else:
                self._around[name] = float(value)

    def hold(self, values: Mapping[str, float]) -> None:
        """Set quantities as `set` does and keep them there until `release` or `reset`.

        Only vital signs, pain and comfort can be held; the rest follows nothing or the muscles.
        """
        for name in values:
            check_name("quantity that can be held", name, _LAGS)
        self.set(values)
        self._held |= {_INDEX[name] for name in values}

    def release(self) -> None:
        """Let all held quantities follow the model again."""
        self._held.clear()

    def fatigues(self) -> list[float]:
        """Return how tired each of `REGIONS` is, 0 to 1."""
        return list(self._tired)

    def fatigue_of(self, region: str) -> float:
        """Return how tired one of `REGIONS` is, 0 to 1."""
        return self._tired[_region_index(region)]

    def set_fatigue(self, region: str, value: float) -> None:
        """Set how tired one of `REGIONS` is, 0 to 1."""
        _check("fatigue", value, QUANTITIES["fatigue"])
        self._tired[_region_index(region)] = float(value)

    def values(self) -> dict[str, float]:
        """Return all quantities that change by themselves, by name."""
        return {name: self.get(name) for name in QUANTITIES}

    @property
    def nerves(self) -> Autonomy:
        """What an injury of the spinal cord leaves."""
        return self._nerves

    @property
    def pain_segment(self) -> str | None:
        """The SMPL-X joint of the segment that hurt last; None if no contact hurts."""
        return self._pain_segment if self.pain > 0.05 else None

    @property
    def is_dysreflexic(self) -> bool:
        """Whether there is an episode of autonomic dysreflexia."""
        rise = self.systolic - self._rest["systolic"]
        return self._stimulus > 0 and rise >= self._figures["dysreflexia_sign"]

    @property
    def is_hypotensive(self) -> bool:
        """Whether the systolic pressure has fallen by what defines orthostatic hypotension."""
        return self.systolic <= self._rest["systolic"] - self._figures["hypotension"]

    def observables(self) -> list[Observable]:
        """Return the quantities as observables, for any agent that may see them."""

        def read(name: str) -> Callable[[], tuple[float]]:
            return lambda: (self.get(name),)

        return [Observable(name, q.unit, 1, read(name)) for name, q in QUANTITIES.items()]

    # Time.

    def reset(self, *, upright: float = 1.0) -> None:
        """Return to the vital signs of the profile, rested, free of pain, in a mild room.

        Args:
            upright: Sine of the trunk's angle with the horizontal in the start posture.
        """
        self._now = [*self._rest.values(), 0.0, 1.0]
        self._tired = [0.0] * len(REGIONS)
        self._around: dict[str, float] = {
            "ambient": self._figures["neutral_ambient"],
            "bladder": 0.0,
        }
        self._held = set[int]()
        self._pain_segment: str | None = None
        self._stimulus, self._start_upright = 0.0, upright
        self._surge: float = 0.0

    def advance(self, duration: float, load: Load) -> None:
        """Go on for `duration` [s] under a constant load."""
        if duration <= 0:
            return
        now = self._now
        for i, aim in enumerate(self._at_once(load)):
            if i not in self._held:
                now[i] = lagged(now[i], aim, duration, self._times[i])
        if not self._held & {_INDEX[name] for name in PRESSURES}:
            times = self._figures["surge_rise"], self._figures["surge_fall"]
            self._surge = lagged(self._surge, self._untreated(), duration, times)
        least = self._figures["tireless_effort"]
        for i, effort in enumerate(load.efforts):
            demand = min(effort, 1.0) if effort > least else 0.0
            if demand > 0 or self._tired[i] > 0:
                fatigue, recovery = self._rates[i]
                rests = effort <= self._figures["rest_effort"]
                more = self._figures["rest_recovery"] if rests else 1.0
                self._tired[i] = tire(self._tired[i], demand, duration, fatigue, more * recovery)

    def steady(self, load: Load) -> tuple[float, ...]:
        """Return where vital signs, pain and comfort tend to, in the order of `QUANTITIES`."""
        out = list(self._at_once(load))
        for name in PRESSURES:
            surge = self._untreated() * self._figures[f"surge_{name}"]
            out[_INDEX[name]] = _inside(name, out[_INDEX[name]] + surge)
        return tuple(out)

    def _untreated(self) -> float:
        """Return the share of the slow part that the present stimulus would reach if it stayed."""
        mild = self._figures["dysreflexia_mild"]
        return max(self._stimulus - mild, 0.0) / (2.0 - mild)

    def _at_once(self, load: Load) -> tuple[float, ...]:
        """Return the same as `steady` without the slow part of dysreflexia."""
        f, nerves, rest = self._figures, self._nerves, self._rest
        pain, touch, self._stimulus = self._feel(load.forces)
        stimulus = min(self._stimulus, 1.0)
        exertion = min(max(load.power, 0.0) / self._greatest_power, 1.0)
        risen = load.upright - self._start_upright
        cut, left = 1 - nerves.outflow, nerves.outflow
        warmer = self._around["ambient"] - f["neutral_ambient"]
        heart_rate = (
            rest["heart_rate"]
            + exertion * (self._greatest_rate - rest["heart_rate"])
            + pain * f["pain_heart_rate"] * nerves.heart
            + risen * (left * f["upright_heart_rate"] + cut * f["upright_heart_rate_tetraplegia"])
            + stimulus * f["dysreflexia_heart_rate"]
        )
        systolic = (
            rest["systolic"]
            + left * (exertion * f["effort_systolic"] + pain * f["pain_systolic"])
            + risen * cut * f["upright_systolic_tetraplegia"]
            + stimulus * f["dysreflexia_systolic"]
        )
        diastolic = (
            rest["diastolic"]
            + left * pain * f["pain_diastolic"]
            + risen * (left * f["upright_diastolic"] + cut * f["upright_diastolic_tetraplegia"])
            + stimulus * f["dysreflexia_diastolic"]
        )
        breath = 0.0 if self._is_ventilated else 1.0
        respiration = rest["respiration_rate"] + breath * (
            exertion * f["effort_respiration"] + pain * f["pain_respiration"]
        )
        drift = left * f["ambient_temperature"] + cut * f["ambient_temperature_tetraplegia"]
        temperature = rest["temperature"] + exertion * f["effort_temperature"] + warmer * drift
        thermal = max(abs(warmer) - f["ambient_tolerance"], 0.0) * f["ambient_discomfort"]
        comfort = (1 - touch) * (1 - 0.5 * exertion) * max(1 - thermal, 0.0)
        systolic = _inside("systolic", systolic)
        return (
            _inside("heart_rate", heart_rate),
            systolic,
            min(_inside("diastolic", diastolic), systolic - LEAST_PULSE),
            _inside("respiration_rate", respiration),
            _inside("temperature", temperature),
            pain,
            comfort,
        )

    def _feel(self, forces: Mapping[str, float]) -> tuple[float, float, float]:
        """Return pain (0 to 10), discomfort (0 to 1) and what a cut cord receives (0 to 2)."""
        f = self._figures
        worst, unnoticed = f["worst_pain_force"], f["unnoticed_force"]
        full = max(2 * self._around["bladder"] - 1, 0.0)
        is_cut = self._nerves.is_below(_BLADDER_LEVEL)
        touch, bladder = (0.0, full) if is_cut else (full, 0.0)
        pain, noxious, hurt = 0.0, 0.0, None
        for joint, force in forces.items():
            threshold, sensation, is_below = self._segment(joint)
            ratio = force / threshold
            felt = ratio * sensation
            touch = max(touch, min((felt - unnoticed) / (1 - unnoticed), 1.0))
            if felt > 1 and felt > pain:
                pain, hurt = felt, joint
            if is_below and ratio > 1:
                noxious = max(noxious, min((ratio - 1) / (worst - 1), 1.0))
        if hurt is not None:
            self._pain_segment = hurt
            pain = WORST_PAIN * min((pain - 1) / (worst - 1), 1.0)
        return pain, touch, noxious + bladder if self._nerves.is_dysreflexic else 0.0

    def _segment(self, joint: str) -> tuple[float, float, bool]:
        """Return force where pain begins [N], share that is felt, and whether the cord is cut above."""
        if joint not in self._segments:
            part = self._model.part(joint)
            is_below = self._nerves.is_below(part.level)
            sensation = self._avatar.profile.side(side_name(joint)).sensation
            if self._nerves.injury is not None and not is_below:
                sensation = "normal"
            share = {"normal": 1.0, "reduced": self._figures["reduced_sensation"], "absent": 0.0}
            self._segments[joint] = (part.pain_force, share[sensation], is_below)
        return self._segments[joint]


def lagged(value: float, aim: float, duration: float, times: tuple[float, float]) -> float:
    """Return where a value is after some time [s] on its way to an aim, for times of rise and fall [s]."""
    return aim + (value - aim) * math.exp(-duration / (times[0] if aim > value else times[1]))


def tire(tired: float, effort: float, duration: float, fatigue: float, recovery: float) -> float:
    """Return the tired share of a muscle after an effort that lasts.

    The three-compartment model: active muscle tires at the rate `fatigue`, tired muscle recovers at the
    rate `recovery` [1/s]. What is active is the effort, as long as enough muscle is not tired; then all
    of the rest. Both phases are linear, so the result is exact for any duration.

    Args:
        tired: Tired share at the start, 0 to 1.
        effort: Share of full strength that is asked for, 0 to 1.
        duration: How long [s].
        fatigue: Rate F [1/s].
        recovery: Rate R [1/s].
    """
    spent = 1 - effort  # from this tired share on the effort asks for more than there is
    for _ in range(2):
        is_spent = tired > spent or (tired == spent and fatigue * effort > recovery * spent)
        rate = fatigue + recovery if is_spent else recovery
        aim = fatigue / rate if is_spent else fatigue * effort / rate
        after = aim + (tired - aim) * math.exp(-rate * duration)
        if (after > spent) == is_spent or tired == spent:
            return min(max(after, 0.0), 1.0)
        duration -= math.log((tired - aim) / (spent - aim)) / rate
        tired = spent
    return tired


def vital_signs(person: Human) -> list[Observable]:
    """Return what a monitor of vital signs shows of a person, for a task to give to another agent.

    Names begin with the person's role: `recipient_heart_rate`.
    """
    shown = ("heart_rate", "systolic", "diastolic", "respiration_rate", "temperature")
    return [
        Observable(f"{person.name}_{o.name}", o.unit, o.size, o.read)
        for o in person.physiology.observables()
        if o.name in shown
    ]


def _check(name: str, value: object, quantity: Quantity) -> None:
    if not is_number(value, quantity.low, quantity.high):
        raise ConfigError(
            f"{name} must lie in {quantity.low:g}..{quantity.high:g} {quantity.unit}, got {value!r}"
        )


def _inside(name: str, value: float) -> float:
    quantity = QUANTITIES[name]
    return min(max(value, quantity.low), quantity.high)


def _region_index(region: str) -> int:
    check_name("region of fatigue", region, REGIONS)
    return REGIONS.index(region)
