"""Makes what drives a person's joints, from who the person is and how the person is cast."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path
from typing import Literal

import numpy as np
import numpy.typing as npt

from rcare_marl.errors import ConfigError
from rcare_marl.pose import Array
from rcare_marl.tree.joint_tree import JointTree

from ..avatar import AvatarConfig, body_model, body_segments
from ..body.anthropometry import Sex
from ..body.person_tree import person_tree
from ..body.posture import PostureConfig
from ..body.skeleton import DOF_INDEX, DOFS, Dof
from ..profile import ASHWORTH, clinical_norms, normal_strength
from ..strength import (
    LEAST_HOLDING,
    GravityTest,
    StrengthMap,
    bisected,
    gravity_tests,
    holding_share,
    strength_share,
)
from . import muscle_kernel as kernel
from .actuation import Actuation, Shaking
from .muscle_model import MuscleModel, Tendon
from .muscle_unit import crosses
from .muscular import Excitation, MuscleDrive
from .musculature import Musculature, load_musculature
from .skeletal import SkeletalDrive

Share = Callable[[str, str, float], float]  # side, muscle group, MMT grade -> share of strength

LEAST_GRADE = 3.0  # MMT grade that holds a limb against gravity; below it furniture must

# Resistance to stretch by Modified Ashworth grade, our own choice: at 2 rad/s, about the speed of the
# test, grade 2 at the elbow gives some 10 N·m, as spastic elbows gave that were measured (from memory).
_ASHWORTH_GAIN = dict(zip(ASHWORTH, (0.0, 0.02, 0.04, 0.08, 0.16, 0.4), strict=True))
FIBRE_GAIN = 3.5  # [s per optimal length]: excitation by stretch speed, per share of torque by rate
FIBRE_THRESHOLD = 0.1  # [optimal lengths/s]

# Stature, and so lever arms, to those of our table; mean of women from memory.
FEMALE_SIZE = 1.62 / 1.75

_BACKWARD = ("extensors", "adductors", "plantarflexors", "supinators")  # against flexors and so on


@dataclass(frozen=True)
class ActuationConfig:
    """How a person's joints are driven.

    Attributes:
        kind: `skeletal` pulls joints towards target angles, `muscle` moves them by Hill muscles.
        excitation: With muscles, what an action is: excitations of each `unit` or of each `group` of them,
            or changes of a `posture` that the person's own controller pursues.
        tendon: With muscles, how tendons yield: `rigid`, `quasi_static` or `implicit`.
        musculature: With muscles, the user's own table (.csv) or MASS file (.xml); ours if None.
        strength: How MMT grades become strength: `linear` or `gravity`.
    """

    kind: Literal["skeletal", "muscle"] = "skeletal"
    excitation: Excitation = "unit"
    tendon: Tendon = "quasi_static"
    musculature: str | None = None
    strength: StrengthMap = "linear"

    @property
    def description(self) -> str:
        """What drives the joints and, with muscles, what an action is."""
        return self.kind if self.kind == "skeletal" else f"muscle by {self.excitation}"


def make_drive(
    avatar: AvatarConfig,
    chain: JointTree,
    config: ActuationConfig,
    *,
    lying: PostureConfig,
    posture: Array,
    limits: Array,
    passive: Array,
    physics_dt: float,
) -> Actuation:
    """Return what drives the moving DoFs of a person.

    Args:
        avatar: Who it is.
        chain: The moving parts, n of them.
        config: How they are driven.
        lying: How furniture bears the person.
        posture: Angles of the start [rad], shape [n].
        limits: Where active movement ends [rad], shape [n, 2].
        passive: Where passive movement ends [rad], shape [n, 2].
        physics_dt: Physics step [s].

    Raises:
        ConfigError: If no muscle of the musculature crosses a moving DoF.
    """
    rows = [DOFS[DOF_INDEX[name]] for name in chain.names]
    order = [DOF_INDEX[name] for name in chain.names]
    profile = avatar.profile
    supported = np.array(
        [
            min(profile.grade(d, positive=True), profile.grade(d, positive=False)) < LEAST_GRADE
            and (lying.supported == "all" or d.joint in lying.supported)
            for d in rows
        ],
        np.bool_,
    )
    normal = normal_strength(avatar.sex)[order]
    low, high = profile.strength(avatar.sex, skeletal_share(avatar, config.strength))
    if config.kind == "skeletal":
        return SkeletalDrive(
            chain,
            strength=np.column_stack((low, high))[order],
            normal_strength=normal,
            supported=supported,
            posture=posture,
            limits=limits,
            physics_dt=physics_dt,
            reflex=_joint_reflex(avatar)[order],
            shaking=_joint_shaking(avatar, order, np.minimum(low, high)),
        )
    model, groups = _muscles(avatar, chain, config)
    graded = [(unit.side, unit.clinical_group) for unit in model.units]
    return MuscleDrive(
        chain,
        model,
        excitation=config.excitation,
        groups=groups,
        normal_strength=normal,
        supported=supported,
        carried=np.array([d.joint in lying.carried and _is_sagittal(d) for d in rows], np.bool_),
        resting=np.array([d.joint in lying.carried for d in rows], np.bool_),
        willed=np.maximum(low, high)[order] > 0,
        posture=posture,
        limits=limits,
        passive=passive,
        physics_dt=physics_dt,
        shaking=_shaking(avatar, graded, np.ones(len(graded))),
    )


def _muscles(
    avatar: AvatarConfig, chain: JointTree, config: ActuationConfig
) -> tuple[MuscleModel, dict[str, list[int]]]:
    """Return the muscles that cross moving DoFs, with a person's strength and reflexes, and groups."""
    muscles = fitted_musculature(avatar, config.musculature)
    chosen = [m for m, unit in enumerate(muscles.units) if crosses(unit, chain)]
    if not chosen:
        raise ConfigError(
            f"no muscle of the musculature crosses a movable degree of freedom of {avatar.name!r}"
        )
    units = [muscles.units[m] for m in chosen]
    share = muscle_share(avatar, config)
    grades = [avatar.profile.side(u.side).mmt.get(u.clinical_group, 5.0) for u in units]
    shares = [share(u.side, u.clinical_group, g) for u, g in zip(units, grades, strict=True)]
    model = MuscleModel(
        units,
        muscles.joints,
        chain,
        tendon=config.tendon,
        strength=np.array(shares),
    )
    _add_reflex(avatar, model)
    groups = {
        name: [chosen.index(m) for m in members if m in chosen]
        for name, members in muscles.groups().items()
    }
    return model, {name: members for name, members in groups.items() if members}


