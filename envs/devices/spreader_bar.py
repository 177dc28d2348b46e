"""The spreader bar of a lift: it hangs, turns, and carries a person in a sling."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from rcare_marl import assets, inertia
from rcare_marl.attachment import Attachment
from rcare_marl.body import Body
from rcare_marl.config import load
from rcare_marl.errors import ConfigError, WorldError
from rcare_marl.pose import Pose
from rcare_marl.urdf import ZERO, Joint, Link, Shape, Triple
from rcare_marl.world import GRAVITY, World

from .device import Frame
from .dry_friction import DryFriction
from .sling import Sling, SlingConfig

if TYPE_CHECKING:
    from rcare_marl.agents.human import Human

LINK = "spreader_bar"
HINGES = ("bar_pitch", "bar_roll", "bar_turn")
TUBE = 0.014  # radius of the tubes of the bar [m]; our own choice
_HOLD = 20.0  # the sling bears this many times the weight of who hangs in it; our own choice
YOKE = 1.2  # mass of each part of the joint [kg]; our own choice
_DAMPING = 0.05  # of its hinges [N·m·s/rad]; our own choice


@dataclass(frozen=True)
class BarConfig:
    """Figures of a spreader bar [m].

    Attributes:
        width: Between the hooks of the two sides.
        reach: Of the hooks before and behind the bar.
        drop: From the pivot down to the hooks.
        mass: Of the bar [kg].
        sling_drop: From the hooks down to the seat of the sling.
        sling_back: From the bar back to where the seat and the reclined back of the sling meet.
        friction: Of the joints of the bar [N·m], empty and with a person.
        swing_deg: How far the bar swings each way [deg].
    """

    width: float
    reach: float
    drop: float
    mass: float
    sling_drop: float
    sling_back: float
    friction: tuple[float, float]
    swing_deg: float = 65.0

    def __post_init__(self) -> None:
        least = min(self.width, self.reach, self.drop, self.mass, self.sling_drop)
        if least <= 0 or min(self.friction) < 0 or not 0 < self.swing_deg < 90:
            raise ConfigError("lengths and mass of a spreader bar must be positive")


class SpreaderBar:
    """The bar that a lift hangs its sling on: x where the person looks, origin between the hooks.

    It pitches and rolls as what hangs from it wants, and turns; friction stills it.

    Frames: `bar`, `sling` (where the seat and the reclined back of the sling meet, as
    `body.posture.pelvis_pose` wants it), `hook_left_front`, `hook_left_back`, and so on the right.

    Attributes:
        config: Its figures.
        sling: What hangs on it.
        person: Who hangs in the sling, if anybody.
        is_joined: Whether the lift was spawned.
    """

    def __init__(self, config: BarConfig, sling: str) -> None:
        """Prepare a bar with the sling of that name; UnknownNameError if there is none."""
        self.config = config
        self.sling = Sling(load(SlingConfig, assets.find("devices", sling)))
        self.person: Human | None = None
        self.is_joined = False
        self._bonds: list[Attachment] = []

    @property
    def hooks(self) -> dict[str, Triple]:
        """Where the loops of the sling hang, in the frame of the bar [m]."""
        c = self.config
        return {
            f"hook_{side}_{end}": (along * c.reach, across * 0.5 * c.width, 0.0)
            for side, across in (("left", 1), ("right", -1))
            for end, along in (("front", 1), ("back", -1))
        }

    @property
    def frames(self) -> dict[str, Frame]:
        """Named places, in the frame of the bar."""
        c = self.config
        out = {
            "bar": Frame((0.0, 0.0, 0.0), note="between the hooks"),
            "sling": Frame(
                (-c.sling_back, 0.0, -c.sling_drop), note="where seat and back of the sling meet"
            ),
        }
        return out | {name: Frame(at, note="a hook") for name, at in self.hooks.items()}

    def links(self) -> dict[str, Link]:
        """Return the links that hang below a pivot."""
        c = self.config
        half, low = 0.5 * c.width, 0.02
        visual = [
            Shape(kind="tube", material="dark", radius=TUBE, bend=0.05,
                  points=((0, -half, 0.03), (0, -0.3 * half, 0.06), (0, 0.3 * half, 0.06),
                          (0, half, 0.03))),
            Shape(kind="cylinder", material="steel", radius=0.022,
                  points=((0, 0, 0.045), (0, 0, c.drop - 0.03))),
            Shape(kind="box", material="accent", at=(0, 0, 0.06), size=(0.05, 0.09, 0.05),
                  bevel=0.012),
        ]  # fmt: skip
        for side in (1, -1):
            y = side * half
            visual.append(Shape(
                kind="tube", material="dark", radius=TUBE, bend=0.03,
                points=((-c.reach, y, -0.005), (-c.reach - 0.012, y, low), (-0.7 * c.reach, y, 0.03),
                        (0.7 * c.reach, y, 0.03), (c.reach + 0.012, y, low), (c.reach, y, -0.005)),
            ))  # fmt: skip
        size = (2 * TUBE, c.width, 0.05)
        solid = [Shape(kind="box", at=(0, 0, 0.045), size=size)]
        solid += [
            Shape(kind="box", at=(0, side * half, 0.015), size=(2 * c.reach + 0.04, 2 * TUBE, 0.04))
            for side in (1, -1)
        ]
        box = (2 * c.reach, c.width, 0.06)
        bar = Link(
            c.mass, (0.0, 0.0, 0.03), inertia.of_box(c.mass, box), tuple(visual), tuple(solid)
        )
        sling = self.sling.config
        fold = (2 * c.reach, c.width, sling.idle_depth)
        fabric = Link(sling.mass, (0.0, 0.0, -0.6 * sling.idle_depth),
                      inertia.of_box(sling.mass, fold))  # fmt: skip
        yoke = inertia.of_box(YOKE, (0.07, 0.07, 0.07))
        fork = Shape(kind="box", material="steel", size=(0.045, 0.06, 0.07), bevel=0.01)
        return {
            "bar_fork": Link(YOKE, inertia=yoke, visual=(fork,)),
            "bar_yoke": Link(YOKE, inertia=yoke),
            LINK: bar,
            "sling": fabric,
        }

    def joints(
        self, parent: str, at: Triple, turn: float = 0.0, *, strap: Joint | None = None
    ) -> dict[str, Joint]:
        """Return the joints from `parent` down to the bar.

        Args:
            parent: Link that carries the pivot.
            at: The pivot in the frame of that link [m].
            turn: Turn of the bar about the vertical at rest [rad].
            strap: Joint from `bar_yoke` to `bar_eye`, where a strap lengthens below the pivot.
        """
        swing = float(np.radians(self.config.swing_deg))
        down = (0.0, 0.0, -self.config.drop)
        hinge = Joint(
            "revolute", parent, "bar_fork", at, axis=(0.0, 1.0, 0.0), lower=-swing, upper=swing,
            effort=50.0, velocity=6.0, damping=_DAMPING,
        )  # fmt: skip
        roll = replace(hinge, parent="bar_fork", child="bar_yoke", at=ZERO, axis=(1.0, 0.0, 0.0))
        out = {"bar_pitch": hinge, "bar_roll": roll}
        last = "bar_yoke"
        if strap is not None:
            out["lift"], last = strap, strap.child
        out["bar_turn"] = Joint(
            "continuous", last, LINK, down, (0.0, 0.0, turn), effort=50.0, velocity=6.0,
            damping=_DAMPING,
        )  # fmt: skip
        return out | {"sling": Joint("fixed", LINK, "sling")}

    def join(self, world: World, body: Body) -> None:
        """Take up work on the body of a lift that was loaded into `world`."""
        self._world, self._body = world, body
        self._hinges, self._friction = body.indices(HINGES), DryFriction(world, body)
        self.is_joined = True
        self.sling.hang(world, body, LINK, self.hooks)

    def settle(self) -> None:
        """Set the friction of the joints: motors do not return with a snapshot."""
        if any(not bond.is_active for bond in self._bonds):  # the world was rewound
            self.release()
        empty, laden = self.config.friction
        friction = empty if self.person is None else laden
        self._friction.hold(dict.fromkeys(self._hinges, friction))

    def set_pitch(self, angle: float) -> None:
        """Put the bar at an angle [rad] about the axis across what carries it, at once and at rest."""
        self._body.set_joints(
            self._hinges, (angle, 0.0, self._body.joint_states(self._hinges)[0][2])
        )
        self.settle()

    def frame_in_world(self, name: str) -> Pose:
        """Return the present pose of one of `frames` in the world; WorldError before it is there."""
        if not self.is_joined:
            raise WorldError("this spreader bar is in no world yet: spawn its lift first")
        return self._body.link_pose(self._body.link_index(LINK)) @ self.frames[name].pose

    def carry(self, person: Human, *, limit: float) -> None:
        """Put the sling round a person and hang it on the bar, as the person is now.

        Args:
            person: Who; with a free pelvis.
            limit: Greatest weight [kg].

        Raises:
            WorldError: If somebody hangs there already.
            ConfigError: If the pelvis is held in place, or the person is too heavy.
        """
        if self.person is not None:
            raise WorldError(f"{self.person.name!r} hangs in the sling already: release them first")
        if not person.body.is_movable:
            raise ConfigError(
                f"the pelvis of {person.name!r} is held in place: make them with fixed_base=False"
            )
        if person.avatar.mass_kg > limit:
            raise ConfigError(
                f"{person.name!r} weighs {person.avatar.mass_kg} kg, the lift bears {limit} kg"
            )
        weight = GRAVITY * person.avatar.mass_kg
        self._bonds = [self._world.attach(self._body, LINK, person.body, force=_HOLD * weight)]
        self.person = person
        self.sling.drape(person)
        self.settle()

    def release(self) -> None:
        """Take the loops off the hooks; nothing happens if nobody hangs there."""
        for bond in self._bonds:
            self._world.detach(bond)
        self._bonds, self.person = [], None
        self.sling.clear()
        self.settle()

    def load(self) -> float:
        """Return what the sling bears [N], at the last physics step."""
        return self._bonds[0].load() if self._bonds else 0.0


__all__ = ["HINGES", "LINK", "YOKE", "BarConfig", "SpreaderBar"]
