"""Furniture of bedrooms, living rooms, studies, halls and other rooms: it works, and is what it claims."""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np
import pybullet as bullet
import pytest
from variants import few

from rcare_marl.body import Body
from rcare_marl.envs.homes.piece import Piece, Setting, make_piece
from rcare_marl.envs.homes.rule import LEVELS, Rules
from rcare_marl.errors import ConfigError
from rcare_marl.model.urdf import write
from rcare_marl.pose import Pose, rotate
from rcare_marl.world import World

KINDS = (
    "armchair",
    "bed",
    "bookshelf",
    "chest_of_drawers",
    "closet_shelves",
    "coat_rack",
    "coffee_table",
    "console_table",
    "desk",
    "dumbbell_rack",
    "exercise_mat",
    "fireplace",
    "floor_lamp",
    "garden_table",
    "nightstand",
    "office_chair",
    "pantry_shelves",
    "parallel_bars",
    "piano",
    "plant_stand",
    "recliner",
    "shoe_bench",
    "side_table",
    "sofa",
    "treadmill",
    "tv_stand",
    "wardrobe",
    "workbench",
)
SPACING = 6.0  # [m] between pieces in the test world


def force_allowed(level: int) -> float:
    """Return the greatest force that may be needed to open something [N]: 5 lbf from level 2 on."""
    return 40.0 if level == 1 else 22.2


