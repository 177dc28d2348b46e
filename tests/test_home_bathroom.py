"""Bathroom and laundry furniture: what moves, what stays, what holds water, what is as high as it says."""

from __future__ import annotations

import math
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass

import numpy as np
import pybullet as bullet
import pytest
from variants import few

from rcare_marl.agents.sensing.proximity import ray_distances
from rcare_marl.body import Body
from rcare_marl.envs.homes.piece import Piece, Setting, make_piece
from rcare_marl.envs.homes.rule import LEVELS, Rules
from rcare_marl.envs.rectangle import Rectangle
from rcare_marl.errors import ConfigError
from rcare_marl.model.urdf import write
from rcare_marl.pose import Array, Pose
from rcare_marl.world import World

JOINTED = (
    "toilet",
    "washbasin",
    "bathtub",
    "bathtub_with_seat",
    "transfer_shower",
    "roll_in_shower",
    "shower_cabin",
    "bathroom_cabinet",
    "washing_machine",
    "dryer",
    "laundry_sink",
)
STILL = (
    "towel_rail",
    "laundry_basket",
    "bath_mat",
    "shelf_linen",
)
HAND = {1: 40.0, 2: 22.2, 3: 22.2}  # [N] that a person pushes or pulls with at most
APART = 4.0  # [m] between pieces, so that none touches another
PACE = {"revolute": 3.0, "prismatic": 0.6}  # [rad/s, m/s] at which the hand stops to push harder


def made(kind: str, level: int, **options: object) -> Piece:
    return make_piece(kind, Setting(Rules(level)), options)


@contextmanager
def loaded(*pieces: Piece) -> Iterator[tuple[World, list[Body]]]:
    """Yield a world with pieces in a row along y, with their dry friction and nothing else."""
    world = World()
    bodies = []
    for i, piece in enumerate(pieces):
        body = world.load_urdf(
            write(piece.model, melt_except=()), Pose((0.0, APART * i, 0.0)), name=piece.kind
        )
        for name, joint in body.joints.items():
            body.release_motors([joint.index], piece.model.joints[name].friction)
        bodies.append(body)
    yield world, bodies
    world.close()


def down(world: World, x: float, y: float, *, start: float = 2.5) -> float:
    """Return the height of what a ray that falls from `start` meets first [m]."""
    away = ray_distances(world, (x, y, start), np.array([[0.0, 0.0, -1.0]]), start)
    return start - float(away[0])


def along(world: World, origin: tuple[float, float, float], way: tuple[int, int, int]) -> float:
    """Return how far it is from a point to what is there [m]."""
    return float(ray_distances(world, origin, np.array([way], float), 3.0)[0])


@dataclass
class Hand:
    """What moves one joint by its handle, pushing harder only while it is slow."""

    body: Body
    joint: str
    kind: str
    upper: float
    limit: float
    grip: Pose  # in the moving link
    axis: tuple[float, float, float]
    force: float = 0.0
    hardest: float = 0.0
    reached: float = 0.0

    @property
    def index(self) -> int:
        return self.body.joint(self.joint).index

    def push(self) -> None:
        (position,), (speed,) = self.body.joint_states([self.index])
        self.reached = max(self.reached, position)
        if self.reached > self.upper - 0.01:
            return
        if speed > PACE[self.kind]:
            self.force = 0.5 * self.force
            return
        self.force = min(self.force + 0.1, self.limit)
        self.hardest = max(self.hardest, self.force)
        link = self.body.link_pose(self.index)
        way, point = self._way(link), (link @ self.grip).position
        self.body.apply_force(self.index, (self.force * way).tolist(), point)

    def _way(self, link: Pose) -> Array:
        axis = np.array((Pose((0, 0, 0), link.quaternion) @ Pose(self.axis)).position)
        if self.kind == "prismatic":
            return axis
        arm = np.array((link @ self.grip).position) - np.array(link.position)
        way = np.cross(axis, arm)
        return way / float(np.linalg.norm(way))


