"""A hospital bed: height, backrest, knees and side rails."""

from __future__ import annotations

import dataclasses
import math

from rcare_marl.agents.people.avatar import AvatarConfig, body_model, load_posture
from rcare_marl.agents.people.body.posture import PostureConfig, pelvis_pose
from rcare_marl.agents.people.body.skeleton import SIDES
from rcare_marl.agents.people.human import Human
from rcare_marl.agents.people.resting.support import Support, bed
from rcare_marl.body import Body
from rcare_marl.errors import ConfigError
from rcare_marl.pose import Pose
from rcare_marl.world import World

from .bed_rest import BedRest, Sections
from .device import Device

_LEGS = ("hip_flexion", "knee_flexion")
_SINK = 0.014  # of a body in the mattress [m]; own choice
# Hands on the belly [deg]; own choice.
_ARMS = {
    "shoulder_abduction": 22.0,
    "shoulder_flexion": 2.0,
    "shoulder_external_rotation": -70.0,
    "elbow_flexion": 70.0,
    "elbow_pronation": 75.0,
}


class HospitalBed(Device):
    """A bed whose platform rises between its ends and bends in three places.

    x towards the feet, y to the left of who lies on the back, origin on the floor at the head end.

    Frames: `mattress` (where the pelvis of somebody lies who lies flat), `fold` (where backrest and
    seat meet), `pillow`, `rail_left`, `rail_right` (top bar), `side_left`, `side_right` (floor beside
    it, x towards the bed). Controls: `height` [m over the lowest], `backrest`, `knee` [rad],
    `rail_left`, `rail_right` (0 lowered, the upper limit raised).

    Nothing of the mattress yields; a person lies in the posture of `posture` and is moved with the
    sections by `raise_with`, who fits each part of their body to its section.
    """

    def __init__(self) -> None:
        """Make a bed."""
        super().__init__("hospital_bed")
        figures = ("low", "mattress_thickness", "seat", "thigh", "calf")
        self._low, self._thick, self._seat, self._thigh, self._calves = map(
            self.model.figure, figures
        )
        self._lying: tuple[AvatarConfig, BedRest] | None = None

    def mattress_height(self) -> float:
        """Return the present height of the top of the mattress [m]."""
        return self._low + self._thick + self.position("height")

    def bears(self, mattress: str = "hospital_foam") -> Support:
        """Return what bears somebody in it now, for `Human.rest_on`, thighs and calves flat.

        Args:
            mattress: Of `assets/cushions`.
        """
        return bed(self.frame_in_world("fold"), mattress, math.degrees(self.position("backrest")))

    def spawn(self, world: World, pose: Pose = Pose(), *, name: str = "") -> Body:
        body = super().spawn(world, pose, name=name)
        knee = self.model.joints["knee"]
        ratio = self._calf(knee.upper) / knee.upper  # nearly fixed: the feet stay level to 5 mm
        body.gear(body.joint("knee").index, body.joint("calf").index, ratio, knee.effort)
        return body

    def set_position(self, name: str, position: float) -> None:
        if name == "knee":
            bend = self._calf(min(max(position, 0.0), self.model.joints["knee"].upper))
            self.body.set_joints([self.body.joint("calf").index], [bend])
        super().set_position(name, position)

    def _calf(self, knee: float) -> float:
        """Return how far the calves are bent from the thighs that rise by `knee` [rad]."""
        return knee + math.asin(self._thigh * math.sin(knee) / self._calves)

    def posture(
        self, avatar: AvatarConfig, *, backrest: float | None = None, knee: float | None = None
    ) -> PostureConfig:
        """Return how somebody lies on the bed bent as it is, or by these angles [rad].

        Hands lie on the belly, where no section of the bed comes upon them.
        """
        back = self.position("backrest") if backrest is None else backrest
        bent = self.position("knee") if knee is None else knee
        lying = load_posture("bed_supine")
        legs = self._rest_of(avatar).lie(back, bent, self._calf(bent))[1]
        degrees = {name: math.degrees(angle) for name, angle in legs.items()}
        return dataclasses.replace(
            lying,
            description=f"lying in bed, backrest raised by {math.degrees(back):.0f} degrees",
            recline_deg=90.0 - math.degrees(back),
            angles_deg=lying.angles_deg | _ARMS | degrees,
        )

    def support(self, person: Human) -> Pose:
        """Return where to spawn a person whose posture is that of `posture` at present."""
        model = body_model(person.avatar.body_path(), person.avatar.height_m)
        angles = person.posture.angles(person.avatar.profile.limits("passive"))
        alone = pelvis_pose(person.posture, model, angles, Pose())
        return self._pelvis(person.avatar)[0] @ alone.inverse()

    def raise_with(self, person: Human) -> None:
        """Put a person who lies here where the sections of the bed are now; to be called as it moves.

        They are put there, not pushed: pelvis, hips and knees follow without slip.

        Raises:
            ConfigError: If the person's hips and knees do not move.
        """
        dofs = [f"{side}_{name}" for side in SIDES for name in _LEGS]
        fixed = [dof for dof in dofs if dof not in person.movable]
        if fixed:
            raise ConfigError(
                f"{person.name!r} cannot be raised: {', '.join(fixed)} must be movable"
            )
        pelvis, angles = self._pelvis(person.avatar)
        person.place(pelvis)
        person.set_angles(angles)

    def _pelvis(self, avatar: AvatarConfig) -> tuple[Pose, dict[str, float]]:
        """Return where the pelvis of somebody lies in the world, and angles of hips and knees [rad]."""
        knee = self.position("knee")
        bends = (self.position("backrest"), knee, self._calf(knee))
        pelvis, angles = self._rest_of(avatar).lie(*bends)
        return self.frame_in_world("fold") @ pelvis, angles

    def _rest_of(self, avatar: AvatarConfig) -> BedRest:
        if self._lying is None or self._lying[0] is not avatar:
            lying = load_posture("bed_supine")
            lying = dataclasses.replace(lying, angles_deg=lying.angles_deg | _ARMS)
            sections = Sections(self._seat, self._thigh, self._thick)
            self._lying = (avatar, BedRest(avatar, lying, sections, sink=_SINK))
        return self._lying[1]
