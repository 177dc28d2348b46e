"""Shorts that hang on one leg of a seated person, their waistband in the fingers of a robot."""

from __future__ import annotations

from pathlib import Path

from rcare_marl.agents.people.garment import band_over_leg, dress, tailor, threaded
from rcare_marl.agents.people.human import Human
from rcare_marl.agents.robots.robot import Robot
from rcare_marl.pose import Array, rotate
from rcare_marl.soft.cloth import Cloth
from rcare_marl.world import World

from .leg_path import LegPath

# All our own choices.
HEM_START = 0.42  # [m] from the toes, past the heel, under which a hem hooks
GATHER = 0.8  # length on the leg of a metre of cloth
# Forward and to the other leg, where the other leg of the shorts hangs: the first that does not put cloth
# past the middle of that leg, round which it would hang.
INWARD = ((0.42, 0.91), (0.64, 0.77), (0.82, 0.57), (0.94, 0.34))
HOLD_START, HOLD_SHARE = (
    0.34,
    0.85,
)  # [m] from the ankle, where the waistband is held; of a short shank
HELD, SPREAD, BEFORE = 3, 0.014, 0.02  # particles in the fingers, [m] apart, [m] before the tips
OFF_SHANK, OFF_THIGH = 0.05, 0.06  # [m] from shank and thigh to the fingers


def hold_start(leg: LegPath) -> float:
    """Return how far from the ankle the waistband is held at the start [m]: before the knee."""
    return min(HOLD_START, HOLD_SHARE * leg.shank)


def tip(leg: LegPath, along: float) -> Array:
    """Return where fingers go to pull a waistband to a place on a leg, in front of it [m], shape [3].

    Args:
        leg: The leg.
        along: Of the place, from the ankle [m].
    """
    start = hold_start(leg)
    share = min(max((along - start) / (leg.shank - start), 0.0), 1.0)
    shank, thigh = OFF_SHANK + leg.radii[0], OFF_THIGH + leg.radii[1]
    return leg.at(along) + (shank + share * (thigh - shank)) * leg.front(along)


def hang(
    world: World, person: Human, garment: str | Path, leg: LegPath, robot: Robot, turn: Array
) -> Cloth:
    """Hang trousers on a leg, the waistband in a robot's fingers; not yet at rest.

    The fingers hold a few neighbours on the band, above the middle of the leg, side by side.

    Args:
        world: Where they are.
        person: Whose leg it is.
        garment: The trousers.
        leg: The leg.
        robot: Who holds them; its tool is where the band is to be.
        turn: Of its tool, shape [4].
    """
    cut = tailor(garment, person.model)
    side = 1.0 if leg.side == "right" else -1.0
    other = LegPath(person, "left" if leg.side == "right" else "right")
    for ahead, inward in INWARD:
        towards = (ahead, inward * side, 0.0)
        placed = threaded(
            cut, leg.side, leg.points, start=HEM_START, gather=GATHER, towards=towards
        )
        if all(side * (other.at(other.place(q))[1] - q[1]) > 0 for q in placed):
            break
    held, tool = band_over_leg(cut, leg.side, HELD), robot.tool_pose()
    for k, particle in enumerate(held):
        across = (k - HELD // 2) * SPREAD
        placed[particle] = tool.position + rotate(turn, (across, 0.0, BEFORE))
    cloth = dress(world, person, garment, positions=placed)
    cloth.hold(held, robot.body, robot.tool_link)
    return cloth
