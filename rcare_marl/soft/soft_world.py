"""All soft matter of a world: cloth, fluids, soft bodies, what they press on, and the snapshot."""

from __future__ import annotations

import math
import weakref
from collections.abc import Iterable, Sequence
from typing import Any, TypeVar

import numpy as np
import numpy.typing as npt

from ..body import Body
from ..body_part import State
from ..contact import Contact
from ..errors import ConfigError
from ..pose import Array, conjugate, multiply, rotation_vector
from ..world import GRAVITY, Skin, World
from . import kernel
from .cloth import FASTEST, SHAPE_SPEED, Cloth
from .collider import Colliders, Links, NearShapes, place_of
from .fluid import HURRY, Fluid
from .soft_body import SETTLED, SoftBody
from .soft_object import SoftObject
from .soft_skin import ClothSkin, FluidSkin, SoftBodySkin
from .vessel import VESSEL, Vessel

Kind = type[Cloth] | type[Fluid] | type[SoftBody]
S = TypeVar("S", bound=SoftObject)

# Our own choices. Nothing in care moves faster than MAX_SPEED: a soft body looks around again before
# anything could have come near, and a link that is set from pose to pose by more is teleported.
MAX_SPEED = 4.0  # [m/s]
WAKE = 0.01  # [m] between skin and shape
NEAR_BODY = 0.08  # [m], shapes that an awake soft body watches
NEAR = 0.02  # [m] beyond what particle of cloth or fluid and shape can move until the next look
LOOK = 4  # physics steps between two looks around
LOOK_ASLEEP = 96  # at most, of a sleeping soft body
_AT_REST = 1e-6  # [m/s] and [rad/s], what Bullet says of a link that is set from pose to pose