class Show:
    """All pieces of a level in one world."""

    def __init__(self, level: int, *, moving_only: bool = False) -> None:
        setting = Setting(Rules(level))
        self.world = World()
        self.pieces: dict[str, Piece] = {}
        self.bodies: dict[str, Body] = {}
        for k, kind in enumerate(KINDS):
            piece = make_piece(kind, setting)
            if moving_only and not piece.model.joints:
                continue
            pose = Pose((SPACING * (k % 6), SPACING * (k // 6), 0.0))
            body = self.world.load_urdf(write(piece.model, melt_except=()), pose, name=kind)
            for name, joint in body.joints.items():
                body.release_motors([joint.index], piece.model.joints[name].friction)
            self.pieces[kind], self.bodies[kind] = piece, body

    def ray(self, kind: str, start: tuple[float, ...], end: tuple[float, ...]) -> float | None:
        """Return how far a ray in the frame of a piece gets [m]; None if it hits nothing."""
        base = self.bodies[kind].base_pose()
        a, b = (base @ Pose(start)).position, (base @ Pose(end)).position
        hit = bullet.rayTest(a, b, physicsClientId=self.world.client)[0]
        return None if hit[0] < 0 else hit[2] * float(np.linalg.norm(np.subtract(b, a)))

    def top(self, kind: str, x: float, y: float, *, below: float = 2.5) -> float:
        """Return the height of what lies under a point of a piece [m]."""
        hit = self.ray(kind, (x, y, below), (x, y, -0.1))
        return -0.1 if hit is None else below - hit


@pytest.fixture(scope="module", params=LEVELS)
def show(request: pytest.FixtureRequest) -> Iterator[Show]:
    made = Show(request.param)
    yield made
    made.world.close()


def level_of(show: Show) -> int:
    return 1 if "door_1" in show.pieces["wardrobe"].model.joints else 2


def test_nothing_is_seen_outside_the_footprint_or_in_the_wall(show: Show) -> None:
    for kind, piece in show.pieces.items():
        assert piece.footprint.x0 >= -1e-6, f"{kind} reaches into the wall"
        origins = {piece.model.root: np.zeros(3)}
        for joint in piece.model.joints.values():
            origins[joint.child] = origins[joint.parent] + joint.at
        for name, link in piece.model.links.items():
            for shape in (*link.visual, *link.collision):
                corners = shape.mesh().vertices + origins[name]
                low, high = corners.min(axis=0), corners.max(axis=0)
                assert low[2] >= -0.005, f"{kind} reaches under the floor"
                assert high[2] <= piece.height + 1e-6 < 2.5, f"{kind} is higher than it says"
                area = piece.footprint.grown(1e-6)
                if low[2] < 2.0:
                    assert area.has(low[0], low[1]) and area.has(high[0], high[1]), (
                        f"{kind}: {name}"
                    )


def test_pieces_are_frugal(show: Show) -> None:
    for kind, piece in show.pieces.items():
        links = piece.model.links.values()
        assert sum(len(link.collision) for link in links) <= 40, kind
        assert sum(len(shape.mesh().faces) for link in links for shape in link.visual) <= 3500, kind


def test_heights_that_are_claimed_are_those_that_rays_meet(show: Show) -> None:
    checked = 0
    for kind, piece in show.pieces.items():
        place = {"bed_height": "mattress", "seat_height": "seat", "table_height": "tabletop"}
        for rule, value in piece.measures.items():
            if rule in place:
                x, y, z = piece.frames[place[rule]].position
                assert show.top(kind, x, y, below=z + 0.3) == pytest.approx(value, abs=2e-3), kind
                assert z == pytest.approx(value)
                checked += 1
            elif rule == "table_knee_height":
                x, y = piece.knee[0].centre
                assert show.ray(kind, (x, y, 0.01), (x, y, 2.0)) == pytest.approx(
                    value - 0.01, abs=2e-3
                )
                checked += 1
            elif rule == "wardrobe_rail_height":
                x, y, z = piece.frames["rail"].position
                rise = show.ray(kind, (x, y, z - 0.3), (x, y, z + 0.3))
                assert rise == pytest.approx(0.3 - 0.0125, abs=2e-3)  # its lower side
                checked += 1
            else:
                assert rule == "bed_side_space"
    assert checked >= 12


def test_beds_leave_the_floor_beside_them_by_rule(show: Show) -> None:
    bed = show.pieces["bed"]
    assert len(bed.zones) == 2
    for zone in bed.zones:
        assert zone.area.depth == pytest.approx(bed.measures["bed_side_space"])
        assert not zone.area.overlaps(bed.footprint)


def test_the_legs_of_a_lift_go_under_a_bed(show: Show) -> None:
    for x in (0.4, 1.0, 1.6):
        for z in (0.05, 0.12, 0.2):
            assert show.ray("bed", (x, 1.0, z), (x, -1.0, z)) is None


def test_knees_find_room_where_it_is_promised(show: Show) -> None:
    found = 0
    for kind, piece in show.pieces.items():
        for area in piece.knee:
            found += 1
            for x in np.linspace(area.x0 + 0.02, area.x1 - 0.02, 4):
                for y in np.linspace(area.y0 + 0.02, area.y1 - 0.02, 4):
                    rise = show.ray(kind, (x, y, 0.01), (x, y, 2.0))
                    assert rise is not None and rise > 0.6, kind
    assert found == 3


def test_handles_are_on_what_they_move(show: Show) -> None:
    probe = show.world.add_sphere(0.001, Pose((-9.0, -9.0, 1.0)), name="probe")
    for kind, piece in show.pieces.items():
        body = show.bodies[kind]
        for name, joint in piece.model.joints.items():
            grip = body.base_pose() @ piece.frames[f"handle_{name}"].pose
            probe.set_base(Pose(grip.position))
            near = bullet.getClosestPoints(
                probe.uid,
                body.uid,
                0.06,
                linkIndexB=body.link_index(joint.child),
                physicsClientId=show.world.client,
            )
            assert near, f"{kind}: nothing near handle_{name}"
    probe.set_base(Pose((-9.0, -9.0, 1.0)))


def test_what_opens_strikes_nothing_of_its_own(show: Show) -> None:
    for kind, body in show.bodies.items():
        if kind == "recliner":  # its cushions give way to each other
            continue
        joints = list(body.joints.values())
        names = list(body.joints)
        for share in (0.0, 0.3, 0.6, 1.0):
            body.set_joints([j.index for j in joints], [share * j.upper for j in joints])
            for name, joint in zip(names, joints, strict=True):
                for other in range(-1, body.link_count):
                    if other != joint.index:
                        gap = body.own_gap(joint.index, other)
                        assert gap > -1e-3, f"{kind}: {name} at {share} strikes {other}: {gap}"
        body.set_joints([j.index for j in joints], [0.0] * len(joints))


@pytest.mark.parametrize("level", few(LEVELS, 1, 3))
def test_everything_opens_and_shuts_by_the_force_allowed(level: int) -> None:
    show = Show(level, moving_only=True)
    limit = force_allowed(level)
    furthest: dict[tuple[str, str], float] = {}
    for way in (1.0, -1.0):
        done: set[tuple[str, str]] = set()
        for _ in range(900):
            for kind, piece in show.pieces.items():
                body = show.bodies[kind]
                for name, joint in piece.model.joints.items():
                    moving = body.joint(name)
                    position = body.joint_states([moving.index])[0][0]
                    goal = (
                        position > 0.985 * joint.upper
                        if way > 0
                        else position < 0.015 * joint.upper
                    )
                    if goal:
                        done.add((kind, name))
                    if (kind, name) in done:
                        continue
                    furthest[kind, name] = position
                    push(show, kind, name, way * limit)
            show.world.step()
        missing = {key: furthest[key] for key in furthest if key not in done}
        assert not missing, f"way {way}: {missing}"
    assert len(done) >= 16
    show.world.close()


def push(show: Show, kind: str, name: str, force: float) -> None:
    """Push a joint at its handle, in the direction in which the handle moves."""
    piece, body = show.pieces[kind], show.bodies[kind]
    joint = piece.model.joints[name]
    link = body.link_index(joint.child)
    here = body.link_pose(link)
    origin = np.array(joint.at)  # all our joints hang on the root
    arm = np.array(piece.frames[f"handle_{name}"].position) - origin
    grip = here @ Pose(tuple(arm.tolist()))
    axis = rotate(here.quaternion, joint.axis)
    if joint.kind == "prismatic":
        direction = axis
    else:
        direction = np.cross(axis, np.subtract(grip.position, here.position))
        direction /= np.linalg.norm(direction)
    body.apply_force(link, (force * direction).tolist(), grip.position)


@pytest.mark.parametrize("share", [0.0, 0.5])
def test_nothing_moves_when_left_alone(share: float) -> None:
    for level in (1, 2):  # level 3 moves as level 2
        show = Show(level, moving_only=True)
        places = [(body, joint) for body in show.bodies.values() for joint in body.joints.values()]
        for body, joint in places:
            body.set_joints([joint.index], [share * joint.upper])
        before = [positions_of(show, body) for body in show.bodies.values()]
        for _ in range(2400):
            show.world.step()
        for body, was in zip(show.bodies.values(), before, strict=True):
            drift = np.abs(positions_of(show, body) - was).max()
            assert drift < 1e-3, f"{body.name} drifts by {drift} m"
        show.world.close()


def positions_of(show: Show, body: Body) -> np.ndarray:
    """Return where the handles of a piece are [m]."""
    piece = show.pieces[body.name]
    out = []
    for name, joint in piece.model.joints.items():
        arm = np.subtract(piece.frames[f"handle_{name}"].position, joint.at)
        out.append(
            (body.link_pose(body.link_index(joint.child)) @ Pose(tuple(arm.tolist()))).position
        )
    return np.array(out)


def test_wardrobes_slide_from_level_2_on_and_are_open_inside(show: Show) -> None:
    wardrobe, body = show.pieces["wardrobe"], show.bodies["wardrobe"]
    kinds = {joint.kind for joint in wardrobe.model.joints.values()}
    assert kinds == ({"revolute"} if level_of(show) == 1 else {"prismatic"})
    name, first = next(iter(body.joints.items()))
    y = 0.5 * float(wardrobe.frames[f"handle_{name}"].position[1])
    assert (show.ray("wardrobe", (1.5, y, 0.6), (0.0, y, 0.6)) or 0.0) < 1.0
    body.set_joints([first.index], [first.upper])
    show.world.step()
    assert (show.ray("wardrobe", (1.5, y, 0.6), (0.0, y, 0.6)) or 0.0) > 1.4
    body.set_joints([first.index], [0.0])
    show.world.step()


def test_a_ball_dropped_into_an_open_drawer_stays_there() -> None:
    show = Show(2, moving_only=True)
    body = show.bodies["chest_of_drawers"]
    drawer = body.joint("drawer_1")
    body.set_joints([drawer.index], [drawer.upper])
    x, y, z = body.base_pose().position
    ball = show.world.add_sphere(0.03, Pose((x + 0.6, y + 0.1, z + 1.2)), mass=0.1, name="ball")
    for _ in range(360):
        show.world.step()
    height = ball.base_pose().position[2]
    assert 0.7 < height < 0.95
    show.world.close()


@pytest.mark.parametrize(
    ("kind", "options", "words"),
    [
        ("bed", {"sides": "top"}, "left or right"),
        ("bed", {"width": 0.3}, "too small"),
        ("wardrobe", {"width": 0.4}, "two doors"),
        ("sofa", {"seats": 7}, "1 to 4"),
        ("chest_of_drawers", {"drawers": 0}, "1 to 6"),
        ("parallel_bars", {"gap": 0.2}, "0.4 m"),
    ],
)
def test_impossible_options_are_refused(kind: str, options: dict[str, object], words: str) -> None:
    with pytest.raises(ConfigError, match=words):
        make_piece(kind, Setting(Rules(1)), options)


def test_sizes_are_options() -> None:
    setting = Setting(Rules(1))
    double = make_piece("bed", setting, {"width": 1.6, "sides": "left"})
    assert double.footprint.depth == pytest.approx(1.66, abs=0.02)
    assert len(double.zones) == 1 and double.zones[0].area.y0 > 0
    assert len(make_piece("bed", Setting(Rules(3)), {"sides": "left"}).zones) == 2
    for width in (1.0, 2.0):
        for level in LEVELS:
            wardrobe = make_piece("wardrobe", Setting(Rules(level)), {"width": width})
            assert wardrobe.footprint.depth == pytest.approx(width, abs=0.01)
    assert make_piece("sofa", setting, {"seats": 2}).footprint.depth < 1.7
    assert math.isclose(make_piece("bookshelf", setting, {"height": 1.1}).height, 1.1)
