"""Doors: hinged leaves with a knob or a lever and a latch, and panels that slide into the wall."""

from __future__ import annotations

import math

from rcare_marl.body import Body
from rcare_marl.errors import ActionError, ConfigError
from rcare_marl.model.shape import Shape, Triple
from rcare_marl.model.urdf import Joint, Link, Model
from rcare_marl.pose import Pose
from rcare_marl.world import World

from ..devices import Device, DeviceModel, Frame
from ..place import DoorSize
from .latch import Latch, Latches
from .palette import Palette
from .plan import JAMB, LEAF, Opening, Plan
from .rule import Rules

# Lengths in metres; common sizes, from memory, where nothing else is said.
GAP = 0.003  # between leaf and lining
FLOOR_GAP = 0.008  # under leaves
PIVOT_OUT = 0.006  # from the face of the leaf to the axis of its hinges
BACKSET = 0.065  # from the edge of the leaf to the spindle of its handle
KNOB_RADIUS, KNOB_OUT, KNOB_TURN = 0.027, 0.052, 1.0
LEVER_REACH, LEVER_OUT, LEVER_TURN = 0.11, 0.05, 0.7
BAR_LENGTH, BAR_OUT, BAR_EDGE = 0.3, 0.04, 0.015
SWING = 1.6  # [rad] that leaves open unless a wall is nearer; own choice
RELEASE = 0.6  # share of its turn at which a handle frees the latch; own choice
SPRING_GAIN = 0.1  # share of the way back that the spring of a handle makes in a physics step
FITTED = 0.012  # what is nearer to a shut door is what it is fitted into
OVERLAP = 0.02  # of a shut panel with the wall, where it comes out of it; own choice
# The spring of a handle yields to this share of the force that the rules allow; own choice.
SPRING_SHARE = 0.85
LEAF_DENSITY, ENTRANCE_DENSITY = 10.0, 22.0  # [kg/m²]; light inner doors, solid front doors
HINGE_DAMPING, SLIDE_DAMPING = 3.0, 15.0  # [N·m·s/rad] and [N·s/m]; own choice
HANDLE_MASS = 0.4  # [kg], both sides

_HINGED = ("knob", "lever")


def hinge_side(opening: Opening) -> int:
    """Return on which side of a door, in its frame, its hinges or pocket are: 1 where x grows, or -1."""
    x, y, _ = opening.pose.matrix()[:3, 0]
    is_along = (x if opening.axis == "x" else y) > 0
    return 1 if is_along == (opening.hinge == "high") else -1


def door_size(opening: Opening, rules: Rules) -> DoorSize:
    """Measure a door; ConfigError if the opening has none."""
    if opening.hardware not in (*_HINGED, "slider"):
        raise ConfigError(
            f"{opening.name!r} has no door: its hardware must be knob, lever or slider, "
            f"got {opening.hardware!r}"
        )
    side, half = hinge_side(opening), 0.5 * opening.width - JAMB
    height = rules.figure("hardware_height")
    bottom, top = opening.threshold + FLOOR_GAP, opening.head - JAMB - GAP
    if opening.hardware == "slider":
        width = 2 * half - GAP + JAMB + OVERLAP
        edge = -side * (half - GAP)
        at = edge + side * BAR_EDGE
        return DoorSize(side, width, bottom, top, (edge, 0.0), 0.5 * LEAF, (at, height))
    width, face = 2 * (half - GAP), 0.5 * opening.thickness
    pivot = (side * (half - GAP), face + PIVOT_OUT)
    at = -side * (half - GAP - BACKSET)
    return DoorSize(side, width, bottom, top, pivot, face, (at, height))


def door_model(opening: Opening, rules: Rules, palette: Palette, *, swing: float = SWING) -> Model:
    """Return a door in the frame of its opening, shut.

    Hinged ones move on `hinge` and have a handle on `knob` or `lever`; panels move on `slide`.

    Args:
        opening: Where it is.
        rules: The rules of the level, which say how high its handle is and how hard to turn.
        palette: The colours of the house.
        swing: How far it opens [rad].

    Raises:
        ConfigError: If the opening has no door.
    """
    size = door_size(opening, rules)
    if opening.hardware == "slider":
        links, joints = _panel(opening, size)
    else:
        links, joints = _leaf(opening, size, swing, spring_torque(opening, rules))
    return Model(
        name=f"door_{opening.hardware}",
        source="common sizes, from memory, and the rules of accessibility",
        links=links,
        joints=joints,
        materials=palette.materials(),
    )


