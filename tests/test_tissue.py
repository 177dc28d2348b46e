"""Flesh of the avatars: meshes that fit the skin, forces of a sphere pressed into it, what is seen."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from typing import NamedTuple

import numpy as np
import numpy.typing as npt
import pytest
from variants import few

from rcare_marl import assets
from rcare_marl.agents.people.avatar import body_model, body_segments, load_avatar, person_urdf
from rcare_marl.agents.people.body.refinement import refined
from rcare_marl.agents.people.body.skeleton import JOINT_INDEX
from rcare_marl.agents.people.body.skin import BodyModel, JointFrame, PersonSkin
from rcare_marl.agents.people.body.tissue import (
    GROUPS,
    SEGMENTS,
    Tissue,
    TissueConfig,
    attach_tissue,
    expand_tissue,
    heat_colors,
    load_tissue,
    make_segment_flesh,
    with_cores,
)
from rcare_marl.body import Body
from rcare_marl.cache import cached
from rcare_marl.config import load, read_yaml
from rcare_marl.errors import ConfigError, UnknownNameError
from rcare_marl.pose import Pose
from rcare_marl.soft.tetrahedron import boundary, signed_volumes
from rcare_marl.world import World

Array = npt.NDArray[np.float64]
RADIUS = 0.02  # [m] of the sphere
DEPTHS = (0.005, 0.008, 0.012)  # [m]


class Person(NamedTuple):
    world: World
    body: Body
    model: BodyModel
    tissue: Tissue
    skin: PersonSkin
    ball: Body


def make_model(name: str = "karan") -> BodyModel:
    avatar = load_avatar(name)
    return body_model(avatar.body_path(), avatar.height_m)


def make_person(
    *segments: str, config: TissueConfig | None = None, refinement: float = 1.0, substeps: int = 5
) -> Person:
    """Return a person in the T-pose, who cannot move, with flesh."""
    world, avatar = World(), load_avatar("karan")
    model = make_model()
    urdf = person_urdf(avatar, "passive", movable=(), tissue=segments)
    file = cached("karan_flesh", ".urdf", urdf.text)
    body = world.load_urdf(file, Pose((0, 0, 1.0), (0.5, 0.5, 0.5, 0.5)))
    frames = [JointFrame(body.link_index(f.link), f.rotation, f.offset) for f in urdf.frames]
    skin = PersonSkin(model, body, frames)
    world.skins.append(skin)
    tissue = attach_tissue(
        world,
        body,
        model,
        frames,
        segments,
        config=config,
        refinement=refinement,
        substeps=substeps,
        skin=skin,
    )
    return Person(world, body, model, tissue, skin, world.add_sphere(RADIUS, Pose((5, 5, 5))))


def press(
    person: Person,
    joint: str = "left_elbow",
    depths: tuple[float, ...] = DEPTHS,
    towards: tuple[float, float, float] = (0, 0, -1),
) -> list[float]:
    """Press the sphere into the middle of a segment; return the forces at `depths` [N]."""
    point, out = person.tissue.skin_point(joint, towards)
    reached, forces = -0.005, []
    for depth in depths:
        for k in range(24):
            now = reached + (depth - reached) * (k + 1) / 24
            person.ball.set_base(Pose(tuple((point + (RADIUS - now) * out).tolist())))
            person.world.step()
        reached = depth
        for _ in range(72):
            person.world.step()
        forces.append(float(np.linalg.norm(person.tissue.bodies[joint].force)))
    return forces


@pytest.fixture(scope="module")
def pressed() -> tuple[Person, list[float]]:
    person = make_person("left_arm")
    return person, press(person)


@pytest.mark.parametrize("name", few(assets.names("avatars"), "natalia"))
def test_flesh_can_be_made_of_every_segment_of_every_avatar(name: str) -> None:
    model, config = make_model(name), load_tissue()
    for joint in SEGMENTS:
        flesh = make_segment_flesh(model, joint, config)
        volumes = signed_volumes(flesh.positions, flesh.tetrahedra)
        assert volumes.min() > 0, joint
        # Neighbours share their faces: nothing but the outside is left over.
        stations, sectors = len(flesh.stations) - 1, flesh.outer.shape[1]
        layers = len(flesh.positions) // flesh.outer.size - 1
        outside = 2 * (2 * stations * sectors + 2 * layers * sectors)
        assert len(boundary(flesh.tetrahedra)) == outside, joint


def distance_to_skin(point: Array, corners: Array) -> float:
    """Return the distance of a point from the nearest triangle that it lies above [m]."""
    a, u, v = corners[:, 0], corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    normal = np.cross(u, v)
    area = np.maximum(np.einsum("ij,ij->i", normal, normal), 1e-18)
    to = point - a
    x = np.einsum("ij,ij->i", np.cross(to, v), normal) / area
    y = np.einsum("ij,ij->i", np.cross(u, to), normal) / area
    above = (x > -1e-6) & (y > -1e-6) & (x + y < 1 + 1e-6)
    heights = np.abs(np.einsum("ij,ij->i", to, normal) / np.sqrt(area))
    return float(heights[above].min(initial=np.inf))


def test_the_outer_layer_is_the_skin() -> None:
    model = make_model()
    corners = model.vertices.astype(np.float64)[model.faces]
    for joint in ("left_elbow", "right_knee", "spine2"):
        flesh = make_segment_flesh(model, joint, load_tissue())
        points = flesh.positions[flesh.outer.ravel()[::7]] + model.joints[JOINT_INDEX[joint]]
        apart = np.array([distance_to_skin(point, corners) for point in points])
        assert (apart < 1e-5).mean() > 0.95, joint
    flesh = make_segment_flesh(model, "left_elbow", load_tissue())
    faces = flesh.positions[flesh.faces]
    outwards = np.cross(faces[:, 1] - faces[:, 0], faces[:, 2] - faces[:, 0])
    arms = faces.mean(axis=1) - flesh.origin
    arms -= np.outer(arms @ flesh.axis, flesh.axis)
    assert (np.einsum("ij,ij->i", outwards, arms) > 0).all()


def test_left_and_right_are_alike() -> None:
    model = make_model()
    volumes = []
    for side in ("left", "right"):
        flesh = make_segment_flesh(model, f"{side}_elbow", load_tissue())
        volumes.append(signed_volumes(flesh.positions, flesh.tetrahedra).sum())
    assert volumes[0] == pytest.approx(volumes[1], rel=0.05)


def test_an_arm_has_more_than_a_thousand_particles() -> None:
    person = make_person("left_arm")
    assert set(person.tissue.bodies) == {"left_shoulder", "left_elbow"}
    assert person.tissue.particle_count >= 1000


def test_cores_are_thin_and_keep_the_mass() -> None:
    avatar = load_avatar("karan")
    path = avatar.body_path()
    whole = body_segments(path, avatar.height_m, avatar.mass_kg, avatar.sex)
    cored = with_cores(whole, make_model(), ("left_arm", "torso"))
    for joint in (*GROUPS["left_arm"], *GROUPS["torso"]):
        assert cored[joint].mass == whole[joint].mass
        assert cored[joint].inertia is whole[joint].inertia
        assert cored[joint].shapes[0].size[1] < whole[joint].shapes[0].size[1]
    assert cored["right_elbow"] is whole["right_elbow"]


def test_a_sphere_pressed_into_a_forearm_meets_a_growing_force(
    pressed: tuple[Person, list[float]],
) -> None:
    person, forces = pressed
    assert 1 < forces[0] < forces[1] < forces[2] < 40
    soft = person.tissue.bodies["left_elbow"]
    assert soft.least_volume_ratio() > 0
    assert not person.tissue.bodies["left_shoulder"].is_awake


def test_the_bone_bears_what_the_sphere_presses_with(pressed: tuple[Person, list[float]]) -> None:
    person, _ = pressed
    soft = person.tissue.bodies["left_elbow"]
    load = float(np.linalg.norm(soft.held_load()))
    assert load == pytest.approx(float(np.linalg.norm(soft.force_on(person.ball))), rel=0.02)
    assert person.tissue.contact_forces()["left_elbow"] == pytest.approx(load, rel=0.02)
    assert person.tissue.contact_forces(person.body) == {}


def test_the_world_counts_flesh_as_part_of_the_person(pressed: tuple[Person, list[float]]) -> None:
    person, forces = pressed
    world, body, ball = person.world, person.body, person.ball
    assert world.contact_force(body, ball) == pytest.approx(forces[-1], rel=0.01)
    assert world.contact_force(ball) == pytest.approx(forces[-1], rel=0.01)
    (contact,) = world.contacts(body, ball)
    (mirrored,) = world.contacts(ball, body)
    assert np.add(contact.normal, mirrored.normal) == pytest.approx(np.zeros(3))
    assert contact.normal[2] > 0.8  # pressed from below
    assert world.contact_force(ball, body) == pytest.approx(forces[-1], rel=0.01)


@pytest.mark.slow
def test_forces_are_within_15_percent_of_a_converged_run(
    pressed: tuple[Person, list[float]],
) -> None:
    """40 substeps a frame of 1/60 s, cells half as long, the whole segment simulated."""
    config = dataclasses.replace(load_tissue(), focus_m=None)
    fine = press(make_person("left_elbow", config=config, refinement=2.0, substeps=10))
    assert pressed[1] == pytest.approx(fine, rel=0.15)


def test_force_is_linear_in_youngs_modulus(pressed: tuple[Person, list[float]]) -> None:
    flesh = load_tissue()
    stiff = dataclasses.replace(flesh.material, youngs_modulus_pa=60e3)
    person = make_person("left_arm", config=dataclasses.replace(flesh, material=stiff))
    assert press(person) == pytest.approx([2 * force for force in pressed[1]], rel=0.06)


def test_the_flesh_comes_back_and_the_skin_with_it() -> None:
    person = make_person("left_elbow")
    person.tissue.show_pressure()
    before, colors = person.skin.vertices(), person.skin.colors.copy()
    press(person, depths=(0.01,))
    during = person.skin.vertices()
    dent = np.linalg.norm(during - before, axis=1)
    assert 0.006 < dent.max() < 0.014
    far = np.linalg.norm(before - before[dent.argmax()], axis=1) > 0.1
    assert dent[far].max() < 1e-4
    painted = (person.skin.colors != colors).any(axis=1)
    assert painted.any() and not painted[far].any()
    pressure = person.tissue.pressure()
    assert 2e3 < pressure.max() < 2e5
    assert set(np.flatnonzero(painted)) <= set(np.flatnonzero(pressure))
    person.ball.set_base(Pose((5, 5, 5)))
    for _ in range(120):
        person.world.step()
    assert not person.tissue.bodies["left_elbow"].is_awake
    np.testing.assert_array_equal(person.skin.vertices(), before)
    np.testing.assert_array_equal(person.skin.colors, colors)
    assert person.tissue.contact_forces() == {}


@pytest.mark.parametrize("joint", ["left_shoulder", "right_hip", "left_knee", "spine2"])
def test_every_kind_of_segment_yields_and_recovers(joint: str) -> None:
    person = make_person("torso" if joint == "spine2" else joint)
    towards = (1, 0, 0) if joint == "spine2" else (0, 0, -1) if "shoulder" in joint else (1, 0, 0)
    forces = press(person, joint, (0.004, 0.008), towards)
    assert 0.5 < forces[0] < forces[1] < 60
    assert person.tissue.bodies[joint].least_volume_ratio() > 0
    person.ball.set_base(Pose((5, 5, 5)))
    for _ in range(200):
        person.world.step()
    assert person.tissue.bodies[joint].deviation() == 0


def test_an_episode_with_flesh_repeats_bit_for_bit() -> None:
    person = make_person("left_elbow")
    person.world.mark_start()
    ends = []
    for _ in range(2):
        person.world.rewind()
        press(person, depths=(0.006,))
        soft = person.tissue.bodies["left_elbow"]
        ends.append((soft.positions.copy(), soft.force, soft.pressure.copy()))
        person.ball.set_base(Pose((5, 5, 5)))
    for first, second in zip(*ends, strict=True):
        assert np.array_equal(first, second)


def test_heat_runs_from_the_skins_own_colour_to_red() -> None:
    colors = np.full((4, 3), 150, np.uint8)
    shown = heat_colors(colors, np.array((0, 1e4, 2e4, 1e6), np.float32), 2e4)
    assert (shown[0] == 150).all()
    assert shown[1, 1] > shown[1, 0] > shown[1, 2]  # green in the middle
    assert shown[2, 0] > 2 * shown[2, 1]
    assert (shown[2] == shown[3]).all()


def test_finer_skin_has_no_gaps_and_keeps_its_vertices() -> None:
    model = make_model()
    chosen = np.linalg.norm(model.vertices - model.joints[JOINT_INDEX["left_elbow"]], axis=1) < 0.15
    fine = refined(model, chosen, times=2)

    def open_edges(faces: npt.NDArray[np.int32]) -> int:
        pairs = np.sort(faces[:, ((0, 1), (1, 2), (2, 0))].reshape(-1, 2), axis=1)
        return int((np.unique(pairs, axis=0, return_counts=True)[1] == 1).sum())

    count = len(model.vertices)
    assert len(fine.faces) > len(model.faces) + 8 * chosen.sum()
    assert open_edges(fine.faces) == open_edges(model.faces)
    np.testing.assert_array_equal(fine.vertices[:count], model.vertices)
    np.testing.assert_allclose(fine.weights.sum(axis=1), 1, atol=1e-5)
    shift = fine.vertices[count:] - model.vertices[np.flatnonzero(chosen)].mean(axis=0)
    assert np.linalg.norm(shift, axis=1).max() < 0.25


def test_groups_and_segments_are_named() -> None:
    assert expand_tissue(["torso", "left_elbow"]) == ("spine1", "spine2", "spine3", "left_elbow")
    assert set(expand_tissue(["left_leg"])) == {"left_hip", "left_knee"}


def broken(**change: object) -> Callable[[], object]:
    data = read_yaml(assets.find("tissue", "flesh"))
    return lambda: load(TissueConfig, {**data, **change})


def test_bad_input_is_named() -> None:
    with pytest.raises(UnknownNameError, match="left_elbow"):
        expand_tissue(["left_elbo"])
    with pytest.raises(UnknownNameError, match="segment with tissue"):
        person_urdf(load_avatar("karan"), "passive", tissue=("head",))
    with pytest.raises(UnknownNameError, match="flesh"):
        load_tissue("flsh")
    with pytest.raises(ConfigError, match="substeps must be at least 1"):
        make_person("left_elbow", substeps=0)
    with pytest.raises(ConfigError, match="refinement must be above 0"):
        make_person("left_elbow", refinement=0.0)
    with pytest.raises(ConfigError, match="at least 6 sectors"):
        make_person("left_elbow", refinement=0.1)
    material = {"youngs_modulus_pa": 3e4, "poissons_ratio": 0.5}
    with pytest.raises(ConfigError, match="poissons_ratio must lie in 0..0.5"):
        broken(material=material)()
    with pytest.raises(UnknownNameError, match="no field of TissueConfig"):
        broken(colour="red")()
    with pytest.raises(ConfigError, match="no kind of segment named 'ear'"):
        broken(segments={"ear": read_yaml(assets.find("tissue", "flesh"))["segments"]["elbow"]})()
    avatar = dataclasses.replace(load_avatar("karan"), body="bodies/nobody.npz")
    with pytest.raises(ConfigError, match=r"nobody\.npz"):
        person_urdf(avatar, "passive", tissue=("left_elbow",))
