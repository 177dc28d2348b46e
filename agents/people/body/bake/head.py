"""The head: eyes, lips, brows, beard and hair as fields, colours and offsets."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..skeleton import JOINT_INDEX
from .mesh import Floats, Ints, Mask, WeightedMesh, cut, noise, refine, smoothstep
from .recipe import BodyRecipe, Hair, Rgb
from .shape import NakedBody
from .source import BODY, LEFT_EYE, RIGHT_EYE, TONGUE, UPPER_TEETH, MaskName, ShapeSource

IRIS_RADIUS, PUPIL_RADIUS = 0.0059, 0.0021  # [m]
LIP_LEVEL = 0.55
PULLED_BACK = ("bun", "ponytail")
# Hairline: elevation [deg] over azimuth from the front [deg], seen from the skull's centre.
_AZIMUTH = (0.0, 15.0, 30.0, 45.0, 58.0, 66.0, 72.0, 80.0, 92.0, 104.0, 116.0, 128.0, 145.0, 180.0)
_HAIRLINES = {
    "full": (31, 32, 33, 31, 25, 8, -14, -34, -16, -8, -22, -38, -47, -50),
    "receding": (43, 48, 53, 48, 34, 10, -14, -32, -16, -8, -22, -38, -46, -48),
    "soft": (37, 36, 33, 28, 20, 10, -2, -14, -14, -8, -22, -38, -46, -50),
}


@dataclass(frozen=True)
class Landmarks:
    """Places of the head in the rest pose [m], each of shape [3] unless said otherwise.

    Attributes:
        eyes: Centres of the left and the right eyeball, shape [2, 3].
        skull: Centre of the skull.
        mouth: Middle of the lips on the midline.
        lip_top: Height of the upper lip's upper border.
        mouth_half_width: Half the mouth's width.
        chin: Front of the chin.
    """

    eyes: Floats
    skull: Floats
    mouth: Floats
    lip_top: float
    mouth_half_width: float
    chin: Floats


def add_sources(source: ShapeSource, naked: NakedBody) -> WeightedMesh:
    """Return the naked mesh with the source's own regions as fields."""
    mesh, index = naked.mesh, naked.source
    on_body, average = index < BODY.stop, mesh.smoother()
    masks: dict[str, MaskName] = {"lips": "lips", "ears": "ears", "nails": "fingernails"}
    for name, mask in masks.items():
        values = np.where(on_body, source.mask(mask), 0.0)
        mesh.fields[name] = np.where(on_body, 0.5 * (values + average(values)), -1.0)
    cavity = source.cavity() & on_body
    mesh.fields["cavity"] = np.where(on_body, cavity.astype(float), -1.0)
    # Within a few centimetres of the nipples the cloth must not follow the body.
    nipples = mesh.vertices[on_body & (source.mask("aureolae") > 0.5)]
    if len(nipples):
        centre = abs(nipples * [1, 0, 0]).mean(axis=0) + nipples.mean(axis=0) * [0, 1, 1]
        apart: Floats = np.linalg.norm(
            mesh.vertices * np.array([0, 1, 1]) - centre + abs(mesh.vertices) * [1, 0, 0], axis=1
        )
        mesh.fields["blunt"] = np.where(on_body, 1 - smoothstep(0.022, 0.036, apart), -1.0)
    kinds = np.zeros(len(mesh))
    for kind, part in ((1, LEFT_EYE), (2, RIGHT_EYE), (3, TONGUE)):
        kinds[(index >= part.start) & (index < part.stop)] = kind
    kinds[index >= UPPER_TEETH.start] = 4
    mesh.fields["kind"] = kinds
    # The source's teeth and tongue touch the lips: closed lips must hide them.
    mesh.vertices[kinds == 4] -= [0.0, 0.0, 0.005]
    apart = np.where(mesh.weights[:, JOINT_INDEX["jaw"]] > 0.5, -0.0028, 0.0028)
    mesh.vertices[:, 1] += np.where(kinds == 4, apart, 0.0)
    mesh.vertices[kinds == 3] -= [0.0, 0.005, 0.004]
    return mesh