def spring_torque(opening: Opening, rules: Rules) -> float:
    """Return the torque of the spring that turns a handle back [N·m].

    What the rules call the force to work hardware acts at the end of a lever, or at the rim of a knob.
    """
    arm = LEVER_REACH if opening.hardware == "lever" else KNOB_RADIUS
    return SPRING_SHARE * rules.figure("hardware_force") * arm


def widest_swing(opening: Opening, plan: Plan) -> float:
    """Return how far a hinged door may open before its handle nears the wall beside it [rad].

    1.7 at most, and less than a quarter turn only where the wall is nearer than the handle.
    """
    half = 0.5 * opening.width - JAMB - GAP
    room = plan.room(opening.rooms[0]).inside.moved(opening.pose.inverse())
    free = (room.x1 if hinge_side(opening) > 0 else -room.x0) - half - 0.015
    reach, out = 2 * half - BACKSET, KNOB_OUT + KNOB_RADIUS - PIVOT_OUT
    angle = 1.7
    while angle > 1.2 and reach * math.cos(angle) - out * math.sin(angle) < -free:
        angle -= 0.01
    return angle


def _slide(opening: Opening) -> float:
    """Return how far a panel slides: until all of it but its handle is in the wall [m]."""
    return opening.clear_width - GAP


def _box_inertia(mass: float, size: Triple) -> tuple[float, float, float, float, float, float]:
    x, y, z = (mass * edge * edge / 12 for edge in size)
    return (y + z, 0.0, 0.0, x + z, 0.0, x + y)


def _leaf(
    opening: Opening, size: DoorSize, swing: float, torque: float
) -> tuple[dict[str, Link], dict[str, Joint]]:
    """A leaf in the frame of its hinges, and the handle on it in the frame of its spindle."""
    is_front = opening.kind == "entrance"
    side, height = size.side, size.top - size.bottom
    box = (size.width, LEAF, height)
    middle = (-0.5 * side * size.width, -PIVOT_OUT - 0.5 * LEAF, size.bottom + 0.5 * height)
    mass = (ENTRANCE_DENSITY if is_front else LEAF_DENSITY) * size.width * height
    knuckles = [
        Shape(kind="box", material="metal", at=(0.0, 0.0, z), size=(0.014, 0.014, 0.09))
        for z in (size.bottom + 0.22, middle[2], size.top - 0.22)
    ]
    look = _boards(middle, box, "wood_dark" if is_front else "door")
    leaf = Link(
        mass,
        middle,
        _box_inertia(mass, box),
        visual=(*look, *knuckles),
        collision=(Shape(kind="box", at=middle, size=box),),
    )
    spindle = (size.handle[0] - size.pivot[0], middle[1], size.handle[1])
    joints = {
        "hinge": Joint(
            "revolute",
            "frame",
            "leaf",
            at=(*size.pivot, 0.0),
            axis=(0.0, 0.0, -float(side)),
            upper=swing,
            effort=100.0,
            velocity=3.0,
            damping=HINGE_DAMPING,
        )
    }
    if opening.hardware == "knob":
        handle, limits, axis = _knob(is_front), (-KNOB_TURN, KNOB_TURN), (0.0, 1.0, 0.0)
    else:
        handle, limits = _lever(side, is_front), (0.0, LEVER_TURN)
        axis = (0.0, float(side), 0.0)
    joints[opening.hardware] = Joint(
        "revolute",
        "leaf",
        "handle",
        at=spindle,
        axis=axis,
        lower=limits[0],
        upper=limits[1],
        effort=torque,
        velocity=10.0,
        damping=0.01,
    )
    return {"frame": Link(), "leaf": leaf, "handle": handle}, joints


def _boards(middle: Triple, box: Triple, material: str) -> list[Shape]:
    """A panelled board: a core, and over it stiles and rails, standing proud on both faces."""
    (x, y, z), (width, thick, height) = middle, box
    low, high = z - 0.5 * height, z + 0.5 * height
    stile = 0.11 if width > 0.7 else 0.09

    def board(at: Triple, size: Triple, colour: str = material) -> Shape:
        return Shape(kind="box", material=colour, at=at, size=size)

    shapes = [board(middle, (width - 0.02, thick - 0.02, height - 0.02))]
    for sign in (-1, 1):
        shapes.append(board((x + sign * 0.5 * (width - stile), y, z), (stile, thick, height)))
    inner = width - 2 * stile
    rails = ((low, 0.2), (low + 0.42 * height, 0.14), (high - 0.12, 0.12))
    for start, deep in rails:
        shapes.append(board((x, y, start + 0.5 * deep), (inner, thick, deep)))
    for (start, deep), (end, _) in zip(rails, rails[1:], strict=False):  # raised fields
        bottom, top = start + deep + 0.035, end - 0.035
        field = (inner - 0.07, thick - 0.008, top - bottom)
        shapes.append(
            Shape(kind="box", material=material, at=(x, y, 0.5 * (bottom + top)), size=field)
        )
    return shapes


