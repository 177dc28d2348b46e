"""Where bodies touch."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Contact:
    """One contact point between two bodies.

    Attributes:
        link_a: Link index of the first body.
        link_b: Link index of the second body.
        position: Point on the second body in the world [m], shape [3].
        normal: From the second body to the first, unit length, shape [3].
        distance: Gap [m]; negative where the bodies overlap.
        force: Normal force [N].
    """

    link_a: int
    link_b: int
    position: tuple[float, float, float]
    normal: tuple[float, float, float]
    distance: float
    force: float


@dataclass(frozen=True)
class Touch:
    """What one contact point does to a body, friction included.

    Attributes:
        link: Link index of the body.
        other: The other body's id in the physics client; -1 for soft matter.
        position: Point of contact on the other body in the world [m], shape [3].
        normal: Into the body, unit length, shape [3].
        force: Normal force on the body [N].
        friction: Friction on the body in the world [N], shape [3].
    """

    link: int
    other: int
    position: tuple[float, float, float]
    normal: tuple[float, float, float]
    force: float
    friction: tuple[float, float, float]


# Link of the body that is pressed, point of contact in the world [m], shape [3], and normal force [N].
Press = tuple[int, tuple[float, float, float], float]