def hands(pieces: list[Piece], bodies: list[Body], level: int) -> list[Hand]:
    out = []
    for i, (piece, body) in enumerate(zip(pieces, bodies, strict=True)):
        for name, joint in piece.model.joints.items():
            link = body.link_pose(body.joint(name).index)
            at = Pose((0.0, APART * i, 0.0)) @ Pose(piece.frames[f"handle_{name}"].position)
            grip = link.inverse() @ at
            out.append(Hand(body, name, joint.kind, joint.upper, HAND[level], grip, joint.axis))
    return out


@pytest.mark.parametrize("level", LEVELS)
@pytest.mark.parametrize("kind", JOINTED + STILL)
def test_a_piece_looks_no_larger_than_it_says(kind: str, level: int) -> None:
    piece = made(kind, level)
    with loaded(piece) as (world, _):
        assert len(world.bodies) == 1
    corners = [
        shape.mesh().vertices
        for name, link in piece.model.links.items()
        if name == piece.model.root
        for shape in link.visual
    ]
    points = np.concatenate(corners)
    assert points[:, 0].min() > -0.011 and points[:, 2].min() > -0.001
    assert points[:, 2].max() <= piece.height + 0.02
    if kind == "toilet":  # its bars hang over clear floor
        points = points[points[:, 2] < 0.6]
    own = piece.footprint.grown(0.012)
    low, high = points[:, :2].min(axis=0), points[:, :2].max(axis=0)
    assert own.contains(Rectangle(low[0], low[1], high[0], high[1]))


@pytest.mark.parametrize("level", few(LEVELS, 1, 3))
def test_every_joint_opens_by_hand_and_stays_within_its_range(level: int) -> None:
    pieces = [made(kind, level) for kind in JOINTED]
    with loaded(*pieces) as (world, bodies):
        pushing = hands(pieces, bodies, level)
        for _ in range(900):
            for hand in pushing:
                hand.push()
            world.step()
            if all(hand.reached > hand.upper - 0.01 for hand in pushing):
                break
        stuck = [
            (h.body.name, h.joint, h.reached, h.hardest)
            for h in pushing
            if h.reached < h.upper - 0.01
        ]
        assert not stuck
        for hand in pushing:
            (position,), _ = hand.body.joint_states([hand.index])
            assert -0.03 < position < hand.upper + 0.1, (hand.body.name, hand.joint)


@pytest.mark.parametrize("level", LEVELS)
def test_nothing_moves_when_left_alone(level: int) -> None:
    pieces = [made(kind, level) for kind in JOINTED]
    with loaded(*pieces) as (world, bodies):

        def grips() -> Array:
            return np.array([(h.body.link_pose(h.index) @ h.grip).position for h in grasped])

        grasped = hands(pieces, bodies, level)
        before, most = grips(), 0.0
        for _ in range(20):
            for _ in range(120):
                world.step()
            most = max(most, float(np.abs(grips() - before).max()))
        assert most < 1e-3


@pytest.mark.parametrize("level", LEVELS)
def test_lids_stay_up_and_fall_shut_from_halfway(level: int) -> None:
    with loaded(made("toilet", level)) as (world, (body,)):
        indices = body.indices(("seat", "lid"))
        ends = [body.joint(name).upper for name in ("seat", "lid")]
        assert min(ends) > math.pi / 2
        body.set_joints(indices, ends)
        for _ in range(480):
            world.step()
        up, _ = body.joint_states(indices)
        assert up == pytest.approx(ends, abs=0.01)
        body.set_joints(indices, [0.8, 0.8])
        for _ in range(480):
            world.step()
        shut, _ = body.joint_states(indices)
        assert shut == pytest.approx([0.0, 0.0], abs=0.01)


@pytest.mark.parametrize("level", LEVELS)
def test_toilets_are_as_high_as_they_say_and_open(level: int) -> None:
    piece = made("toilet", level)
    with loaded(piece) as (world, (body,)):
        seat, lid = body.indices(("seat", "lid"))
        x, y, height = piece.frames["seat"].position
        assert down(world, x, y) == pytest.approx(piece.frames["lid"].position[2], abs=1e-3)
        body.set_joints([lid], [body.joint("lid").upper])
        assert down(world, x, y + 0.15) == pytest.approx(
            piece.measures["toilet_seat_height"], abs=1e-3
        )
        assert height == piece.measures["toilet_seat_height"]
        assert down(world, x, y) < height - 0.15  # a hole
        body.set_joints([seat], [body.joint("seat").upper])
        assert height - 0.04 < down(world, x, y + 0.15) < height - 0.02
    if level > 1:
        assert Rules(level)["toilet_seat_height"].allows(height, level)