def find_landmarks(mesh: WeightedMesh, joints: Floats) -> Landmarks:
    """Find the landmarks on the mesh of `add_sources`."""
    points = mesh.vertices
    eyes = np.stack([points[mesh.fields["kind"] == k].mean(axis=0) for k in (1, 2)])
    on_head = mesh.weights[:, JOINT_INDEX["head"]] > 0.9
    cranium = points[on_head & (points[:, 1] > eyes[0, 1] + 0.02) & (mesh.fields["kind"] == 0)]
    skull = np.array([0.0, eyes[0, 1] + 0.015, 0.5 * (cranium[:, 2].min() + cranium[:, 2].max())])
    lips = points[mesh.fields["lips"] > LIP_LEVEL]
    middle = lips[abs(lips[:, 0]) < 0.004]
    mouth = np.array([0.0, 0.5 * (middle[:, 1].min() + middle[:, 1].max()), middle[:, 2].max()])
    below = points[(abs(points[:, 0]) < 0.006) & on_jaw(mesh) & (points[:, 2] > eyes[0, 2] - 0.01)]
    chin = below[np.argmin(below[:, 1])] if len(below) else mouth - [0.0, 0.04, 0.0]
    return Landmarks(
        eyes, skull, mouth, float(middle[:, 1].max()),
        float(abs(lips[:, 0]).max()), chin,
    )  # fmt: skip


def on_jaw(mesh: WeightedMesh) -> Mask:
    """Return which skin vertices follow the jaw."""
    return (mesh.weights[:, JOINT_INDEX["jaw"]] > 0.5) & (mesh.fields["kind"] == 0)


def shape_head(mesh: WeightedMesh, marks: Landmarks, recipe: BodyRecipe) -> WeightedMesh:
    """Add the fields of brows, hair, beard and irises and cut the mesh along them."""
    skin = mesh.fields["kind"] == 0
    near = mesh.vertices - marks.eyes.mean(axis=0)
    fine = (near[:, 2] > -0.03) & (abs(near[:, 1] - 0.018) < 0.022) & (abs(near[:, 0]) < 0.07)
    beard = recipe.beard.style in ("moustache", "full")
    if beard:
        fine |= _beard(mesh, marks, recipe) > -0.006
    mesh = refine(mesh, (fine & skin) | (_hairline(mesh, marks, recipe.hair) > -0.01))
    for _ in range(2):
        mesh = refine(mesh, _gaze(mesh, marks) < 0.0095)
    skin = mesh.fields["kind"] == 0
    for name, values in (
        ("hair", _hairline(mesh, marks, recipe.hair)),
        ("brow", _brow(mesh, marks, recipe.seed)),
        ("beard", _beard(mesh, marks, recipe)),
    ):
        mesh.fields[name] = np.where(skin, values, -1.0)
    mesh.fields["gaze"] = _gaze(mesh, marks)
    mesh = cut(mesh, "hair", 0.0, 0.0012)
    mesh = cut(mesh, "brow", 0.0, 0.0005)
    mesh = cut(mesh, "lips", LIP_LEVEL - 0.06, LIP_LEVEL + 0.06)
    if beard:
        mesh = cut(mesh, "beard", 0.0, 0.0008)
    ring = IRIS_RADIUS
    levels = (ring, ring - 0.0003, ring - 0.0009, PUPIL_RADIUS + 0.0003, PUPIL_RADIUS)
    return cut(mesh, "gaze", *levels)


def head_offset(mesh: WeightedMesh, marks: Landmarks, recipe: BodyRecipe) -> Floats:
    """Return how far hair, brows and beard stand off the skin [m], shape [n]."""
    hair, points = mesh.fields["hair"], mesh.vertices
    tufts = 0.5 * strands(points, marks, recipe) + 0.5 * noise(points, 0.028, recipe.seed + 1)
    thickness = recipe.hair.length * (0.12 + 0.88 * smoothstep(0.0, 0.035, hair))
    out = np.where(hair > 0, thickness * (1 + 0.16 * tufts), 0.0) * smoothstep(0, 0.0012, hair)
    out += 0.0011 * smoothstep(0.0, 0.0008, mesh.fields["brow"])
    if recipe.beard.style in ("moustache", "full"):
        depth = smoothstep(0.0, 0.008, mesh.fields["beard"])
        out += 0.0055 * depth * (1 + 0.25 * tufts)
    return out


def strands(points: Floats, marks: Landmarks, recipe: BodyRecipe) -> Floats:
    """Return noise in -1..1 that runs along the hair, away from the crown or to the knot."""
    pole = np.array([0.0, 0.38, -0.93] if recipe.hair.style in PULLED_BACK else [0.0, 0.95, -0.3])
    side = np.array([1.0, 0.0, 0.0])
    d = points - marks.skull
    angle = np.arctan2(d @ np.cross(pole, side), d @ side)
    around = np.stack([np.cos(angle), np.sin(angle), 0.05 * d @ pole / 0.1], axis=1)
    fine = noise(around, 0.07, recipe.seed)
    return 0.6 * fine + 0.4 * noise(around, 0.2, recipe.seed + 2)


