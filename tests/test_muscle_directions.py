"""Which way muscles turn joints over the whole range, as every textbook has it."""

from __future__ import annotations

import itertools
from collections.abc import Sequence

import numpy as np
import pytest

from rcare_marl.agents.people.actuation.published_band import posture
from rcare_marl.agents.people.body.skeleton import DOF_INDEX, DOFS
from rcare_marl.agents.people.validation.reference_muscles import muscle_model

TURNED = range(-60, 81, 20)  # [deg] of the shoulder
# Who turns which way over the whole range, as every textbook has it: units, DoF, sign, least arm [mm], and
# the postures: DoFs with their clinical angles [deg].
TURNS: tuple[tuple[str, str, int, float, dict[str, Sequence[float]]], ...] = (
    (
        "biclong_l bicshort_l",
        "elbow_pronation",
        -1,
        1.0,
        {"elbow_flexion": range(10, 141, 26), "elbow_pronation": range(-70, 71, 35)},
    ),
    (
        "sup_l",
        "elbow_pronation",
        -1,
        4.0,
        {"elbow_flexion": range(0, 141, 35), "elbow_pronation": range(-75, 76, 30)},
    ),
    (
        "pq_l",
        "elbow_pronation",
        1,
        4.0,
        {"elbow_flexion": range(0, 141, 70), "elbow_pronation": range(-75, 76, 30)},
    ),
    (
        "pt_l",
        "elbow_pronation",
        1,
        3.0,
        {"elbow_flexion": range(0, 141, 35), "elbow_pronation": range(-75, 76, 30)},
    ),
    (
        "brd_l",
        "elbow_pronation",
        1,
        1.0,
        {"elbow_flexion": (30, 90, 130), "elbow_pronation": (-75, -40)},
    ),
    (
        "brd_l",
        "elbow_pronation",
        -1,
        1.0,
        {"elbow_flexion": (30, 90, 130), "elbow_pronation": (40, 75)},
    ),
    (
        "bra_l biclong_l bicshort_l brd_l",
        "elbow_flexion",
        1,
        8.0,
        {"elbow_flexion": range(0, 141, 20)},
    ),
    (
        "trilong_l trilat_l trimed_l anc_l",
        "elbow_flexion",
        -1,
        4.0,
        {"elbow_flexion": range(0, 141, 20)},
    ),
    (
        "infsp_l tmin_l",
        "shoulder_external_rotation",
        1,
        5.0,
        {"shoulder_abduction": (0, 30, 60, 90), "shoulder_external_rotation": TURNED},
    ),
    (
        "infsp_l tmin_l",
        "shoulder_external_rotation",
        1,
        5.0,
        {"shoulder_flexion": (30, 60, 90), "shoulder_external_rotation": (-45, 0, 45)},
    ),
    (
        "subsc_l",
        "shoulder_external_rotation",
        -1,
        5.0,
        {"shoulder_abduction": (0, 30, 60, 90), "shoulder_external_rotation": TURNED},
    ),
    (
        "subsc_l",
        "shoulder_external_rotation",
        -1,
        5.0,
        {"shoulder_flexion": (30, 60, 90), "shoulder_external_rotation": (-45, 0, 45)},
    ),
    (
        "delt2_l",
        "shoulder_abduction",
        1,
        8.0,
        {"shoulder_abduction": range(0, 121, 20), "shoulder_external_rotation": (-60, 0, 60)},
    ),
    (
        "delt1_l",
        "shoulder_flexion",
        1,
        8.0,
        {"shoulder_flexion": (0, 30, 60, 90), "shoulder_external_rotation": (-45, 0, 45)},
    ),
    (
        "delt3_l",
        "shoulder_flexion",
        -1,
        5.0,
        {"shoulder_flexion": (0, 30, 60, 90), "shoulder_external_rotation": (-45, 0, 45)},
    ),
    (
        "lat1_l lat2_l lat3_l tmaj_l",
        "shoulder_abduction",
        -1,
        5.0,
        {"shoulder_abduction": (0, 30, 60, 90), "shoulder_external_rotation": (-60, 0, 60)},
    ),
    (
        "lat1_l lat2_l lat3_l tmaj_l pecm1_l pecm2_l pecm3_l",
        "shoulder_external_rotation",
        -1,
        0.5,
        {"shoulder_abduction": (0, 30, 60), "shoulder_external_rotation": (-30, 0, 30)},
    ),
    (
        "supsp_l",
        "shoulder_abduction",
        1,
        4.0,
        {"shoulder_abduction": (0, 30, 60, 90), "shoulder_external_rotation": (-45, 0, 45)},
    ),
    (
        "corb_l bicshort_l biclong_l",
        "shoulder_flexion",
        1,
        5.0,
        {"shoulder_flexion": (0, 30, 60), "shoulder_external_rotation": (-45, 0, 45)},
    ),
    (
        "trilong_l tmaj_l lat1_l lat2_l lat3_l",
        "shoulder_flexion",
        -1,
        5.0,
        {"shoulder_flexion": (0, 30, 60, 90), "shoulder_external_rotation": (-45, 0, 45)},
    ),
    (
        "trilong_l pecm2_l pecm3_l",
        "shoulder_abduction",
        -1,
        5.0,
        {"shoulder_abduction": (0, 30, 60, 90), "shoulder_external_rotation": (-45, 0, 45)},
    ),
    # An arm raised sideways is brought forward, or back.
    (
        "pecm1_l pecm2_l pecm3_l delt1_l subsc_l",
        "shoulder_flexion",
        1,
        5.0,
        {"shoulder_abduction": (90,), "shoulder_flexion": (-20, 0, 30, 60)},
    ),
    (
        "delt3_l infsp_l tmin_l trilong_l",
        "shoulder_flexion",
        -1,
        1.0,
        {"shoulder_abduction": (90,), "shoulder_flexion": (-20, 0, 30, 60)},
    ),
    (
        "lat1_l lat2_l lat3_l tmaj_l pecm1_l pecm2_l pecm3_l",
        "shoulder_external_rotation",
        -1,
        0.5,
        {"shoulder_flexion": (0, 30, 60, 90), "shoulder_external_rotation": (-45, 0, 45)},
    ),
    (
        "lat1_l lat2_l lat3_l tmaj_l pecm1_l pecm2_l pecm3_l",
        "shoulder_external_rotation",
        -1,
        0.5,
        {"shoulder_abduction": (90,), "shoulder_external_rotation": (-45, 0, 45)},
    ),
    # Who turns the shoulder blade up helps to raise the arm; who turns it down, to lower it.
    (
        "serr_inf_l trap_low_l trap_acr_l",
        "shoulder_abduction",
        1,
        5.0,
        {"shoulder_abduction": (30, 60, 90, 120, 150)},
    ),
    (
        "serr_inf_l trap_low_l trap_acr_l",
        "shoulder_flexion",
        1,
        5.0,
        {"shoulder_flexion": (30, 60, 90, 120, 150)},
    ),
    (
        "rhom_maj_l levscap_l pecmin_l",
        "shoulder_abduction",
        -1,
        2.0,
        {"shoulder_abduction": (60, 90, 120, 150)},
    ),
    (
        "rhom_maj_l levscap_l pecmin_l",
        "shoulder_flexion",
        -1,
        2.0,
        {"shoulder_flexion": (60, 90, 120, 150)},
    ),
    ("pecm1_l", "shoulder_flexion", 1, 8.0, {"shoulder_flexion": (0, 30, 60, 90)}),
    (
        "recfem_l vasint_l vaslat_l vasmed_l",
        "knee_flexion",
        -1,
        15.0,
        {"knee_flexion": range(0, 136, 15)},
    ),
    (
        "gasmed_l gaslat_l bflh_l bfsh_l semimem_l semiten_l",
        "knee_flexion",
        1,
        2.0,
        {"knee_flexion": range(0, 136, 15)},
    ),
    ("psoas_l iliacus_l", "hip_flexion", 1, 8.0, {"hip_flexion": range(-20, 121, 20)}),
    (
        "glmax1_l glmax2_l glmax3_l bflh_l semimem_l semiten_l",
        "hip_flexion",
        -1,
        2.0,
        {"hip_flexion": range(-20, 121, 20)},
    ),
    (
        "soleus_l gasmed_l gaslat_l",
        "ankle_dorsiflexion",
        -1,
        25.0,
        {"ankle_dorsiflexion": range(-45, 21, 13)},
    ),
    (
        "tibant_l edl_l ehl_l",
        "ankle_dorsiflexion",
        1,
        20.0,
        {"ankle_dorsiflexion": range(-45, 21, 13)},
    ),
)


