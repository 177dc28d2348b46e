"""What floor lifts and ceiling lifts share: a spreader bar with a sling, and a person who hangs in it."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

from rcare_marl import assets
from rcare_marl.agents.people.human import Human
from rcare_marl.attachment import Attachment
from rcare_marl.body import Body
from rcare_marl.config import load
from rcare_marl.contact import Contact
from rcare_marl.errors import ConfigError, WorldError
from rcare_marl.pose import Pose, Vector
from rcare_marl.world import GRAVITY, World

from .device import Device
from .device_model import DeviceModel
from .dry_friction import DryFriction
from .sling import Sling, SlingConfig

BAR = "spreader_bar"
HINGES = ("bar_pitch", "bar_roll", "bar_turn")
_HOLD = 20.0  # the sling bears this many times the weight of who hangs in it; our own choice
# Of a person's weight: where something else bears as much, the sling is about to go slack; own choice.
_SLACK = 0.8


class Lift(Device):
    """A device that raises people in a sling on a spreader bar.

    The bar pitches and rolls as what hangs from it wants, and turns; friction stills it.

    Frames of the bar: `bar`, `sling` (where the seat and the reclined back of the sling meet, as
    `body.posture.pelvis_pose` wants it), `hook_left_front`, `hook_left_back`, and so on the right.

    Attributes:
        sling: What hangs on the bar.
        person: Who hangs in the sling, if anybody.
    """

    person: Human | None = None
    _raises: str  # the control that lowers the bar where it moves backwards
    _pivots: DryFriction | None = None

    def __init__(self, source: str | Path | DeviceModel) -> None:
        """Make the lift of that name or YAML file, with its sling; UnknownNameError if there is none."""
        super().__init__(source)
        self.sling = Sling(load(SlingConfig, assets.find("devices", self.model.sling)))

    @property
    def postures(self) -> Mapping[str, tuple[str, str]]:
        """How people rest in it: posture, frame."""
        return {"slung": (self.sling.config.posture, "sling")}

    @property
    def safe_load(self) -> float:
        """Greatest weight of a person [kg]."""
        return self.model.figure("load")

    @property
    def hooks(self) -> dict[str, Vector]:
        """Where the loops of the sling hang, in the frame of the bar [m]."""
        to_bar = self.model.link_pose(BAR).inverse()
        return {
            name: (to_bar @ frame.pose).position
            for name, frame in self.frames.items()
            if name.startswith("hook_")
        }

    def spawn(self, world: World, pose: Pose = Pose(), *, name: str = "") -> Body:
        body = super().spawn(world, pose, name=name)
        self._pivots = DryFriction(world, body)
        self.sling.hang(world, body, BAR, self.hooks)
        world.matter.append(SlackStop(world, self, self._raises))
        self._settle()
        return body

    def reset(self) -> None:
        """Hold every control, and let go of who is gone after a rewind."""
        super().reset()
        if self._bond is not None and not self._bond.is_active:  # the world was rewound
            self.release()
        self._settle()

    def _settle(self) -> None:
        """Set the friction of the bar's joints: motors do not return with a snapshot."""
        if self._pivots is not None:
            friction = self.model.figure(f"bar_friction{'' if self.person is None else '_laden'}")
            self._pivots.hold(dict.fromkeys(self.body.indices(HINGES), friction))

    def carry(self, person: Human, frame: str = "") -> Attachment:
        """Put the sling round a person, hang it on the bar as the person is now, and return the bond.

        The person is best in one of `postures`, at the frame named there. Lowered, the lift stops
        where a seat or bed bears the person: then `release` them.

        Args:
            person: Who; with a free pelvis.
            frame: They hang in the sling: it does not matter.

        Raises:
            WorldError: If somebody hangs there already, or the lift is in no world.
            ConfigError: If the pelvis is held in place, or the person is too heavy.
        """
        body, mass = self.body, person.avatar.mass_kg
        if self.person is not None:
            raise WorldError(f"{self.person.name!r} hangs in the sling already: release them first")
        if not person.body.is_movable:
            raise ConfigError(
                f"the pelvis of {person.name!r} is held in place: make them with fixed_base=False"
            )
        if mass > self.safe_load:
            raise ConfigError(
                f"{person.name!r} weighs {mass} kg, the lift bears {self.safe_load} kg"
            )
        self._bond = self._world.attach(body, BAR, person.body, force=_HOLD * GRAVITY * mass)
        self.person = person
        self.sling.drape(person)
        self._settle()
        return self._bond

    def release(self) -> None:
        """Take the loops off the hooks; nothing happens if nobody hangs there."""
        super().release()
        self.person = None
        self.sling.clear()
        self._settle()

    def load(self) -> float:
        """Return what the sling bears [N], at the last physics step."""
        return self._bond.load() if self._bond is not None else 0.0


class SlackStop:
    """Stops the lowering of a lift once a seat or bed bears the person, as push-only actuators do.

    The bond of the sling is stiff, and would press the person down. Heels that land hard stop it, too:
    told to go on, the lift tries again. Implements `rcare_marl.world.SteppedMatter`; it remembers nothing.
    """

    def __init__(self, world: World, lift: Lift, control: str) -> None:
        """Watch `control`, which lowers the bar where it moves backwards."""
        self._world, self._lift, self._control = world, lift, control
        self._joint = lift.body.joint(lift.controls[control].joint).index

    def step(self) -> None:
        """Look at the last physics step, and stop the control if need be."""
        person = self._lift.person
        if person is None or self._lift.body.joint_states([self._joint])[1][0] >= 0.0:
            return
        weight = GRAVITY * person.avatar.mass_kg
        if self._world.contact_force(person.body) >= _SLACK * weight:
            self._lift.stop(self._control)

    def contacts(self, a: Body, b: Body | None = None) -> list[Contact]:
        """Return nothing: it touches nobody."""
        return []

    def mark(self) -> None:
        """Remember nothing."""

    def rewind(self) -> None:
        """Forget nothing."""
