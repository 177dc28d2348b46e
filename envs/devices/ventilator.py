"""A portable ventilator on a wheelchair, whose tube goes to the throat of who sits there."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from rcare_marl.agents.people.body.skeleton import JOINT_INDEX
from rcare_marl.agents.people.human import Human
from rcare_marl.model.shape import Shape
from rcare_marl.pose import Array, Pose, rotate
from rcare_marl.world import World

from .device import Device
from .wheelchair import SIDES, Wheelchair

# [m], all our own choices.
BEHIND = (-0.16, 0.0, -0.33)  # from the middle of the backrest's face
OVER_SHOULDER, BEFORE_THROAT = 0.05, 0.04
THROAT_UP = -0.045  # of the opening over the joint of the neck, which lies high


class Ventilator(Device):
    """A ventilator: x forward, y left, origin under the middle of the machine.

    The machine is solid. The tube is for the eye: a real one gives way, to robots and to people, and
    so it never keeps a spoon from the mouth.

    Frames: `outlet`, where the tube begins.
    """

    def __init__(self, source: str = "ventilator") -> None:
        """Make the ventilator of that name or YAML file; UnknownNameError if it lacks `tube_radius`."""
        super().__init__(source)
        self._radius = self.model.figure("tube_radius")

    def lead_tube(self, path: Sequence[Array]) -> None:
        """Lead the tube from the outlet through points in its frame [m], before `spawn`."""
        points = [self.frame("outlet").position, *(tuple(point.tolist()) for point in path)]
        root = self.model.root
        tube = Shape("tube", "tube", radius=self._radius, bend=0.05, points=tuple(points))
        collar = Shape("sphere", "shell", points[-1], radius=1.4 * self._radius)
        link = self.model.links[root]
        self.model = self.model.with_shapes(root, [*link.visual, tube, collar], link.collision)


def throat(person: Human) -> Array:
    """Return where a tracheostomy opens, in front of the lower end of the neck, in the world [m]."""
    model, neck = person.model, JOINT_INDEX["neck"]
    at = model.vertices - model.joints[neck]
    is_front = (np.abs(at[:, 0]) < 0.02) & (np.abs(at[:, 1] - THROAT_UP) < 0.02)
    local = np.array((0.0, THROAT_UP, float(at[is_front, 2].max())))
    pose = person.joint_pose("neck")
    return rotate(pose.quaternion, local) + pose.position


def hang_ventilator(
    world: World, chair: Wheelchair, person: Human, *, side: str = "left"
) -> Ventilator:
    """Add a ventilator behind the backrest of a chair, with its tube over one shoulder to a throat.

    Args:
        world: Where both are.
        chair: The chair.
        person: Who sits in it, spawned; they pass through the ventilator.
        side: Of the shoulder, `left` or `right`.
    """
    device, sign = Ventilator(), SIDES[side]
    place = Pose(tuple(np.add(chair.frame("backrest").position, BEHIND).tolist()))
    there = chair.pose @ place
    neck, shoulder = (
        np.array(person.joint_pose(joint).position) for joint in ("neck", f"{side}_shoulder")
    )
    ahead = rotate(chair.pose.quaternion, (1.0, 0.0, 0.0))
    aside = rotate(chair.pose.quaternion, (0.0, float(sign), 0.0))
    over, end = 0.45 * neck + 0.55 * shoulder, throat(person)
    over[2] = 0.5 * (neck[2] + shoulder[2]) + OVER_SHOULDER
    behind = over - 0.16 * ahead
    before = end + BEFORE_THROAT * (ahead + aside) - (0.0, 0.0, 0.01)
    back = there.inverse()
    way = [behind - (0.0, 0.0, 0.12), behind, over, over + 0.09 * ahead, before, end]
    device.lead_tube([rotate(back.quaternion, p) + back.position for p in way])
    device.spawn(world, there)
    person.ignore(device.body)
    return device
