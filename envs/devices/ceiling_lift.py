"""A ceiling lift: a motor on a track in the ceiling raises a person in a sling."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

from rcare_marl import assets, inertia
from rcare_marl.body import Body
from rcare_marl.config import load
from rcare_marl.errors import ConfigError
from rcare_marl.pose import Pose
from rcare_marl.urdf import Joint, Link, Model, Shape
from rcare_marl.world import GRAVITY, World

from .device import DeviceControl, Frame
from .lift import Lift
from .spreader_bar import LINK, BarConfig, SpreaderBar
from .telescope import Telescope

_UNIT = (0.36, 0.2, 0.17)  # edges of the motor unit [m]; our own choice
_BELOW = 0.02  # of the unit's top below the track [m]
_RAIL = 0.045  # edge of the wall rails of a room system [m]
_END = 0.03  # length of an end stop [m]
_EYE = 0.35  # mass of the buckle of the strap [kg]; our own choice
_BRIDGE = 2.4  # mass of a metre of track [kg/m]; extruded aluminium, from memory
_LIFT_MARGIN = 1.6  # of the safe load
_STRAP_COLOR = (0.14, 0.15, 0.17)


@dataclass(frozen=True)
class CeilingLiftConfig:
    """Figures of a ceiling lift [m]; see `assets/devices/ceiling_lift.yaml`."""

    source: str
    track_length: float
    span: float
    track_height: float
    track_width: float
    strap_length: float
    swing_deg: float
    unit_mass: float
    load: float
    lift_speed: float
    traverse_speed: float
    traverse_force: float
    bar: BarConfig
    sling: str
    materials: dict[str, tuple[float, ...]]

    def __post_init__(self) -> None:
        if self.track_length < _UNIT[0] + 0.2:
            raise ConfigError(f"a track of {self.track_length} m is too short for its motor")
        if self.span != 0.0 and self.span < 0.5:
            raise ConfigError(f"a span is 0, or at least 0.5 m wide, got {self.span}")
        if self.strap_length <= 0:
            raise ConfigError(f"the strap must have a length, got {self.strap_length} m")


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
        *,
        track_length: float | None = None,
        span: float | None = None,
        config: CeilingLiftConfig | None = None,
    ) -> None:
        """Make a lift.

        Args:
            track_length: Of the track, wall to wall or less [m]; that of the figures if None.
            span: Between the two wall rails across which the whole track rolls [m]; 0 for a track
                that stands still; that of the figures if None.
            config: Its figures; those of the data file if None.

        Raises:
            ConfigError: If the track is shorter than its motor.
        """
        made = config or load(CeilingLiftConfig, assets.find("devices", "ceiling_lift"))
        if track_length is not None:
            made = replace(made, track_length=track_length)
        if span is not None:
            made = replace(made, span=span)
        self.config = made
        super().__init__(SpreaderBar(replace(made.bar, swing_deg=made.swing_deg), made.sling))

    @property
    def safe_load(self) -> float:
        return self.config.load

    @property
    def controls(self) -> Mapping[str, DeviceControl]:
        c = self.config
        force = _LIFT_MARGIN * GRAVITY * c.load
        out = {
            "lift": DeviceControl("lift", c.lift_speed, force, "winds the strap"),
            "traverse": DeviceControl(
                "traverse", c.traverse_speed, c.traverse_force, "rolls the motor along the track"
            ),
        }
        if c.span:
            out["cross"] = DeviceControl(
                "cross", c.traverse_speed, c.traverse_force, "rolls the track along its wall rails"
            )
        return out

    @property
    def frames(self) -> Mapping[str, Frame]:
        c = self.config
        down = -self._hooks_below()
        out = {
            name: replace(f, position=(f.position[0], f.position[1], f.position[2] + down))
            for name, f in self.bar.frames.items()
        }
        half = 0.5 * c.track_length
        out["track_start"] = Frame((-half, 0.0, -c.track_height), note="lower side of its end")
        out["track_end"] = Frame((half, 0.0, -c.track_height), note="lower side of its end")
        return out

    def spawn(self, world: World, pose: Pose = Pose(), *, name: str = "") -> Body:
        body = super().spawn(world, pose, name=name)
        top, low = (0.0, 0.0, -_UNIT[2]), (0.0, 0.0, self.config.bar.drop - 0.04)
        world.lines.append(
            Telescope(
                body, ("motor", top), (LINK, low), length=0.01, radii=(0.012, 0.007),
                colors=(_STRAP_COLOR, _STRAP_COLOR),
            )
        )  # fmt: skip
        return body

    def model(self) -> Model:
        c = self.config
        links = {
            "ceiling": self._wall_rails() if c.span else Link(),
            "track": self._track(),
            "motor": self._motor(),
            "bar_eye": Link(_EYE, inertia=inertia.of_box(_EYE, (0.07, 0.07, 0.07))),
        }
        return Model(
            name="ceiling_lift",
            source=c.source,
            links=links | self.bar.links(),
            materials=c.materials,
            joints=self._joints(),
        )

    def _joints(self) -> dict[str, Joint]:
        c = self.config
        low = -self._rails_below()
        way = 0.5 * (c.track_length - _UNIT[0]) - _END
        push, speed = c.traverse_force, c.traverse_speed
        if c.span:
            # The track spans the rails along x and rolls along them, to the left and the right.
            aside = 0.5 * c.span - 0.5 * c.track_width - _END
            track = Joint(
                "prismatic", "ceiling", "track", (0.0, 0.0, low), axis=(0.0, 1.0, 0.0),
                lower=-aside, upper=aside, effort=push, velocity=speed,
            )  # fmt: skip
        else:
            track = Joint("fixed", "ceiling", "track", (0.0, 0.0, low))
        lift = Joint(
            "prismatic", "bar_yoke", "bar_eye", lower=-c.strap_length, upper=0.0,
            effort=self.controls["lift"].force, velocity=c.lift_speed,
        )  # fmt: skip
        pivot = (0.0, 0.0, -_UNIT[2])
        return {
            "cross": track,
            "traverse": Joint(
                "prismatic", "track", "motor", (0.0, 0.0, -c.track_height - _BELOW),
                axis=(1.0, 0.0, 0.0), lower=-way, upper=way, effort=push, velocity=speed,
            ),
            **self.bar.joints("motor", pivot, strap=lift),
        }  # fmt: skip

    def _rails_below(self) -> float:
        """Return how far the top of the track is below the ceiling [m]."""
        return _RAIL if self.config.span else 0.0

    def _hooks_below(self) -> float:
        """Return how far the hooks are below the ceiling when the strap is wound up [m]."""
        c = self.config
        return self._rails_below() + c.track_height + _BELOW + _UNIT[2] + c.bar.drop

    def _track(self) -> Link:
        c = self.config
        size = (c.track_length, c.track_width, c.track_height)
        at = (0.0, 0.0, -0.5 * c.track_height)
        visual = [
            Shape(kind="box", material="frame", at=at, size=size),
            Shape(kind="box", material="dark", at=(0.0, 0.0, -c.track_height - 0.0005),
                  size=(c.track_length - 0.02, 0.012, 0.001)),
        ]  # fmt: skip
        for sign in (1, -1):
            stop = (sign * (0.5 * c.track_length - 0.5 * _END), 0.0, -0.5 * c.track_height - 0.004)
            visual.append(
                Shape(kind="box", material="dark", at=stop, bevel=0.006,
                      size=(_END, c.track_width + 0.008, c.track_height + 0.008))
            )  # fmt: skip
            if not c.span:  # plates that hold it to the ceiling
                plate = (sign * (0.5 * c.track_length - 0.25), 0.0, -0.004)
                visual.append(
                    Shape(kind="box", material="steel", at=plate, size=(0.08, 0.13, 0.008))
                )
        mass = _BRIDGE * c.track_length
        return Link(
            mass, at, inertia.of_box(mass, size), tuple(visual),
            (Shape(kind="box", at=at, size=size),),
        )  # fmt: skip

    def _wall_rails(self) -> Link:
        """Return the two rails along y, at the ends of the track, on which it rolls."""
        c = self.config
        rails = [
            Shape(
                kind="box", material="frame", size=(_RAIL, c.span, _RAIL),
                at=(sign * (0.5 * c.track_length - 0.5 * _RAIL), 0.0, -0.5 * _RAIL),
            )
            for sign in (1, -1)
        ]  # fmt: skip
        return Link(visual=tuple(rails), collision=tuple(rails))

    def _motor(self) -> Link:
        c = self.config
        middle = (0.0, 0.0, -0.5 * _UNIT[2])
        rollers = [
            Shape(kind="box", material="dark", at=(x, 0.0, 0.5 * _BELOW), size=(0.05, 0.03, 0.03))
            for x in (-0.1, 0.1)
        ]
        visual = (
            Shape(kind="box", material="frame", at=middle, size=_UNIT, bevel=0.04),
            Shape(kind="box", material="accent", at=(0.0, 0.0, -0.62 * _UNIT[2]),
                  size=(_UNIT[0] + 0.003, _UNIT[1] + 0.003, 0.02), bevel=0.009),
            Shape(kind="box", material="dark", at=(0.0, 0.0, -_UNIT[2] - 0.004),
                  size=(0.1, 0.06, 0.02), bevel=0.006),
            *rollers,
        )  # fmt: skip
        solid = Shape(kind="box", at=middle, size=_UNIT)
        return Link(c.unit_mass, middle, inertia.of_box(c.unit_mass, _UNIT), visual, (solid,))


__all__ = ["CeilingLift", "CeilingLiftConfig"]