class SoftWorld:
    """The soft matter of one world; the world steps, marks and rewinds it.

    Attributes:
        cloths: Cloths, in the order in which they came.
        fluids: Fluids.
        bodies: Soft bodies: flesh and sponges.
        vessels: What fluids lie in.
    """

    def __init__(self, world: World) -> None:
        self._world: World = weakref.proxy(world)
        self.cloths: list[Cloth] = []
        self.fluids: list[Fluid] = []
        self.bodies: list[SoftBody] = []
        self.vessels: list[Vessel] = []
        self._ignored: dict[Kind, list[Body]] = {Cloth: [], Fluid: [], SoftBody: []}
        self._joined: list[Body] = []
        self._foundations: dict[tuple[int, int], float] = {}  # by body and link
        self._gravity = np.array((0.0, 0.0, -GRAVITY))
        self._colliders: Colliders | None = None
        self._known = 0  # bodies of the world that were read
        self._steps = 0
        self._until_look: dict[Kind, int] = dict.fromkeys(self._ignored, 0)
        self._teleports = -1  # of the world at the last look
        self._pushes: dict[int, Array] = {}  # force and moment on free links in this step, by row
        self._pushed: dict[int, Array] = {}  # in the last step
        self._marked: list[tuple[Any, ...]] = []
        self._marked_pushes: dict[int, Array] = {}

    @staticmethod
    def of(world: World) -> SoftWorld:
        """Return the soft matter of a world; it comes into being when it is first asked for."""
        for matter in world.matter:
            if isinstance(matter, SoftWorld):
                return matter
        made = SoftWorld(world)
        world.matter.append(made)
        return made

    @property
    def objects(self) -> list[SoftObject]:
        """All cloths, fluids and soft bodies."""
        return [*self.cloths, *self.fluids, *self.bodies]

    def add(
        self, soft: S, *, color: Sequence[int] | None = None, beneath: Sequence[Skin] = ()
    ) -> S:
        """Put a cloth, fluid or soft body into the world and return it.

        Args:
            soft: What is added.
            color: RGB that it is drawn in, and for fluids opacity; that of its kind if None. A soft body
                is not drawn without.
            beneath: Skins of people that a cloth is drawn outside of; the physics does not know them.
        """
        world, color = self._world, soft.color if color is None else color
        if isinstance(soft, SoftBody):
            self.bodies.append(soft)
            if color is not None:
                # Renderers draw a skin in place of its body, but the carrier is to be seen as well: a
                # second handle on the same body.
                carrier = soft.carrier.body
                handle = world.body_type(world, carrier.uid, carrier.name, carrier.source)
                world.skins.append(SoftBodySkin(soft, handle, color))
        elif isinstance(soft, Cloth):
            soft.bind()
            self.cloths.append(soft)
            world.skins.append(ClothSkin(soft, self._stand_in(soft), color or (), beneath))
        elif isinstance(soft, Fluid):
            self.fluids.append(soft)
            world.skins.append(FluidSkin(soft, self._stand_in(soft), color or ()))
        self._colliders = None
        return soft

    def _stand_in(self, soft: SoftObject) -> Body:
        """Return a body that is nowhere and touches nothing: renderers ask what a skin belongs to."""
        return self._world.add_box((0.001,) * 3, collides=False, name=soft.name)

    def add_vessel(self, vessel: Vessel) -> Vessel:
        """Let fluids lie in a vessel; its body then counts for them as that alone."""
        self.vessels.append(vessel)
        self.ignore([vessel.body], by=Fluid)
        return vessel

    def ignore(self, bodies: Iterable[Body], *, by: Kind | SoftObject) -> None:
        """Let soft matter pass through rigid bodies, such as the chair that a person sits on.

        Args:
            bodies: The rigid bodies.
            by: One soft object, or all cloths, all fluids or all soft bodies.
        """
        ignored = by.ignored if isinstance(by, SoftObject) else self._ignored[by]
        ignored.extend(bodies)
        self._colliders = None

    def set_foundation(self, body: Body, link: int, stiffness: float) -> None:
        """Let soft bodies sink into a link as into flesh: an elastic foundation.

        Args:
            body: The body.
            link: Its link.
            stiffness: Pressure for each depth [Pa/m]; 0 makes it rigid again.

        Raises:
            ConfigError: If it is negative.
        """
        if not stiffness >= 0:
            raise ConfigError(f"the stiffness of flesh must not be negative, got {stiffness}")
        self._foundations[id(body), link] = stiffness
        self._colliders = None

    def read_bodies(self) -> None:
        """Read masses and friction of all rigid bodies anew before the next step."""
        self._colliders = None

    def join_limbs(self, body: Body) -> None:
        """Close the gaps between the limbs of a person, for cloth alone.

        Their capsules end round where a joint is: a hem would slip in between thigh and shank, and in there
        through the leg. So slender ones are longer for cloth, by a part of their radius at each end.
        """
        self._joined.append(body)
        self._colliders = None

    def step(self) -> None:
        """Simulate up to the end of the coming physics step and push the rigid bodies."""
        is_flowing = any(fluid.count for fluid in self.fluids)
        if not (self.cloths or self.bodies or is_flowing):
            return
        self._steps += 1
        self._pushed, self._pushes = self._pushes, {}
        colliders, period = self._prepare(), self._world.physics_dt
        table = self._write_vessels(colliders) if is_flowing else _NO_VESSELS
        if self._look_around(colliders, table):
            self._note_links(colliders)
        self._fetch(colliders, self._wanted)
        for cloth in self.cloths:
            tears = cloth.tears
            cloth.advance(colliders, self._gravity, period)
            if cloth.tears != tears:
                self._until_look[Cloth] = 0
        for fluid in self.fluids:
            if fluid.count:
                fluid.advance(colliders, self.vessels, table, self._gravity, period)
        self._advance_bodies(colliders, period)

    def mark(self) -> None:
        """Remember the present state as the one that `rewind` returns to."""
        self._marked = [soft.save() for soft in self.objects]
        self._marked_pushes = dict(self._pushes)
        self._forget()

    def rewind(self) -> None:
        """Return to the marked state."""
        for soft, snapshot in zip(self.objects, self._marked, strict=True):
            soft.restore(snapshot)
        self._pushes = dict(self._marked_pushes)
        self._forget()

    def _forget(self) -> None:
        self._until_look = dict.fromkeys(self._ignored, 0)
        if self._colliders is not None:
            self._colliders.forget_poses()
            self._history.clear()

    def contacts(self, a: Body, b: Body | None = None) -> list[Contact]:
        """Return what soft matter on `a` pressed on `b` with, and `a` on that of `b`; on anything if None.

        A soft body counts as part of its carrier; what has none belongs to no body, and is left out if
        `b`. The force is all of it on a link, friction included, and the distance is zero. See
        `SoftContact.load` for a sleeve that squeezes all round.
        """
        found = []
        for soft in self.objects:
            if not soft.contacts:
                continue
            carrier = soft.carrier
            own, own_link = (None, -1) if carrier is None else (carrier.body, carrier.link)
            for touch in soft.contacts:
                if own is not a and touch.body is not a:
                    continue
                x, y, z = touch.force.tolist()
                size = math.sqrt(x * x + y * y + z * z)
                least = max(size, 1e-12)
                along, point = (x / least, y / least, z / least), tuple(touch.point.tolist())
                if own is a and b in (None, touch.body):
                    out = (-along[0], -along[1], -along[2])
                    found.append(Contact(own_link, touch.link, point, out, 0.0, size))
                if touch.body is a and b in (None, own):
                    found.append(Contact(touch.link, own_link, point, along, 0.0, size))
        return found

    def _prepare(self) -> Colliders:
        """Read the shapes of all rigid bodies again if there are new ones."""
        world = self._world
        if self._colliders is not None and self._known == len(world.bodies):
            return self._colliders
        self._known = len(world.bodies)
        kinds = [kind for kind in self._ignored if any(isinstance(s, kind) for s in self.objects)]
        chosen = [b for b in world.bodies if any(b not in self._ignored[k] for k in kinds)]
        links = [(vessel.body, vessel.link) for vessel in self.vessels]
        made = Colliders(chosen, world.client, joined=self._joined, links=links)
        owners = [made.links[row] for row in made.shape_links]
        made.foundations[:] = [self._foundations.get((id(b), link), 0.0) for b, link in owners]
        self._meetable = {soft: self._shapes_met_by(soft, made) for soft in self.objects}
        self._places = {  # of bodies that some object of a kind can meet
            kind: sorted(
                {
                    place
                    for soft, is_met in self._meetable.items()
                    if isinstance(soft, kind)
                    for place in np.unique(made.shape_bodies[is_met]).tolist()
                }
            )
            for kind in self._ignored
        }
        for soft in self.objects:
            soft.near = None
        self._masses = {
            row: body.mass_and_inertia(-1)
            for row, (body, _) in enumerate(made.links)
            if body.is_movable and not body.link_count
        }
        # Of links, by row: the step in which it was read, its state, and that a step ago if it was read.
        self._history: dict[int, tuple[int, State, State | None]] = {}
        self._vessel_rows = made.by_body(sorted({made.row_of[link] for link in links}))
        self._wanted: list[Links] = []
        self._answering: list[int] = []  # rows of free links near awake soft bodies
        self._until_look = dict.fromkeys(self._ignored, 0)
        self._colliders = made
        return made

    def _shapes_met_by(self, soft: SoftObject, colliders: Colliders) -> npt.NDArray[np.bool_]:
        """Return which shapes a soft object can meet, shape [s]."""
        kind = next(kind for kind in self._ignored if isinstance(soft, kind))
        carriers = [soft.carrier.body] if soft.carrier else []
        passed = {id(body) for body in (*self._ignored[kind], *soft.ignored, *carriers)}
        is_met = np.array([id(body) not in passed for body in colliders.bodies], np.bool_)
        seen = colliders.is_for_cloth if kind is Cloth else colliders.is_for_others
        return np.asarray(is_met[colliders.shape_bodies] & seen)

    def _write_vessels(self, colliders: Colliders) -> Array:
        """Return the kernel's table of vessels."""
        self._fetch(colliders, self._vessel_rows)
        table = np.empty((len(self.vessels), VESSEL))
        for row, vessel in zip(table, self.vessels, strict=True):
            vessel.write(row, colliders.states[colliders.row_of[vessel.body, vessel.link]])
        return table

    def _look_around(self, colliders: Colliders, vessels: Array) -> bool:
        """Let each kind find what is near if it is time, and return whether any did."""
        has_moved = self._world.teleports != self._teleports
        if has_moved:
            colliders.forget_poses()
            self._teleports, self._until_look[SoftBody] = self._world.teleports, 0
        looked = False
        wait = LOOK * self._world.physics_dt
        for kind, members in ((Cloth, self.cloths), (Fluid, self.fluids), (SoftBody, self.bodies)):
            self._until_look[kind] -= 1
            if self._until_look[kind] > 0 or not members:
                continue
            looked, self._until_look[kind] = True, LOOK
            if kind is Cloth:
                self._look_of_cloths(colliders, wait)
            elif kind is Fluid:
                self._look_of_fluids(colliders, vessels, wait)
            else:
                self._until_look[kind] = self._look_of_bodies(colliders)
        return looked

    def _note_links(self, colliders: Colliders) -> None:
        """Note which links are near what is being simulated."""
        awake = [body for body in self.bodies if body.is_awake]
        near = [s.near for s in (*self.cloths, *self.fluids) if s.near is not None]
        near_bodies = [body.near for body in awake if body.near is not None]
        rows = {row for shapes in near_bodies for row in shapes.by_link[0]}
        self._answering = sorted(rows & self._masses.keys())
        rows.update(row for shapes in near for row in shapes.by_link[0])
        self._wanted = colliders.by_body(sorted(rows))

    def _look_of_cloths(self, colliders: Colliders, wait: float) -> None:
        """Find which shapes are near each cloth and which particles are near each other."""
        spheres = []
        for cloth in self.cloths:
            low, high = cloth.positions.min(axis=0), cloth.positions.max(axis=0)
            spheres.append(((low + high) / 2, float(np.linalg.norm(high - low)) / 2))
        reach = NEAR + (FASTEST + SHAPE_SPEED) * wait
        fresh, _ = colliders.fetch_near(self._places[Cloth], spheres, reach)
        for cloth in self.cloths:
            cloth.find_near(colliders, np.flatnonzero(fresh & self._meetable[cloth]), wait)

    def _look_of_fluids(self, colliders: Colliders, vessels: Array, wait: float) -> None:
        """Find which shapes particles outside of vessels are near."""
        reach = NEAR + (HURRY + SHAPE_SPEED) * wait
        for fluid in self.fluids:
            outside = fluid.find_outside(vessels)
            if not len(outside):
                fluid.ignore_shapes()
                continue
            points = fluid.positions[outside]
            speed = float(np.abs(fluid.velocities[outside]).max())
            middle = 0.5 * (points.min(axis=0) + points.max(axis=0))
            radius = float(np.linalg.norm(points - middle, axis=1).max()) + wait * speed
            fresh, _ = colliders.fetch_near(self._places[Fluid], [(middle, radius)], reach)
            rows = np.flatnonzero(fresh & self._meetable[fluid])
            fluid.find_near(colliders, rows, wait, outside)

    def _look_of_bodies(self, colliders: Colliders) -> int:
        """Find what is near each soft body, wake and put to sleep, and say when to look again."""
        frames = [soft.frame() for soft in self.bodies]
        spheres = [
            (place_of(frame, soft.middle), soft.radius)
            for soft, frame in zip(self.bodies, frames, strict=True)
        ]
        places = self._places[SoftBody]
        fresh, beyond = colliders.fetch_near(places, spheres, 2 * NEAR_BODY)
        least = beyond  # gap of any sleeping body
        for soft, frame in zip(self.bodies, frames, strict=True):
            rows, gaps = np.flatnonzero(fresh & self._meetable[soft]), np.zeros(0)
            gap = beyond
            if len(rows):
                sphere = (soft.middle, soft.radius)
                gaps = NearShapes(colliders, rows).gaps(frame, sphere, soft.points, soft.skin)
                gap = min(float(gaps.min()), beyond)
                rows, gaps = rows[gaps < NEAR_BODY], gaps[gaps < NEAR_BODY]
            if soft.near is None or not np.array_equal(rows, soft.near.rows):
                soft.near = NearShapes(colliders, rows)
            if gap < WAKE:
                soft.wake(frame, NearShapes(colliders, rows[gaps < WAKE]))
            elif soft.is_awake and soft.deviation() < SETTLED:
                soft.sleep()
            if not soft.is_awake:
                least = min(least, gap)
        wait = LOOK if any(soft.is_awake for soft in self.bodies) else LOOK_ASLEEP
        if least < math.inf:
            wait = min(wait, int((least - WAKE) / (MAX_SPEED * self._world.physics_dt)))
        return max(wait, 1)

    def _fetch(self, colliders: Colliders, grouped: list[Links]) -> None:
        """Read the states of links; let those set from pose to pose move there within the step."""
        period = self._world.physics_dt
        for row, state in colliders.fetch(grouped):
            step, last, before = self._history.get(row, (-2, state, None))
            if step != self._steps:
                before = last if step == self._steps - 1 else None
                self._history[row] = (self._steps, state, before)
            if before is None or state[:7] == before[:7]:
                continue
            if any(abs(value) > _AT_REST for value in state[7:]):
                continue
            out, pose = colliders.states[row], np.array(before[:7])
            apart = out[:3] - pose[:3]
            if float(apart @ apart) < (MAX_SPEED * period) ** 2:
                turn = rotation_vector(multiply(out[3:7], conjugate(pose[3:]))) / period
                out[:7], out[7:10], out[10:] = pose, apart / period, turn
                colliders.forget_poses()

    def _advance_bodies(self, colliders: Colliders, period: float) -> None:
        """Simulate all awake soft bodies, and note how they push free links."""
        for row in self._answering:
            self._foresee(colliders.states[row], row, period)
        for soft in self.bodies:
            if not soft.is_awake:
                continue
            soft.advance(colliders, period, soft.frame())
            for touch in soft.contacts:
                row = colliders.row_of[touch.body, touch.link]
                if row in self._masses:
                    ax, ay, az = touch.point - colliders.states[row, :3]
                    fx, fy, fz = touch.force
                    moment = (ay * fz - az * fy, az * fx - ax * fz, ax * fy - ay * fx)
                    self._pushes[row] = self._pushes.get(row, _NO_PUSH) + (fx, fy, fz, *moment)

    def _foresee(self, state: Array, row: int, period: float) -> None:
        """Let a link without joints answer weight and push within the step, as far as it is free to.

        How far it is, the last step has shown: one that is bonded to a gripper did not answer at all.
        """
        mass, inertia = self._masses[row]
        push, share = self._pushed.get(row, _NO_PUSH), 1.0
        _, now, before = self._history[row]
        if before is not None:
            share = kernel.answer(
                np.array(before), np.array(now), mass, push, self._gravity, period
            )
        kernel.foresee(state, mass, inertia, push, self._gravity, share * period)


_NO_PUSH = np.zeros(6)
_NO_VESSELS = np.empty((0, VESSEL))
