"""What the task of tooth brushing reads once a control step."""

from __future__ import annotations

from dataclasses import dataclass

from rcare_marl.pose import Array

from ..state import State
from .refusal import Refusal


@dataclass(frozen=True, eq=False)
class ToothBrushingState(State):
    """What tooth brushing reads."""

    bristles: Array  # their middle [m], shape [3]
    to_turn: Array  # by how much it is to be turned to go in to the next quadrant [rad], shape [3]
    axis: Array  # along the handle to the head, a unit vector, shape [3]
    mouth: Array  # between the lips [m], shape [3]
    face: Array  # where the face looks, a unit vector, shape [3]
    bowed: float  # how far it looks below where it did at rest, along z of that vector
    jaw: float  # how far the jaw is open [rad]
    is_inside: bool  # whether the brush is in the mouth
    distance: float  # from bristles to lips [m]
    targets: Array  # where the middle of the bristles touches each of `QUADRANTS` [m], shape [4, 3]
    outward: Array  # out of the teeth there, unit vectors, shape [4, 3]
    to_next: Array  # from the bristles to the first quadrant that is not clean [m], shape [3]
    next_outward: Array  # the way out of the teeth there, a unit vector, shape [3]
    next_into: Array  # along the brush into the mouth there, a unit vector, shape [3]
    next_force: float  # of the bristles on the outer side there, the mean of the control step [N]
    push: Array  # on the brush within the mouth, the mean of the control step [N], shape [3]
    press: float  # of the brush on the person, the mean of the control step [N]
    cleaning: Array  # of that on the outer side of each quadrant [N], shape [4]
    speed: Array  # of the bristles along the upper and the lower row [m/s], shape [2]
    brushed: Array  # how long each quadrant was brushed [s], shape [4]
    gained: float  # of that in this control step, up to `BRUSHED` each
    local: Array  # the bristles as each row sees them [m], shape [2, 3]
    refusal: Refusal  # what the recipient did not want
