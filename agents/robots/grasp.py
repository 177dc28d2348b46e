"""What a robot holds: bonds between its tool and things, which last until the gripper opens."""

from __future__ import annotations

from rcare_marl.attachment import Attachment
from rcare_marl.body import Body
from rcare_marl.pose import Pose
from rcare_marl.world import World

from .gripper import Gripper

RELEASE = 0.01  # [m] that the gap of a gripper grows before it lets go; our own choice


class Grasp:
    """The bonds of one tool. Their state is in the world, and comes back with it."""

    def __init__(self, world: World, body: Body, tool_link: str, gripper: Gripper | None) -> None:
        self._world, self._body, self._tool_link = world, body, tool_link
        self._gripper = gripper
        self._held: list[Attachment] = []

    def take(self, thing: Body, pose: Pose, thing_in_tool: Pose, *, force: float) -> Attachment:
        """Put the base of `thing` at `pose` in the world and bond it to the tool.

        The robot and what it holds do not collide from then on.

        Args:
            thing: What to hold.
            pose: Where its base goes.
            thing_in_tool: The same place in the frame of the tool.
            force: Greatest force of the bond [N].
        """
        thing.set_base(pose)
        self._world.set_collision(self._body, thing, False)
        held = self._world.attach(self._body, self._tool_link, thing, thing_in_tool, force=force)
        gripper = self._gripper
        if gripper is not None and gripper.is_movable:
            self._least_closing = gripper.least_closing(gripper.start, RELEASE)
            self._held.append(held)
        return held

    def update(self) -> None:
        """Let go of everything if the gripper has opened too far to hold it."""
        if not self._held or self._gripper is None:
            return
        if self._gripper.closing() < self._least_closing:
            for held in self._held:
                self._world.detach(held)
