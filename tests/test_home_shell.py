"""Shells of homes: solid where walls are, open where openings are, level to roll on, and with a way in."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pybullet as bullet
import pytest
from small_home import small_home

from rcare_marl.body import Body
from rcare_marl.envs.homes.layout import lay_out, load_house
from rcare_marl.envs.homes.palette import Palette
from rcare_marl.envs.homes.plan import CEILING_HEIGHT, OUTSIDE, Plan
from rcare_marl.envs.homes.rule import Rules
from rcare_marl.envs.homes.shell import floor_model, maximal, shell_model
from rcare_marl.envs.homes.shell_wall import wall_boxes
from rcare_marl.envs.rectangle import Rectangle
from rcare_marl.errors import ConfigError
from rcare_marl.model.urdf import Model, write
from rcare_marl.pose import Pose
from rcare_marl.world import World

LEVELS = (1, 2, 3)


def built(plan: Plan, **options: bool) -> tuple[World, Body, Body]:
    world = World()
    walls = shell_model(plan, Palette(), **options)
    floor = floor_model(plan, Rules(plan.level), Palette())
    bodies = [world.load_urdf(write(model, melt_except=())) for model in (walls, floor)]
    bullet.performCollisionDetection(physicsClientId=world.client)
    return world, bodies[0], bodies[1]


def height_at(world: World, x: float, y: float, *, top: float = 0.6) -> float:
    """Return the height of what is met from above [m]."""
    hit = bullet.rayTest((x, y, top), (x, y, -2.0), physicsClientId=world.client)[0]
    return float(hit[3][2]) if hit[0] >= 0 else -math.inf


def is_free(world: World, start: Pose, end: Pose) -> bool:
    hit = bullet.rayTest(start.position, end.position, physicsClientId=world.client)[0]
    return bool(hit[0] < 0)


def triangles(model: Model) -> int:
    return sum(len(shape.mesh().faces) for shape in model.links[model.root].visual)


@pytest.mark.parametrize("level", LEVELS)
def test_walls_are_solid_but_for_their_openings(level: int) -> None:
    plan = small_home(level)
    world, _, _ = built(plan)
    for opening in plan.openings.values():
        middle, reach = 0.5 * (opening.sill + opening.head), 0.5 * opening.thickness + 0.1
        half = 0.5 * opening.width
        for x, z, expected in (
            (0.0, middle, opening.kind != "window"),  # panes stop things
            (0.0, opening.head + 0.1, False),
            (half + 0.1, middle, False),
            (-half - 0.1, middle, False),
        ):
            start = opening.pose @ Pose((x, reach, z))
            end = opening.pose @ Pose((x, -reach, z))
            assert is_free(world, start, end) == expected, (opening.name, x, z)
    for wall in plan.walls:
        x, y = wall.area.centre
        ends = (wall.area.x0, y) if wall.axis == "x" else (x, wall.area.y0)
        at = (ends[0] + 0.02, y) if wall.axis == "x" else (x, ends[1] + 0.02)
        assert height_at(world, *at, top=3.0) > CEILING_HEIGHT - 1e-3


@pytest.mark.parametrize("level", LEVELS)
def test_wall_boxes_are_the_walls_less_their_openings(level: int) -> None:
    plan = small_home(level)
    boxes = wall_boxes(plan)
    whole = sum(wall.area.area for wall in plan.walls) * CEILING_HEIGHT
    gaps = sum(o.gap.area * (o.head - o.sill) for o in plan.openings.values())
    volume = sum(b.area.area * (b.high - b.low) for b in boxes)
    if level < 3:
        assert volume == pytest.approx(whole - gaps)
    else:  # and less the pocket of the panel
        door = plan.openings["door_1"]
        assert whole - gaps - volume == pytest.approx(
            (door.clear_width + 0.03) * 0.06 * door.head, rel=1e-6
        )
    for box in boxes:
        assert plan.walls[box.wall].area.contains(box.area, by=1e-6)
    low = wall_boxes(plan, height=1.0)
    assert max(b.high for b in low) == 1.0
    for k, a in enumerate(boxes):
        for b in boxes[k + 1 :]:
            apart = min(a.high, b.high) - max(a.low, b.low) < 1e-9
            assert apart or not a.area.overlaps(b.area, by=1e-6)


@pytest.mark.parametrize("level", LEVELS)
def test_floors_are_level_and_thresholds_as_high_as_the_rules_say(level: int) -> None:
    plan, rules = small_home(level), Rules(level)
    world, _, _ = built(plan)
    for room in plan.rooms.values():
        for x in np.linspace(room.inside.x0 + 0.1, room.inside.x1 - 0.1, 7):
            for y in np.linspace(room.inside.y0 + 0.1, room.inside.y1 - 0.1, 7):
                assert height_at(world, x, y) == pytest.approx(0.0, abs=1e-6)
    for name, rule in (("door_1", "door_threshold"), ("entrance_1", "entrance_threshold")):
        height = height_at(world, *plan.openings[name].centre)
        assert height == pytest.approx(rules.figure(rule), abs=1e-6)
        assert level == 1 or rules[rule].allows(height, level)


def test_a_ball_feels_no_seam_between_slabs() -> None:
    plan = replace(
        small_home(3),
        outline=(Rectangle(-0.25, -0.25, 6.25, 2.0), Rectangle(-0.25, 2.0, 3.06, 4.25)),
    )
    assert len(maximal(plan.outline)) == 2
    world = World()
    floor = world.load_urdf(write(floor_model(plan, Rules(3), Palette()), melt_except=()))
    floor.set_friction([-1], lateral=0.8)
    # One crosses the end of the slab that lies under the other's, one rolls along it.
    balls = [world.add_sphere(0.1, Pose((2.2, y, 0.1)), mass=5.0) for y in (0.8, 1.99)]
    speeds = []
    for k in range(720):
        for ball in balls:
            if k < 120:
                ball.apply_force(-1, (6.0, 0.0, 0.0), ball.base_pose().position)
            elif k > 130:
                assert abs(ball.base_pose().position[2] - 0.1) < 3e-4
        world.step()
        if k > 130:
            velocities = [
                bullet.getBaseVelocity(b.uid, physicsClientId=world.client) for b in balls
            ]
            speeds.append([velocity[0][0] for velocity in velocities])
    assert all(ball.base_pose().position[0] > 3.2 for ball in balls)
    assert np.abs(np.diff(speeds, axis=0)).max() < 0.003, "nothing pulls at them"


def entrance_frame(plan: Plan) -> Pose:
    """Return the frame on the floor before the entrance, x away from the house."""
    opening = plan.openings["entrance_1"]
    turn = Pose((0.0, -0.5 * opening.thickness, 0.0), (0.0, 0.0, -math.sqrt(0.5), math.sqrt(0.5)))
    return opening.pose @ turn


def profile(world: World, plan: Plan, length: float) -> tuple[list[float], list[float]]:
    """Return how far from the door, and how high, the way straight out is [m]."""
    frame = entrance_frame(plan)
    xs = np.arange(0.02, length, 0.02).tolist()
    return xs, [height_at(world, *(frame @ Pose((x, 0.0, 0.0))).position[:2]) for x in xs]


@pytest.mark.parametrize("level", (2, 3))
def test_a_ramp_as_the_rules_want_it_leads_to_the_entrance(level: int) -> None:
    plan, rules = small_home(level), Rules(level)
    world, _, _ = built(plan)
    xs, heights = profile(world, plan, 8.0)
    rise = rules.figure("entrance_rise")
    landing = max(x for x, z in zip(xs, heights, strict=True) if z > -1e-4)
    assert landing >= 1.525 - 0.03
    assert heights[-1] == pytest.approx(-rise, abs=1e-6)
    # Between its ends: rays see edges rounded.
    ramp = [z for z in heights if -0.9 * rise < z < -0.1 * rise]
    assert len(ramp) > 40
    falls = -np.diff(ramp) / 0.02
    assert (falls.min(), falls.max()) == pytest.approx(2 * (rules.figure("ramp_slope"),), rel=0.01)
    frame, middle = entrance_frame(plan), landing + 0.5 * rise / rules.figure("ramp_slope")
    reach = 0.0
    for sign in (-1, 1):
        start = frame @ Pose((middle, 0.0, -0.5 * rise + 0.04))
        end = frame @ Pose((middle, sign * 2.0, -0.5 * rise + 0.04))
        hit = bullet.rayTest(start.position, end.position, physicsClientId=world.client)[0]
        reach += 2.0 * hit[2]
    assert reach == pytest.approx(rules.figure("ramp_width"), abs=0.005)
    assert rules["ramp_width"].allows(reach, level)


def test_steps_lead_to_the_entrance_of_usual_homes() -> None:
    plan = small_home(1)
    world, _, _ = built(plan)
    _, heights = profile(world, plan, 3.0)
    falls = [-step for step in np.diff(heights) if step < -1e-4]
    assert falls == pytest.approx([0.15, 0.15], abs=1e-4)
    assert heights[-1] == pytest.approx(-0.3)


def test_a_ramp_turns_where_the_house_is_in_the_way_and_says_so_where_it_cannot() -> None:
    plan = small_home(2)
    across = Rectangle(-0.25, -4.0, 6.25, -2.5)  # a wing opposite the door
    turned = replace(plan, outline=(*plan.outline, across))
    world, _, _ = built(turned)
    frame = entrance_frame(turned)
    sides = []
    for sign in (-1, 1):
        steps = [(frame @ Pose((0.8, sign * (0.9 + 0.1 * k), 0.0))).position for k in range(15)]
        heights = [height_at(world, p[0], p[1]) for p in steps]
        sides.append(-0.149 < heights[8] < -0.01)
    assert sum(sides) == 1, "the ramp runs along the house on one side"
    walled = (Rectangle(2.0, -2.0, 3.5, -0.25), Rectangle(5.5, -2.0, 6.25, -0.25))
    with pytest.raises(ConfigError, match="no room for a ramp"):
        floor_model(replace(turned, outline=(*turned.outline, *walled)), Rules(2), Palette())


def test_a_yard_within_the_house_is_level_with_its_floor() -> None:
    plan = small_home(3)
    wings = (
        Rectangle(1.0, -4.0, 3.0, -0.25),
        Rectangle(5.6, -4.0, 7.0, -0.25),
        Rectangle(1.0, -5.0, 7.0, -4.0),
    )
    yard, _, _ = built(replace(plan, outline=(*plan.outline, *wings)))
    _, heights = profile(yard, plan, 3.7)
    assert heights == pytest.approx([0.0] * len(heights), abs=1e-6)
    assert height_at(yard, 3.2, -3.8) == pytest.approx(0.0, abs=1e-6)
    open_yard, _, _ = built(replace(plan, outline=(*plan.outline, *wings[:2])))
    _, heights = profile(open_yard, plan, 5.0)
    assert min(heights) == pytest.approx(-Rules(3).figure("entrance_rise"), abs=1e-6)


def test_a_house_is_cheap_to_draw_and_complete() -> None:
    plan = lay_out(load_house("house_01"), 3)
    floor, walls = floor_model(plan, Rules(3), Palette()), shell_model(plan, Palette())
    assert triangles(floor) < 6000
    assert triangles(walls) < 20000
    world, _, _ = built(plan, ceilings=True)
    for room in plan.rooms.values():
        x, y = room.inside.centre
        assert height_at(world, x, y, top=2.4) == pytest.approx(0.0, abs=1e-6)
        up = bullet.rayTest((x, y, 1.0), (x, y, 4.0), physicsClientId=world.client)[0]
        assert up[3][2] == pytest.approx(CEILING_HEIGHT)
    for opening in plan.openings.values():
        if opening.kind != "window" and OUTSIDE not in opening.rooms:
            start, end = (opening.pose @ Pose((0.0, y, 1.0)) for y in (0.5, -0.5))
            assert is_free(world, start, end), opening.name


def test_ceilings_can_be_left_out_and_walls_cut() -> None:
    plan = small_home(2)
    world, _, _ = built(plan, ceilings=False)
    assert height_at(world, 1.5, 2.0, top=4.0) == pytest.approx(0.0, abs=1e-6)
    cut = shell_model(plan, Palette(), ceilings=False, wall_height=1.2)
    link = cut.links[cut.root]
    tops = [float(shape.mesh().vertices[:, 2].max()) for shape in (*link.visual, *link.collision)]
    assert max(tops) < 1.2 + 1e-6
    for height in (0.0, 3.0):
        with pytest.raises(ConfigError, match="wall_height"):
            shell_model(plan, Palette(), wall_height=height)


def test_nothing_flat_is_taken_for_a_floor_without_end() -> None:
    """Renderers draw level slabs, wide and thinner than 0.3 m, as wood up to the horizon."""
    plan = lay_out(load_house("house_01"), 1)
    for model in (floor_model(plan, Rules(1), Palette()), shell_model(plan, Palette())):
        link = model.links[model.root]
        for material in {shape.material for shape in link.visual}:
            points = np.concatenate(
                [s.mesh().vertices for s in link.visual if s.material == material]
            )
            wide, deep, high = np.ptp(points, axis=0)
            assert min(wide, deep) < 3.0 or high > 0.3, material
