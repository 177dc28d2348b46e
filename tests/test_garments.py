"""Garments: cut to the measure of whoever wears them, whole, and worn outside."""

from __future__ import annotations

import dataclasses

import numpy as np
import numpy.typing as npt
import pytest
from scipy.sparse import coo_matrix  # type: ignore[import-untyped]
from scipy.sparse.csgraph import connected_components  # type: ignore[import-untyped]

from rcare_marl import assets
from rcare_marl.agents.people.avatar import body_model, load_avatar, load_posture
from rcare_marl.agents.people.body.measure import measure
from rcare_marl.agents.people.body.skeleton import JOINT_INDEX
from rcare_marl.agents.people.body.skin import BodyModel
from rcare_marl.agents.people.garment import dress, load_garment, tailor, threaded, worn
from rcare_marl.agents.people.human import Human
from rcare_marl.errors import ConfigError, UnknownNameError
from rcare_marl.pose import Pose
from rcare_marl.soft.cloth import Cloth
from rcare_marl.soft.constraint import make_constraints
from rcare_marl.soft.garment import Dimension, cut_garment
from rcare_marl.world import GRAVITY, World

Array = npt.NDArray[np.float64]

NAMES = assets.names("garments")
AVATARS = ("daniel", "natalia", "kim")  # the tallest, one in between, the smallest
# Openings; the neck of a gown meets the slit of its back at the tie.
LOOPS = {
    "shorts": 3,
    "running_shorts": 3,
    "long_sleeve": 4,
    "bed_jacket": 3,
    "hospital_gown": 3,
    "blanket": 1,
}


def model_of(name: str) -> BodyModel:
    avatar = load_avatar(name)
    return body_model(avatar.body_path(), avatar.height_m)


def length(points: Array) -> float:
    return float(np.linalg.norm(np.diff(points, axis=0, append=points[:1]), axis=1).sum())


def test_measures_are_those_of_a_person() -> None:
    for name in AVATARS:
        sizes, height = measure(model_of(name)).sizes, load_avatar(name).height_m
        assert 0.38 < sizes["inseam"] / height < 0.50
        assert 0.27 < sizes["arm"] / height < 0.33
        assert sizes["wrist"] < sizes["upper_arm"] < sizes["knee"] < sizes["thigh"] < sizes["waist"]
        assert 0.7 < sizes["hip"] < 1.3


@pytest.mark.parametrize("name", NAMES)
def test_a_garment_is_whole_for_everybody(name: str) -> None:
    for avatar in AVATARS:
        garment = tailor(name, model_of(avatar))
        sides = np.concatenate([garment.faces[:, k] for k in ((0, 1), (1, 2), (2, 0))])
        _, times = np.unique(sides, axis=0, return_counts=True)
        assert times.max() == 1  # all faces turn the same way
        _, times = np.unique(np.sort(sides, axis=1), axis=0, return_counts=True)
        assert times.max() == 2
        assert set(garment.faces.ravel().tolist()) == set(range(len(garment.rest)))
        assert 120 < len(garment.rest) < 1700
        constraints = make_constraints(
            garment.rest, garment.faces, garment.grain, garment.config.fabric
        )
        lengths = constraints.thread_table[:, 0] / garment.config.spacing_m
        assert 0.8 < np.median(lengths) < 1.2
        assert lengths.max() < 3.2
        assert loops(garment.faces) == LOOPS[name]


def loops(faces: npt.NDArray[np.int32]) -> int:
    """Return how many pieces the boundary consists of."""
    sides = np.sort(np.concatenate([faces[:, k] for k in ((0, 1), (1, 2), (2, 0))]), axis=1)
    known, times = np.unique(sides, axis=0, return_counts=True)
    ends = known[times == 1]
    size = int(faces.max()) + 1
    graph = coo_matrix((np.ones(len(ends)), (ends[:, 0], ends[:, 1])), (size, size))
    _, labels = connected_components(graph, directed=False)
    return len(np.unique(labels[ends]))


def test_shorts_have_the_girths_that_their_file_says() -> None:
    for avatar in AVATARS:
        model, config = model_of(avatar), load_garment("shorts")
        garment, sizes = tailor("shorts", model), measure(model).sizes
        waist = garment.rest[garment.rings["waist"]]
        hem = garment.rest[garment.rings["left_hem"]]
        assert length(waist) == pytest.approx(config.dimensions["waist"].of(sizes), rel=0.02)
        assert length(hem) == pytest.approx(config.dimensions["hem"].of(sizes), rel=0.02)
        assert hem[:, 1].max() < waist[:, 1].min() - 0.25


@pytest.mark.parametrize("name", ["shorts", "long_sleeve", "hospital_gown"])
def test_what_is_worn_lies_outside_the_skin(name: str) -> None:
    model = model_of("daniel")
    garment = tailor(name, model)
    positions = worn(garment, model, np.tile(np.eye(3), (55, 1, 1)), model.joints)
    # A ray from the middle of the body through a particle meets the skin before the particle.
    level = np.abs(positions[:, 1] - measure(model).armpit + 0.1) < 0.03
    if name == "shorts":
        level = np.abs(positions[:, 1] - model.joints[0, 1]) < 0.03
    skin = model.vertices[np.isin(model.owner, range(10))]
    for point in positions[level]:
        near = skin[np.abs(skin[:, 1] - point[1]) < 0.015][:, [0, 2]] - (0, 0.04)
        way = point[[0, 2]] - (0, 0.04)
        way /= np.linalg.norm(way)
        side = np.abs(near @ (-way[1], way[0])) < 0.02
        reach = (near[side] @ way).max() if side.any() else 0.0
        assert (point[[0, 2]] - (0, 0.04)) @ way > reach - 0.004


