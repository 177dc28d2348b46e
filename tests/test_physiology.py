"""Physiology: each answer has its direction and its steady state, and time steps do not matter."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable
from typing import Literal

import numpy as np
import pytest

from rcare_marl import assets
from rcare_marl.agents.people.avatar import AvatarConfig, load_avatar
from rcare_marl.agents.people.body.skeleton import JOINTS
from rcare_marl.agents.people.physiology import QUANTITIES, Load, Physiology, tire
from rcare_marl.agents.people.physiology_model import REGIONS, physiology_model
from rcare_marl.agents.people.profile import ClinicalProfile
from rcare_marl.errors import ConfigError, UnknownNameError

AVATARS = assets.names("avatars")
LONG = 40_000.0  # [s], in which everything comes to its steady state


Sensation = Literal["normal", "reduced", "absent"]


def body(injury: str | None = None, **sides: Sensation) -> Physiology:
    """Return the physiology of the caregiver with an injury and a sensation by side."""
    avatar = load_avatar("caregiver")
    profile = dataclasses.replace(avatar.profile, injury_level=injury)
    for side, sensation in sides.items():
        changed = dataclasses.replace(profile.side(side), sensation=sensation)
        profile = dataclasses.replace(profile, **{side: changed})  # type: ignore[arg-type]
    return Physiology(dataclasses.replace(avatar, profile=profile))


def after(physiology: Physiology, load: Load, seconds: float = LONG) -> dict[str, float]:
    physiology.advance(seconds, load)
    return physiology.values()


# Rest.


@pytest.mark.parametrize("avatar", AVATARS)
def test_a_body_at_rest_keeps_the_vital_signs_of_its_profile(avatar: str) -> None:
    physiology, vitals = Physiology(load_avatar(avatar)), load_avatar(avatar).profile.vitals
    rest = physiology.values()
    assert (rest["heart_rate"], rest["systolic"], rest["diastolic"], rest["temperature"]) == (
        vitals.heart_rate, vitals.systolic, vitals.diastolic, vitals.temperature,
    )  # fmt: skip
    assert (rest["pain"], rest["comfort"], rest["fatigue"]) == (0, 1, 0)
    assert after(physiology, Load()) == pytest.approx(rest)


# Effort.


def test_heart_rate_pressure_breath_and_temperature_rise_with_effort_and_return() -> None:
    physiology = body()
    rest, signs = physiology.values(), ("heart_rate", "systolic", "respiration_rate", "temperature")
    seen = [after(physiology, Load(power=power)) for power in (50.0, 150.0, 400.0)]
    for sign in signs:
        rising = [rest[sign], *(values[sign] for values in seen)]
        assert rising == sorted(rising) and rising[-1] > rising[0]
    assert after(physiology, Load())["heart_rate"] == pytest.approx(rest["heart_rate"])


def test_the_greatest_effort_brings_the_heart_to_the_rate_of_the_age() -> None:
    assert after(body(), Load(power=1e6))["heart_rate"] == pytest.approx(208 - 0.7 * 40)


def test_a_heart_without_sympathetic_nerves_stays_slow() -> None:
    assert after(body("C5"), Load(power=1e6))["heart_rate"] == pytest.approx(120)
    assert 120 < after(body("T3"), Load(power=1e6))["heart_rate"] < 180
    assert after(body("T8"), Load(power=1e6))["heart_rate"] == pytest.approx(180)


def test_heart_rate_takes_its_time_constant_to_do_63_percent_of_a_rise() -> None:
    physiology, aim = body(), body().steady(Load(power=100))[0]
    rest, time = physiology.heart_rate, physiology_model().figure("heart_rate_rise")
    physiology.advance(time, Load(power=100))
    assert physiology.heart_rate == pytest.approx(rest + (aim - rest) * (1 - 1 / math.e))


# Fatigue.


def test_the_harder_the_effort_the_sooner_the_muscle_is_spent() -> None:
    """The shoulder holds half of its strength for about a minute (Frey-Law et al. 2012)."""
    rates = physiology_model().fatigue["arm"]

    def endurance(effort: float) -> float:
        seconds = 0.0
        tired = 0.0
        while tired < 1 - effort and seconds < 3600:
            tired = tire(tired, effort, 0.5, rates.fatigue, rates.recovery)
            seconds += 0.5
        return seconds

    times = [endurance(effort) for effort in (0.25, 0.5, 0.75)]
    assert times == sorted(times, reverse=True)
    assert 45 < times[1] < 75


def test_only_the_region_that_works_tires_and_it_recovers() -> None:
    physiology = body()
    efforts = [0.0] * len(REGIONS)
    efforts[REGIONS.index("right_arm")] = 0.5
    physiology.advance(60, Load(efforts=efforts))
    tired = physiology.fatigue_of("right_arm")
    assert physiology.fatigue == tired > 0.3
    assert physiology.fatigue_of("left_arm") == 0
    physiology.advance(600, Load())
    assert 0 < physiology.fatigue < 0.5 * tired


def test_a_small_effort_can_be_held_for_ever() -> None:
    assert after(body(), Load(efforts=(0.1,) * len(REGIONS)))["fatigue"] == 0


# Touch and pain.


def test_pain_begins_at_the_force_of_the_part_and_grows_with_it() -> None:
    pains = [after(body(), Load(forces={"head": force}))["pain"] for force in (60, 70, 100, 130)]
    assert pains[0] == 0 and pains == sorted(pains) and pains[-1] == pytest.approx(10)
    assert after(body(), Load(forces={"left_hip": 70}))["pain"] == 0


def test_a_touch_that_does_not_hurt_can_still_be_uncomfortable() -> None:
    values = after(body(), Load(forces={"head": 40}))
    assert values["pain"] == 0 and 0 < values["comfort"] < 0.7
    assert after(body(), Load(forces={"head": 5}))["comfort"] == 1


def test_sensation_lets_through_all_half_or_nothing() -> None:
    load = Load(forces={"left_elbow": 400})
    full, half, none = (
        after(body(left=sensation), load)["pain"] for sensation in ("normal", "reduced", "absent")
    )
    assert full == 10 and 0 < half < full and none == 0


def test_pain_says_where_and_fades() -> None:
    physiology = body()
    physiology.advance(1, Load(forces={"left_elbow": 300, "right_knee": 200}))
    assert physiology.pain_segment == "left_elbow"  # 1.9 times its limit, the knee 1.5 times
    physiology.advance(60, Load())
    assert physiology.pain < 0.01 and physiology.pain_segment is None


@pytest.mark.parametrize("avatar", ["jose", "daniel", "natalia"])
def test_the_face_feels_above_an_injury_of_the_cord(avatar: str) -> None:
    physiology = Physiology(load_avatar(avatar))
    assert after(physiology, Load(forces={"head": 100}))["pain"] > 3
    physiology.reset()
    assert after(physiology, Load(forces={"spine1": 1000}))["pain"] == 0


# Autonomic dysreflexia.


@pytest.mark.parametrize(
    ("injury", "answers"), [("C3", True), ("T1", True), ("T6", True), ("T7", False), (None, False)]
)
def test_dysreflexia_needs_an_injury_at_or_above_t6(injury: str | None, answers: bool) -> None:
    physiology = body(injury, left="absent")
    rest = physiology.values()
    values = after(physiology, Load(forces={"left_hip": 330}))  # 1.5 times what would hurt
    rise = values["systolic"] - rest["systolic"]
    assert physiology.is_dysreflexic is answers
    if answers:
        assert 20 <= rise <= 40 and values["heart_rate"] < rest["heart_rate"]
        assert values["pain"] == 0
        after(physiology, Load())
        assert physiology.systolic == pytest.approx(rest["systolic"])
    else:
        assert rise == 0 and values["heart_rate"] == rest["heart_rate"]


def test_a_stimulus_above_the_injury_is_no_dysreflexia() -> None:
    physiology = body("T4")
    values = after(physiology, Load(forces={"left_shoulder": 300}))
    assert values["pain"] > 0 and not physiology.is_dysreflexic
    assert values["heart_rate"] >= 72


@pytest.mark.parametrize("avatar", ["daniel", "jose", "natalia"])
def test_severe_dysreflexia_that_nobody_treats_passes_250_within_minutes(avatar: str) -> None:
    physiology, rest = Physiology(load_avatar(avatar)), load_avatar(avatar).profile.vitals
    physiology.bladder, pinched = 1.0, Load(forces={"left_hip": 440})
    assert rest.systolic + 40 < after(physiology, pinched, 15)["systolic"] < 170
    values = after(physiology, pinched, 285)
    assert 250 < values["systolic"] <= 300 and values["heart_rate"] < rest.heart_rate - 10
    physiology.bladder = 0.0
    assert after(physiology, Load(), 300)["systolic"] == pytest.approx(rest.systolic, abs=5)


def test_pressures_set_or_held_in_dysreflexia_are_what_they_were_set_to() -> None:
    physiology = body("C6")
    physiology.bladder = 1.0
    after(physiology, Load(), 200)
    physiology.set({"systolic": 150, "diastolic": 90})
    assert (physiology.systolic, physiology.diastolic) == pytest.approx((150, 90))
    physiology.hold({"systolic": 170})
    assert after(physiology, Load(), 60)["systolic"] == pytest.approx(170)


def test_vital_signs_are_everybodys_own() -> None:
    own = [load_avatar(name).profile.vitals for name in AVATARS]
    for name in ("heart_rate", "systolic", "diastolic"):
        assert len({getattr(vitals, name) for vitals in own}) >= len(own) - 1


def test_a_ventilator_sets_the_breath_whatever_the_body_does() -> None:
    avatar = load_avatar("jose")
    assert avatar.profile.ventilator_rate == 12
    set_to = dataclasses.replace(avatar.profile, ventilator_rate=16.0)
    physiology = Physiology(dataclasses.replace(avatar, profile=set_to))
    values = after(physiology, Load(power=300, forces={"head": 130}))
    assert values["respiration_rate"] == 16
    with pytest.raises(ConfigError, match="ventilator_rate must lie in 4..40 per minute"):
        dataclasses.replace(avatar.profile, ventilator_rate=50.0)


def test_a_full_bladder_is_enough() -> None:
    physiology = body("C6", axial="absent")
    physiology.bladder = 0.9
    values = after(physiology, Load())
    assert physiology.is_dysreflexic and values["systolic"] > 160 and values["heart_rate"] < 72
    healthy = body()
    healthy.bladder = 0.9
    assert after(healthy, Load())["comfort"] < 0.5 and healthy.systolic == 120


# Posture and room.


def test_to_sit_up_lowers_the_pressure_only_without_sympathetic_nerves() -> None:
    for injury, falls in ((None, False), ("T10", False), ("C5", True)):
        physiology = body(injury)
        physiology.reset(upright=0.0)
        lying = physiology.values()
        values = after(physiology, Load(upright=1.0))
        assert values["heart_rate"] > lying["heart_rate"]
        assert physiology.is_hypotensive is falls
        assert after(physiology, Load(upright=0.0)) == pytest.approx(lying)


def test_the_core_follows_the_room_only_where_nerves_are_cut() -> None:
    drift = {}
    for injury in (None, "T6", "C5"):
        physiology = body(injury)
        physiology.ambient = 10.0
        drift[injury] = after(physiology, Load())["temperature"] - 36.8
    assert -0.2 < drift[None] < 0
    assert drift["C5"] < drift["T6"] < drift[None] and drift["C5"] < -1.0


def test_a_machine_breathes_for_a_high_injury() -> None:
    load = Load(power=100)
    assert (
        after(body("C3"), load)["respiration_rate"] == 14 < after(body(), load)["respiration_rate"]
    )


# Time.


def test_the_length_of_a_step_does_not_matter() -> None:
    """Ten seconds of everything at once, in 1 or in 1000 steps."""
    load = Load(power=120, efforts=(0.6, 0.2, 0.95, 0.0, 0.5, 0.1),
                forces={"head": 90, "left_hip": 300}, upright=0.3)  # fmt: skip
    once, often = body("T3"), body("T3")
    for physiology in (once, often):
        physiology.set({"ambient": 30, "bladder": 0.7, "heart_rate": 150, "fatigue": 0.03})
    once.advance(10, load)
    for _ in range(1000):
        often.advance(0.01, load)
    assert often.values() == pytest.approx(once.values(), abs=1e-9)
    for region in REGIONS:
        assert often.fatigue_of(region) == pytest.approx(once.fatigue_of(region), abs=1e-9)


@pytest.mark.parametrize("tired", [0.0, 0.3, 0.5, 0.97])
@pytest.mark.parametrize("effort", [0.0, 0.05, 0.5, 1.0])
def test_fatigue_is_exact_over_the_point_where_the_muscle_is_spent(
    tired: float, effort: float
) -> None:
    once = tire(tired, effort, 300, 0.0182, 0.00168)
    often = tired
    for _ in range(300):
        often = tire(often, effort, 1, 0.0182, 0.00168)
    fine = tired  # the equation itself, by Euler's method
    for _ in range(30_000):
        active = min(effort, 1 - fine)
        fine += 0.01 * (0.0182 * active - 0.00168 * fine)
    assert often == pytest.approx(once, abs=1e-9)
    assert fine == pytest.approx(once, abs=1e-4)


def test_values_stay_in_their_range_whatever_comes() -> None:
    rng = np.random.default_rng(0)
    physiology = body("C4")
    for _ in range(300):
        physiology.set({"ambient": rng.uniform(-30, 55), "bladder": rng.uniform()})
        load = Load(rng.uniform(0, 5000), rng.uniform(0, 1, len(REGIONS)).tolist(),
                    {joint: rng.uniform(0, 2000) for joint in rng.choice(JOINTS, 5)},
                    rng.uniform(-1, 1))  # fmt: skip
        values = after(physiology, load, rng.uniform(0, 100))
        for name, quantity in QUANTITIES.items():
            assert quantity.low <= values[name] <= quantity.high
        assert values["diastolic"] < values["systolic"]


# Reading and setting.


def test_what_is_set_is_read_and_goes_on_from_there() -> None:
    physiology = body()
    physiology.heart_rate = 140.0
    assert physiology.heart_rate == 140.0
    physiology.advance(10, Load())
    assert 72 < physiology.heart_rate < 140
    physiology.fatigue = 0.4
    assert all(physiology.fatigue_of(region) == 0.4 for region in REGIONS)


def test_what_is_held_stays_until_released_or_reset() -> None:
    physiology = body()
    physiology.hold({"temperature": 39.5, "pain": 6})
    assert after(physiology, Load())["temperature"] == 39.5
    physiology.release()
    assert after(physiology, Load())["temperature"] == pytest.approx(36.8)
    physiology.hold({"pain": 6})
    physiology.reset()
    assert after(physiology, Load())["pain"] == 0


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ({"heart_rate": 400}, "heart_rate must lie in 20..230"),
        ({"comfort": -0.1}, "comfort must lie in 0..1"),
        ({"temperature": math.nan}, "temperature must lie in"),
        ({"pain": "much"}, "pain must lie in"),
        ({"systolic": 70}, "diastolic pressure must stay below"),
    ],
)
def test_a_value_out_of_range_is_refused_and_nothing_changes(
    values: dict[str, float], message: str
) -> None:
    physiology = body()
    before = physiology.values()
    with pytest.raises(ConfigError, match=message):
        physiology.set({"fatigue": 0.5, **values})
    assert physiology.values() == before


def misspelt(physiology: Physiology) -> list[Callable[[], object]]:
    return [
        lambda: setattr(physiology, "hart_rate", 90.0),
        lambda: physiology.set({"hart_rate": 90.0}),
        lambda: physiology.get("hart_rate"),
        lambda: physiology.hold({"hart_rate": 90.0}),
    ]


def test_a_misspelt_quantity_is_named() -> None:
    for attempt in misspelt(body()):
        with pytest.raises(UnknownNameError, match="Did you mean 'heart_rate'"):
            attempt()
    with pytest.raises(UnknownNameError, match="Did you mean 'left_arm'"):
        body().set_fatigue("left_army", 0.1)


def test_an_unknown_level_of_injury_is_named() -> None:
    with pytest.raises(UnknownNameError, match="no spinal level named 'C9'"):
        ClinicalProfile(injury_level="C9")
    with pytest.raises(ConfigError, match="respiration_rate must lie in 4..60"):
        raise_config(respiration_rate=100.0)


def raise_config(**vitals: float) -> None:
    from rcare_marl.config import load

    load(AvatarConfig, {"name": "A", "condition": "none", "sex": "female", "height_m": 1.6,
                        "mass_kg": 60, "body": "b.npz", "profile": {"vitals": vitals}})  # fmt: skip


def test_every_figure_has_a_source_and_every_joint_a_part() -> None:
    model = physiology_model()
    sources = [f.source for f in model.figures.values()]
    sources += [level.source for level in model.levels.values()]
    sources += [rates.source for rates in model.fatigue.values()]
    assert all(sources)
    for joint in JOINTS:
        assert model.region(joint) in REGIONS


# In a world.
