"""A ceiling lift: a motor on a track in the ceiling raises a person in a sling."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

from rcare_marl.body import Body
from rcare_marl.errors import ConfigError
from rcare_marl.model.shape import Shape
from rcare_marl.model.urdf import Joint, Link
from rcare_marl.pose import Pose
from rcare_marl.world import World

from .device_model import DeviceModel
from .lift import Lift
from .telescope import Telescope
from .weight import weighed

_RAIL = 0.045  # edge of the wall rails of a room system [m]
_END = 0.03  # length of an end stop [m]
_LEAST_WAY, _LEAST_SPAN = 0.2, 0.5  # [m], of the motor on its track, and between wall rails
_STRAP_COLOR = (0.14, 0.15, 0.17)


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
