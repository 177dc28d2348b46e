"""The bathing challenge's scene: a bed, over it a table with sponge and basin, and limbs to be washed."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterable

import numpy as np

from rcare_marl.agents.people.body.skeleton import SIDES
from rcare_marl.agents.people.human import Human
from rcare_marl.body import Body
from rcare_marl.errors import ConfigError
from rcare_marl.pose import Array, Pose, about_z, quaternion_from_matrix
from rcare_marl.separation import box_of
from rcare_marl.world import World

from ..devices import Device, HospitalBed, Sponge, WashBasin, lay_under, move_under
from ..scenes.wiped_skin import WipedSkin, pad

# Of the challenge's scene, as read from its player of October 2024 (docs/phyrc.md):
PERSON_SPREAD = 0.10  # [m] along and across, uniform each way
JOINT_SPREAD = math.radians(15)  # of shoulder, hip and elbow, uniform each way
# Our own choices.
BED_RAISE = 0.17  # [m] of the platform over its lowest, less for who else comes up to the table
TOP, CLEAR = 0.022, 0.01  # [m] thickness of the table's top, and between it and who lies under it
TABLE_AT, TABLE_OVER = (-0.38, 0.08), 0.31  # [m] middle of the top, its height over the mattress
SPONGE_Y, BASIN_Y = -0.34, -0.08  # [m] from the middle of the table
DEPTH_SHARE = 0.8  # of the sponge that a hand over the rim puts under water
# How far a limb is laid towards the body at most: it is not laid into trunk or other leg.
INWARD = {"shoulder_abduction": math.radians(8), "hip_abduction": math.radians(5)}
# Long side across the bed, face down, so that a hand from the side or from above takes the sponge.
FACE_DOWN = quaternion_from_matrix(np.array(((0.0, 1.0, 0.0), (1.0, 0.0, 0.0), (0.0, 0.0, -1.0))))
# Joint a washed limb moves with, joint at its far end, from where it is bare: sleeves and trousers are short.
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
        self.follow()
        for limb in self.limbs.values():
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


class BathScene:
    """What stands and lies about a person who is bathed in bed; the bed has its head at +x.

    Attributes:
        bed: The bed.
        table: The table over the legs.
        sponge: What is washed with.
        basin: Where the water is.
        sponge_at: Pose of the sponge as it lies at the start.
        basin_at: Pose of the basin at the start.
    """

    def __init__(self, world: World) -> None:
        """Put everything into the world."""
        self.bed = HospitalBed()
        half = 0.5 * self.bed.model.figure("mattress_length") + self.bed.model.figure("end")
        # Mounts beside a bed have its head at +x.
        self.bed.spawn(world, Pose((half, 0.0, 0.0), about_z(math.pi)))
        self.bed.set_position("height", BED_RAISE)
        height, (x, y) = self.bed.mattress_height() + TABLE_OVER, TABLE_AT
        self.table = Device("overbed_table", fixed={"height": height})
        self.table.spawn(world, Pose((x, y, 0.0)))
        self.basin, self.basin_at = WashBasin(), Pose((x, y + BASIN_Y, height))
        self.basin.spawn(world, self.basin_at)
        self.sponge = Sponge()
        self._face = self.sponge.frame("face").position[2]
        self.sponge_at = self.over((x, y + SPONGE_Y, height))
        self.sponge.spawn(world, self.sponge_at)
        for body in (self.bed.body, self.basin.body):
            world.sleeping.add(body)
        self._cushions: dict[str, Body] = {}

    def lower(self, person: Human) -> None:
        """Lower the bed so far that a person fits under the table, wherever they are laid.

        Raises:
            ConfigError: If the bed does not go so far down.
        """
        body, half = person.body, 0.5 * self.table.model.figure("depth") + PERSON_SPREAD
        shapes = [
            (link, shape) for link in body.solid_links() for shape in body.collision_shapes(link)
        ]
        boxes = np.array(
            [box_of(shape, body.link_pose(link) @ shape.pose) for link, shape in shapes]
        )
        is_under = (boxes[:, 0] < TABLE_AT[0] + half) & (boxes[:, 3] > TABLE_AT[0] - half)
        under = self.table.frame_in_world("top").position[2] - TOP - CLEAR
        self._lowered = max(float(boxes[is_under, 5].max(initial=under)) - under, 0.0)
        if self._lowered > BED_RAISE:
            raise ConfigError(
                f"{person.name!r} does not fit under the table over the bed: "
                f"{100 * (self._lowered - BED_RAISE):.0f} cm are lacking"
            )
        self.bed.set_position("height", BED_RAISE - self._lowered)
        person.place(self._lying(person, np.zeros(2)))

    def _lying(self, person: Human, shift: Array) -> Pose:
        """Return where the pelvis of a person is, who was spawned on the raised bed, shifted by [m], [2]."""
        x, y, z = person.pelvis.position
        return Pose((x + shift[0], y + shift[1], z - self._lowered), person.pelvis.quaternion)

    def lay_cushions(self, person: Human, limbs: WashedLimbs, world: World) -> None:
        """Lay a cushion under each arm of a person."""
        for side in SIDES:
            skin = limbs.limbs[f"{side}_shoulder"]
            under = float(min(skin.place(share, math.pi)[0][2] for share in (0.5, 0.9)))
            base = self.bed.mattress_height()
            made = lay_under(world, person, side, base=base, under=under)
            if made is not None:
                self._cushions[side] = made

    def lay_person(self, person: Human, rng: np.random.Generator) -> None:
        """Lay a person, who lies in the posture of the start, somewhere else, and cushions under them."""
        shift = rng.uniform(-PERSON_SPREAD, PERSON_SPREAD, 2)
        turns = rng.uniform(-JOINT_SPREAD, JOINT_SPREAD, (3, 2))
        person.place(self._lying(person, shift))
        dofs = ("shoulder_abduction", "hip_abduction", "elbow_flexion")
        for (i, dof), (k, side) in itertools.product(enumerate(dofs), enumerate(SIDES)):
            name = f"{side}_{dof}"
            if name in person.movable:
                turn = max(float(turns[i, k]), -INWARD.get(dof, math.inf))
                person.set_angles({name: person.angle(name) + turn}, laid=True)
        for side, cushion in self._cushions.items():
            move_under(cushion, person, side)

    def over(self, face: Array | tuple[float, float, float]) -> Pose:
        """Return the pose of a sponge that faces down, with its face at a place [m], shape [3]."""
        x, y, z = (float(value) for value in face)
        return Pose((x, y, z + self._face), tuple(FACE_DOWN.tolist()))

    def dipped(self) -> Pose:
        """Return a pose of the sponge with most of it in the water, and its handle over the rim."""
        depth = DEPTH_SHARE * self.sponge.block.size[2]
        return self.over(np.subtract(self.water(), (0.0, 0.0, depth)))

    def water(self) -> tuple[float, ...]:
        """Return the middle of the surface of the water in the world [m], shape [3]."""
        return self.basin.frame_in_world("water").position

    def edge(self) -> float:
        """Return where the table ends towards the head of the bed, along x [m]."""
        return TABLE_AT[0] + 0.5 * self.table.model.figure("depth")
