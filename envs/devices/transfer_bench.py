"""A transfer bench that spans the rim of a bathtub, with a seat that slides across it."""

from __future__ import annotations

from rcare_marl.body import Body
from rcare_marl.errors import ConfigError
from rcare_marl.pose import Pose, Vector
from rcare_marl.world import World

from .device import Device

_CLEAR = 0.02  # [m], of soles over the floor; own choice


class TransferBench(Device):
    """A bench that stands by itself: x where the sitter looks, y into the tub, origin on the floor.

    Frames: `seat_back` (where seat and backrest meet), `seat` (middle of its surface), `handle_slide`.
    Controls: one for each leg [m over its shortest]. The seat slides freely, joint `slide`, from
    outside (0) over the tub.
    """

    def __init__(self, *, seat_height: float = 0.48) -> None:
        """Make a bench whose seat is `seat_height` over the floor on which it is put [m].

        Raises:
            ConfigError: If the legs cannot reach `seat_height`.
        """
        super().__init__("transfer_bench")
        self.seat_height = seat_height
        self._leg(seat_height)

    def fit_legs(self, left: Vector, right: Vector) -> None:
        """Choose the height of the seat, before `spawn`, so that a person's soles come to the floor.

        As near to it as the legs reach; never under it.

        Args:
            left: Middle of the left sole in the bench's frame [m], for the person on `seat_back`.
            right: That of the right sole.
        """
        low, high = self._reach()
        self.seat_height = min(max(low - min(float(left[2]), float(right[2])) + _CLEAR, low), high)

    def _reach(self) -> tuple[float, float]:
        """Return the least and the greatest height of the seat [m]."""
        low = self.model.figure("seat_low")
        return low, low + self.model.joints["leg_front_inside"].upper

    def _leg(self, length: float) -> float:
        """Return how far a leg is out under a seat `length` above its foot [m]."""
        low, high = self._reach()
        if not low - 1e-9 <= length <= high + 1e-9:
            raise ConfigError(f"the legs reach from {low} to {high:.2f} m, not {length} m")
        return length - low

    def spawn(self, world: World, pose: Pose = Pose(), *, name: str = "") -> Body:
        # The base hangs above the feet, whose floor is that of `pose`: legs first, then down.
        lifted = pose @ Pose((0.0, 0.0, self._leg(self.seat_height)))
        body = super().spawn(world, lifted, name=name)
        self.stand(self.seat_height)
        body.set_damping()
        return body

    def stand(self, seat_height: float, *, tub_floor: float = 0.0) -> None:
        """Set the legs at once so that the seat is level on a floor and on that of a bathtub.

        Args:
            seat_height: Over the floor [m].
            tub_floor: Height of the floor of the tub over the other [m].

        Raises:
            ConfigError: If the legs cannot reach.
        """
        for leg in self.controls:
            below = tub_floor if leg.endswith("inside") else 0.0
            self.set_position(leg, self._leg(seat_height - below))
