"""Floor lifts and ceiling lifts: a spreader bar with a sling, and a person who hangs in it."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np
import numpy.typing as npt

from rcare_marl import assets
from rcare_marl.agents.people.human import Human
from rcare_marl.attachment import Attachment
from rcare_marl.body import Body
from rcare_marl.config import load
from rcare_marl.contact import Contact
from rcare_marl.errors import ActionError, ConfigError, WorldError
from rcare_marl.model.shape import Shape, Triple
from rcare_marl.model.urdf import Joint, Link
from rcare_marl.pose import Pose, Vector
from rcare_marl.world import GRAVITY, World

from .device import Device, DryFriction
from .device_model import DeviceModel, weighed
from .sling import Sling, SlingConfig

BAR = "spreader_bar"
HINGES = ("bar_pitch", "bar_roll", "bar_turn")
_HOLD = 20.0  # the sling bears this many times the weight of who hangs in it; our own choice
# Of a person's weight: where something else bears as much, the sling is about to go slack; own choice.
_SLACK = 0.8
CHASSIS = "chassis"
ROLLING = ("roll_x", "roll_y", "roll_turn")
_RAIL = 0.045  # edge of the wall rails of a room system [m]
_END = 0.03  # length of an end stop [m]
_LEAST_WAY, _LEAST_SPAN = 0.2, 0.5  # [m], of the motor on its track, and between wall rails
_STRAP_COLOR = (0.14, 0.15, 0.17)


class Telescope:
    """A cylinder and its rod, between two frames of a device: implements `rcare_marl.world.Lines`.

    It lengthens and turns with them; the joint that it works does the pushing.

    Attributes:
        starts: First point of each line, and the end of the last, shape [3].
        radii: Radius at each point [m], shape [4].
    """

    def __init__(
        self,
        device: Device,
        low: str,
        high: str,
        *,
        length: float,
        radii: tuple[float, float] = (0.026, 0.013),
        colors: tuple[Triple, Triple] = ((0.2, 0.21, 0.23), (0.72, 0.73, 0.75)),
    ) -> None:
        """Prepare it.

        Args:
            device: What it is part of.
            low: Frame where the cylinder begins.
            high: Frame where the rod ends.
            length: Of the cylinder [m].
            radii: Of cylinder and rod [m].
            colors: Of cylinder and rod, red, green, blue, each in [0, 1].
        """
        self._device, self._ends, self._length = device, (low, high), length
        self.starts = np.array((0, 2, 4), np.int64)
        self.radii = np.repeat(np.array(radii, np.float32), 2)
        self._colors = np.repeat(np.round(255 * np.array(colors)).astype(np.uint8), 2, axis=0)

    def points(self) -> npt.NDArray[np.float32]:
        """Return where it is in the world [m], shape [4, 3]."""
        low, high = (np.array(self._device.frame_in_world(end).position) for end in self._ends)
        top = low + (high - low) * min(1.0, self._length / float(np.linalg.norm(high - low)))
        return np.array((low, top, low, high), np.float32)

    def colors(self) -> npt.NDArray[np.uint8]:
        """Return the colour of each point, shape [4, 3]."""
        return self._colors


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


class CeilingLift(Lift):
    """A ceiling lift: x along the track, y left, origin in its middle at the ceiling.

    Controls: `lift` (height of the bar against where it is wound up, at rest: 0 down to the negative
    of the strap's length), `traverse` (along the track), and `cross` (of the track
    along its wall rails) where it has a span. The person looks along the track.

    Frames: those of the bar (`sling`, `bar`, `hook_left_front`, ...), which move with it, and
    `track_start`, `track_end`.
    """

    _raises = "lift"

    def __init__(
        self,
        source: str | Path | DeviceModel = "ceiling_lift",
        *,
        track_length: float | None = None,
        span: float = 0.0,
    ) -> None:
        """Make a lift.

        Args:
            source: A name in `assets/devices`, a YAML file, or a model; its track stands still.
            track_length: Of the track, wall to wall or less [m]; that of the data if None.
            span: Between the two wall rails across which the whole track rolls [m]; 0 for a track
                that stands still.

        Raises:
            ConfigError: If the track is shorter than its motor, or the span too narrow.
        """
        super().__init__(source)
        if track_length is not None:
            if track_length < self.model.links["motor"].collision[0].size[0] + _LEAST_WAY:
                raise ConfigError(f"a track of {track_length} m is too short for its motor")
            self.model = _with_track(self.model, track_length)
        if span:
            if span < _LEAST_SPAN:
                raise ConfigError(f"a span is 0, or at least {_LEAST_SPAN} m wide, got {span}")
            self.model = _on_rails(self.model, span)

    def spawn(self, world: World, pose: Pose = Pose(), *, name: str = "") -> Body:
        body = super().spawn(world, pose, name=name)
        strap = Telescope(
            self,
            "strap_start",
            "strap_end",
            length=0.01,
            radii=(0.012, 0.007),
            colors=(_STRAP_COLOR, _STRAP_COLOR),
        )
        world.lines.append(strap)
        return body


def _with_track(model: DeviceModel, length: float) -> DeviceModel:
    """Return a lift with a track of another length [m]."""
    old = model.links["track"].collision[0].size[0]
    half = 0.5 * (length - old)

    def fit(shape: Shape) -> Shape:
        """What is at an end goes with it; what is in the middle lengthens."""
        x, y, z = shape.at
        if x:
            return replace(shape, at=(x + half * math.copysign(1.0, x), y, z))
        return replace(shape, size=(shape.size[0] + 2 * half, *shape.size[1:]))

    links, frames = dict(model.links), dict(model.frames)
    for name in ("track", "plates"):
        link = links[name]
        visual, collision = (tuple(map(fit, s)) for s in (link.visual, link.collision))
        mass = link.mass * length / old
        links[name] = replace(link, visual=visual, collision=collision, mass=mass)
    links["track"] = weighed(links["track"])
    for name, sign in (("track_start", -1), ("track_end", 1)):
        _, y, z = frames[name].position
        frames[name] = replace(frames[name], position=(0.5 * sign * length, y, z))
    way = model.joints["traverse"]
    way = replace(way, lower=way.lower - half, upper=way.upper + half)
    return replace(model, links=links, frames=frames, joints=model.joints | {"traverse": way})


def _on_rails(model: DeviceModel, span: float) -> DeviceModel:
    """Return a lift whose track rolls along y on two wall rails at its ends, `span` long [m]."""
    length, width, _ = model.links["track"].collision[0].size
    ends = ((sign * 0.5 * (length - _RAIL), 0.0, -0.5 * _RAIL) for sign in (1, -1))
    rails = tuple(Shape("box", "frame", at, size=(_RAIL, span, _RAIL)) for at in ends)
    motor, aside = model.controls["traverse"], 0.5 * (span - width) - _END
    cross = Joint(
        "prismatic",
        "ceiling",
        "track",
        (0.0, 0.0, -_RAIL),
        axis=(0.0, 1.0, 0.0),
        lower=-aside,
        upper=aside,
        effort=motor.force,
        velocity=motor.speed,
    )
    control = replace(motor, joint="cross", note="rolls the track along its wall rails")

    model = model.without(["plates"])
    places = {name: frame.position for name, frame in model.frames.items()}
    lowered = {k: (x, y, z - _RAIL) for k, (x, y, z) in places.items()}
    return replace(
        model.with_frames(lowered),
        links=model.links | {"ceiling": Link(visual=rails, collision=rails)},
        joints=model.joints | {"cross": cross},
        controls=model.controls | {"cross": control},
    )