def _hairline(mesh: WeightedMesh, marks: Landmarks, hair: Hair) -> Floats:
    """Return the distance above the hairline [m], negative on the face, ears and neck."""
    d = mesh.vertices - marks.skull
    azimuth = np.degrees(np.arctan2(abs(d[:, 0]), d[:, 2]))
    elevation = np.degrees(np.arctan2(d[:, 1], np.hypot(d[:, 0], d[:, 2])))
    table = _HAIRLINES[{"receding": "receding", "short": "full"}.get(hair.style, "soft")]
    fine = np.arange(0.0, 181.0, 3.0)
    line = np.interp(fine, _AZIMUTH, table)
    for _ in range(3):
        line[1:-1] = 0.25 * line[:-2] + 0.5 * line[1:-1] + 0.25 * line[2:]
    above = np.radians(elevation - np.interp(azimuth, fine, line)) * 0.1
    ears = np.clip(mesh.fields["ears"], 0.0, 1.0)
    above = np.minimum(above, 0.012 - 0.03 * ears)
    high = mesh.weights[:, JOINT_INDEX["head"]] + mesh.weights[:, JOINT_INDEX["neck"]] > 0.5
    return np.where(high & (mesh.fields["kind"] == 0), above, -0.05)


def _brow(mesh: WeightedMesh, marks: Landmarks, seed: int) -> Floats:
    eye = marks.eyes[0]
    x, y = abs(mesh.vertices[:, 0]) / eye[0], mesh.vertices[:, 1] - eye[1]
    middle = np.interp(x, (0.40, 0.75, 1.2, 1.55, 1.85), (0.0165, 0.0195, 0.0215, 0.019, 0.0145))
    half = np.interp(x, (0.40, 0.6, 1.2, 1.85), (0.0018, 0.0034, 0.0026, -0.0003))
    ends = np.minimum(x - 0.36, 1.9 - x) * eye[0]
    values = np.minimum(half - abs(y - middle), ends)
    values += 0.0003 * noise(mesh.vertices, 0.004, seed)
    return np.where(mesh.vertices[:, 2] > eye[2] - 0.02, values, -0.02)


def _beard(mesh: WeightedMesh, marks: Landmarks, recipe: BodyRecipe) -> Floats:
    p, half = mesh.vertices, marks.mouth_half_width
    x = abs(p[:, 0])
    top = marks.lip_top + 0.0065 - 0.009 * (x / half) ** 2
    moustache = np.minimum(0.0055 - 0.0015 * x / half - abs(p[:, 1] - top), 1.15 * half - x)
    moustache = np.where(p[:, 2] > marks.mouth[2] - 0.03, moustache, -0.02)
    values = moustache
    if recipe.beard.style in ("full", "stubble"):
        # Cheek line from the ear to the mouth's corner; neck line from the throat to the ear.
        back = marks.skull[2] + 0.022
        along = np.clip((p[:, 2] - back) / (marks.mouth[2] - 0.01 - back), 0.0, 1.0)
        cheek = (1 - along) * (marks.eyes[0, 1] - 0.01) + along * (marks.mouth[1] + 0.002)
        cheek -= 0.022 * np.sin(np.pi * along)
        neck = marks.chin[1] - 0.004 + 0.05 * (1 - along) ** 1.5
        jaw = np.minimum(np.minimum(cheek - p[:, 1], p[:, 1] - neck), p[:, 2] - back)
        values = np.maximum(values, jaw)
    elif recipe.beard.style == "none":
        values = np.full(len(mesh), -0.02)
    lips = np.clip(mesh.fields["lips"], 0.0, 1.0)
    values = np.minimum(values, 0.006 - 0.02 * lips)
    inside = mesh.fields["cavity"] > 0.3
    return np.where(inside | (mesh.fields["kind"] != 0), -0.02, values)


def _gaze(mesh: WeightedMesh, marks: Landmarks) -> Floats:
    """Return the distance from the optical axis [m] on the front of the eyeballs, else 1."""
    out = np.ones(len(mesh))
    for kind, eye in zip((1, 2), marks.eyes, strict=True):
        mine = mesh.fields["kind"] == kind
        d = mesh.vertices[mine] - eye
        out[mine] = np.where(d[:, 2] > -0.002, np.hypot(d[:, 0], d[:, 1]), 0.02)
    return out


