"""Arms and legs of a person who is washed: eight limbs, of which each knows what was wiped."""

from __future__ import annotations

from collections.abc import Iterable

from rcare_marl.agents.people.body.skeleton import SIDES
from rcare_marl.agents.people.human import Human
from rcare_marl.pose import Array
from rcare_marl.world import World

from ..scenes.wiped_skin import WipedSkin, pad

# Joint a limb moves with, joint at its far end, from where on it is bare. Sleeves and trousers are short.
LIMBS = (
    ("shoulder", "elbow", 0.04),
    ("elbow", "wrist", -1.0),
    ("hip", "knee", 0.2),
    ("knee", "ankle", -1.0),
)  # our own choice


class WashedLimbs:
    """The upper sides of arms and legs of somebody who lies on the back.

    Attributes:
        limbs: The skin of each limb, by the SMPL-X joint that it moves with.
    """

    def __init__(self, person: Human, world: World) -> None:
        """Bare arms and legs of a person as they are now, and let them yield to soft matter as flesh.

        Raises:
            ConfigError: If a limb has simulated flesh or is not one rigid capsule.
        """
        self.limbs = {
            f"{side}_{joint}": WipedSkin(
                person, world, f"{side}_{joint}", f"{side}_{end}", bare=bare, like=f"{side}_wrist"
            )
            for side in SIDES
            for joint, end, bare in LIMBS
        }
        pad(person, world, list(self.limbs))
        areas = {joint: limb.area for joint, limb in self.limbs.items()}
        self._shares = {joint: area / sum(areas.values()) for joint, area in areas.items()}

    def reset(self) -> None:
        """Let all of them be dry and unwiped, where they are now."""
        for limb in self.limbs.values():
            limb.follow()
            limb.reset()

    def follow(self) -> None:
        """Take the limbs to be where they are now."""
        for limb in self.limbs.values():
            limb.follow()

    @property
    def coverage(self) -> float:
        """Share of the area to be wiped that was."""
        return sum(share * self.limbs[joint].coverage for joint, share in self._shares.items())

    def coverages(self) -> list[float]:
        """Return the share of each limb that was wiped, in their order."""
        return [limb.coverage for limb in self.limbs.values()]

    def wipe(self, touched: Iterable[str], points: Array, duration: float) -> None:
        """Wipe with points of something wet.

        Args:
            touched: SMPL-X joints of the segments that it presses on.
            points: Points of its face in the world [m], shape [n, 3].
            duration: How long [s].
        """
        for joint in touched:
            if joint in self.limbs:
                self.limbs[joint].wipe(points, duration)
