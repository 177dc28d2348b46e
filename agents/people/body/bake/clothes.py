"""Clothes: top, trousers and shoes, worn over the body by offsetting draped skin."""

from __future__ import annotations

import numpy as np
from scipy.spatial import cKDTree  # type: ignore[import-untyped]

from ..goal import convex_hull
from ..skeleton import JOINT_INDEX, JOINTS
from .mesh import (
    Floats,
    Ints,
    Mask,
    WeightedMesh,
    cut,
    drape,
    join,
    keep_faces,
    noise,
    refine,
    smoothstep,
)
from .recipe import BodyRecipe, Clothes

SOLE = 0.009  # thickness of the sole under the foot [m]
TRIM = 0.016  # width of neckband and cuffs [m]
_TOP_THICKNESS, _TROUSER_THICKNESS = 0.004, 0.004  # [m]
_STEP = 0.0012  # width of the band in which a hem rises [m]


def cut_clothes(mesh: WeightedMesh, joints: Floats, clothes: Clothes) -> WeightedMesh:
    """Add the fields `top`, `hem` and `shoe` (positive inside, in metres) and cut along them."""
    mesh = refine(mesh, abs(_collar(mesh, joints, clothes)) < 0.03)
    x, y = abs(mesh.vertices[:, 0]), mesh.vertices[:, 1]
    at = {name: joints[JOINT_INDEX[name]] for name in JOINTS}
    shoulder, elbow, wrist = (at[f"left_{j}"][0] for j in ("shoulder", "elbow", "wrist"))
    sleeve = float(np.interp(clothes.sleeve, (0, 1, 2), (shoulder, elbow, wrist)))
    top = np.minimum(sleeve - x, _collar(mesh, joints, clothes))
    skin = mesh.fields["kind"] == 0
    hem = y - (at["pelvis"][1] - 0.05)
    mesh.fields["top"] = np.where(skin, np.clip(top, -0.3, 0.3), -1.0)
    mesh.fields["hem"] = np.where(skin, hem, 1.0)
    mesh.fields["shoe"] = np.where(skin, at["left_ankle"][1] + 0.004 - y, -1.0)
    mesh = cut(mesh, "top", 0.0, 0.0003, _STEP, TRIM, TRIM + 0.0005)
    mesh = cut(mesh, "hem", 0.0, 0.0003, _STEP)
    return cut(mesh, "shoe", 0.0)


def _collar(mesh: WeightedMesh, joints: Floats, clothes: Clothes) -> Floats:
    """Return the distance below the neckline [m]; far from the neck it only has the right sign."""
    x, y, z = abs(mesh.vertices[:, 0]), mesh.vertices[:, 1], mesh.vertices[:, 2]
    neck = joints[JOINT_INDEX["neck"]]
    forward = z - neck[2]
    # Lower in front, and rising beside the neck so that the raised shoulders stay covered.
    collar = neck[1] - 0.012 - 0.42 * np.maximum(forward, -0.03) - y + 3.0 * x * x
    if clothes.neck == "v":
        collar -= smoothstep(0.0, 0.05, forward) * np.maximum(0.0, 0.075 - 1.15 * x)
    return np.where(mesh.fields["kind"] == 0, collar, 1.0)


def wear(
    mesh: WeightedMesh, joints: Floats, recipe: BodyRecipe, head_offset: Floats
) -> WeightedMesh:
    """Return the mesh with cloth, hair and shoes standing off the body.

    Args:
        mesh: WeightedMesh with all fields and cuts.
        joints: Joint centres [m], shape [55, 3].
        recipe: Whose clothes.
        head_offset: Offset of hair and beard [m], shape [n].
    """
    f = mesh.fields
    covered = smoothstep(0.0, 0.05, f["top"])
    torso = mesh.weights[:, [JOINT_INDEX[j] for j in ("pelvis", "spine1", "spine2", "spine3")]]
    edge = np.minimum(np.minimum(f["top"], abs(f["hem"])), -f["shoe"])
    slack, blunt = smoothstep(0.0, 0.035, edge), np.clip(f["blunt"], 0.0, 1.0)
    loose = drape(mesh, (f["top"] > 0) & (f["shoe"] < -0.01), slack, blunt, 90)
    worn = WeightedMesh(loose, mesh.faces, mesh.weights)
    out_of, average = worn.normals(), worn.smoother()
    for _ in range(4):
        out_of = out_of + average(out_of)
        out_of /= np.linalg.norm(out_of, axis=1, keepdims=True)
    out_of = np.where((f["top"] > 0)[:, None], out_of, mesh.normals())
    is_top = smoothstep(0.0, _STEP, f["hem"])
    knee, ankle = (joints[JOINT_INDEX[f"left_{j}"]][1] for j in ("knee", "ankle"))
    flare = smoothstep(0.0, 1.0, (knee + 0.1 - mesh.vertices[:, 1]) / (knee + 0.1 - ankle))
    trousers = _TROUSER_THICKNESS + 0.009 * flare
    folds = noise(mesh.vertices * [1.0, 0.6, 1.0], 0.05, recipe.seed + 3)
    top = _TOP_THICKNESS + recipe.clothes.looseness * torso.sum(axis=1) * covered
    cloth = is_top * top + (1 - is_top) * trousers
    cloth *= smoothstep(0.0, _STEP, f["top"])
    cloth += 0.0022 * folds * covered * (1 - 0.5 * flare)
    offset = np.where(f["top"] > 0, cloth, head_offset)
    worn.vertices = worn.vertices + offset[:, None] * out_of
    _straighten_trousers(worn, mesh, joints)
    _round_hair(worn, f["hair"])
    worn.fields = mesh.fields
    return worn