def fitted_musculature(avatar: AvatarConfig, path: str | None) -> Musculature:
    """Return a musculature on an avatar's body.

    A woman's forces are such that her torques are to a man's as the norms say.
    """
    version = _version(path)
    return _fitted_musculature(avatar.body_path(), avatar.height_m, avatar.sex, path, version)


def _version(path: str | None) -> tuple[int, int]:
    """Return what tells whether a file has changed; zeros where there is none."""
    if path is None or not Path(path).expanduser().is_file():
        return 0, 0
    status = Path(path).expanduser().stat()
    return status.st_mtime_ns, status.st_size


@lru_cache(maxsize=32)
def _fitted_musculature(
    body: Path, height: float, sex: Sex, path: str | None, version: tuple[int, int]
) -> Musculature:
    fitted = load_musculature(path).fitted(body_model(body, height).joints)
    if sex != "female":
        return fitted
    factor = clinical_norms().female_strength / FEMALE_SIZE
    weaker = [
        replace(unit, max_isometric_force=unit.max_isometric_force * factor)
        for unit in fitted.units
    ]
    return replace(fitted, units=tuple(weaker))


def whole_chain(body: Path, height: float, mass: float, sex: Sex) -> JointTree:
    """Return the moving parts of a body with all 112 DoFs."""
    return person_tree(
        body_segments(body, height, mass, sex),
        body_model(body, height).joints,
        np.zeros(len(DOFS)),
        [dof.name for dof in DOFS],
    )


def skeletal_share(avatar: AvatarConfig, strength: StrengthMap) -> Share:
    """Return the share of normal torque by side, muscle group and grade."""
    if strength == "linear":
        return lambda side, group, grade: strength_share(grade, "linear")
    normal = normal_torques(avatar)
    chain = whole_chain(avatar.body_path(), avatar.height_m, avatar.mass_kg, avatar.sex)
    holding = {
        key: holding_share(test.torque, normal[test.dof, int(test.sign > 0)])
        for key, test in gravity_tests(chain).items()
    }
    return _by_gravity(holding)


def muscle_share(avatar: AvatarConfig, config: ActuationConfig) -> Share:
    """Return the share of full excitation by side, muscle group and grade."""
    if config.strength == "linear":
        return lambda side, group, grade: strength_share(grade, "linear")
    body = (avatar.body_path(), avatar.height_m, avatar.mass_kg, avatar.sex)
    return _by_gravity(_muscle_holding(*body, config.musculature, _version(config.musculature)))


def _by_gravity(holding: dict[tuple[str, str], float]) -> Share:
    def share(side: str, group: str, grade: float) -> float:
        return strength_share(grade, "gravity", holding.get((side, group), LEAST_HOLDING))

    return share


