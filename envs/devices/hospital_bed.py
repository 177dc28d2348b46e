"""A hospital bed: height, backrest, knees and side rails."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping
from dataclasses import dataclass

from rcare_marl import assets
from rcare_marl.agents.avatar import AvatarConfig, body_model, load_posture
from rcare_marl.agents.body.posture import PostureConfig, pelvis_pose
from rcare_marl.agents.body.skeleton import SIDES
from rcare_marl.agents.human import Human
from rcare_marl.body import Body
from rcare_marl.config import load
from rcare_marl.errors import ConfigError
from rcare_marl.pose import Pose
from rcare_marl.urdf import Model, Shape, Triple
from rcare_marl.world import World

from .assembly import Assembly
from .bed_rest import HIPS, BedRest, Sections
from .device import DeviceControl, Frame
from .jointed_device import JointedDevice

_LEGS = ("hip_flexion", "knee_flexion")
_PLATFORM = 0.03  # thickness of the platform under the mattress [m]
_KNEE = 400.0  # torque under the thighs, and by which the calves follow [N·m]; own choice
_PELVIS = 0.07  # from the hips to the pelvis of an adult, towards the head [m]
_SINK = 0.014  # of a body in the mattress [m]; own choice
# Hands on the belly [deg]; own choice.
_ARMS = {
    "shoulder_abduction": 22.0, "shoulder_flexion": 2.0, "shoulder_external_rotation": -70.0,
    "elbow_flexion": 70.0, "elbow_pronation": 75.0,
}  # fmt: skip


@dataclass(frozen=True)
class HospitalBedConfig:
    """Dimensions of a bed [m, kg]; see `assets/devices/hospital_bed.yaml`."""

    source: str
    mattress_length: float
    mattress_width: float
    mattress_thickness: float
    low: float
    high: float
    sections: tuple[float, float, float, float]
    end: float
    board_height: float
    rail_drop: float
    backrest_deg: float
    knee_deg: float
    masses: dict[str, float]
    materials: dict[str, tuple[float, ...]]

    def __post_init__(self) -> None:
        if abs(sum(self.sections) - self.mattress_length) > 1e-6:
            raise ConfigError(f"the sections must add up to {self.mattress_length} m")
        if not 0.15 <= self.low < self.high:
            raise ConfigError("a platform moves up from 0.15 m or more")
        if not (0 < self.backrest_deg < 90 and 0 < self.knee_deg < 60):
            raise ConfigError("a backrest rises by less than 90 degrees, knees by less than 60")


class HospitalBed(JointedDevice):
    """A bed whose platform rises between its ends and bends in three places.

    x towards the feet, y to the left of who lies on the back, origin on the floor at the head end.

    Frames: `mattress` (where the pelvis of somebody lies who lies flat), `fold` (where backrest and
    seat meet), `pillow`, `rail_left`, `rail_right` (top bar), `side_left`, `side_right` (floor beside
    it, x towards the bed). Controls: `height` [m over the lowest], `backrest`, `knee` [rad],
    `rail_left`, `rail_right` (0 lowered, the upper limit raised).

    Nothing of the mattress yields; a person lies in the posture of `posture` and is moved with the
    sections by `raise_with`, who fits each part of their body to its section.
    """

    postures = {"lain": ("bed_supine", "mattress")}
    _on = {
        "mattress": "platform",
        "fold": "platform",
        "pillow": "backrest",
        "rail_left": "rail_left",
        "rail_right": "rail_right",
    }

    def __init__(self, config: HospitalBedConfig | None = None) -> None:
        """Make a bed of the dimensions in `config`; those of the data file if None."""
        self.config = config or load(HospitalBedConfig, assets.find("devices", "hospital_bed"))
        self._lying: tuple[AvatarConfig, BedRest] | None = None

    @property
    def frames(self) -> Mapping[str, Frame]:
        c = self.config
        top, fold = c.low + c.mattress_thickness, self._hinges()[0]
        side, rail = 0.5 * c.mattress_width, self._rail_y()
        out = {
            "mattress": Frame((fold + HIPS - _PELVIS, 0.0, top), note="under the pelvis"),
            "fold": Frame((fold, 0.0, top), note="where backrest and seat meet"),
            "pillow": Frame((c.end + 0.2, 0.0, top), note="under the head"),
        }
        for name, sign in (("left", 1), ("right", -1)):
            at = (fold, sign * rail, c.low + 0.34 - c.rail_drop)
            out[f"rail_{name}"] = Frame(at, note="top bar")
            out[f"side_{name}"] = Frame((fold, sign * (side + 0.45), 0.0), (0.0, 0.0, -90.0 * sign))
        return out

    @property
    def controls(self) -> Mapping[str, DeviceControl]:
        return {
            "height": DeviceControl("height", 0.03, 4000.0, "motor"),
            "backrest": DeviceControl("backrest", 0.05, 500.0, "motor"),
            "knee": DeviceControl("knee", 0.05, _KNEE, "motor; the calves follow"),
            "rail_left": DeviceControl("rail_left", 0.3, 60.0, "hand"),
            "rail_right": DeviceControl("rail_right", 0.3, 60.0, "hand"),
        }

    def mattress_height(self) -> float:
        """Return the present height of the top of the mattress [m]."""
        return self.config.low + self.config.mattress_thickness + self.position("height")

    def spawn(self, world: World, pose: Pose = Pose(), *, name: str = "") -> Body:
        body = super().spawn(world, pose, name=name)
        upper = math.radians(self.config.knee_deg)
        # Nearly a fixed ratio: the feet stay level to 5 mm.
        body.gear(
            body.joint("knee").index, body.joint("calf").index, self._calf(upper) / upper, _KNEE
        )
        return body

    def set_position(self, name: str, position: float) -> None:
        if name == "knee":
            bend = self._calf(min(max(position, 0.0), math.radians(self.config.knee_deg)))
            self.body.set_joints([self.body.joint("calf").index], [bend])
        super().set_position(name, position)

    def _calf(self, knee: float) -> float:
        """Return how far the calves are bent from the thighs that rise by `knee` [rad]."""
        _, _, thigh, calf = self.config.sections
        return knee + math.asin(thigh * math.sin(knee) / calf)

    def _hinges(self) -> tuple[float, float, float]:
        """Return x of the hinges of backrest, thighs and calves [m]."""
        back, seat, thigh, _ = self.config.sections
        first = self.config.end + back
        return first, first + seat, first + seat + thigh

    def _rail_y(self) -> float:
        return 0.5 * self.config.mattress_width + 0.035

    # ---- people

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
            _, seat, thigh, _ = self.config.sections
            lying = load_posture("bed_supine")
            lying = dataclasses.replace(lying, angles_deg=lying.angles_deg | _ARMS)
            sections = Sections(seat, thigh, self.config.mattress_thickness)
            self._lying = (avatar, BedRest(avatar, lying, sections, sink=_SINK))
        return self._lying[1]

    # ---- parts

    def model(self) -> Model:
        c = self.config
        made = Assembly("ends", 40.0)
        self._add_ends(made)
        self._hang_platform(made)
        back, thigh, calf = self._hinges()
        z, masses = c.low, c.masses
        backrest = made.hang(
            "backrest", "platform", masses["back"], at=(back, 0.0, z), axis=(0.0, 1.0, 0.0),
            upper=math.radians(c.backrest_deg), effort=500.0,
        )  # fmt: skip
        self._add_section(made, "backrest", c.end, back)
        backrest.visual.append(
            Shape(kind="box", material="linen", size=(0.4, 0.6, 0.07), bevel=0.03,
                  at=(c.end + 0.22, 0.0, z + c.mattress_thickness + 0.012))
        )  # fmt: skip
        upper = math.radians(c.knee_deg)
        made.hang("knee", "platform", masses["thigh"], at=(thigh, 0.0, z), axis=(0.0, -1.0, 0.0),
                  upper=upper, effort=_KNEE)  # fmt: skip
        self._add_section(made, "knee", thigh, calf)
        made.hang("calf", "knee", masses["calf"], at=(calf, 0.0, z), axis=(0.0, 1.0, 0.0),
                  upper=self._calf(upper), effort=_KNEE)  # fmt: skip
        self._add_section(made, "calf", calf, c.end + c.mattress_length)
        for name, sign in (("left", 1), ("right", -1)):
            self._hang_rail(made, name, sign)
        return made.model("hospital_bed", c.source, c.materials)

    def _add_ends(self, made: Assembly) -> None:
        """Add head end and foot end, which stand on the floor."""
        c, root = self.config, made.parts["ends"]
        half, length = 0.5 * c.mattress_width, c.mattress_length + 2 * c.end
        for x, inward, height in ((0.0, 1, c.board_height), (length, -1, c.board_height - 0.08)):
            middle = (x + 0.0125 * inward, 0.0, 0.5 * (0.3 + height))
            panel = (0.025, c.mattress_width + 0.02, height - 0.3)
            root.visual.append(
                Shape(kind="box", material="wood", at=middle, size=panel, bevel=0.01)
            )
            root.collision.append(Shape(kind="box", at=middle, size=panel))
            foot = (x + 0.055 * inward, 0.0, 0.12)
            size = (0.06, c.mattress_width, 0.04)
            root.visual.append(Shape(kind="box", material="frame", at=foot, size=size))
            root.collision.append(Shape(kind="box", at=foot, size=size))
            for sign in (1, -1):
                post = (x + 0.055 * inward, 0.3 * sign, 0.42)
                root.visual.append(
                    Shape(kind="box", material="frame", at=post, size=(0.05, 0.07, 0.62))
                )
                root.collision.append(Shape(kind="box", at=post, size=(0.05, 0.07, 0.62)))
                at = (x + 0.055 * inward, sign * (half - 0.06), 0.05)
                wheel = ((at[0], at[1] - 0.016, 0.05), (at[0], at[1] + 0.016, 0.05))
                root.visual += [
                    Shape(kind="cylinder", material="rubber", radius=0.05, points=wheel),
                    Shape(kind="box", material="steel", at=(at[0], at[1], 0.09),
                          size=(0.03, 0.05, 0.04)),
                ]  # fmt: skip
                root.collision.append(Shape(kind="sphere", radius=0.05, at=at))

    def _hang_platform(self, made: Assembly) -> None:
        c, z = self.config, self.config.low
        half, length = 0.5 * c.mattress_width, c.mattress_length
        part = made.hang(
            "platform", "ends", c.masses["frame"], kind="prismatic", at=(0.0, 0.0, z),
            axis=(0.0, 0.0, 1.0), upper=c.high - c.low, effort=4000.0, velocity=0.03, joint="height",
        )  # fmt: skip
        low = z - _PLATFORM - 0.02
        middle = c.end + 0.5 * length
        for sign in (1, -1):
            beam = (middle, sign * (half - 0.05), low)
            part.visual.append(
                Shape(kind="box", material="frame", at=beam, size=(length, 0.03, 0.04))
            )
            part.collision.append(Shape(kind="box", at=beam, size=(length, 0.03, 0.04)))
            for x in (c.end + 0.015, c.end + length - 0.015):  # guides of the rails
                guide: tuple[Triple, Triple] = (
                    (x, sign * self._rail_y(), z - 0.09),
                    (x, sign * self._rail_y(), z + 0.36),
                )
                part.visual.append(Shape(kind="tube", material="steel", radius=0.011, points=guide))
                arm = ((x, sign * (half - 0.05), low), (x, sign * self._rail_y(), low))
                part.visual.append(Shape(kind="tube", material="steel", radius=0.011, points=arm))
        for x in (c.end + 0.01, c.end + length - 0.01):
            cross = (x, 0.0, low)
            part.visual.append(
                Shape(kind="box", material="frame", at=cross, size=(0.04, c.mattress_width - 0.08, 0.04))
            )  # fmt: skip
        self._add_section(made, "platform", self._hinges()[0], self._hinges()[1])

    def _add_section(self, made: Assembly, link: str, start: float, end: float) -> None:
        """Add a piece of the mattress and of what carries it."""
        c, part, z = self.config, made.parts[link], self.config.low
        middle, size = 0.5 * (start + end), end - start
        soft = (size, c.mattress_width, c.mattress_thickness)
        at = (middle, 0.0, z + 0.5 * c.mattress_thickness)
        slab = Shape(kind="box", material="frame", at=(middle, 0.0, z - 0.5 * _PLATFORM),
                     size=(size - 0.01, c.mattress_width - 0.04, _PLATFORM))  # fmt: skip
        # Neighbours overlap a little, so that the mattress looks like one piece.
        part.visual += [
            Shape(
                kind="box", material="mattress", at=at, size=(size + 0.03, *soft[1:]), bevel=0.02
            ),
            slab,
        ]
        part.collision += [Shape(kind="box", at=at, size=soft), slab]

    def _hang_rail(self, made: Assembly, name: str, sign: int) -> None:
        c = self.config
        y, z = sign * self._rail_y(), c.low - c.rail_drop
        start, end = c.end + 0.015, c.end + c.mattress_length - 0.015
        part = made.hang(
            f"rail_{name}", "platform", c.masses["rail"], kind="prismatic", at=(0.0, y, z),
            axis=(0.0, 0.0, 1.0), upper=c.rail_drop, effort=60.0,
        )  # fmt: skip
        for height in (0.2, 0.32):
            at, size = (0.5 * (start + end), y, z + height), (end - start, 0.022, 0.07)
            part.visual.append(Shape(kind="box", material="rail", at=at, size=size, bevel=0.008))
            part.collision.append(Shape(kind="box", at=at, size=size))
        for x in (start + 0.5, 0.5 * (start + end), end - 0.5):
            bar = Shape(kind="box", material="rail", at=(x, y, z + 0.26), size=(0.04, 0.016, 0.12))
            part.visual.append(bar)


__all__ = ["HospitalBed", "HospitalBedConfig"]