def _straighten_trousers(worn: WeightedMesh, body: WeightedMesh, joints: Floats) -> None:
    """Let the trousers fall straight from the knee instead of following the calf."""
    knee, ankle = (joints[JOINT_INDEX[f"left_{j}"]][1] for j in ("knee", "ankle"))
    y = body.vertices[:, 1]
    for sign in (1.0, -1.0):
        leg = (body.fields["shoe"] <= 1e-9) & (y < knee + 0.12) & (body.vertices[:, 0] * sign > 0)
        leg &= body.fields["top"] > 0
        levels = np.linspace(ankle, knee + 0.12, 12)
        centres = np.stack(
            [worn.vertices[leg & (abs(y - h) < 0.025)][:, [0, 2]].mean(axis=0) for h in levels]
        )
        middle = np.stack([np.interp(y, levels, centres[:, k]) for k in (0, 1)], axis=1)
        away = worn.vertices[:, [0, 2]] - middle
        radius: Floats = np.linalg.norm(away, axis=1)
        at_knee = float(np.quantile(radius[leg & (abs(y - knee) < 0.03)], 0.8))
        fall = np.clip((knee + 0.04 - y) / (knee + 0.04 - ankle), 0.0, 1.0)
        wanted = at_knee * (1.0 - 0.06 * fall)
        excess = wanted - radius
        push = 0.5 * (excess + np.sqrt(excess**2 + 0.008**2)) - 0.004
        push = np.maximum(push, 0.0) * smoothstep(0.0, 0.25, fall) * leg
        worn.vertices[:, [0, 2]] += away / np.maximum(radius, 1e-6)[:, None] * push[:, None]


def _round_hair(worn: WeightedMesh, hair: Floats) -> None:
    """Smooth the facets of the skull out of the hair's outline."""
    amount = 0.6 * smoothstep(0.003, 0.015, hair)[:, None]
    average, out_of = worn.smoother(), worn.normals()
    before = worn.vertices.copy()
    for _ in range(6):
        worn.vertices = worn.vertices + amount * (average(worn.vertices) - worn.vertices)
    lost = np.einsum("ij,ij->i", before - worn.vertices, out_of).clip(0.0)
    worn.vertices += (0.8 * lost.mean() / max((hair > 0.003).mean(), 1e-6)) * amount * out_of


def cloth_colors(mesh: WeightedMesh, clothes: Clothes, colors: Floats) -> Floats:
    """Return `colors` [n, 3] with the cloth painted over the skin."""
    f, out = mesh.fields, colors.copy()
    inside = f["top"] > 0.00025
    trousers = f["hem"] < 0.00005
    shade = 1 + 0.03 * noise(mesh.vertices, 0.02, 5)[:, None]
    out[inside] = (np.asarray(clothes.top) * shade)[inside]
    if clothes.trim is not None:
        out[inside & (f["top"] < TRIM + 0.0001)] = clothes.trim
    out[inside & trousers] = (np.asarray(clothes.trousers) * shade)[inside & trousers]
    return out


def put_on_shoes(
    mesh: WeightedMesh, colors: Floats, naked: WeightedMesh, clothes: Clothes
) -> tuple[WeightedMesh, Floats]:
    """Replace the feet by shoes.

    Args:
        mesh: The clothed body, cut at the level 0 of `shoe`.
        colors: Its colours, shape [n, 3].
        naked: The naked body that the shoes must hold.
        clothes: Colours of the shoes.

    Returns:
        The new mesh and its colours.
    """
    feet: Mask = np.all((mesh.fields["shoe"] >= -1e-9)[mesh.faces], axis=1)
    body, old = keep_faces(mesh, ~feet)
    parts, paints = [body], [colors[old]]
    faces = []
    count = len(body)
    for sign in (1.0, -1.0):
        loop = _boundary_loop(body, sign)
        shoe, links, paint = _shoe(body, loop, naked, sign, clothes)
        parts.append(shoe)
        paints.append(paint)
        on_rim = loop[np.clip(-links - 1, 0, len(loop) - 1)]
        faces.append(np.where(links < 0, on_rim, links + count))
        count += len(shoe)
    joined = join(parts)
    joined.faces = np.concatenate([joined.faces, *faces])
    return joined, np.concatenate(paints)