def test_bars_of_a_toilet_are_where_the_rules_want_them() -> None:
    for level, wall, side in ((2, "left", 1), (3, "right", -1)):
        piece = made("toilet", level, wall=wall)
        measures = piece.measures
        with loaded(piece) as (world, _):
            for name in ("grab_bar_rear", "grab_bar_side"):
                x, y, _ = piece.frames[name].position
                assert down(world, x, y) == pytest.approx(measures["grab_bar_height"], abs=1e-3)
            x, y, z = piece.frames["grab_bar_rear"].position
            gap = along(world, (0.0, y, z), (1, 0, 0))
            assert gap == pytest.approx(measures["grab_bar_gap"], abs=1e-3)
            x, y, z = piece.frames["grab_bar_side"].position
            at = side * measures["toilet_centre_to_wall"]
            assert along(world, (x, at, z), (0, -side, 0)) == pytest.approx(gap, abs=1e-3)
            front = 3.0 - along(world, (3.0, y, z), (-1, 0, 0))
            back = along(world, (0.2, y, z), (1, 0, 0)) + 0.2
            assert front - back == pytest.approx(measures["grab_bar_side_length"], abs=3e-3)
            assert back <= 0.305
        assert (piece.footprint.y1 if side > 0 else -piece.footprint.y0) == pytest.approx(abs(at))
    assert not any("grab_bar" in name for name in made("toilet", 1).measures)


def test_a_fold_down_bar_comes_down_to_the_height_of_the_others() -> None:
    piece = made("toilet", 3)
    with loaded(piece) as (world, (body,)):
        index = body.joint("fold_down").index
        x, y, z = piece.frames["fold_down"].position
        assert down(world, x, y) < 0.5
        body.set_joints([index], [body.joint("fold_down").upper])
        assert down(world, x, y) == pytest.approx(piece.measures["grab_bar_height"], abs=1e-3)
        for _ in range(240):
            world.step()
        assert down(world, x, y) == pytest.approx(piece.measures["grab_bar_height"], abs=2e-3)


@pytest.mark.parametrize("level", LEVELS)
@pytest.mark.parametrize("kind", ["washbasin", "laundry_sink"])
def test_basins_have_their_rim_and_room_for_knees(kind: str, level: int) -> None:
    piece = made(kind, level)
    with loaded(piece) as (world, _):
        x, y, floor = piece.frames["basin"].position
        rim = piece.measures["basin_rim_height"]
        # The edge of the ceramic; that of a worktop, a little lower, at level 1.
        inset = {"washbasin": (0.06, 0.02, 0.04), "laundry_sink": (0.02,) * 3}[kind][level - 1]
        edge = down(world, piece.footprint.x1 - inset, y, start=1.1)
        assert edge == pytest.approx(rim, abs=6e-3 if level == 1 else 1e-3)
        assert (
            down(world, x, y + 0.05, start=1.1) == pytest.approx(floor, abs=2e-3)
            and floor < rim - 0.08
        )
        assert bool(piece.knee) == (level > 1)
        for area in piece.knee:
            for ax in np.linspace(area.x0, area.x1, 5):
                for ay in np.linspace(area.y0, area.y1, 5):
                    free = along(world, (float(ax), float(ay), 0.0), (0, 0, 1))
                    assert free >= piece.measures["basin_knee_height"] - 1e-6