@pytest.mark.parametrize("turn", TURNS, ids=lambda turn: f"{turn[0].split()[0]} {turn[1]}")
def test_no_muscle_turns_round_within_the_range(
    turn: tuple[str, str, int, float, dict[str, Sequence[float]]],
) -> None:
    names, dof, sign, least, grid = turn
    model = muscle_model()
    column = model.dofs.index(f"left_{dof}")
    chosen = [model.index(name) for name in names.split()]
    for values in itertools.product(*grid.values()):
        text = "; ".join(f"left_{name}:{v}" for name, v in zip(grid, values, strict=True))
        q = posture(text, "here")[[DOF_INDEX[name] for name in model.dofs]]
        arms = 1e3 * sign * model.moment_arms(q)[chosen, column]
        assert (arms > least).all(), (text, names, arms)


def test_bones_of_the_forearm() -> None:
    """What inserts on the ulna does not turn it; the pronator quadratus does not cross the wrist."""
    model = muscle_model()
    names = ("trilong_l", "trilat_l", "trimed_l", "anc_l", "bra_l")
    for bend, turn in itertools.product((0.3, 1.2, 2.0), (-1.2, 0.0, 1.2)):
        q = np.zeros(len(DOFS))
        q[DOF_INDEX["left_elbow_flexion"]], q[DOF_INDEX["left_elbow_pronation"]] = bend, turn
        arms = model.moment_arms(q)
        assert (arms[[model.index(n) for n in names], DOF_INDEX["left_elbow_pronation"]] == 0).all()
        wrist = [i for i, dof in enumerate(DOFS) if dof.joint == "left_wrist"]
        assert (arms[model.index("pq_l"), wrist] == 0).all()