def _boundary_loop(mesh: WeightedMesh, sign: float) -> Ints:
    """Return the open border on one side, in the direction of its faces, from the heel on."""
    near = (mesh.fields["shoe"][mesh.faces] > -0.05).any(axis=1)
    directed = mesh.faces[near][:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2)
    keys = directed[:, 0] * len(mesh) + directed[:, 1]
    back = directed[:, 1] * len(mesh) + directed[:, 0]
    border = directed[~np.isin(keys, back)]
    border = border[mesh.fields["shoe"][border].max(axis=1) > -1e-6]
    following = dict(border.tolist())
    # From the outside: a wide leg reaches across the middle.
    start = max(following, key=lambda v: sign * float(mesh.vertices[v, 0]))
    loop = [start]
    while (after := following[loop[-1]]) != start:
        loop.append(after)
    heel = int(np.argmin(mesh.vertices[loop, 2]))
    loop = loop[heel:] + loop[:heel]
    return np.array(loop, dtype=np.int64)


def _shoe(
    body: WeightedMesh, loop: Ints, naked: WeightedMesh, sign: float, clothes: Clothes
) -> tuple[WeightedMesh, Ints, Floats]:
    """Loft a shoe under a trouser leg; in the links, -k - 1 stands for `loop[k]`."""
    rim = body.vertices[loop]
    top = float(rim[:, 1].mean())
    step: Floats = np.linalg.norm(np.roll(rim, -1, axis=0) - rim, axis=1)
    fraction = np.concatenate([[0.0], np.cumsum(step)[:-1]]) / step.sum()
    foot = naked.vertices
    foot = foot[(foot[:, 0] * sign > 0) & (foot[:, 1] < top + 0.03) & (foot[:, 1] < 0.3)]
    turn = np.sign(_area(rim[:, [0, 2]]))
    levels = [
        (top, 0.002), (top - 0.012, 0.003), (0.78 * top, 0.004), (0.66 * top, 0.005),
        (0.55 * top, 0.0055), (0.45 * top, 0.006), (0.36 * top, 0.006), (0.25 * top, 0.006),
        (0.010, 0.006), (0.009, 0.009), (-SOLE + 0.003, 0.009), (-SOLE, 0.006),
    ]  # fmt: skip
    rings = []
    for height, grow in levels:
        ring = _slice(foot, height, grow, fraction, float(turn))
        rings.append(np.stack([ring[:, 0], np.full(len(loop), height), ring[:, 1]], axis=1))
    uppers = np.stack(rings)
    for _ in range(3):  # round the instep and the toe cap, not the sole
        uppers[1:8, :, [0, 2]] = (0.5 * uppers[1:8] + 0.25 * uppers[:7] + 0.25 * uppers[2:9])[
            ..., [0, 2]
        ]
    count, rows = len(loop), len(levels)
    points = np.concatenate([uppers.reshape(-1, 3), uppers[-1].mean(axis=0, keepdims=True)])
    index = np.arange(rows * count).reshape(rows, count)
    chain = np.concatenate([-np.arange(count)[None] - 1, index])
    a, b = chain[:-1], np.roll(chain[:-1], -1, axis=1)
    c, d = chain[1:], np.roll(chain[1:], -1, axis=1)
    last, after = index[-1], np.roll(index[-1], -1)
    links = np.concatenate(
        [
            np.stack([b, a, c], -1).reshape(-1, 3),
            np.stack([b, c, d], -1).reshape(-1, 3),
            np.stack([after, last, np.full(count, rows * count)], -1),
        ]
    )
    colors = np.tile(np.asarray(clothes.shoes, dtype=float), (len(points), 1))
    colors[9 * count :] = clothes.sole
    return _with_foot_weights(points, naked), links, colors


def _with_foot_weights(points: Floats, naked: WeightedMesh) -> WeightedMesh:
    near = naked.vertices[:, 1] < 0.3
    candidates, weights = naked.vertices[near], naked.weights[near]
    distance, nearest = cKDTree(candidates).query(points, k=12)
    closeness = 1 / (distance**2 + 1e-4)
    mixed = (weights[nearest] * closeness[..., None]).sum(axis=1)
    return WeightedMesh(
        points, np.zeros((0, 3), np.int64), mixed / mixed.sum(axis=1, keepdims=True)
    )


def _slice(foot: Floats, height: float, grow: float, fraction: Floats, turn: float) -> Floats:
    """Return the outline in x and z of the foot above `height`, grown, at arc `fraction`s."""
    hull = convex_hull(foot[foot[:, 1] >= height - 0.002][:, [0, 2]])
    if np.sign(_area(hull)) != turn:
        hull = hull[::-1]
    centre = hull.mean(axis=0)
    away = hull - centre
    hull = hull + grow * away / np.linalg.norm(away, axis=1, keepdims=True)
    rear = hull[:, 1].argmin()
    hull = np.roll(hull, -int(rear), axis=0)
    closed = np.concatenate([hull, hull[:1]])
    arc = np.concatenate([[0], np.cumsum(np.linalg.norm(np.diff(closed, axis=0), axis=1))])
    return np.stack([np.interp(fraction * arc[-1], arc, closed[:, k]) for k in (0, 1)], axis=1)


def _area(polygon: Floats) -> float:
    following = np.roll(polygon, -1, axis=0)
    return float((polygon[:, 0] * following[:, 1] - following[:, 0] * polygon[:, 1]).sum() / 2)
