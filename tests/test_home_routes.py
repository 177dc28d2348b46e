"""Maps of free floor, and ways for wheelchairs."""

from __future__ import annotations

import numpy as np
import pytest

from rcare_marl.envs.homes.ground import Gate, Ground
from rcare_marl.envs.homes.occupancy import Obstacle, Occupancy
from rcare_marl.envs.homes.route import Way
from rcare_marl.envs.rectangle import Rectangle
from rcare_marl.errors import ConfigError

WEST, EAST = Rectangle(0.0, 0.0, 3.0, 4.0), Rectangle(3.2, 0.0, 6.0, 4.0)


def two_rooms(door: float) -> Occupancy:
    """Two rooms of 4 m depth with a wall between them that has a gap of `door` [m] in its middle."""
    low, high = 2.0 - door / 2, 2.0 + door / 2
    walls = [
        Rectangle(3.0, 0.0, 3.2, low),
        Rectangle(3.0, high, 3.2, 4.0),
        Rectangle(-0.2, -0.2, 6.2, 0.0),
        Rectangle(-0.2, 4.0, 6.2, 4.2),
        Rectangle(-0.2, 0.0, 0.0, 4.0),
        Rectangle(6.0, 0.0, 6.2, 4.0),
    ]
    return Occupancy(Rectangle(-1, -1, 7, 5), [Obstacle(wall, "wall") for wall in walls])


@pytest.mark.parametrize("door", [0.66, 0.815, 0.915])
def test_a_route_tells_its_narrowest_width_within_a_cell(door: float) -> None:
    route = Way(two_rooms(door), 0.5).route(WEST, EAST)
    assert route is not None
    assert route.narrowest == pytest.approx(door, abs=0.026)
    assert 2.95 < route.narrowest_at[0] < 3.25


@pytest.mark.parametrize(("door", "passes"), [(0.6, False), (0.66, False), (0.8, True)])
def test_a_wheelchair_passes_only_doors_that_are_wide_enough(door: float, passes: bool) -> None:
    way = Way(two_rooms(door))
    assert bool(way.regions_in(WEST) & way.regions_in(EAST)) is passes
    assert (way.route(WEST, EAST) is not None) is passes


def test_every_point_of_a_route_has_the_room_that_was_asked_for() -> None:
    floor = two_rooms(0.9)
    route = Way(floor, 0.7).route(WEST, EAST)
    assert route is not None
    assert min(floor.clearance(x, y) for x, y in route.points) >= 0.35 - 1e-9
    assert np.linalg.norm(np.diff(route.points, axis=0), axis=1).max() < 0.04


def test_the_largest_free_circle_fits_between_walls_and_furniture() -> None:
    room = Rectangle(0, 0, 3, 4)
    cupboard = Obstacle(Rectangle(0, 3, 3, 4), "cupboard")
    assert Occupancy(room, []).free_circle(room)[0] == pytest.approx(3.0, abs=0.05)
    diameter, (x, y) = Occupancy(room, [cupboard]).free_circle(room)
    assert diameter == pytest.approx(3.0, abs=0.05)
    assert (x, y) == pytest.approx((1.5, 1.5), abs=0.05)


def test_clearance_is_the_exact_distance_to_the_nearest_obstacle() -> None:
    floor = Occupancy(Rectangle(0, 0, 5, 5), [Obstacle(Rectangle(1, 1, 2, 2), "box")])
    assert floor.clearance(3.0, 1.5) == pytest.approx(1.0)
    assert floor.clearance(5.0, 6.0) == pytest.approx(5.0)
    assert floor.clearance(1.5, 1.5) == 0.0


@pytest.mark.parametrize("width", [0.0, -1.0])
def test_a_width_that_nothing_can_have_is_refused(width: float) -> None:
    with pytest.raises(ConfigError, match="positive width"):
        Way(two_rooms(0.9), width)


HALL = Rectangle(0.0, 0.0, 6.0, 4.0)
ENDS = [
    Gate(Rectangle(0.0, 1.5, 0.0, 2.5), (1, 0)),
    Gate(Rectangle(6.0, 1.5, 6.0, 2.5), (-1, 0)),
]


@pytest.mark.parametrize("gap", [0.5, 0.6603, 0.8149, 0.915, 1.2])
@pytest.mark.parametrize("y", [0.8, 1.03171])
def test_straight_gaps_are_measured_to_the_millimetre(gap: float, y: float) -> None:
    ground = Ground(HALL, [Rectangle(2.5, 0.0, 3.5, y), Rectangle(2.7, y + gap, 3.1, 4.0)])
    assert ground.width(ENDS) == pytest.approx(gap, abs=0.0011)
    _, middle = ground.circle
    for width, is_joined in ((gap - 1e-4, True), (gap + 1e-3, False)):
        assert ground.joins([end.place(width) for end in ENDS], middle, width) is is_joined


@pytest.mark.parametrize("angle", [10.0, 25.0, 35.0, 45.0, 70.0])
def test_slanted_gaps_are_found_hardly_wider_and_little_narrower(angle: float) -> None:
    gap, turn = 0.8, np.radians(angle)
    x, y = 2.6 + gap * np.cos(turn), 1.5 + gap * np.sin(turn)
    ground = Ground(HALL, [Rectangle(2.0, 0.0, 2.6, 1.5), Rectangle(x, y, x + 0.5, 4.0)])
    assert -0.04 < ground.width(ENDS) - gap < 0.003


def test_a_way_reaches_all_doors_or_has_no_width() -> None:
    shut = Ground(HALL, [Rectangle(2.0, 0.0, 2.5, 4.0)])
    assert shut.width(ENDS) < 0.002 < shut.width(ENDS[1:])
    behind = Ground(HALL, [Rectangle(0.0, 1.4, 0.76, 2.6)])  # something stands in a door
    assert behind.width(ENDS) < 0.002


def test_a_way_leads_straight_out_of_a_door() -> None:
    post = Rectangle(0.6, 1.9, 0.7, 2.1)
    assert Ground(HALL, [post]).width(ENDS) < 0.72  # there is 1.9 m of floor on each side of it
    assert Ground(HALL, [post]).width(ENDS[1:]) > 2.5


def test_one_is_within_a_room_in_line_with_its_door() -> None:
    assert ENDS[0].place(0.6) == Rectangle(0.3, 1.8, 0.3, 2.2)
    assert ENDS[1].place(1.2) == Rectangle(5.4, 2.0, 5.4, 2.0)


@pytest.mark.parametrize("side", [0.9, 2.0])
def test_an_empty_floor_is_as_wide_as_its_shorter_side(side: float) -> None:
    area = Rectangle(1.0, 1.0, 1.0 + side, 5.0)
    door = Gate(Rectangle(1.0, 1.0, 1.0 + side, 1.0), (0, 1))
    assert Ground(area, []).width([door]) == pytest.approx(side, abs=0.0011)
    assert Ground(area, []).circle[0] == pytest.approx(side, abs=1e-3)
