"""A tailor's measures of a body: girths, lengths and where they were taken."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
import numpy.typing as npt
from scipy.spatial import ConvexHull  # type: ignore[import-untyped]

from rcare_marl.errors import ConfigError
from rcare_marl.pose import Array

from .skeleton import JOINT_INDEX, JOINTS
from .skin import BodyModel

_BELOW_CROTCH = 0.04  # [m], where a thigh is measured
_BELOW_ARMPIT = 0.03  # [m], where in the T-pose the chest no longer runs out into the arms
_WAISTBAND = 0.07  # [m] above the joint of the pelvis, the crest of the hip bone; our own choice
_STEP = 0.01  # [m] between sections
_ARM = ("shoulder", "elbow", "wrist")


@dataclass(frozen=True, eq=False)
class Measures:
    """What a tailor would note, in the T-pose; heights are above the floor.

    Attributes:
        sizes: Girths and lengths by name [m].
        crotch: Height of the crotch [m].
        shoulder: Height of the shoulder's ridge [m].
        armpit: Height of the armpit [m].
        depth: Where the middle of the trunk is, to the front [m].
        arm: Height and depth of the arm's axis [m], shape [2].
        leg: Where the knee's middle is, to the side and to the front [m], shape [2].
    """

    sizes: dict[str, float]
    crotch: float
    shoulder: float
    armpit: float
    depth: float
    arm: tuple[float, float]
    leg: tuple[float, float]


@lru_cache(maxsize=16)
def measure(model: BodyModel) -> Measures:
    """Return the measures of a body.

    Raises:
        ConfigError: If the body has no section where there must be one.
    """
    joint = {name: model.joints[JOINT_INDEX[name]] for name in JOINTS}
    skin = model.vertices.astype(np.float64)
    # Just beside the middle, where vertices lie; thighs may cross it and are left out.
    trunk = model.faces[(model.owner[model.faces] == JOINT_INDEX["pelvis"]).any(axis=1)]
    crotch = float(_section(skin, trunk, 0, 1e-4)[:, 0].min())
    arms = [JOINT_INDEX[f"{side}_{part}"] for side in ("left", "right") for part in _ARM]
    of_arm = model.owner >= JOINT_INDEX["jaw"]
    of_arm |= np.isin(model.owner, arms)
    body = model.faces[~of_arm[model.faces].any(axis=1)]
    shoulder, elbow = joint["left_shoulder"], joint["left_elbow"]
    middle = (shoulder + 0.4 * (elbow - shoulder))[0]
    upper = _section(skin, model.faces, 0, middle)
    ridge = float(_section(skin, model.faces, 0, 0.75 * shoulder[0])[:, 0].max())
    armpit = float(upper[:, 0].min()) - 0.02
    waist = float(joint["pelvis"][1]) + _WAISTBAND
    left = body[(skin[body][:, :, 0] > 0).all(axis=1)]
    wrist = joint["left_wrist"]
    sizes = {
        "stature": float(np.ptp(skin[:, 1])),
        "waist": _girth(_section(skin, body, 1, waist)),
        "chest": _widest(skin, body, joint["spine2"][1], armpit - _BELOW_ARMPIT),
        "hip": _widest(skin, body, crotch + 0.02, joint["pelvis"][1] + 0.05),
        "thigh": _girth(_section(skin, left, 1, crotch - _BELOW_CROTCH)),
        "knee": _girth(_section(skin, left, 1, joint["left_knee"][1])),
        "upper_arm": _girth(upper),
        "wrist": _girth(_section(skin, model.faces, 0, wrist[0] - 0.02)),
        "rise": waist - crotch,
        "inseam": crotch - float(joint["left_ankle"][1]),
        "thigh_length": crotch - float(joint["left_knee"][1]),
        "trunk": ridge - crotch,
        "shoulders": 2 * float(shoulder[0]) + 0.03,
        "arm": float(wrist[0] - shoulder[0]),
        "armhole": ridge - armpit,
    }
    waistline = _section(skin, body, 1, joint["spine1"][1])
    return Measures(
        sizes=sizes,
        crotch=crotch,
        shoulder=ridge,
        armpit=armpit,
        depth=float(waistline[:, 1].min() + waistline[:, 1].max()) / 2,
        arm=(float(upper[:, 0].mean()), float(upper[:, 1].mean())),
        leg=(float(joint["left_knee"][0]), float(joint["left_knee"][2])),
    )


def _section(skin: Array, faces: npt.NDArray[np.int32], axis: int, at: float) -> Array:
    """Return where edges go through a plane across an axis, in the two other axes, shape [p, 2]."""
    sides = np.concatenate([faces[:, k] for k in ((0, 1), (1, 2), (2, 0))])
    a, b = skin[sides[:, 0]], skin[sides[:, 1]]
    crosses = (a[:, axis] - at) * (b[:, axis] - at) < 0
    a, b = a[crosses], b[crosses]
    if len(a) < 6:
        raise ConfigError(f"the body has no section at {at:.3f} m along axis {axis}")
    share = (at - a[:, axis]) / (b[:, axis] - a[:, axis])
    points = a + share[:, None] * (b - a)
    return np.asarray(np.delete(points, axis, axis=1))


def _girth(section: Array) -> float:
    """Return the length of a tape around a section [m]: it bridges hollows."""
    return float(ConvexHull(section).area)  # in the plane scipy's area is the perimeter


def _widest(skin: Array, faces: npt.NDArray[np.int32], low: float, high: float) -> float:
    """Return the greatest girth between two heights [m]."""
    heights = np.arange(low, max(high, low + _STEP), _STEP)
    return max(_girth(_section(skin, faces, 1, y)) for y in heights)
