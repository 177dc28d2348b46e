"""Makes what drives a person's joints, from who the person is and how the person is cast."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path
from typing import Literal

import numpy as np
import numpy.typing as npt

from rcare_marl.errors import ConfigError
from rcare_marl.pose import Array
from rcare_marl.tree.dynamics import holding_torques
from rcare_marl.tree.joint_tree import JointTree
from rcare_marl.world import GRAVITY

from ..avatar import AvatarConfig, body_model, body_segments
from ..body.anthropometry import Sex
from ..body.person_tree import person_tree
from ..body.posture import PostureConfig
from ..body.skeleton import DOF_INDEX, DOFS, Dof
from ..profile import clinical_norms, normal_strength
from ..strength import StrengthMap, tissue_share
from .actuation import Actuation, Shaking
from .graded import motion_limits, normal_torques, torque_share, unit_shares
from .muscle_layout import crossing
from .muscle_model import MuscleModel, Tendon
from .muscular import Excitation, MuscleDrive
from .musculature import Musculature, load_musculature
from .skeletal import SkeletalDrive
from .stretch_reflex import StretchReflex

# MMT grade that holds a limb against gravity; below it furniture must, and where the limb is heavier as it
# lies than in the test of its grade (a straight leg).
LEAST_GRADE = 3.0
JAW = "jaw"

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
        strength: How MMT grades become strength: `mmt`, what a clinician means by them, or `linear`, the
            paper's map.
    """

    kind: Literal["skeletal", "muscle"] = "skeletal"
    excitation: Excitation = "unit"
    tendon: Tendon = "quasi_static"
    musculature: str | None = None
    strength: StrengthMap = "mmt"

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
    normal = normal_strength(avatar.sex)[order]
    low, high = avatar.profile.strength(avatar.sex, torque_share(avatar, config.strength))
    strength = np.column_stack((low, high))[order]
    supported = _supported(avatar, chain, lying, posture, strength)
    reflex = _reflex(avatar, chain, posture, passive, physics_dt, config)
    if config.kind == "skeletal":
        return SkeletalDrive(
            chain,
            strength=strength,
            normal_strength=normal,
            supported=supported,
            posture=posture,
            limits=limits,
            passive=passive,
            physics_dt=physics_dt,
            overcoming=_overcoming(avatar, rows),
            reflex=reflex,
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
        motion_limits=motion_limits(avatar, config.strength)[:, order],
        reflex=reflex,
        shaking=_shaking(avatar, graded, np.ones(len(graded))),
    )


def _supported(
    avatar: AvatarConfig, chain: JointTree, lying: PostureConfig, posture: Array, strength: Array
) -> npt.NDArray[np.bool_]:
    """Return whether furniture holds each limb: it can, and the person cannot; shape [n].

    Nothing holds a jaw: a weak one drops.
    """
    profile, out = avatar.profile, np.zeros(len(chain.names), np.bool_)
    weight = holding_torques(chain.arrays, posture, lying_gravity(lying))
    able = np.where(weight > 0.0, strength[:, 1], strength[:, 0])
    for i, name in enumerate(chain.names):
        dof = DOFS[DOF_INDEX[name]]
        least = min(profile.grade(dof, positive=True), profile.grade(dof, positive=False))
        is_weak = least < LEAST_GRADE or abs(weight[i]) > able[i]
        held = dof.joint != JAW and (lying.supported == "all" or dof.joint in lying.supported)
        out[i] = is_weak and held
    return out


def _reflex(
    avatar: AvatarConfig,
    chain: JointTree,
    posture: Array,
    passive: Array,
    physics_dt: float,
    config: ActuationConfig,
) -> StretchReflex | None:
    """Return what answers stretch; None if nobody is spastic."""
    order = [DOF_INDEX[name] for name in chain.names]
    reflex = StretchReflex(
        _ashworth(avatar, [DOFS[i] for i in order]),
        passive=passive,
        strength=normal_torques(avatar.sex)[order],
        inertia=np.diag(chain.mass_matrix(posture)),
        physics_dt=physics_dt,
        by_muscle=config.kind == "muscle",
    )
    return None if reflex.is_silent else reflex


def lying_gravity(lying: PostureConfig) -> Array:
    """Return gravity in the frame of a pelvis on level furniture [m/s²], shape [3]."""
    recline = math.radians(lying.recline_deg)
    return GRAVITY * np.array((0.0, -math.cos(recline), -math.sin(recline)))


def _muscles(
    avatar: AvatarConfig, chain: JointTree, config: ActuationConfig
) -> tuple[MuscleModel, dict[str, list[int]]]:
    """Return the muscles that cross moving DoFs, with a person's strength and reflexes, and groups."""
    muscles = fitted_musculature(avatar, config.musculature)
    chosen = crossing(muscles.units, chain)
    if not chosen:
        raise ConfigError(
            f"no muscle of the musculature crosses a movable degree of freedom of {avatar.name!r}"
        )
    units = [muscles.units[m] for m in chosen]
    key = config.musculature, _version(config.musculature)
    model = MuscleModel(
        units,
        muscles.joints,
        chain,
        tendon=config.tendon,
        strength=unit_shares(avatar, units, config.strength, muscles, key),
    )
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


def _ashworth(avatar: AvatarConfig, rows: Sequence[Dof]) -> list[tuple[str, str]]:
    """Return the Ashworth grades of what pulls against and along each DoF."""
    motions = clinical_norms().motions
    grades = [avatar.profile.side(d.side).spasticity for d in rows]
    return [
        (g.get(motions[d.negative].group, "0"), g.get(motions[d.positive].group, "0"))
        for d, g in zip(rows, grades, strict=True)
    ]


def _overcoming(avatar: AvatarConfig, rows: Sequence[Dof]) -> Array:
    """Return the share of the tissue's resistance that muscles overcome, shape [n, 2]."""
    return np.array(
        [[tissue_share(avatar.profile.grade(d, positive=k == 1)) for k in range(2)] for d in rows]
    ).reshape(-1, 2)


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
