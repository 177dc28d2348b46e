"""Pressure between people and what they sit or lie on, beside published measurements."""

from __future__ import annotations

import dataclasses
import math
from functools import cache

import numpy as np

from rcare_marl.pose import Pose, quaternion_from_rpy

from ..avatar import AvatarConfig, load_avatar, load_posture
from ..profile import ClinicalProfile
from ..resting.pressure import PosedBody, PressureMap, pressure_map
from ..resting.support import bed, chair
from .check import Basis, Check

MMHG = 133.322  # [Pa]
FACTOR = 1.5  # either way of a published pressure
CUSHIONS = (
    "three cushions and none, 211 people, J Phys Ther Sci 2017;29:57, table of mean pressures"
)
HERMANS = (
    "Hermans et al. 2012, WOCN abstract 6427, ten standard foam mattresses; its heel is given as 45.5 on "
    "average with a range of 45.5 to 59.2"
)
TAM = (
    "Tam et al. 2003, Arch Phys Med Rehabil 84:1466, five people each, as reprinted in an exercise"
)
THOMPSON = "Thompson-Bishop & Mottola 1992, Decubitus 5(2):42, abstract"
DEFLOOR = "Defloor 2000, Appl Nurs Res 13:2, abstract: 20 to 30 % less; a tenth wider"
LIPPOLDT = (
    "Lippoldt et al. 2014, Am J Crit Care 23:119, abstract: significantly more only at 45 degrees"
)
HOBSON = "Hobson 1992, as summed up by SCIRE: 26 % more on average; a fifth either way"
TILT_THESIS = "effectiveness of tilt in space, Pacific University 1994, abstract: 1.1 to 2.1 times"
TILT = "a chair maker's review: 11 % less at 20, 22 % less at 25 degrees; 10 points either way"
PELVIS = (
    "Force on the sacrococcygeal and ischial areas during posterior pelvic tilt, abstract: 19 % of body "
    "weight at 30 degrees, people of 60 years and more"
)
SACRAL = (
    "Influence of sacral sitting in a wheelchair, 2016 (PubMed 27821944), abstract: ischial maximum falls, "
    "slid 5 cm; no figure"
)
RECLINE = "Human-seat interface analysis, abstract: 9 % less at 115 degrees; 5 points either way"
ULTRASOUND = (
    "ultrasound of 26 able-bodied people, a Bone & Joint abstract: 64.2 +- 9.1 %; two deviations"
)
NORWAY = (
    "Wound Manag Prev 2020;66(8):26, abstract: 30.28 to 38.37 mmHg on five mattresses; the middle"
)
SENSORS = "Sensors 2026;26:4233, introduction: 3 to 5.5 N/cm2 at most while sitting; seat not named"
OTHERS = ("daniel", "jose", "kim", "morgan", "natalia")
SLUMP = 30.0  # [deg]


def person(name: str, *, able: bool) -> AvatarConfig:
    """Return an avatar as they are, or their body without any impairment."""
    avatar = load_avatar(name)
    return dataclasses.replace(avatar, profile=ClinicalProfile()) if able else avatar


@cache
def seated(
    name: str, cushion: str, *, able: bool = True, tilt: float = 0.0, recline: float = 10.0
) -> PressureMap:
    """Return the pressure of somebody in a wheelchair.

    Args:
        name: The avatar.
        cushion: Of the seat.
        able: Whether they have no impairment.
        tilt: How far the whole chair is tilted back [deg].
        recline: How far back and trunk lean back from upright to the seat [deg].
    """
    avatar = person(name, able=able)
    posture = dataclasses.replace(load_posture("wheelchair"), recline_deg=recline)
    turned = quaternion_from_rpy(0.0, -math.radians(tilt), 0.0)
    fold = Pose((0, 0, 0), tuple(turned.tolist()))
    return pressure_map(PosedBody.laid(avatar, posture, fold), chair(fold, cushion, recline))


@cache
def slumped(name: str, cushion: str, *, able: bool = True, slid: float = 0.05) -> PressureMap:
    """Return the pressure of somebody whose pelvis rolled back by `SLUMP` and slid forward [m]."""
    avatar, upright = person(name, able=able), load_posture("wheelchair")
    at = float(PosedBody.laid(avatar, upright).places[0, 0])
    posture = dataclasses.replace(
        upright,
        recline_deg=upright.recline_deg + SLUMP,
        angles_deg=upright.angles_deg
        | {"hip_flexion": 96 - SLUMP}
        | {f"spine{k}_flexion": SLUMP / 3 for k in (1, 2, 3)},
        leans_on=(),
    )
    body = PosedBody.laid(avatar, posture, Pose((at + slid, 0, 0)))
    return pressure_map(body, chair(Pose(), cushion, upright.recline_deg))


@cache
def lying(name: str, mattress: str, *, head: float = 0.0) -> PressureMap:
    """Return the pressure of somebody on their back in a bed whose head is raised [deg]."""
    posture = load_posture("bed_supine")
    if head:
        posture = dataclasses.replace(
            posture,
            recline_deg=90 - head,
            angles_deg=posture.angles_deg | {"hip_flexion": head},
            leans_on=("spine1", "spine2", "spine3"),
        )
    return pressure_map(
        PosedBody.laid(person(name, able=True), posture), bed(Pose(), mattress, head)
    )


def checks() -> list[Check]:
    """Return the checks; flesh, cushions and mattresses were chosen by those that say fitted.

    Held out are other publications, and the same ones on other bodies and cushions. Bands of ratios that
    were published without a span are our own reading, as their sources say.
    """
    return [*_sitting(), *_effects(), *_bed()]


