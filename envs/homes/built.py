"""A home in a world: a few still bodies, and what moves."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from typing import TYPE_CHECKING

from rcare_marl.body import Body
from rcare_marl.errors import check_name
from rcare_marl.model.shape import Shape
from rcare_marl.model.urdf import Link, Model, write
from rcare_marl.pose import Pose
from rcare_marl.world import World

from ..rectangle import Rectangle
from .door import Door, door_model, widest_swing
from .furnishing import Placed
from .merging import NEAR, Part, extent, merged, partition
from .plan import Opening
from .shell import floor_model, shell_model

if TYPE_CHECKING:
    from .care_home import CareHome

SPECK = 1e-3  # [m]
OPEN_DOOR = 1.5  # [rad] that doors stand open where they do not move; own choice


class BuiltHome:
    """A house that stands in a world.

    Attributes:
        home: The house.
        pose: Where its origin is in the world.
        floor: The floor.
        bodies: The floor, and `house`: what one sees of all that stands still. What is solid of it is
            in bodies of its own: `walls`, `doors` and each room; where a busy floor is given, by
            the side of that floor that it is on: `solid_left`, ...
        furniture: What moves, by name, such as `kitchen_1.fridge`.
        doors: Doors that move, by name.
    """

    def __init__(
        self,
        home: CareHome,
        world: World,
        at: Pose,
        articulated: Sequence[str],
        *,
        busy: Rectangle | None,
        ceilings: bool,
        wall_height: float | None,
    ) -> None:
        self.home, self.pose, self._world = home, at, world
        self._busy, self._solids = busy, dict[str, list[Shape]]()
        self.furniture: dict[str, Body] = {}
        self.doors: dict[str, Door] = {}
        self.bodies: list[Body] = []
        self.floor = self._load(floor_model(home.plan, home.rules, home.palette), "floor")
        self.floor.set_friction([-1], lateral=0.8)
        shell = shell_model(home.plan, home.palette, ceilings=ceilings, wall_height=wall_height)
        doors = [o for o in home.plan.openings.values() if o.hardware]
        moving = [o for o in doors if set(o.rooms) & set(articulated)]
        still = [self._still_door(o) for o in doors if o not in moving]
        models = {"walls": shell, "doors": merged(f"{home.name}_doors", still)}
        self._load_still(models, articulated)
        moves = [p for p in home.placed if p.room in articulated and _moves(p)]
        for each in moves:
            self._load_moving(each)
        for opening in moving:
            swing = widest_swing(opening, home.plan)
            door = Door(opening, home.rules, home.palette, swing=swing)
            door.spawn(world, at @ opening.pose, name=opening.name)
            self._world.sleeping.add(door.body)
            self.doors[opening.name] = door

    def _load_still(self, models: dict[str, Model], articulated: Sequence[str]) -> None:
        """Load what stands still: `models` by name, and the furniture of each room."""
        name = self.home.name
        for room in self.home.plan.rooms:
            parts: list[Part] = [
                (p.piece.model, p.pose, {})
                for p in self.home.furniture(room)
                if room not in articulated or not _moves(p)
            ]
            if parts:
                models[room] = merged(f"{name}_{room}", parts)
        # For the eye all is one body: each costs a little at every step, and files to load.
        house = merged(f"{name}_still", [(m, Pose(), {}) for m in models.values()])
        if self._busy is None:
            for key, model in models.items():
                self._solids[key] = [s for link in model.links.values() for s in link.collision]
            house = _with_solids(house, ())
        self._load(house, "house")
        for key, solids in self._solids.items():
            if solids:
                self._write(_unseen(f"{name}_{key}", solids), key)

    def _still_door(self, opening: Opening) -> Part:
        model = door_model(opening, self.home.rules, self.home.palette)
        wide = {"slide": model.joints["slide"].upper} if "slide" in model.joints else {}
        angle = min(OPEN_DOOR, widest_swing(opening, self.home.plan))
        return model, opening.pose, wide or {"hinge": angle}

    def _load(self, model: Model, name: str) -> Body:
        """Load what stands still; what is solid of it waits for the others on its side."""
        if self._busy is not None:
            (link,) = model.links.values()
            sides = partition(link.collision, self._busy)
            kept = sides.pop("below" if name == "floor" else NEAR, ())
            for side, shapes in sides.items():
                self._solids.setdefault(f"solid_{side}", []).extend(shapes)
            model = _with_solids(model, kept)
        return self._write(model, name)

    def _write(self, model: Model, name: str) -> Body:
        body = self._world.load_urdf(write(model, melt_except=()), self.pose, name=name)
        self.bodies.append(body)
        return body

    def _load_moving(self, placed: Placed) -> None:
        model = placed.piece.model
        path = write(model, melt_except=())
        body = self._world.load_urdf(path, self.pose @ placed.pose, name=placed.name)
        for name, joint in body.joints.items():
            body.release_motors([joint.index], model.joints[name].friction)
        for still in self.bodies:  # it cannot leave its place, so it never needs to feel the house
            self._world.set_collision(body, still, False)
        self._world.sleeping.add(body)
        self.furniture[placed.name] = body

    def things(self) -> list[tuple[str, Body]]:
        """Return all that one can run into, with what it is; not the floor."""
        still = [
            ("what stands still" if body.name.startswith("solid_") else body.name, body)
            for body in self.bodies
            if body is not self.floor
        ]
        doors = [(name, door.body) for name, door in self.doors.items()]
        return [*still, *self.furniture.items(), *doors]

    def part(self, name: str) -> Body:
        """Return a piece of furniture that moves; UnknownNameError lists those there are."""
        check_name("furniture that moves", name, self.furniture)
        return self.furniture[name]

    def in_world(self, pose: Pose) -> Pose:
        """Return a pose given in the house in the world."""
        return self.pose @ pose


def _with_solids(model: Model, solids: Sequence[Shape]) -> Model:
    """Return a model of one link with other solids."""
    ((name, link),) = model.links.items()
    return dataclasses.replace(
        model, links={name: dataclasses.replace(link, collision=tuple(solids))}
    )


def _unseen(name: str, solids: Sequence[Shape]) -> Model:
    """Return a link to run into that shows nothing but a speck inside the first of its solids.

    Bullet draws the solids themselves of a link that has nothing to draw.
    """
    lowest, highest = extent(solids[0])
    x, y, z = (0.5 * (lowest + highest)).tolist()
    speck = Shape(kind="box", material="speck", at=(x, y, z), size=(SPECK, SPECK, SPECK))
    return Model(
        name=name,
        source="a plan by rule",
        links={"solid": Link(visual=(speck,), collision=tuple(solids))},
        materials={"speck": (0.5, 0.5, 0.5, 1.0)},
    )


def _moves(placed: Placed) -> bool:
    return any(joint.kind != "fixed" for joint in placed.piece.model.joints.values())
