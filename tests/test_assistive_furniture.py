"""Assistive devices that stand in homes as furniture."""

from __future__ import annotations

from collections.abc import Callable

import pybullet as bullet
import pytest

from rcare_marl.envs.homes.furniture.assistive import (
    make_hospital_bed,
    make_manual_wheelchair,
    make_transfer_bench,
)
from rcare_marl.envs.homes.piece import Piece, Setting
from rcare_marl.envs.homes.rule import Rules
from rcare_marl.model.urdf import write
from rcare_marl.world import World

FURNITURE = (make_hospital_bed, make_manual_wheelchair, make_transfer_bench)


@pytest.mark.parametrize("level", [1, 2, 3])
@pytest.mark.parametrize("make", FURNITURE)
def test_devices_stand_in_homes_as_furniture(make: Callable[[Setting], Piece], level: int) -> None:
    piece, world = make(Setting(Rules(level))), World()
    body = world.load_urdf(write(piece.model, melt_except=()))
    assert not body.joints
    low, high = body.bounds()
    area, slack = piece.footprint, 0.01
    assert low[0] >= area.x0 - slack and low[1] >= area.y0 - slack and low[2] >= -0.015
    assert high[0] <= area.x1 + slack and high[1] <= area.y1 + slack
    assert high[2] <= piece.height + slack
    bed = piece.measures.get("bed_height")
    if bed is not None:
        assert Rules(level)["bed_height"].allows(bed, level)
        hit = bullet.rayTest((1.0, 0, 2.0), (1.0, 0, 0.0), physicsClientId=world.client)[0]
        assert hit[3][2] == pytest.approx(bed, abs=2e-3)
    seat = piece.measures.get("bath_seat_height")
    if seat is not None:
        x, y, _ = piece.frames["seat"].position
        hit = bullet.rayTest((x, y, 2.0), (x, y, 0.0), physicsClientId=world.client)[0]
        assert hit[3][2] == pytest.approx(seat, abs=2e-3)
