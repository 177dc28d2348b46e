"""Who a person is: avatars and postures from YAML, their bodies and URDFs."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import lru_cache
from pathlib import Path

import numpy as np

from rcare_marl import assets
from rcare_marl.config import load
from rcare_marl.errors import UnknownNameError
from rcare_marl.pose import Pose

from ..agent import Array
from .body.anthropometry import Sex
from .body.body_spec import OLDEST, YOUNGEST, BodySpec, body_recipe, made_body
from .body.posture import Bearing, PostureConfig, Seated
from .body.segment import Segment, make_segments
from .body.skeleton import DOF_INDEX, DOFS, DOFS_OF, JOINT_INDEX, JOINTS
from .body.skin import BodyModel, load_body_model
from .body.tissue import with_cores
from .body.urdf import PersonUrdf, write_urdf
from .eating import Eating
from .manner import Manner
from .profile import ClinicalProfile, Range


@dataclass(frozen=True)
class AvatarConfig:
    """A person: body and clinical abilities (`assets/avatars/<name>.yaml`).

    Attributes:
        name: First name.
        condition: Diagnosis.
        sex: Of the body proportions and of the strength norms.
        height_m: Stature [m].
        mass_kg: Weight [kg].
        body: A body model, relative to assets/avatars or an absolute path: one of ours, or the
            user's own `SMPLX_*.npz`. Or what describes it; then it is made from sex, age, stature
            and mass, and kept in the user's cache.
        pronoun: For texts.
        age_years: Age [years].
        profile: What the person can do.
        bearing: How they hold themselves, in place of what a posture says; a later entry counts.
        eating: How they chew and swallow.
        manner: How they make themselves understood, and their temper.
    """

    name: str
    condition: str
    sex: Sex
    height_m: float
    mass_kg: float
    body: str | BodySpec = BodySpec()
    pronoun: str = "they"
    age_years: float = 40.0
    profile: ClinicalProfile = field(default_factory=ClinicalProfile)
    bearing: tuple[Bearing, ...] = ()
    eating: Eating = field(default_factory=Eating)
    manner: Manner = field(default_factory=Manner)

    def __post_init__(self) -> None:
        for name, low, high in (("height_m", 0.5, 2.5), ("mass_kg", 5, 300), ("age_years", 0, 120)):
            if not low <= getattr(self, name) <= high:
                raise ValueError(f"{name} must lie in {low}..{high}, got {getattr(self, name)}")
        if isinstance(self.body, BodySpec) and not YOUNGEST <= self.age_years <= OLDEST:
            raise ValueError(
                f"age_years must lie in {YOUNGEST:g}..{OLDEST:g} where `body` names no file, "
                f"got {self.age_years:g}"
            )

    def body_path(self) -> Path:
        """Return the file of the body model, made first where a spec describes it.

        Raises:
            ConfigError: If no body is as described.
        """
        if isinstance(self.body, BodySpec):
            return made_body(
                body_recipe(self.body, self.sex, self.age_years, self.height_m, self.mass_kg)
            )
        return assets.ROOT / "avatars" / Path(self.body).expanduser()


def load_avatar(name: str | Path) -> AvatarConfig:
    """Return the avatar of that name, or from that YAML file."""
    return load(AvatarConfig, assets.find("avatars", name))


def load_posture(name: str | Path) -> PostureConfig:
    """Return the posture of that name, or from that YAML file."""
    return load(PostureConfig, assets.find("postures", name))


def seated(avatar: AvatarConfig, posture: PostureConfig, support: Pose) -> Seated:
    """Return what functions of `body.posture` take of somebody in a posture on a support."""
    model = body_model(avatar.body_path(), avatar.height_m)
    return posture, model, avatar.profile.limits("passive"), support


@lru_cache(maxsize=32)
def body_model(path: Path, height: float) -> BodyModel:
    """Return the body model in a file, scaled to a stature [m]."""
    model = load_body_model(path)
    measured = float(model.meta.get("height_m", np.ptp(model.vertices[:, 1])))
    scale = height / measured
    scaled = dataclasses.replace(
        model,
        vertices=model.vertices * np.float32(scale),
        joints=model.joints * scale,
        mouth=model.mouth * scale,
    )
    for array in (scaled.vertices, scaled.joints, scaled.mouth):
        array.setflags(write=False)  # everybody of this body shares them
    return scaled


@lru_cache(maxsize=32)
def body_segments(path: Path, height: float, mass: float, sex: Sex) -> dict[str, Segment]:
    """Return the segments of that body by SMPL-X joint, `mass` [kg] in all."""
    return make_segments(body_model(path, height), mass, sex)


def person_urdf(
    avatar: AvatarConfig,
    kind: Range,
    *,
    movable: Sequence[str] | None = None,
    posture: Array | None = None,
    tissue: Sequence[str] = (),
) -> PersonUrdf:
    """Return the URDF of an avatar: limits of `active` (AROM) or `passive` (PROM) range.

    Args:
        avatar: The person.
        kind: Which range of motion the joint limits are.
        movable: DoFs, or joints for all DoFs of a joint, that move; all 112 if None.
        posture: Angle of every DoF [rad], shape [112], where fixed ones stay; the T-pose if None.
        tissue: Segments with soft tissue, as in `body.tissue.expand_tissue`: their shapes shrink to
            the core.
    """
    path = avatar.body_path()
    segments = body_segments(path, avatar.height_m, avatar.mass_kg, avatar.sex)
    if tissue:
        segments = with_cores(segments, body_model(path, avatar.height_m), tissue)
    limits = avatar.profile.limits(kind)
    low, high = avatar.profile.strength(avatar.sex)
    effort = dict(zip((dof.name for dof in DOFS), np.maximum(low, high).tolist(), strict=True))
    chosen = expand_movable(movable)
    return write_urdf(
        avatar.name.lower().replace(" ", "_"),
        segments,
        body_model(path, avatar.height_m).joints,
        limits={name: limits[name] for name in chosen},
        posture=np.zeros(len(DOFS)) if posture is None else posture,
        effort=effort,
    )


def expand_movable(movable: Sequence[str] | None) -> tuple[str, ...]:
    """Return DoF names in the order of the skeleton; a joint stands for all of its DoFs."""
    if movable is None:
        return tuple(dof.name for dof in DOFS)
    chosen: set[str] = set()
    for name in movable:
        if name in DOF_INDEX:
            chosen.add(name)
        elif name in JOINT_INDEX and name != JOINTS[0]:
            chosen.update(dof.name for dof in DOFS_OF[name])
        else:
            raise UnknownNameError("joint or degree of freedom", name, [*JOINTS[1:], *DOF_INDEX])
    return tuple(dof.name for dof in DOFS if dof.name in chosen)
