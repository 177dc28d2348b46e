"""The naked body: Anny's shape solved for stature and mass, posed into the SMPL-X T-pose."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType

import numpy as np
from scipy.spatial.transform import Rotation  # type: ignore[import-untyped]

from ..anthropometry import limb_length
from ..skeleton import JOINT_INDEX, JOINTS
from .girth import swollen
from .mesh import Floats, Ints, WeightedMesh, smoothstep
from .phenotype import phenotype_age
from .recipe import BodyRecipe
from .source import BODY, BONE_OF_JOINT, RIG_SIDES, ShapeSource

DENSITY = 980.0  # [kg/m³], the density that Anny's anthropometry uses
JAW_CLOSE = float(np.radians(1.3))  # Anny's lips stand open by about a millimetre
# Bones of a limb whose length is published, and the bone at its end; a hand ends with its skin.
_STRETCHED = {
    "thigh": (("upperleg01", "upperleg02"), "lowerleg01"),
    "shank": (("lowerleg01", "lowerleg02"), "foot"),
    "upper_arm": (("upperarm01", "upperarm02"), "lowerarm01"),
    "forearm": (("lowerarm01", "lowerarm02"), "wrist"),
    "hand": (("wrist",), "finger3-1"),
}
_CHILD, _GROWN = 11.0, 18.0  # [years] between which limbs take adult proportions; our own choice
_TO_THE_TIP = ("wrist", "finger3-1", "finger3-2", "finger3-3")


@dataclass
class NakedBody:
    """A body in the T-pose, in SMPL-X axes, soles at y = 0.

    Attributes:
        mesh: Skin, eyes, tongue and teeth; its vertices are a subset of the base mesh.
        source: Base-mesh index of each vertex, shape [n].
        joints: Joint centres [m], shape [55, 3].
        height: Barefoot stature [m].
        mass: Mass [kg].
        parameters: Anny's solved phenotype.
    """

    mesh: WeightedMesh
    source: Ints
    joints: Floats
    height: float
    mass: float
    parameters: dict[str, float]


def solve_body(source: ShapeSource, recipe: BodyRecipe) -> NakedBody:
    """Find the body of the recipe's stature and mass.

    Stature and weight are solved together by Newton steps on the T-posed body; if Anny's weight
    saturates, a soft layer over trunk and limbs takes up the rest.
    """
    phenotype = {
        "gender": recipe.gender, "age": phenotype_age(recipe.age), "muscle": recipe.muscle,
        "height": 0.5, "weight": 0.5, "proportions": 0.7,
        "african": 0.0, "asian": 0.0, "caucasian": 0.0,
    }  # fmt: skip
    phenotype.update(recipe.ancestry or {"african": 1.0, "asian": 1.0, "caucasian": 1.0})
    target = np.array([recipe.height, recipe.mass])
    layer = 0.0

    def attempt(height: float, weight: float, thickness: float) -> NakedBody:
        values = {**phenotype, "height": height, "weight": weight}
        return pose_body(source, recipe, values, thickness)

    solved = attempt(phenotype["height"], phenotype["weight"], layer)
    for _ in range(8):
        error = target - [solved.height, solved.mass]
        if abs(error[0]) < 5e-4 and abs(error[1]) < 0.1:
            break
        h, w, step = phenotype["height"], phenotype["weight"], 0.02
        side = step if w < 0.5 else -step
        up, fat = attempt(h + step, w, layer), attempt(h, w + side, layer)
        slope = np.array(
            [
                [(up.height - solved.height) / step, (fat.height - solved.height) / side],
                [(up.mass - solved.mass) / step, (fat.mass - solved.mass) / side],
            ]
        )
        change = np.linalg.solve(slope, error)
        wanted = w + change[1]
        phenotype["weight"] = float(np.clip(wanted, 0.02, 0.98))
        if phenotype["weight"] != wanted:  # saturated: height alone, then the soft layer
            area = 1.3  # [m²] of the covered skin, to start with
            left = error[1] - slope[1] @ [change[0], phenotype["weight"] - w]
            layer += float(left / (DENSITY * area))
            change[0] = (error[0] - slope[0, 1] * (phenotype["weight"] - w)) / slope[0, 0]
        phenotype["height"] = float(np.clip(h + change[0], 0.0, 1.0))
        solved = attempt(phenotype["height"], phenotype["weight"], layer)
    solved.parameters["layer_m"] = layer
    return solved


def pose_body(
    source: ShapeSource,
    recipe: BodyRecipe,
    phenotype: dict[str, float],
    layer: float,
    swell: Mapping[str, float] = MappingProxyType({}),
) -> NakedBody:
    """Return the body of a phenotype in the T-pose.

    Args:
        source: Where rest shapes come from.
        recipe: Changes, stature and proportions.
        phenotype: Values by name.
        layer: Thickness of a soft layer over trunk and limbs [m].
        swell: Factors of girths by name.
    """
    vertices, heads = source.rest(phenotype, recipe.changes)
    turns = _t_pose_turns(source, heads)
    _stretch(source, vertices, heads, turns, recipe)
    posed_heads = heads.copy()
    for i, parent in enumerate(source.parents):
        if parent >= 0:
            posed_heads[i] = posed_heads[parent] + turns[parent] @ (heads[i] - heads[parent])
    shifts = posed_heads - np.einsum("bij,bj->bi", turns, heads)
    blended = (source.weights @ turns.reshape(-1, 9)).reshape(-1, 3, 3)
    posed = np.einsum("vij,vj->vi", blended, vertices) + source.weights @ shifts

    joints = np.stack([posed_heads[source.bone_index[BONE_OF_JOINT[j]]] for j in JOINTS])
    _place_hips(joints)
    faces = np.concatenate([source.faces, source.teeth])
    mesh = WeightedMesh(posed, faces, source.joint_weights)
    if layer:
        mesh.vertices = mesh.vertices + layer * _soft_layer(mesh)[:, None] * mesh.normals()
    if swell:
        mesh.vertices = swollen(mesh, joints, swell)
    skin = WeightedMesh(mesh.vertices, faces[: len(source.faces)], mesh.weights)
    body = mesh.vertices[source.index < BODY.stop]
    floor = body[:, 1].min()
    for points in (mesh.vertices, joints):
        points[:, 1] -= floor
    height, mass = float(np.ptp(body[:, 1])), skin.volume() * DENSITY
    return NakedBody(mesh, source.index, joints, height, mass, dict(phenotype))


def _stretch(
    source: ShapeSource, vertices: Floats, heads: Floats, turns: Floats, recipe: BodyRecipe
) -> None:
    """Stretch the turns of arms, hands and legs lengthwise until they have their published lengths.

    What is published is of adults; children keep the lengths that the source gives their age.
    """
    grown = float(np.clip((recipe.age - _CHILD) / (_GROWN - _CHILD), 0.0, 1.0))
    for _, s, _ in RIG_SIDES:
        for name, (first, end) in _STRETCHED.items():
            start, stop = (heads[source.bone_index[f"{bone}.{s}"]] for bone in (first[0], end))
            chain = [source.bone_index[f"{bone}.{s}"] for bone in first]
            along = (stop - start) / np.linalg.norm(stop - start)
            length = float(np.linalg.norm(stop - start))
            if name == "hand":
                length = _hand_length(source, vertices, heads, s)
                wrist = source.bone_index[f"wrist.{s}"]
                chain = [i for i in range(len(heads)) if source.descends(i, wrist)]
            wanted = limb_length(name, recipe.gender) * recipe.height
            stretch = 1 + grown * (wanted / length - 1)
            stretch *= recipe.proportions.get(name, 1.0)
            for i in chain:
                turns[i] = turns[i] @ (np.eye(3) + (stretch - 1) * np.outer(along, along))


def _hand_length(source: ShapeSource, vertices: Floats, heads: Floats, side: str) -> float:
    """Return the length from the wrist to the tip of the middle finger, held straight [m]."""
    bones = [source.bone_index[f"{bone}.{side}"] for bone in _TO_THE_TIP]
    steps = np.diff(heads[bones], axis=0)
    tip = vertices[source.weights[:, bones[-1]] > 0.5] - heads[bones[-1]]
    along = steps[-1] / np.linalg.norm(steps[-1])
    return float(np.linalg.norm(steps, axis=1).sum() + (tip @ along).max())


def _place_hips(joints: Floats) -> None:
    """Move hips and pelvis to their anatomical centres; Anny has them at the trochanters and back.

    The adult's hip centres are about 17 cm apart: four fifths of Anny's distance.
    """
    hips = [JOINT_INDEX["left_hip"], JOINT_INDEX["right_hip"]]
    joints[hips, 0] *= 0.8
    joints[JOINT_INDEX["pelvis"]] = joints[hips].mean(axis=0) + [0.0, 0.03, 0.0]


def _soft_layer(mesh: WeightedMesh) -> Floats:
    """Return 1 on trunk, thighs and upper arms, less on the shanks and forearms, 0 elsewhere."""
    share = {"pelvis": 1.0, "spine1": 1.0, "spine2": 1.0, "spine3": 1.0, "neck": 0.3}
    for side in ("left", "right"):
        share |= {f"{side}_hip": 1.0, f"{side}_collar": 0.6, f"{side}_shoulder": 0.8}
        share |= {f"{side}_knee": 0.5, f"{side}_elbow": 0.4}
    row = np.array([share.get(name, 0.0) for name in JOINTS])
    return smoothstep(0.0, 1.0, mesh.weights @ row)


def _t_pose_turns(source: ShapeSource, heads: Floats) -> Floats:
    """Return each bone's rotation [b, 3, 3] from Anny's A-pose to the SMPL-X T-pose."""
    turns = np.tile(np.eye(3), (len(source.bones), 1, 1))
    jaw = source.bone_index["jaw"]
    for i in range(len(source.bones)):
        if source.descends(i, jaw):
            turns[i] = _about(np.array([1.0, 0.0, 0.0]), -JAW_CLOSE)

    def along(first: str, last: str) -> Floats:
        return heads[source.bone_index[last]] - heads[source.bone_index[first]]

    def turn(bone: str, value: Floats) -> None:
        turns[source.bone_index[bone]] = value

    down = np.array([0.0, -1.0, 0.0])
    for _, s, sign in RIG_SIDES:
        thigh = _shortest(along(f"upperleg01.{s}", f"lowerleg01.{s}"), down)
        shank = _shortest(along(f"lowerleg01.{s}", f"foot.{s}"), down)
        for half in ("01", "02"):
            turn(f"upperleg{half}.{s}", thigh)
            turn(f"lowerleg{half}.{s}", shank)
        out, forward = np.array([sign, 0.0, 0.0]), np.array([0.0, 0.0, 1.0])
        upper = along(f"upperarm01.{s}", f"lowerarm01.{s}")
        fore = along(f"lowerarm01.{s}", f"wrist.{s}")
        # The elbow's crease looks forward and the palm down; twist is spread over the half bones.
        raised = _shortest(upper, out)
        arm = _frame(out, forward) @ _frame(upper, fore).T
        arm_twist = _angle_about(out, arm @ raised.T)
        fore_raised = _shortest(arm @ fore, out) @ arm
        hand_axis = along(f"wrist.{s}", f"finger3-1.{s}")
        across = along(f"finger5-1.{s}", f"finger2-1.{s}")
        palm = _frame(out, forward) @ _frame(hand_axis, across).T
        hand_raised = _shortest(fore_raised @ hand_axis, out) @ fore_raised
        fore_twist = _angle_about(out, palm @ hand_raised.T)
        turn(f"clavicle.{s}", _about(forward, np.radians(8.0) * sign))
        turn(f"shoulder01.{s}", _about(forward, np.radians(16.0) * sign))
        turn(f"upperarm01.{s}", _about(out, 0.5 * arm_twist) @ raised)
        turn(f"upperarm02.{s}", arm)
        turn(f"lowerarm01.{s}", _about(out, 0.25 * fore_twist) @ fore_raised)
        turn(f"lowerarm02.{s}", _about(out, 0.75 * fore_twist) @ fore_raised)
        for bone in ("wrist", *(f"metacarpal{k}" for k in (1, 2, 3, 4))):
            turn(f"{bone}.{s}", palm)
        # Fingers are straightened into the plane of the palm; the thumb keeps its shape.
        for finger in (f"finger{k}" for k in range(1, 6)):
            flat = palm @ along(f"{finger}-1.{s}", f"{finger}-3.{s}") * [1.0, 0.0, 0.6]
            for k in (1, 2, 3):
                bone = f"{finger}-{min(k, 2)}.{s}"
                phalanx = palm @ along(bone, f"{finger}-{min(k, 2) + 1}.{s}")
                straight = np.eye(3) if finger == "finger1" else _shortest(phalanx, flat)
                turn(f"{finger}-{k}.{s}", straight @ palm)
    return turns


def _frame(first: Floats, second: Floats) -> Floats:
    """Return the right-handed frame with x along `first` and y towards `second` (columns)."""
    x = first / np.linalg.norm(first)
    y = second - x * (x @ second)
    y = y / np.linalg.norm(y)
    return np.stack([x, y, np.cross(x, y)], axis=1)


def _shortest(a: Floats, b: Floats) -> Floats:
    """Return the smallest rotation that turns the direction `a` to `b`."""
    a, b = a / np.linalg.norm(a), b / np.linalg.norm(b)
    axis = np.cross(a, b)
    sine = float(np.linalg.norm(axis))
    return _about(axis / sine, float(np.arctan2(sine, a @ b))) if sine > 1e-9 else np.eye(3)


def _about(axis: Floats, angle: float) -> Floats:
    """Return the rotation by `angle` [rad] about the unit `axis`."""
    return np.asarray(Rotation.from_rotvec(angle * axis).as_matrix())


def _angle_about(axis: Floats, rotation: Floats) -> float:
    """Return the angle [rad] of a rotation known to be about `axis`."""
    return float(Rotation.from_matrix(rotation).as_rotvec() @ axis)