@pytest.mark.parametrize("kind", ["bathtub", "bathtub_with_seat", "washbasin", "laundry_sink"])
def test_a_ball_that_is_dropped_in_stays_in(kind: str) -> None:
    for level in (1, 2):
        piece = made(kind, level)
        x, y, floor = piece.frames.get("bath", piece.frames.get("basin")).position  # type: ignore[union-attr]
        rim = piece.measures.get("bathtub_rim_height", piece.measures.get("basin_rim_height", 0.0))
        with loaded(piece) as (world, _):
            ball = world.add_sphere(0.03, Pose((x - 0.03, y - 0.06, rim + 0.1)), mass=0.1)
            ball.set_friction([-1], lateral=0.5, rolling=0.001)
            bullet.resetBaseVelocity(ball.uid, (0.3, 0.6, 0.0), physicsClientId=world.client)
            for _ in range(720):
                world.step()
            end = ball.base_pose().position
            assert floor + 0.02 < end[2] < rim
            assert piece.footprint.has(end[0], end[1])


@pytest.mark.parametrize("level", LEVELS)
def test_rims_seats_and_thresholds_of_baths_are_as_high_as_they_say(level: int) -> None:
    for kind in (
        "bathtub",
        "bathtub_with_seat",
        "transfer_shower",
        "roll_in_shower",
        "shower_cabin",
    ):
        piece = made(kind, level)
        with loaded(piece) as (world, (body,)):
            if kind == "roll_in_shower":
                body.set_joints(body.indices(["seat"]), [body.joint("seat").upper])
            if "bath_seat_height" in piece.measures:
                x, y, height = piece.frames["seat"].position
                assert down(world, x, y) == pytest.approx(height, abs=1e-3)
                assert height == piece.measures["bath_seat_height"]
            if "rim" in piece.frames:
                x, y, height = piece.frames["rim"].position
                assert down(world, x, y) == pytest.approx(height, abs=1e-3)
                assert height == piece.measures["bathtub_rim_height"]
            if "shower_threshold" in piece.measures:
                step = piece.measures["shower_threshold"]
                # From just over it, under the glass of a cabin, which a ray that starts in it passes.
                front = max(
                    down(world, float(x), 0.0, start=step + 0.02)
                    for x in np.arange(0.8, piece.footprint.x1, 0.005)
                )
                assert front == pytest.approx(step, abs=1e-3), kind


def test_a_wheelchair_finds_nothing_in_its_way_in_a_roll_in_shower() -> None:
    piece = made("roll_in_shower", 3)
    with loaded(piece) as (world, _):
        x, y, _ = piece.frames["floor"].position
        low, high = (x - 0.4, y - 0.35, 0.0), (x + 0.5, y + 0.35, 0.75)
        chair = world.add_box(
            [b - a for a, b in zip(low, high, strict=True)],
            Pose(tuple(0.5 * (a + b) for a, b in zip(low, high, strict=True))),
        )
        assert not world.contacts(chair)
        near = bullet.getClosestPoints(
            chair.uid, world.bodies[0].uid, 0.0, physicsClientId=world.client
        )
        assert not near


@pytest.mark.parametrize("kind", ["washing_machine", "dryer"])
def test_drums_are_hollow_behind_their_doors(kind: str) -> None:
    piece = made(kind, 2)
    with loaded(piece) as (world, (body,)):
        y, z = 0.0, piece.frames["handle_door"].position[2]
        shut = along(world, (1.5, y, z), (-1, 0, 0))
        body.set_joints(body.indices(["door"]), [body.joint("door").upper])
        world.step()
        assert along(world, (1.5, y, z), (-1, 0, 0)) > shut + 0.4


def test_what_cannot_be_built_is_refused() -> None:
    for kind, options in (
        ("toilet", {"wall": "behind"}),
        ("transfer_shower", {"seat": "middle"}),
        ("roll_in_shower", {"ends": "some"}),
        ("washbasin", {"width": 0.3}),
    ):
        with pytest.raises(ConfigError, match="must be"):
            make_piece(kind, Setting(Rules(3)), options)


@pytest.mark.parametrize("level", (2, 3))
def test_what_is_built_obeys_the_rules(level: int) -> None:
    rules = Rules(level)
    kinds = [*JOINTED, *STILL]
    unlike = {2: {"shower_cabin"}, 3: {"shower_cabin"}}[level]
    for kind in kinds:
        if kind in unlike:
            continue
        for name, value in made(kind, level).measures.items():
            if rules.has(name):
                assert rules[name].allows(value, level), (kind, name, value)
