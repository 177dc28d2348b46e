"""The switch that stops a lift when what it lowers has come to rest."""

from __future__ import annotations

from rcare_marl.body import Body
from rcare_marl.world import GRAVITY, Contact, World

from .device import Device
from .spreader_bar import SpreaderBar

# Of a person's weight: where something else bears as much, the sling is about to go slack; own choice.
SHARE = 0.8


class SlackStop:
    """Stops the lowering of a lift once a seat or bed bears the person, as push-only actuators do.

    The bond of the sling is stiff, and would press the person down. Heels that land hard stop it, too:
    told to go on, the lift tries again. Implements `rcare_marl.world.SteppedMatter`; it remembers nothing.
    """

    def __init__(self, world: World, device: Device, control: str, bar: SpreaderBar) -> None:
        """Watch `control`, which lowers `bar` where it moves backwards."""
        self._world, self._device, self._control, self._bar = world, device, control, bar
        self._joint = device.body.joint(device.controls[control].joint).index

    def step(self) -> None:
        """Look at the last physics step, and stop the control if need be."""
        person = self._bar.person
        if person is None or self._device.body.joint_states([self._joint])[1][0] >= 0.0:
            return
        weight = GRAVITY * person.avatar.mass_kg
        if self._world.contact_force(person.body) >= SHARE * weight:
            self._device.stop(self._control)

    def contacts(self, a: Body, b: Body | None = None) -> list[Contact]:
        """Return nothing: it touches nobody."""
        return []

    def mark(self) -> None:
        """Remember nothing."""

    def rewind(self) -> None:
        """Forget nothing."""


__all__ = ["SHARE", "SlackStop"]
