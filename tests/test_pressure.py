"""Pressure of a resting person on seat and bed, and what it does to skin over time."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest
from variants import every

from rcare_marl import assets
from rcare_marl.agents.people.avatar import load_avatar, load_posture
from rcare_marl.agents.people.body.refinement import refined
from rcare_marl.agents.people.human import Human
from rcare_marl.agents.people.resting.bone import regions
from rcare_marl.agents.people.resting.dose import PressureDose, tolerance
from rcare_marl.agents.people.resting.pressure import PosedBody, pressure_map
from rcare_marl.agents.people.resting.support import Layer, Pad, Support, bed, chair, load_cushion
from rcare_marl.agents.people.validation.pressure import lying, seated, slumped
from rcare_marl.envs.devices.hospital_bed import HospitalBed
from rcare_marl.envs.devices.wheelchair import Wheelchair
from rcare_marl.errors import ConfigError, UnknownNameError
from rcare_marl.pose import Pose
from rcare_marl.world import World


def sitting(name: str = "karan") -> PosedBody:
    return PosedBody.laid(load_avatar(name), load_posture("wheelchair"))


def test_the_pads_bear_the_weight() -> None:
    for found in (seated("karan", "foam"), seated("natalia", "air")):
        up = found.force(pad=0) + math.sin(math.radians(10)) * found.force(pad=1)
        assert up == pytest.approx(found.weight, rel=1e-3)
    tilted = seated("karan", "foam", tilt=20.0)  # the seat's hold along it bears some, too
    assert tilted.force(pad=0) < math.cos(math.radians(20)) * tilted.weight * 1.02
    flat = lying("karan", "hospital_foam")
    assert flat.force() == pytest.approx(9.81 * load_avatar("karan").mass_kg, rel=1e-3)


def test_what_is_borne_elsewhere_is_not_on_the_pads() -> None:
    avatar = load_avatar("karan")
    share = seated("karan", "foam").weight / (9.81 * avatar.mass_kg)
    assert 0.75 < share < 0.87  # without shanks, feet, forearms and hands


@pytest.mark.slow
@pytest.mark.parametrize("cell", [0.003, 0.0075])
def test_peaks_do_not_depend_on_the_grid(cell: float) -> None:
    body = sitting()
    for cushion in ("board", "foam"):
        usual = pressure_map(body, chair(Pose(), cushion))
        other = pressure_map(body, chair(Pose(), cushion), cell=cell)
        assert other.peak() == pytest.approx(usual.peak(), rel=0.1)
        assert other.mean() == pytest.approx(usual.mean(), rel=0.05)


def test_peaks_do_not_depend_on_the_mesh() -> None:
    body = sitting()
    chosen = np.isin(body.model.owner, (0, 1, 2))
    finer = dataclasses.replace(body, model=refined(body.model, chosen))
    usual, fine = (pressure_map(b, chair(Pose(), "board")) for b in (body, finer))
    assert fine.peak() == pytest.approx(usual.peak(), rel=0.15)


def test_a_softer_cushion_means_lower_peaks() -> None:
    peaks = [seated("natalia", c).peak(pad=0) for c in ("board", "sling", "gel", "foam", "air")]
    assert peaks == sorted(peaks, reverse=True)
    assert peaks[0] > 2 * peaks[3]


def test_slumping_loads_the_sacrum() -> None:
    upright = seated("karan", "foam")
    slid = [slumped("karan", "foam", slid=by) for by in (0.02, 0.1)]
    assert upright.peak(pad=0) < slid[0].peak(pad=0) < slid[1].peak(pad=0)
    assert upright.peak("sacrum", pad=0) < slid[0].peak("sacrum", pad=0)
    assert slid[0].peak("sacrum", pad=0) < slid[1].peak("sacrum", pad=0)


def test_tilting_the_chair_takes_load_off_the_tuberosities() -> None:
    peaks = [seated("karan", "foam", tilt=tilt).peak("ischium") for tilt in (0.0, 20.0, 40.0)]
    assert peaks == sorted(peaks, reverse=True)
    assert seated("karan", "foam", tilt=40.0).force(pad=1) > 2 * seated("karan", "foam").force(
        pad=1
    )


def test_wasted_flesh_means_higher_peaks() -> None:
    assert seated("daniel", "foam", able=False).peak() > 1.1 * seated("daniel", "foam").peak()


def test_lying_loads_occiput_sacrum_and_heels() -> None:
    flat = lying("natalia", "hospital_foam")
    for region in ("occiput", "sacrum", "left_heel", "right_heel", "scapula"):
        assert flat.peak(region) > 1500, region
    assert flat.peak("left_heel") == pytest.approx(flat.peak("right_heel"), rel=0.3)


@pytest.mark.parametrize("name", every(3, assets.names("cushions")))
def test_every_cushion_bears_everybody_and_says_where_it_is_from(name: str) -> None:
    assert len(load_cushion(name).source) > 20
    found = pressure_map(sitting("kim"), chair(Pose(), name))
    assert np.isfinite(found.pressure).all()


def test_dose_grows_while_sitting_and_falls_when_repositioned() -> None:
    dose = PressureDose()
    dose.bear(seated("daniel", "board", able=False))
    dose.advance(600)
    region, worst = dose.worst
    assert "ischium" in region and worst > 0.1
    left = dose.time_left()
    assert 0 < left < 3 * 3600
    dose.bear(seated("daniel", "air"))
    assert dose.time_left() > left  # borne for longer
    dose.bear(None)  # lifted
    dose.advance(600)
    assert dose.doses()[region] < 0.5 * worst
    assert dose.time_left() == math.inf


def test_dose_reaches_one_at_the_published_product() -> None:
    limits, dose = tolerance(), PressureDose()
    found = seated("karan", "foam")
    dose.bear(found)
    dose.advance(limits.product_pa_s / found.peak())
    assert dose.worst[1] == pytest.approx(1.0)
    assert dose.time_left() == pytest.approx(0.0, abs=1e-6)


def test_the_other_curve_is_that_of_muscle() -> None:
    limits = dataclasses.replace(tolerance(), curve="linder_ganz")
    assert limits.borne_s(8e3) == math.inf
    assert 7200 < limits.borne_s(9.5e3) < 4 * 3600
    assert limits.borne_s(31.95e3) < 3600 and limits.borne_s(40e3) == limits.least_s
    times = [limits.borne_s(p) for p in np.linspace(9.1e3, 35e3, 30)]
    assert times == sorted(times, reverse=True)


def test_a_person_in_a_chair_counts_their_dose() -> None:
    world, device = World(), Wheelchair(mounts="none")
    device.spawn(world, Pose((1.0, 2.0, 0.0)))
    person = Human("p", load_avatar("natalia"), posture=load_posture("wheelchair"), movable=())
    person.spawn(world, device.frame_in_world("seat_back"))
    person.ignore(device.body)
    person.rest_on(device.bears("sling"))
    found = person.pressure_dose.map
    assert found is not None and found.peak(pad=0) > 5e3
    for _ in range(24):
        world.step()
    person.sense()
    assert person.pressure_dose.map is found  # they lay still
    assert 0 < person.pressure_dose.worst[1] < 1e-3
    person.rest_on(None)
    assert person.pressure_dose.map is None
    person.reset(np.random.default_rng(0))
    assert person.pressure_dose.worst[1] == 0


def test_a_bed_bears_who_lies_in_it_with_its_head_raised() -> None:
    world, device = World(), HospitalBed()
    device.spawn(world)
    device.set_position("backrest", 0.5)
    avatar = load_avatar("natalia")
    person = Human("p", avatar, posture=device.posture(avatar), movable=())
    person.spawn(world, device.support(person))
    found = pressure_map(person, device.bears())
    assert found.force(pad=0) > 0.4 * found.weight and found.force(pad=1) > 0.2 * found.weight


def test_bad_input_is_named() -> None:
    found = seated("karan", "foam")
    with pytest.raises(UnknownNameError, match="sacrum"):
        found.peak("sacral")
    with pytest.raises(UnknownNameError, match="foam"):
        chair(Pose(), "foams")
    with pytest.raises(ConfigError, match="0 to 90"):
        bed(Pose(), head_deg=-10)
    with pytest.raises(ConfigError, match="pad"):
        Support(())
    with pytest.raises(UnknownNameError, match="left_knee"):
        Support(chair(Pose()).pads, ("left_kne",))
    with pytest.raises(ConfigError, match="above 0"):
        Layer(0.0, 1e4, 0.8)
    with pytest.raises(ConfigError, match="limit"):
        Layer(0.1, 1e4, 1.5)
    with pytest.raises(ConfigError, match="cell"):
        pressure_map(sitting(), chair(Pose()), cell=0.05)
    with pytest.raises(ConfigError, match="not over the support"):
        pressure_map(sitting(), chair(Pose((5, 0, 0))))
    with pytest.raises(ConfigError, match="0 s or more"):
        PressureDose().advance(-1.0)
    with pytest.raises(UnknownNameError, match="left_heel"):
        PressureDose().time_left("heels")
    with pytest.raises(ConfigError, match="lengths"):
        Pad("seat", Pose(), (0.0, 1.0), load_cushion("foam"))
    assert set(PressureDose().doses()) == set(regions())