def _near(
    case: str, ours: float, published: float, source: str, *, fitted: bool, basis: Basis = "read"
) -> Check:
    """Return the check of a pressure [Pa] against a published one [mmHg]."""
    low, high = published / FACTOR, published * FACTOR
    return Check("pressure", case, ours / MMHG, low, high, "mmHg", source, basis, fitted)


def _ratio(
    case: str, ours: float, low: float, high: float, source: str, *, fitted: bool = False
) -> Check:
    return Check("pressure", case, ours, low, high, "1", source, "read", fitted)


def _sitting() -> list[Check]:
    rows = []
    for name in ("caregiver", "karan", *OTHERS):
        fitted = name not in OTHERS
        man = load_avatar(name).sex == "male"
        for cushion, male, female, chosen in (
            ("board", 56.3, 48.6, fitted),
            ("memory_foam", 34.9, 29.6, fitted),
            ("air", 55.0, 47.4, False),
        ):
            mean = seated(name, cushion).mean(pad=0)
            case = f"{name}'s body, able: mean on the seat, {cushion}"
            rows.append(_near(case, mean, male if man else female, CUSHIONS, fitted=chosen))
        hard = seated(name, "board")
        case = f"{name}'s body, able: mean under the tuberosities, board"
        rows.append(_near(case, hard.mean("ischium"), 124.6, TAM, fitted=fitted))
        case = f"{name}'s body, able: greatest, board"
        low, high = 3e4 / MMHG, 5.5e4 / MMHG
        rows.append(
            Check("pressure", case, hard.peak() / MMHG, low, high, "mmHg", SENSORS, "read", False)
        )
        most = hard.of("ischium")
        thinner = float(hard.squeeze[most][np.argmax(hard.sensed[most])])
        case = f"{name}'s body, able: flesh under a tuberosity thinner, board"
        rows.append(_ratio(case, thinner, 0.642 - 0.182, 0.642 + 0.182, ULTRASOUND))
    for name in ("daniel", "natalia", "jose"):
        mean = seated(name, "board", able=False).mean("ischium")
        rows.append(
            _near(f"{name}: mean under the tuberosities, board", mean, 136.6, TAM, fitted=False)
        )
    return rows


def _effects() -> list[Check]:
    rows = []
    for name in ("daniel", "natalia", "jose"):
        more = seated(name, "foam", able=False).peak(pad=0) / seated(name, "foam").peak(pad=0)
        case = f"{name}: greatest on foam, to the same body able"
        rows.append(_ratio(case, more, 1.26 / 1.2, 1.26 * 1.2, HOBSON, fitted=name == "daniel"))
        rows.append(_ratio(case, more, 1.1, 2.1, TILT_THESIS, fitted=name == "daniel"))
    for name in ("caregiver", "karan", "daniel"):
        upright, slump = seated(name, "foam"), slumped(name, "foam")
        weight = load_avatar(name).mass_kg * 9.81
        share = slump.force("sacrum", pad=0) / weight
        rows.append(
            _ratio(
                f"{name}'s body: share of body weight on the sacrum, pelvis back by 30 degrees",
                share,
                0.19 / FACTOR,
                0.19 * FACTOR,
                PELVIS,
            )
        )
        fall = slump.peak("ischium") / upright.peak("ischium")
        rows.append(
            _ratio(
                f"{name}'s body: greatest under the tuberosities, slumped to upright",
                fall,
                0.4,
                1.0,
                SACRAL,
            )
        )
        for degrees, left in ((20.0, 0.89), (25.0, 0.78)):
            less = seated(name, "foam", tilt=degrees).peak("ischium") / upright.peak("ischium")
            case = f"{name}'s body: under the tuberosities, tilted by {degrees:.0f} degrees to not"
            rows.append(_ratio(case, less, left - 0.1, left + 0.1, TILT))
        less = seated(name, "foam", recline=25.0).force(pad=0) / seated(
            name, "foam", recline=5.0
        ).force(pad=0)
        rows.append(
            _ratio(
                f"{name}'s body: force on the seat, back at 115 to 95 degrees",
                less,
                0.86,
                0.96,
                RECLINE,
            )
        )
    return rows


def _bed() -> list[Check]:
    rows = []
    for name in ("caregiver", "karan", *OTHERS):
        fitted = name not in OTHERS
        flat = lying(name, "hospital_foam")
        for region, mmhg in (("occiput", 50.4), ("sacrum", 40.2), ("heel", 45.5)):
            case = f"{name}'s body: greatest at the {region}, standard mattress"
            rows.append(_near(case, flat.peak(region), mmhg, HERMANS, fitted=fitted))
        case = f"{name}'s body: heel, standard mattress"
        rows.append(_near(case, flat.peak("heel"), 93.9, THOMPSON, fitted=False))
        case = f"{name}'s body: mean of all, standard mattress"
        rows.append(_near(case, flat.mean(), 34.3, NORWAY, fitted=False))
        soft = lying(name, "viscoelastic").peak("sacrum") / flat.peak("sacrum")
        case = f"{name}'s body: sacrum, viscoelastic to standard mattress"
        rows.append(_ratio(case, soft, 0.63, 0.88, DEFLOOR))
        for head, low, high in ((30.0, 0.8, 1.25), (45.0, 1.0, 2.0)):
            raised = lying(name, "hospital_foam", head=head).peak("sacrum") / flat.peak("sacrum")
            case = f"{name}'s body: sacrum, head raised by {head:.0f} degrees to flat"
            rows.append(_ratio(case, raised, low, high, LIPPOLDT))
    return rows
