"""A patient lift on wheels: a boom raises a person in a sling, legs spread, and it is pushed."""

from __future__ import annotations

import math
from pathlib import Path

from rcare_marl.agents.people.human import Human
from rcare_marl.attachment import Attachment
from rcare_marl.body import Body
from rcare_marl.errors import ActionError
from rcare_marl.pose import Pose
from rcare_marl.world import GRAVITY, World

from .device_model import DeviceModel
from .dry_friction import DryFriction
from .lift import HINGES, Lift
from .telescope import Telescope

CHASSIS = "chassis"
ROLLING = ("roll_x", "roll_y", "roll_turn")


class FloorLift(Lift):
    """A floor lift: x forward along its legs, y left, origin on the floor in the middle of the base.

    Controls: `boom` (angle above the level; at 0 the bar hangs level with the mast's top) and `legs`
    (how far each leg is spread). It rolls where it is pushed, and stands when the brakes are on. A
    person who hangs in it faces the mast.

    Frames: those of the bar (`sling`, `bar`, `hook_left_front`, ...), which move with it, and
    `handle_left`, `handle_right` (of who pushes), `mast`.
    """

    _raises = "boom"
    _casters: DryFriction | None = None

    def __init__(self, source: str | Path | DeviceModel = "hoyer_lift_sling") -> None:
        """Make a lift.

        Args:
            source: `hoyer_lift_sling`, `hoyer_lift_transfer`, a YAML file, or a model.

        Raises:
            UnknownNameError: If there is no such lift.
        """
        super().__init__(source)
        self._is_braked = self._is_pushed = False

    @property
    def pose(self) -> Pose:
        """The present pose of the chassis in the world."""
        return self.body.link_pose(self.body.link_index(CHASSIS))

    @property
    def is_braked(self) -> bool:
        """Whether the casters are locked."""
        return self._is_braked

    def spawn(self, world: World, pose: Pose = Pose(), *, name: str = "") -> Body:
        body = super().spawn(world, pose, name=name)
        joints = body.joints
        # The right leg mirrors the left one: one pedal or motor spreads both.
        effort = 10 * self.model.joints["leg_left"].effort
        body.gear(joints["leg_left"].index, joints["leg_right"].index, 1.0, effort)
        length = self.model.figure("actuator_length")
        world.lines.append(Telescope(self, "actuator_foot", "actuator_rod", length=length))
        self._rolling, self._casters = body.indices(ROLLING), DryFriction(world, body)
        self.brake(False)
        return body

    def reset(self) -> None:
        """Hold boom and legs, take off the brakes, and let go of who is gone after a rewind."""
        super().reset()
        if self._casters is not None:
            self.brake(False)

    def set_position(self, name: str, position: float) -> None:
        """Put a control at `position` [rad] at once and hold it there; the bar hangs level."""
        super().set_position(name, position)
        if name == "boom":
            hinges = self.body.indices(HINGES)
            turn = self.body.joint_states(hinges)[0][2]
            self.body.set_joints(hinges, (self.position("boom"), 0.0, turn))
            self._settle()

    def push(self, forward: float, left: float = 0.0, turn: float = 0.0) -> None:
        """Push it at these speeds in its own frame [m/s, m/s, rad/s], until told otherwise.

        Its axes are those at the time of the call: call it each control step while it turns. With
        all at zero it is let go, and stands by the resistance of its casters. Braked, it stays.

        Raises:
            ActionError: If a speed is not finite.
            WorldError: If the lift is in no world.
        """
        body = self.body
        speeds = (float(forward), float(left), float(turn))
        if not all(map(math.isfinite, speeds)):
            raise ActionError(f"{body.name!r} needs finite speeds, got {speeds}")
        if self._is_braked or self._casters is None:
            return
        self._is_pushed = any(speeds)
        if not self._is_pushed:
            self._hold()
            return
        self._casters.let_go(self._rolling)
        heading = body.joint_states([self._rolling[2]])[0][0]
        c, s = math.cos(heading), math.sin(heading)
        wanted = [c * forward - s * left, s * forward + c * left, turn]
        force, torque = map(self.model.figure, ("push_force", "push_torque"))
        body.drive_velocities(self._rolling, wanted, [force, force, torque])

    def brake(self, on: bool) -> None:
        """Lock the casters, or unlock them; WorldError if the lift is in no world."""
        self._need_body()
        self._is_braked, self._is_pushed = on, False
        self._hold()

    def carry(self, person: Human, frame: str = "") -> Attachment:
        bond = super().carry(person, frame)
        if not self._is_pushed:
            self._hold()
        return bond

    def release(self) -> None:
        super().release()
        if not self._is_pushed:
            self._hold()

    def _hold(self) -> None:
        """Let the casters resist, by their brakes or by what they roll over."""
        f, person = self.model.figure, self.person
        mass = self.model.mass - self.model.links["sling"].mass
        weight = GRAVITY * (mass + (person.avatar.mass_kg if person is not None else 0.0))
        force = f("brake_force") if self._is_braked else f("rolling_resistance") * weight
        if self._casters is not None:
            forces = (force, force, f("turn_arm") * force)
            self._casters.hold(dict(zip(self._rolling, forces, strict=True)))
