"""Kitchen and dining furniture: what opens, what stays, what is as high as it says."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest
from variants import few

from rcare_marl.agents.sensing.proximity import ray_distances
from rcare_marl.body import Body
from rcare_marl.envs.devices import Frame
from rcare_marl.envs.homes.furniture.kitchen_layout import RunPlan, Unit, lay_units
from rcare_marl.envs.homes.piece import Piece, Setting, make_piece
from rcare_marl.envs.homes.rule import LEVELS, Rules
from rcare_marl.errors import ConfigError
from rcare_marl.model.urdf import Joint, write
from rcare_marl.pose import Pose
from rcare_marl.world import World

JOINTED: dict[str, dict[str, object]] = {
    "kitchen_run": {"length": 3.6, "window": (1.2, 2.4)},
    "fridge": {},
    "oven_tower": {},
    "tall_cupboard": {"width": 0.9},
    "bin": {},
    "sideboard": {},
    "dresser_cabinet": {},
}
STILL: dict[str, dict[str, object]] = {
    "dining_table": {"seats": 6},
    "round_table": {},
    "chair": {},
    "rug": {},
    "picture": {},
    "wall_clock": {},
    "plant": {},
}
STEPS = {"open": 480, "rest": 2400}
HAND = {1: 40.0, 2: 22.2, 3: 22.2}  # [N] that a person pulls with at most


@cache
def piece(kind: str, level: int, seats: int = 0) -> Piece:
    options = {**JOINTED, **STILL}[kind] if not seats else {"seats": seats}
    return make_piece(kind, Setting(Rules(level)), options)


def load(world: World, made: Piece, pose: Pose = Pose()) -> Body:
    """Load a piece with its dry friction and nothing else at its joints."""
    body = world.load_urdf(write(made.model, melt_except=()), pose, name=made.kind)
    for name, joint in made.model.joints.items():
        body.release_motors([body.joint(name).index], joint.friction)
    return body


def furnished(level: int) -> tuple[World, list[tuple[Piece, Body]]]:
    """Return a world with everything that has joints, well apart."""
    world = World()
    pieces = [piece(kind, level) for kind in JOINTED]
    return world, [
        (made, load(world, made, Pose((0.0, 8.0 * place, 0.0))))
        for place, made in enumerate(pieces)
    ]


def pull(body: Body, made: Piece, name: str, force: float) -> None:
    """Pull at a handle with `force` [N], the way it moves, for one physics step."""
    joint = made.model.joints[name]
    index = body.joint(name).index
    at = body.link_pose(index)
    offset = np.subtract(handle(made, name).position, joint.at)
    turn = at.matrix()[:3, :3]
    arm, axis = turn @ offset, turn @ np.asarray(joint.axis)
    way = axis if joint.kind == "prismatic" else np.cross(axis, arm)
    push = force * way / np.linalg.norm(way)
    body.apply_force(index, push.tolist(), (np.asarray(at.position) + arm).tolist())


def handle(made: Piece, name: str) -> Frame:
    return made.frames[f"handle_{name}"]


def positions(pieces: list[tuple[Piece, Body]]) -> list[tuple[str, Joint, float]]:
    out = []
    for made, body in pieces:
        for name, joint in made.model.joints.items():
            place = body.joint_states([body.joint(name).index])[0][0]
            out.append((f"{made.kind}/{name}", joint, place))
    return out


@pytest.mark.parametrize("level", LEVELS)
def test_all_that_can_be_seen_and_touched_lies_within_what_a_piece_says_it_covers(
    level: int,
) -> None:
    for kind in (*JOINTED, *STILL):
        check_cover(piece(kind, level), most=12000 if kind == "kitchen_run" else 4000)


def check_cover(made: Piece, most: int) -> None:
    """Hold a piece to its footprint and height, and to a number of triangles."""
    area, triangles = made.footprint, 0
    for name, link in made.model.links.items():
        origin = next((np.array(j.at) for j in made.model.joints.values() if j.child == name), 0.0)
        for shape in (*link.visual, *link.collision):
            mesh = shape.mesh()
            corners = mesh.vertices + origin
            where = f"{name} of {made.kind}"
            assert corners[:, 2].min() > -1e-6, where
            assert corners[:, 2].max() < made.height + 1e-3, where
            low = corners[corners[:, 2] < 2.0]
            if len(low):
                assert low[:, 0].min() > area.x0 - 1e-3 and low[:, 0].max() < area.x1 + 1e-3, where
                assert low[:, 1].min() > area.y0 - 1e-3 and low[:, 1].max() < area.y1 + 1e-3, where
        triangles += sum(len(shape.mesh().faces) for shape in link.visual)
    assert triangles < most, made.kind
    assert all(f"handle_{joint}" in made.frames for joint in made.model.joints), made.kind


@pytest.mark.slow
@pytest.mark.parametrize("level", few(LEVELS, 2, 3))
def test_a_hand_opens_everything_and_closes_it_again(level: int) -> None:
    world, pieces = furnished(level)
    for sign in (1.0, -1.0):
        for _ in range(STEPS["open"]):
            for made, body in pieces:
                for name in made.model.joints:
                    pull(body, made, name, sign * HAND[level])
            world.step()
        for name, joint, place in positions(pieces):
            share = place / joint.upper
            assert share > 0.98 if sign > 0 else share < 0.02, f"{name} stands at {share:.2f}"


@pytest.mark.parametrize("level", LEVELS)
def test_what_is_left_half_open_stays_there_and_nothing_else_stirs(level: int) -> None:
    world, pieces = furnished(level)
    for made, body in pieces:
        for name, joint in list(made.model.joints.items())[::2]:
            body.set_joints([body.joint(name).index], [0.5 * joint.upper])
    before = positions(pieces)
    for _ in range(STEPS["rest"]):
        world.step()
    for (name, joint, old), (_, _, new) in zip(before, positions(pieces), strict=True):
        arm = 1.0 if joint.kind == "prismatic" else 0.9  # [m], longer than any leaf
        assert abs(new - old) * arm < 1e-3, f"{name} drifted by {new - old:.4f}"


@pytest.mark.parametrize("level", LEVELS)
def test_a_kitchen_is_as_high_and_deep_as_it_says(level: int) -> None:
    world = World()
    made = piece("kitchen_run", level)
    load(world, made)
    rules, measures = Rules(level), made.measures
    for name in ("counter_height", "wall_cabinet_height"):
        assert rules[name].allows(measures[name], level)
    x, y, z = made.frames["worktop"].position
    down, up = np.array([[0.0, 0.0, -1.0]]), np.array([[0.0, 0.0, 1.0]])
    worktop = z + 0.1 - ray_distances(world, (0.5, y, z + 0.1), down, 1.0)[0]
    assert worktop == pytest.approx(measures["counter_height"], abs=1e-4)
    assert bool(made.knee) == (level > 1)
    for place in made.knee:
        rays = [
            ray_distances(world, (a, b, 0.01), up, 2.0)[0] + 0.01
            for a in np.linspace(place.x0 + 0.01, place.x1 - 0.01, 6)
            for b in np.linspace(place.y0 + 0.01, place.y1 - 0.01, 6)
        ]
        assert min(rays) == pytest.approx(measures["counter_knee_height"], abs=1e-3)
        sides = np.array([[0.0, 1.0, 0.0], [0.0, -1.0, 0.0]])
        wide = ray_distances(world, (0.4, place.centre[1], 0.3), sides, 0.9)
        assert sum(wide) >= measures["counter_knee_width"] - 1e-3
        back = ray_distances(world, (0.6, place.centre[1], 0.3), np.array([[-1.0, 0.0, 0.0]]), 0.6)[
            0
        ]
        assert back == pytest.approx(measures["counter_knee_depth"], abs=1e-3)
        for name in ("counter_knee_height", "counter_knee_width", "counter_knee_depth"):
            assert rules[name].allows(measures[name], level)


@pytest.mark.parametrize("level", LEVELS)
def test_the_lowest_shelf_of_wall_cabinets_is_where_the_rule_wants_it(level: int) -> None:
    world = World()
    made = make_piece("kitchen_run", Setting(Rules(level)), {"length": 2.4, "plain": True})
    load(world, made)
    shelf = made.measures["wall_cabinet_height"]
    start = (0.2, 0.13, shelf + 0.15)
    below = ray_distances(world, start, np.array([[0.0, 0.0, -1.0]]), 1.0)[0]
    assert shelf + 0.15 - below == pytest.approx(shelf, abs=1e-4)


@pytest.mark.parametrize("level", LEVELS)
def test_a_sink_is_deep_enough_for_plates(level: int) -> None:
    world = World()
    made = piece("kitchen_run", level)
    load(world, made)
    x, y, z = made.frames["basin"].position
    top = made.measures["counter_height"]
    deep = ray_distances(world, (x + 0.08, y, top), np.array([[0.0, 0.0, -1.0]]), 1.0)[0]
    assert deep == pytest.approx(top - z, abs=1e-4)
    assert 0.1 <= deep <= 0.2


@pytest.mark.parametrize("level", LEVELS)
def test_a_ball_dropped_into_the_sink_stays_there(level: int) -> None:
    world = World()
    made = piece("kitchen_run", level)
    load(world, made)
    x, y, z = made.frames["basin"].position
    ball = world.add_sphere(0.025, Pose((x + 0.05, y + 0.1, z + 0.2)), mass=0.05)
    for _ in range(480):
        world.step()
    at = ball.base_pose().position
    assert at[2] == pytest.approx(z + 0.025, abs=2e-3)
    assert 0.1 < at[0] < 0.48 and abs(at[1] - y) < 0.26


@pytest.mark.parametrize("kind", ["fridge", "oven_tower", "tall_cupboard"])
def test_behind_open_doors_there_is_room(kind: str) -> None:
    world = World()
    made = piece(kind, 2)
    body = load(world, made)
    frame = {"fridge": "shelf", "oven_tower": "rack", "tall_cupboard": ""}[kind]
    z = made.frames[frame].position[2] + 0.06 if frame else 1.0
    inwards = np.array([[-1.0, 0.0, 0.0]])
    shut = ray_distances(world, (1.5, 0.05, z), inwards, 1.5)[0]
    for name, joint in made.model.joints.items():
        body.set_joints([body.joint(name).index], [joint.upper])
    free = ray_distances(world, (1.5, 0.05, z), inwards, 1.5)[0]
    assert shut < 0.97 and free > shut + 0.4


@pytest.mark.parametrize("level", LEVELS)
@pytest.mark.parametrize("seats", [4, 6, 8])
def test_knees_go_under_dining_tables(seats: int, level: int) -> None:
    world = World()
    made = piece("dining_table", level, seats)
    load(world, made)
    measures = made.measures
    middle = (0.5 * made.footprint.x1, 0.3, 1.0)
    top = 1.0 - ray_distances(world, middle, np.array([[0.0, 0.0, -1.0]]), 1.0)[0]
    assert top == pytest.approx(measures["table_height"], abs=1e-4)
    lowest = 2.0
    for place in made.knee:
        for a in np.linspace(place.x0 + 1e-3, place.x1 - 1e-3, 15):
            for b in np.linspace(place.y0 + 1e-3, place.y1 - 1e-3, 15):
                up = ray_distances(world, (a, b, 0.025), np.array([[0.0, 0.0, 1.0]]), 2.0)[0]
                lowest = min(lowest, up + 0.025)
    assert lowest >= measures["table_knee_height"] - 1e-4
    for name in ("table_height", "table_knee_height"):
        assert Rules(level)[name].allows(measures[name], level)


@pytest.mark.parametrize("level", LEVELS)
@pytest.mark.parametrize("seats", [4, 6, 8])
def test_chairs_at_their_places_touch_neither_table_nor_each_other(seats: int, level: int) -> None:
    world = World()
    made = piece("dining_table", level, seats)
    table = load(world, made)
    places = [frame for name, frame in made.frames.items() if name.startswith("place_")]
    assert len(places) == seats
    chairs = [load(world, piece("chair", level), frame.pose) for frame in places]
    world.step()
    for chair in chairs:
        forward = chair.base_pose().matrix()[:3, 0]
        to_table = np.subtract((0.5 * made.footprint.x1, 0.0, 0.0), chair.base_pose().position)
        assert forward @ to_table > 0
        for other in (table, *chairs):
            if other is not chair:
                low, high = chair.bounds()
                a, b = other.bounds()
                apart = (low > b).any() or (a > high).any()
                assert apart or chair_gap(chair, other) > 0


def chair_gap(a: Body, b: Body) -> float:
    """Return the least gap between two bodies that are near each other [m]."""
    import pybullet as bullet

    points = bullet.getClosestPoints(a.uid, b.uid, 0.5, physicsClientId=a._client)
    return min((float(point[8]) for point in points), default=0.5)


@pytest.mark.parametrize("level", LEVELS)
def test_a_chair_is_as_high_as_it_says(level: int) -> None:
    world = World()
    made = piece("chair", level)
    load(world, made)
    seat = 1.2 - ray_distances(world, (0.3, 0.0, 1.2), np.array([[0.0, 0.0, -1.0]]), 1.2)[0]
    assert seat == pytest.approx(made.measures["seat_height"], abs=1e-4)
    assert Rules(level)["seat_height"].allows(seat, level)


@pytest.mark.parametrize("level", LEVELS)
@pytest.mark.parametrize("corner", ["", "left", "right"])
def test_units_fill_every_length_of_kitchen_without_gaps(corner: str, level: int) -> None:
    for tenths in range(18, 49):
        plan = RunPlan(tenths / 10, corner=corner)
        if corner and tenths < 24:
            continue
        units = lay_units(plan, Rules(level))
        assert units[0].y0 == pytest.approx(-0.5 * plan.length)
        assert units[-1].y1 == pytest.approx(0.5 * plan.length)
        for a, b in zip(units, units[1:], strict=False):
            assert a.y1 == b.y0 and a.y1 > a.y0
        kinds = [unit.kind for unit in units]
        assert sum(kind.endswith("sink") for kind in kinds) == 1
        assert sum(kind.endswith("hob") for kind in kinds) == 1
        if corner:
            end: Unit = units[-1 if corner == "left" else 0]
            assert end.kind == "corner" and end.y1 - end.y0 == pytest.approx(0.6)


def test_the_sink_goes_under_the_window() -> None:
    for low in (0.3, 1.2, 2.1):
        plan = RunPlan(3.6, window=(low, low + 1.2))
        units = lay_units(plan, Rules(1))
        sink = next(unit for unit in units if unit.kind == "sink")
        assert abs(sink.middle + 1.8 - (low + 0.6)) < 0.16


@pytest.mark.parametrize(
    ("kind", "options", "words"),
    [
        ("kitchen_run", {"length": 5.5}, "1.8 to 4.8"),
        ("kitchen_run", {"corner": "up"}, "'left', 'right'"),
        ("kitchen_run", {"length": 1.8, "corner": "left"}, ""),
        ("dining_table", {"seats": 5}, "4, 6, 8"),
        ("fridge", {"width": 2.0}, "0.55 to 0.95"),
        ("plant", {"size": "huge"}, "'small' or 'large'"),
    ],
)
def test_what_cannot_be_built_is_refused_in_words(
    kind: str, options: dict[str, object], words: str
) -> None:
    level = 3
    if (kind, words) == ("kitchen_run", ""):
        words = "do not fit"
    with pytest.raises(ConfigError, match=words):
        make_piece(kind, Setting(Rules(level)), options)


@pytest.mark.parametrize("level", LEVELS)
def test_no_joint_leans_on_its_limit_when_all_is_shut(level: int) -> None:
    world, pieces = furnished(level)
    for _ in range(480):
        world.step()
    for name, joint, place in positions(pieces):
        assert joint.lower < place < 1e-3, f"{name} stands at {place}"
