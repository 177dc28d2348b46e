"""A task takes place in any suitable room of any house at any level."""

from collections.abc import Iterator

import numpy as np
import pytest

import rcare_marl
from rcare_marl.envs.care_env import CareEnv
from rcare_marl.envs.homes import HomePlace
from rcare_marl.envs.homes.merging import LOW, SIDES, extent, partition
from rcare_marl.envs.rectangle import Rectangle
from rcare_marl.errors import ConfigError, UnknownNameError
from rcare_marl.model.shape import Shape


@pytest.fixture(scope="module")
def env() -> Iterator[CareEnv]:
    env = rcare_marl.make(
        "feeding",
        home="house_03",
        level=1,
        policies={"robot": "scripted", "recipient": "cooperative"},
    )
    yield env
    env.close()


def place_of(env: CareEnv) -> HomePlace:
    assert isinstance(env.task.place, HomePlace)
    return env.task.place


@pytest.mark.slow
def test_people_robots_and_house_keep_clear_of_each_other(env: CareEnv) -> None:
    assert place_of(env).home_room.kind in type(env.task).room_kinds
    env.reset(seed=0)
    for agent in env.cast.values():
        for name, thing in env.task.place.obstacles:
            assert env.world.separation(agent.body, thing, within=0.01) > 0, name


def test_furniture_of_the_room_moves_and_that_of_others_does_not(env: CareEnv) -> None:
    place = place_of(env)
    furniture = place.standing.furniture
    assert {name.split(".")[0] for name in furniture} == {place.home_room.name}
    assert not set(place.aside) & set(furniture)


def test_what_is_only_solid_is_not_drawn(env: CareEnv) -> None:
    for body in place_of(env).standing.bodies:
        if body.name.startswith("solid_"):
            lowest, highest = body.bounds()
            assert (highest - lowest).max() > 1.0
            assert all(shape.kind == "mesh" for shape in body.visual_shapes())  # not Bullet's boxes


def test_scripted_feeding_succeeds_in_a_home_and_repeats_bit_by_bit(env: CareEnv) -> None:
    tracks = []
    for seed in (0, 1, 0):
        env.reset(seed=seed)
        track = [env.state()]
        while not env.is_over:
            env.step({})
            track.append(env.state())
        assert env.task.succeeded(), seed
        tracks.append(np.array(track))
    np.testing.assert_array_equal(tracks[0], tracks[2])


@pytest.mark.parametrize(
    ("place", "message"),
    [
        ({"home": "house_3"}, "house_03"),
        ({"home": "house_03", "level": 4}, "level must be 1"),
        ({"home": "house_03", "room": "kitchen_7"}, "kitchen_1"),
        ({"home": "house_03", "room": "bathroom_1"}, "does not suit this task"),
        ({"home": "house_03", "level": 2, "room": "kitchen_1"}, "large enough: .*living_1"),
        ({"level": 2}, "home"),
        ({"room": "kitchen_1"}, "home"),
    ],
)
def test_a_place_that_is_none_is_refused(place: dict[str, object], message: str) -> None:
    with pytest.raises((ConfigError, UnknownNameError), match=message):
        rcare_marl.make("feeding", **place)  # type: ignore[arg-type]


def test_solids_are_on_the_side_that_keeps_them_clear_of_the_busy_floor() -> None:
    rng = np.random.default_rng(0)
    solids = [
        Shape(
            kind="box",
            size=tuple(rng.uniform(0.1, 1, 3)),
            rpy=tuple(rng.uniform(-3, 3, 3)),
            at=tuple(rng.uniform(-4, 4, 3)),
        )
        for _ in range(200)
    ]
    busy = Rectangle(-1, -1.5, 1, 1.5)
    sides = partition(solids, busy)
    assert sum(map(len, sides.values())) == len(solids)
    low, high = (-1, -1.5, LOW), (1, 1.5, 2.1)
    for side in SIDES:
        extents = [extent(shape) for shape in sides[side]]
        lowest = np.min([a for a, _ in extents], axis=0)
        highest = np.max([b for _, b in extents], axis=0)
        assert (lowest >= high).any() or (highest <= low).any(), side
    for shape in sides["near"]:
        lowest, highest = extent(shape)
        assert (lowest < high).all() and (highest > low).all()


@pytest.mark.slow
def test_a_crowded_place_pushes_nothing_aside_and_is_nearer_to_things(env: CareEnv) -> None:
    options = {"crowded": True}
    crowded = rcare_marl.make(
        "feeding", home="house_03", options=options, policies=dict.fromkeys(env.policies, "still")
    )
    env.reset(seed=0)
    crowded.reset(seed=0)
    assert place_of(crowded).aside == ()
    assert crowded.told()["room_clearance_m"] < env.told()["room_clearance_m"]
    crowded.close()


def test_what_a_robot_runs_into_in_a_room_is_counted() -> None:
    robot = {"model": "pr2", "moves": ["right_arm", "base"]}
    still = {"recipient": "still"}
    env = rcare_marl.make("feeding", home="house_03", robot=robot, policies=still)
    env.reset(seed=0)
    backwards = np.zeros(env.action_space("robot").shape, np.float32)
    names = env.cast["robot"].action_names
    backwards[next(i for i, name in enumerate(names) if "forward" in name)] = -1
    infos = {"robot": {"room_contacts": 0.0}}
    while env.agents and not infos["robot"]["room_contacts"]:
        *_, infos = env.step({"robot": backwards})
    env.close()
    assert infos["robot"]["room_contacts"] > 0
    assert infos["robot"]["room_clearance_m"] < 0.001


def test_nothing_is_said_of_a_room_where_there_is_none() -> None:
    with rcare_marl.make("feeding", policies=dict.fromkeys(("robot", "recipient"), "still")) as env:
        env.reset(seed=0)
        assert env.told() == {}