def _knob(is_front: bool) -> Link:
    metal = "brass" if is_front else "metal"
    r = KNOB_RADIUS
    visual, solids = [], []
    for sign in (-1, 1):
        turn = (-sign * 0.5 * math.pi, 0.0, 0.0)  # z to y on one side, to -y on the other
        profile = (
            (0.028, 0.5 * LEAF), (0.026, 0.5 * LEAF + 0.006), (0.011, 0.5 * LEAF + 0.008),
            (0.011, 0.5 * LEAF + KNOB_OUT - r), (0.8 * r, 0.5 * LEAF + KNOB_OUT - 0.6 * r),
            (r, 0.5 * LEAF + KNOB_OUT), (0.8 * r, 0.5 * LEAF + KNOB_OUT + 0.6 * r),
        )  # fmt: skip
        visual.append(Shape(kind="lathe", material=metal, rpy=turn, profile=profile))
        solids.append(Shape(kind="sphere", radius=r, at=(0.0, sign * (0.5 * LEAF + KNOB_OUT), 0.0)))
    span = LEAF + 2 * KNOB_OUT
    inertia = _box_inertia(HANDLE_MASS, (1.4 * r, span, 1.4 * r))
    return Link(HANDLE_MASS, inertia=inertia, visual=tuple(visual), collision=tuple(solids))


def _lever(side: int, is_front: bool) -> Link:
    """Levers point to the hinges."""
    metal = "brass" if is_front else "metal"
    visual, solids = [], []
    for sign in (-1, 1):
        face, out = sign * 0.5 * LEAF, sign * (0.5 * LEAF + LEVER_OUT)
        end = (side * LEVER_REACH, out, 0.0)
        visual += [
            Shape(
                kind="cylinder",
                material=metal,
                radius=0.026,
                points=((0.0, face, 0.0), (0.0, face + sign * 0.008, 0.0)),
            ),
            Shape(
                kind="tube",
                material=metal,
                radius=0.009,
                bend=0.02,
                points=((0.0, face, 0.0), (0.0, out, 0.0), end),
            ),
        ]
        solids.append(Shape(kind="capsule", radius=0.009, points=((0.0, out, 0.0), end)))
    reach = side * LEVER_REACH
    inertia = _box_inertia(HANDLE_MASS, (LEVER_REACH, LEAF + 2 * LEVER_OUT, 0.02))
    com = (0.35 * reach, 0.0, 0.0)
    return Link(HANDLE_MASS, com, inertia, visual=tuple(visual), collision=tuple(solids))


def _panel(opening: Opening, size: DoorSize) -> tuple[dict[str, Link], dict[str, Joint]]:
    """A panel in the frame of its free edge."""
    side, height = size.side, size.top - size.bottom
    box = (size.width, LEAF, height)
    middle = (0.5 * side * size.width, 0.0, size.bottom + 0.5 * height)
    mass = LEAF_DENSITY * size.width * height
    visual = _boards(middle, box, "door")
    solids = [Shape(kind="box", at=middle, size=box)]
    x, z = side * BAR_EDGE, size.handle[1]
    for sign in (-1, 1):
        face, out = sign * 0.5 * LEAF, sign * (0.5 * LEAF + BAR_OUT)
        low, high = z - 0.5 * BAR_LENGTH, z + 0.5 * BAR_LENGTH
        visual.append(
            Shape(
                kind="tube",
                material="metal",
                radius=0.009,
                bend=0.02,
                points=((x, face, low), (x, out, low), (x, out, high), (x, face, high)),
            )
        )
        solids.append(Shape(kind="capsule", radius=0.009, points=((x, out, low), (x, out, high))))
    panel = Link(
        mass, middle, _box_inertia(mass, box), visual=tuple(visual), collision=tuple(solids)
    )
    slide = Joint(
        "prismatic",
        "frame",
        "panel",
        at=(*size.pivot, 0.0),
        axis=(float(side), 0.0, 0.0),
        upper=_slide(opening),
        effort=200.0,
        velocity=1.5,
        damping=SLIDE_DAMPING,
    )
    return {"frame": Link(), "panel": panel}, {"slide": slide}