def test_shorts_that_are_worn_stay_on_and_rest_on_the_wearer() -> None:
    world, avatar = World(), load_avatar("daniel")
    person = Human("daniel", avatar, posture=load_posture("standing"), movable=())
    person.spawn(world, Pose())
    cloth = dress(world, person, "shorts")
    positions = cloth.positions.copy()
    for _ in range(240):
        world.step()
    weight = cloth.mass * GRAVITY
    assert cloth.force_on(person.body) == pytest.approx([0, 0, -weight], abs=0.15 * weight)
    assert np.abs(cloth.positions.mean(axis=0) - positions.mean(axis=0)).max() < 0.06
    assert cloth.strain.max() < 0.3
    assert world.skins[-1].vertices().shape == world.skins[-1].colors.shape


def test_shorts_on_a_foot_go_round_it() -> None:
    model = model_of("daniel")
    garment = tailor("shorts", model)
    joints = [model.joints[JOINT_INDEX[f"left_{j}"]] for j in ("ankle", "knee", "hip")]
    path = np.array(joints)
    placed = threaded(garment, "left", path, start=0.05, gather=0.6, towards=(-1.0, 0.0, 0.0))
    hem = placed[garment.rings["left_hem"]]
    assert hem[:, 1].mean() == pytest.approx(joints[0][1] + 0.05, abs=0.01)
    angle = np.unwrap(np.arctan2(hem[:, 0] - joints[0][0], hem[:, 2] - joints[0][2]))
    assert abs(angle[-1] - angle[0]) > 1.9 * np.pi * (1 - 1 / len(hem))
    other = placed[garment.rings["right_hem"]]
    assert other[:, 0].mean() < hem[:, 0].mean() - 0.15
    assert np.ptp(placed[:, 1]) == pytest.approx(0.6 * np.ptp(garment.rest[:, 1]), rel=0.05)
    with pytest.raises(UnknownNameError, match="leg"):
        threaded(garment, "middle", path, start=0.0, gather=0.6, towards=(-1.0, 0.0, 0.0))
    with pytest.raises(ConfigError, match="do not fit"):
        threaded(garment, "left", path, start=0.7, gather=1.0, towards=(-1.0, 0.0, 0.0))


def test_shorts_that_are_torn_about_on_a_leg_stay_round_it() -> None:
    world, avatar = World(), load_avatar("daniel")
    person = Human("daniel", avatar, posture=load_posture("standing"), movable=())
    person.spawn(world, Pose())
    garment = tailor("shorts", person.model)
    ankle, knee, hip = (
        np.array(person.joint_pose(f"left_{j}").position) for j in ("ankle", "knee", "hip")
    )
    # The other leg of the shorts hangs outwards: the wearer's own other leg is in its way.
    placed = threaded(
        garment,
        "right",
        np.array((ankle, knee, hip)),
        start=0.1,
        gather=0.75,
        towards=(0.0, 1.0, 0.0),
    )
    cloth = dress(world, person, "shorts", positions=placed)
    hand = world.add_sphere(0.02, collides=False)
    waist = garment.rings["waist"]
    rng, at = np.random.default_rng(3), placed[waist[0]]
    hand.set_base(Pose(tuple(at.tolist())))
    for step in range(360):
        if step % 90 == 0:
            cloth.release()
            hand.set_base(Pose(tuple(cloth.positions[waist[step // 9]].tolist())))
            cloth.grasp(hand, -1, 0.05)
            at, way = np.array(hand.base_pose().position), rng.uniform(-0.5, 0.5, 3)
        at = at + way / 240
        hand.set_base(Pose(tuple(at.tolist())))
        world.step()
        assert not pierced(cloth, ankle, knee)
        assert not pierced(cloth, knee, hip - 0.15 * (hip - knee))
    assert np.isfinite(cloth.positions).all()


def pierced(cloth: Cloth, start: Array, end: Array) -> bool:
    """Whether a segment goes through any face."""
    a, b, c = (cloth.positions[cloth.faces[:, k]] for k in range(3))

    def volume(p: Array, q: Array, r: Array, s: Array) -> Array:
        return np.asarray(np.einsum("ij,ij->i", np.cross(q - p, r - p), s - p))

    first, last = np.broadcast_to(start, a.shape), np.broadcast_to(end, a.shape)
    crosses = volume(a, b, c, first) * volume(a, b, c, last) < 0
    signs = [volume(first, last, *pair) > 0 for pair in ((a, b), (b, c), (c, a))]
    return bool((crosses & (signs[0] == signs[1]) & (signs[1] == signs[2])).any())


def test_a_garment_that_cannot_be_cut_is_refused() -> None:
    config = load_garment("blanket")
    with pytest.raises(UnknownNameError, match="dimension"):
        dataclasses.replace(config, dimensions={"girth": Dimension(ease_m=1.0)})
    with pytest.raises(ConfigError, match="also needs length"):
        dataclasses.replace(config, dimensions={"width": Dimension(ease_m=1.0)})
    with pytest.raises(UnknownNameError, match="measure of a body"):
        cut_garment(config, {"waist": 1.0})
    small = {"width": Dimension(ease_m=-1.0), "length": Dimension(ease_m=1.0)}
    with pytest.raises(ConfigError, match="above 0"):
        cut_garment(dataclasses.replace(config, dimensions=small), {})
    with pytest.raises(UnknownNameError, match="garment"):
        load_garment("sock")
