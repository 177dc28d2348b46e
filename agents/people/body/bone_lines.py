"""A plain skeleton to draw: slender bones between the joint centres of a person."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from .skeleton import JOINT_INDEX, JOINTS, PARENTS
from .skin import PersonSkin

IVORY = (226, 217, 196)  # sRGB
_SHARES = (0.0, 0.12, 0.3, 0.7, 0.88, 1.0)  # along a bone, where its radius is given
_SHAPE = (1.0, 0.95, 0.55, 0.55, 0.95, 1.0)  # of the radius of its ends
# Radius of the ends of bones [m] by the joint where they begin, our own choice.
_RADII = {
    "pelvis": 0.018, "hip": 0.020, "knee": 0.017, "ankle": 0.012, "foot": 0.009, "spine1": 0.018,
    "spine2": 0.017, "spine3": 0.015, "neck": 0.012, "head": 0.012, "collar": 0.008,
    "shoulder": 0.015, "elbow": 0.011, "wrist": 0.006,
}  # fmt: skip
_FINGER = 0.0045  # [m]
_TIP = 0.8  # length of the last bone of a finger or toe, of the one before; our own choice
_TOE = 0.35
# The skull from the head's joint, as shares of the way to the top of the head, and its radius.
_SKULL = (0.5, 0.62)
_SKULL_WIDTH = 0.38
_NOT_DRAWN = ("jaw", "left_eye_smplhf", "right_eye_smplhf")


class BoneLines:
    """The bones of a spawned person: implements `rcare_marl.world.Lines`.

    Bones run between joint centres, since the body model knows no others: a picture, not anatomy.
    """

    def __init__(self, skin: PersonSkin) -> None:
        """Follow the joints of a person's skin."""
        self._skin = skin
        rest = skin.model.joints
        rows: list[tuple[int, npt.NDArray[np.float64], npt.NDArray[np.float64], float]] = []
        for j, joint in enumerate(JOINTS):
            if j and joint not in _NOT_DRAWN:
                rows.append(
                    (PARENTS[j], np.zeros(3), rest[j] - rest[PARENTS[j]], _radius(PARENTS[j]))
                )
            if j and j not in PARENTS and joint not in _NOT_DRAWN:
                share = _TOE if joint.endswith("foot") else _TIP
                rows.append((j, np.zeros(3), share * (rest[j] - rest[PARENTS[j]]), _radius(j)))
        head = JOINT_INDEX["head"]
        up = float(skin.model.vertices[:, 1].max()) - rest[head][1]
        low, high = (np.array((0.0, share * up, 0.1 * up)) for share in _SKULL)
        rows.append((head, np.zeros(3), low, _radius(head)))
        count = len(_SHARES)
        shares = np.array(_SHARES)[:, None]
        self._joints = np.repeat([row[0] for row in rows], count)
        self._local = np.concatenate([a * (1 - shares) + b * shares for _, a, b, _ in rows])
        radii = np.concatenate([radius * np.array(_SHAPE) for *_, radius in rows])
        self._joints = np.append(self._joints, (head, head))
        self._local = np.vstack((self._local, low, high))
        self.radii = np.append(radii, 2 * [_SKULL_WIDTH * up]).astype(np.float32)
        starts = np.append(np.arange(len(rows) + 1) * count, len(self.radii))
        self.starts = starts.astype(np.int64)
        self._colors = np.tile(np.array(IVORY, np.uint8), (len(self.radii), 1))

    def points(self) -> npt.NDArray[np.float32]:
        """Return where the bones are in the world [m], shape [p, 3]."""
        rotations, positions = self._skin.joint_transforms()
        turned = np.einsum("pab,pb->pa", rotations[self._joints], self._local)
        return np.asarray(turned + positions[self._joints], np.float32)

    def colors(self) -> npt.NDArray[np.uint8]:
        """Return the colour of each point, shape [p, 3]."""
        return self._colors


def _radius(joint: int) -> float:
    name = JOINTS[joint]
    part = name.removeprefix("left_").removeprefix("right_")
    return _RADII.get(part, _FINGER)