class Door(Device):
    """A door; its frame is that of its opening: origin on the floor in the gap, y into the first room.

    Frames: `handle_inside` and `handle_outside` to grasp, x out of the door, inside being the first
    room's side; `lever_inside` and `lever_outside`, where a lever is pushed down. They go with it.

    Attributes:
        opening: Where it is.
        size: Its measures.
        swing: How far it opens [rad or m].
    """

    def __init__(
        self,
        opening: Opening,
        rules: Rules,
        palette: Palette = Palette(),
        *,
        swing: float = SWING,
    ) -> None:
        """Make a door.

        Args:
            opening: Where it is.
            rules: The rules of the level of accessibility.
            palette: The colours of the house.
            swing: How far it opens [rad], if it is hinged; see `widest_swing`.

        Raises:
            ConfigError: If the opening has no door.
        """
        self.opening, self._rules = opening, rules
        self.size = door_size(opening, rules)
        self._is_hinged = opening.hardware in _HINGED
        self.swing = swing if self._is_hinged else _slide(opening)
        self._latch: Latch | None = None
        model = door_model(opening, rules, palette, swing=self.swing)
        super().__init__(DeviceModel(**vars(model), frames=self._frames()))

    def _frames(self) -> dict[str, Frame]:
        size, hardware = self.size, self.opening.hardware
        out = {"knob": KNOB_OUT, "lever": LEVER_OUT, "slider": BAR_OUT}[hardware]
        x, z = size.handle
        places = {"handle": x + (0.5 * size.side * LEVER_REACH if hardware == "lever" else 0.0)}
        if hardware == "lever":
            places["lever"] = x + size.side * LEVER_REACH
        frames, link = {}, "handle" if self._is_hinged else "panel"
        for name, at in places.items():
            note = "where it is grasped" if name == "handle" else "end of the lever"
            front, back = size.face + out, size.face - LEAF - out
            frames[f"{name}_inside"] = Frame((at, front, z), (0.0, 0.0, 90.0), note, link)
            frames[f"{name}_outside"] = Frame((at, back, z), (0.0, 0.0, -90.0), note, link)
        return frames

    def spawn(self, world: World, pose: Pose | None = None, *, name: str = "") -> Body:
        """Load it into `world`, once, shut, and return its body.

        It passes through what stands still around it by then: walls come first.

        Args:
            world: The world.
            pose: Where the frame of its opening is; as if the house stood at the origin if None.
            name: Name in the world; that of the opening if empty.
        """
        body = super().spawn(
            world, self.opening.pose if pose is None else pose, name=name or self.opening.name
        )
        for other in world.bodies:
            if other is not body and not other.is_movable and not other.joints:
                # Walls and floor, which it never meets: Bullet would look for contacts all the time.
                if world.separation(body, other, within=FITTED) < FITTED:
                    world.set_collision(body, other, False)
        if self._is_hinged:
            body.exclude_pairs((("leaf", "handle"),))  # they never touch, but would cost time
            hinge, handle = (body.joint(j).index for j in ("hinge", self.opening.hardware))
            self._latch = Latch(body, hinge, handle, release=self.release_angle, swing=self.swing)
            Latches.of(world).add(self._latch)
        return body

    def reset(self) -> None:
        super().reset()
        if self._is_hinged:  # a spring of constant torque turns the handle back
            handle = self.body.joint(self.opening.hardware).index
            force = spring_torque(self.opening, self._rules)
            self.body.drive_to([handle], [0.0], [6.0], [force], [SPRING_GAIN])

    @property
    def name(self) -> str:
        """Name of its opening."""
        return self.opening.name

    @property
    def hardware(self) -> str:
        """What opens it: `knob`, `lever` or `slider`."""
        return self.opening.hardware

    @property
    def clear_width(self) -> float:
        """Free width when it is open [m]."""
        return self.opening.clear_width

    @property
    def thickness(self) -> float:
        """Of the wall [m]."""
        return self.opening.thickness

    @property
    def release_angle(self) -> float:
        """Turn of the handle at which the latch is free [rad]; 0 of panels."""
        return RELEASE * {"knob": KNOB_TURN, "lever": LEVER_TURN, "slider": 0.0}[self.hardware]

    @property
    def angle(self) -> float:
        """How far it is open [rad], or slid into the wall [m]."""
        joint = self.body.joint("hinge" if self._is_hinged else "slide")
        return self.body.joint_states([joint.index])[0][0]

    @property
    def is_latched(self) -> bool:
        """Whether a latch holds it shut; panels have none."""
        return self._latch is not None and self._latch.is_latched

    def open(self, fraction: float = 1.0) -> None:
        """Put it at a fraction of its way at once, 0 for shut; a shut leaf is latched.

        Raises:
            ActionError: If `fraction` is not within 0 and 1.
        """
        if not 0 <= fraction <= 1:
            raise ActionError(f"{self.body.name!r} opens by a fraction of 0 to 1, got {fraction}")
        joint = self.body.joint("hinge" if self._is_hinged else "slide")
        if self._latch is not None:
            self._latch.set(fraction == 0)
        self.body.set_joints([joint.index], [fraction * self.swing])