def head_colors(mesh: WeightedMesh, marks: Landmarks, recipe: BodyRecipe) -> Floats:
    """Return the colours of skin, eyes, mouth and hair, 0 to 255, shape [n, 3]."""
    f, points = mesh.fields, mesh.vertices
    colors = _skin(mesh, marks, recipe)

    def paint(amount: Floats, color: Rgb | Floats) -> None:
        colors[:] = colors + amount[:, None] * (np.asarray(color, dtype=float) - colors)

    if recipe.beard.style == "stubble":
        paint(0.38 * smoothstep(-0.004, 0.012, f["beard"]), recipe.beard.color)
    fuzz = 0.5 * noise(points, 0.006, recipe.seed) + 0.7 * strands(points, marks, recipe)
    strand = 1 + 0.22 * fuzz[:, None]
    paint(smoothstep(LIP_LEVEL - 0.06, LIP_LEVEL + 0.06, f["lips"]), recipe.lips)
    paint((f["cavity"] > 0.5).astype(float), (92, 28, 30))
    if recipe.beard.style in ("moustache", "full"):
        paint((f["beard"] > 0.0007).astype(float), np.asarray(recipe.beard.color) * strand)
    paint(
        0.72 * (f["brow"] > 0.0004).astype(float), 0.8 * np.asarray(recipe.hair.color, dtype=float)
    )
    paint((f["hair"] > 0.0011).astype(float), np.asarray(recipe.hair.color) * strand)
    eye = (f["kind"] == 1) | (f["kind"] == 2)
    paint(eye.astype(float), (236, 232, 228))
    iris = np.asarray(recipe.iris, dtype=float)
    paint((f["gaze"] <= IRIS_RADIUS - 0.00029).astype(float), 0.55 * iris)
    paint((f["gaze"] <= IRIS_RADIUS - 0.00089).astype(float), iris)
    paint((f["gaze"] <= PUPIL_RADIUS + 0.0001).astype(float), (12, 10, 10))
    paint((f["kind"] == 3).astype(float), (178, 88, 86))
    paint((f["kind"] == 4).astype(float), (240, 236, 224))
    return colors


def _skin(mesh: WeightedMesh, marks: Landmarks, recipe: BodyRecipe) -> Floats:
    """Return skin with redder cheeks, nose, ears and knuckles and paler nails."""
    points = mesh.vertices
    base = np.asarray(recipe.skin, dtype=float)
    colors = np.tile(base, (len(mesh), 1))
    eye = marks.eyes[0]
    side = np.abs(points) * [1, 0, 0] + points * [0, 1, 1]
    cheek = np.array([1.25 * eye[0], marks.mouth[1] + 0.032, marks.mouth[2] - 0.022])
    nose = np.array([0.0, marks.mouth[1] + 0.032, marks.mouth[2] + 0.012])
    red = 0.6 * np.exp(-(((side - cheek) / 0.018) ** 2).sum(axis=1))
    red += 0.5 * np.exp(-(((side - nose) / 0.014) ** 2).sum(axis=1))
    red += 0.6 * np.clip(mesh.fields["ears"], 0, 1)
    socket = np.exp(-(((side - eye - [0, 0, 0.008]) / [0.017, 0.010, 0.02]) ** 2).sum(axis=1))
    colors *= 1 - np.clip(red, 0, 1)[:, None] * [0.02, 0.13, 0.12]
    colors *= 1 - 0.16 * socket[:, None]
    colors *= 1 + 0.018 * noise(points, 0.03, recipe.seed + 7)[:, None]
    nails = smoothstep(0.3, 0.8, mesh.fields["nails"])[:, None]
    nail = 0.55 * base * [1.02, 0.9, 0.88] + 0.45 * 235.0
    return np.asarray(colors + 0.6 * nails * (nail - colors), dtype=np.float64)


def lip_edges(mesh: WeightedMesh, marks: Landmarks) -> tuple[Ints, Ints]:
    """Return a few vertices of the upper and of the lower lip's free edge, left to right."""
    lips = (mesh.fields["lips"] > LIP_LEVEL) & (mesh.fields["kind"] == 0)
    lower = on_jaw(mesh)
    edges: tuple[list[int], list[int]] = ([], [])
    for x in np.linspace(0.6, -0.6, 5) * marks.mouth_half_width:
        strip = lips & (abs(mesh.vertices[:, 0] - x) < 0.005)
        strip &= mesh.vertices[:, 2] > mesh.vertices[strip, 2].max() - 0.007
        for edge, mine, sign in zip(edges, (~lower, lower), (1.0, -1.0), strict=True):
            found = np.flatnonzero(strip & mine)
            if len(found):
                edge.append(int(found[np.argmin(sign * mesh.vertices[found, 1])]))
    upper, under = (np.array(list(dict.fromkeys(edge)), dtype=np.int64) for edge in edges)
    return upper, under