@lru_cache(maxsize=16)
def _muscle_holding(
    body: Path, height: float, mass: float, sex: Sex, path: str | None, version: tuple[int, int]
) -> dict[tuple[str, str], float]:
    """Return the share of grade 3 by side and group: what the muscles need in the test position."""
    chain = whole_chain(body, height, mass, sex)
    muscles = _fitted_musculature(body, height, sex, path, version)
    model = MuscleModel(muscles.units, muscles.joints, chain)
    out = {}
    for (side, group), test in gravity_tests(chain).items():
        members = np.array(
            [u.side == side and u.clinical_group == group for u in muscles.units], np.bool_
        )
        if members.any():
            found = _holding_activation(model, members, test)
            out[side, group] = holding_share(found, 1.0)
    return out


def _holding_activation(
    model: MuscleModel, members: npt.NDArray[np.bool_], test: GravityTest
) -> float:
    """Return the activation that just carries the level limb, the other muscles being at rest.

    That of the whole group which the grade is about; and where the group alone is too weak in the test
    position, since it owns only a part of the motion, that of all muscles which make the motion.
    """
    arms = test.sign * model.moment_arms(test.angles)[:, test.dof]
    at_rest = model.table[:, kernel.LEAST]

    def torque(activation: float, active: npt.NDArray[np.bool_]) -> float:
        told = np.where(active, np.maximum(activation, at_rest), at_rest)
        return float(arms @ model.isometric_forces(test.angles, told))

    makers = members if torque(1.0, members) > test.torque else arms > 0
    return bisected(lambda activation: torque(activation, makers), test.torque)


def normal_torques(avatar: AvatarConfig) -> Array:
    """Return a healthy person's greatest torques of each DoF, against and along it [N·m], [112, 2]."""
    norms = clinical_norms()
    factor = norms.female_strength if avatar.sex == "female" else 1.0
    return factor * np.array(
        [[norms.motions[d.negative].torque, norms.motions[d.positive].torque] for d in DOFS]
    )


def _joint_reflex(avatar: AvatarConfig) -> Array:
    """Return the resistance to movement against and along each DoF [N·m·s/rad], shape [112, 2].

    Movement against the axis stretches the muscles of the positive motion.
    """
    norms, torques = clinical_norms(), normal_torques(avatar)
    out = np.zeros((len(DOFS), 2))
    for i, dof in enumerate(DOFS):
        grades = avatar.profile.side(dof.side).spasticity
        for k, motion in enumerate((dof.positive, dof.negative)):
            gain = _ASHWORTH_GAIN[grades.get(norms.motions[motion].group, "0")]
            out[i, k] = gain * torques[i, 1 - k]
    return out


def _add_reflex(avatar: AvatarConfig, model: MuscleModel) -> None:
    for m, unit in enumerate(model.units):
        grade = avatar.profile.side(unit.side).spasticity.get(unit.clinical_group, "0")
        if _ASHWORTH_GAIN[grade] > 0:
            model.table[m, kernel.REFLEX_GAIN] = FIBRE_GAIN * _ASHWORTH_GAIN[grade]
            model.table[m, kernel.REFLEX_THRESHOLD] = FIBRE_THRESHOLD


def _joint_shaking(avatar: AvatarConfig, order: Sequence[int], strength: Array) -> Shaking | None:
    """Return what shakes joints: a DoF shakes with the group of either motion that shakes more."""
    norms = clinical_norms()
    groups = []
    for i in order:
        dof, profile = DOFS[i], avatar.profile.side(DOFS[i].side)
        pair = [norms.motions[motion].group for motion in (dof.positive, dof.negative)]
        amount = [profile.tremor.get(g, 0.0) + profile.dyskinesia.get(g, 0.0) for g in pair]
        groups.append((dof.side, pair[int(amount[1] > amount[0])]))
    return _shaking(avatar, groups, strength[list(order)])


def _is_sagittal(dof: Dof) -> bool:
    """Return whether a limb that lies on something sags about this axis."""
    return dof.positive.endswith(("_flexion", "dorsiflexion", "foot_extension"))


def _shaking(
    avatar: AvatarConfig, groups: Sequence[tuple[str, str]], scale: Array
) -> Shaking | None:
    """Return what shakes parts of the given sides and groups; None if nothing does."""
    sides = [avatar.profile.side(side) for side, _ in groups]
    tremor = np.array([s.tremor.get(g, 0.0) for s, (_, g) in zip(sides, groups, strict=True)])
    slow = np.array([s.dyskinesia.get(g, 0.0) for s, (_, g) in zip(sides, groups, strict=True)])
    if not tremor.any() and not slow.any():
        return None
    rhythms: dict[tuple[str, str], int] = {}
    signs, rhythm = np.ones(len(groups)), np.zeros(len(groups), np.int64)
    for i, (side, group) in enumerate(groups):
        signs[i] = -1.0 if group.endswith(_BACKWARD) else 1.0
        rhythm[i] = rhythms.setdefault((side, group.split("_")[0]), len(rhythms))
    return Shaking(tremor=tremor * scale, dyskinesia=slow * scale, signs=signs, rhythm=rhythm)
