"""The physics world: one PyBullet client with its clock, snapshots, contacts and attachments.

Conventions everywhere in this package: SI units, right-handed world frame with z up,
quaternions as (x, y, z, w), joints and links addressed by their URDF name.
"""

from __future__ import annotations

import weakref
from collections.abc import Collection, Container, Iterable, Sequence
from pathlib import Path
from typing import Any

from rcare_marl.bullet import bullet
from rcare_marl.separation import ALL_LINKS, Near, SeparationQuery
from rcare_marl.sleeping import SleepingBodies

from .attachment import Attachment
from .body import Body
from .contact import Contact, Press, Touch
from .errors import ConfigError, WorldError
from .model.shape import Shape
from .model.urdf import Model, lump
from .pair_filter import PairFilter
from .pose import Pose, Vector
from .world_part import Lines as Lines
from .world_part import Skin as Skin
from .world_part import SteppedMatter as SteppedMatter

GRAVITY = 9.81  # [m/s²]
FAR_AWAY = 100.0  # [m]
SOLVER_ITERATIONS = 30  # of Bullet's 50: food stays on the spoon just as well


class World:
    """One PyBullet client with its clock. All simulated state lives here.

    Attributes:
        client: Id of the physics client, -1 once closed.
        physics_dt: Length of one physics step [s].
        step_count: Physics steps since the start or the last `rewind`.
        bodies: Every body, in the order of loading.
        skins: Deforming surfaces for the renderers.
        lines: Thin tubes for the renderers, such as muscles.
        matter: What is simulated beside Bullet, such as soft bodies.
        sleeping: Bodies that sleep while nobody uses them.
        bonds: All bonds, broken ones too, in the order in which they were made.
        teleports: How often a body was set to a pose or joint angle instead of moving there.
        solver_iterations: Of the solver in each physics step; see `set_solver_iterations`.
    """

    body_type: type[Body] = Body
    bond_type: type[Attachment] = Attachment

    def __init__(
        self, physics_dt: float = 1 / 240, *, solver_iterations: int = SOLVER_ITERATIONS
    ) -> None:
        """Connect a private physics client.

        Args:
            physics_dt: Length of one physics step [s].
            solver_iterations: See `set_solver_iterations`.

        Raises:
            ConfigError: If `physics_dt` or `solver_iterations` is not a positive number.
        """
        if not 0 < physics_dt < 1:
            raise ConfigError(f"physics_dt must lie between 0 and 1 s, got {physics_dt}")
        self.client: int = bullet.connect(bullet.DIRECT)
        if self.client < 0:
            raise WorldError("PyBullet has no free physics client left: close some environments")
        self._closer = weakref.finalize(self, _disconnect, self.client)
        self.physics_dt = physics_dt
        self.step_count = 0
        self.bodies: list[Body] = []
        self.skins: list[Skin] = []
        self.lines: list[Lines] = []
        self.matter: list[SteppedMatter] = []
        self.sleeping = SleepingBodies(self.client)
        self._ties: list[int] = []  # constraints without force between jointed bodies
        self._separations = SeparationQuery(self.client)
        self.filter = PairFilter(self.client)
        self.teleports = 0
        self.own_groups = 0  # bodies that have a collision group of their own
        self.bonds: list[Attachment] = []
        self._marked: list[tuple[Attachment, bool]] = []
        self._start: int | None = None
        # Bullet's usual broad phase drops stale pairs in an order that depends on all it has ever seen.
        bullet.resetSimulation(bullet.RESET_USE_SIMPLE_BROADPHASE, physicsClientId=self.client)
        # Bullet sorts overlapping pairs by address unless told otherwise: that breaks repeatability.
        bullet.setPhysicsEngineParameter(
            fixedTimeStep=physics_dt, deterministicOverlappingPairs=1, physicsClientId=self.client
        )
        self.set_solver_iterations(solver_iterations)
        bullet.setGravity(0, 0, -GRAVITY, physicsClientId=self.client)

    def set_solver_iterations(self, count: int) -> None:
        """Let the solver go over contacts, bonds and motors `count` times a physics step, 1 to 1000.

        A heavy load on something light needs more; a step costs nearly in proportion. `rewind` brings
        back the number at `mark_start`. ConfigError if `count` is no such number.
        """
        if isinstance(count, bool) or not isinstance(count, int) or not 0 < count <= 1000:
            raise ConfigError(f"solver iterations must be a whole number, 1 to 1000, got {count!r}")
        self.solver_iterations = count
        bullet.setPhysicsEngineParameter(numSolverIterations=count, physicsClientId=self.client)

    @property
    def time(self) -> float:
        """Simulated time since the start or the last `rewind` [s]."""
        return self.step_count * self.physics_dt

    def load_urdf(
        self,
        path: str | Path,
        pose: Pose = Pose(),
        *,
        name: str = "",
        fixed: bool = True,
        self_collision: bool = False,
    ) -> Body:
        """Load a URDF with the frame of its base link at `pose` and return a handle on it.

        Args:
            path: The URDF file.
            pose: Pose of the base link.
            name: Name in this world; the file's stem if empty.
            fixed: Whether the base is held in place.
            self_collision: Whether links that are not parent and child collide with each other.

        Raises:
            ConfigError: If there is no such file, or Bullet cannot read it.
        """
        self._check_unmarked("load a body")
        if not Path(path).is_file():
            raise ConfigError(f"no URDF at {path}")
        flags = bullet.URDF_USE_INERTIA_FROM_FILE
        if self_collision:
            flags |= bullet.URDF_USE_SELF_COLLISION | bullet.URDF_USE_SELF_COLLISION_EXCLUDE_PARENT
        try:
            uid = bullet.loadURDF(
                str(path), useFixedBase=fixed, flags=flags, physicsClientId=self.client
            )
        except bullet.error as error:
            raise ConfigError(f"Bullet cannot read the URDF {path}: {error}") from error
        body = self._register(uid, name or Path(path).stem, Path(path))
        body.meets_itself = self_collision
        body.set_base(pose)
        return body

    def add_sphere(
        self,
        radius: float,
        pose: Pose = Pose(),
        *,
        mass: float = 0.0,
        name: str = "sphere",
        rgba: Vector = (0.8, 0.8, 0.8, 1.0),
        collides: bool = True,
    ) -> Body:
        """Add a sphere of `radius` [m] and `mass` [kg]; mass 0 makes it immovable."""
        return self._add(Shape("sphere", radius=radius), pose, mass, name, rgba, collides)

    def add_box(
        self,
        size: Vector,
        pose: Pose = Pose(),
        *,
        mass: float = 0.0,
        name: str = "box",
        rgba: Vector = (0.8, 0.8, 0.8, 1.0),
        collides: bool = True,
    ) -> Body:
        """Add a box with edges `size` [m], shape [3], and `mass` [kg]; mass 0 makes it immovable."""
        x, y, z = (float(edge) for edge in size)
        return self._add(Shape("box", size=(x, y, z)), pose, mass, name, rgba, collides)

    def _add(
        self, solid: Shape, pose: Pose, mass: float, name: str, rgba: Vector, collides: bool
    ) -> Body:
        self._check_unmarked("add a body")
        geometry: dict[str, float | list[float]] = {"radius": solid.radius}
        kind = bullet.GEOM_SPHERE
        if solid.kind == "box":
            kind, geometry = bullet.GEOM_BOX, {"halfExtents": [0.5 * edge for edge in solid.size]}
        shape, client = -1, self.client
        if collides:
            shape = bullet.createCollisionShape(kind, **geometry, physicsClientId=client)
        drawn = bullet.createVisualShape(kind, **geometry, rgbaColor=rgba, physicsClientId=client)
        uid = bullet.createMultiBody(
            mass, shape, drawn, pose.position, pose.quaternion, physicsClientId=client
        )
        return self._register(uid, name, lump(name, solid, mass, rgba, collides=collides))

    def _register(self, uid: int, name: str, source: Path | Model) -> Body:
        taken = {body.name for body in self.bodies}
        unique = name if name not in taken else f"{name}_{uid}"
        body = self.body_type(self, uid, unique, source)
        self.bodies.append(body)
        return body

    def attach(
        self,
        parent: Body,
        link: str,
        child: Body,
        child_in_link: Pose | None = None,
        *,
        force: float = 500.0,
        child_link: str | None = None,
        pivot: Vector | None = None,
    ) -> Attachment:
        """Bond `child` to a link of `parent`.

        Args:
            parent: The body that holds.
            link: The link that holds.
            child: The body that is held.
            child_in_link: Pose of the held frame in the frame of the link; as it is now if None.
            force: Greatest force of the bond [N].
            child_link: The link by which the child is held; its base if None.
            pivot: A point in the frame of the link [m], shape [3], about which the child may turn;
                the bond is rigid if None.
        """
        index = parent.link_index(link)
        child_index = -1 if child_link is None else child.link_index(child_link)
        if child_in_link is None:
            child_in_link = parent.link_pose(index).inverse() @ child.link_pose(child_index)
        point = None if pivot is None else tuple(float(value) for value in pivot)
        attachment = self.bond_type(
            self, parent, index, child, child_index, child_in_link, force, point
        )
        attachment._make()
        self.bonds.append(attachment)
        return attachment

    def detach(self, attachment: Attachment) -> None:
        """Break a bond; breaking it twice does no harm."""
        attachment._break()

    def set_collision(
        self,
        a: Body,
        b: Body,
        enabled: bool,
        *,
        links_a: Iterable[int] | None = None,
        links_b: Sequence[int] | None = None,
    ) -> None:
        """Switch the collision of all links of `a` (or `links_a`) with those of `b` (or `links_b`)."""
        for link_a in range(-1, a.link_count) if links_a is None else links_a:
            for link_b in range(-1, b.link_count) if links_b is None else links_b:
                self.filter.set((a.uid, link_a), (b.uid, link_b), enabled)

    @property
    def is_compiled(self) -> bool:
        """Whether compiled code can step it, with nothing of Python between."""
        return False

    def step(self) -> None:
        """Advance by one physics step."""
        for matter in self.matter:
            matter.step()
        bullet.stepSimulation(self.client)
        self.step_count += 1

    def mark_start(self) -> None:
        """Remember the present state as the one that `rewind` returns to.

        From here on no body can be added: the state could not be restored.
        """
        if self._start is None:
            self._join_islands()
        else:
            bullet.removeState(self._start, physicsClientId=self.client)
        self._start = bullet.saveState(physicsClientId=self.client)
        self._marked = [(a, a.is_active) for a in self.bonds]
        self._marked_iterations = self.solver_iterations
        self.filter.mark()
        for matter in self.matter:
            matter.mark()

    def _join_islands(self) -> None:
        """Tie all jointed bodies together by constraints without force.

        The solver sorts constraints by the island of touching bodies that they belong to, and how it
        numbers islands depends on what the broad phase has seen since the client was made: with few
        iterations the order shows in the seventh digit. Bodies in one island are always in one order.
        """
        jointed = [b for b in self.bodies if b.joints and b not in self.sleeping]
        for a, b in zip(jointed, jointed[1:], strict=False):
            first, second = (next(iter(body.joints.values())).index for body in (a, b))
            pair, frames = (a.uid, first, b.uid, second), ((1, 0, 0), (0, 0, 0), (0, 0, 0))
            uid = bullet.createConstraint(
                *pair, bullet.JOINT_GEAR, *frames, physicsClientId=self.client
            )
            bullet.changeConstraint(uid, gearRatio=1, maxForce=0, physicsClientId=self.client)
            self._ties.append(uid)

    def _part_islands(self) -> None:
        while self._ties:
            bullet.removeConstraint(self._ties.pop(), physicsClientId=self.client)

    def _restore_bonds(self) -> None:
        """Make all bonds as they were marked, in the order in which they were: it is the solver's."""
        if all(a.is_active == was_active for a, was_active in self._marked):
            return
        self._part_islands()  # ties came after the bonds
        for attachment, _ in self._marked:
            attachment._break()
        for attachment, was_active in self._marked:
            if was_active:
                attachment._make()
        self._join_islands()

    def rewind(self) -> None:
        """Return to the marked state, attachments included, and set the clock to zero.

        Raises:
            WorldError: If `mark_start` was never called.
        """
        if self._start is None:
            raise WorldError("rewind() needs a state to return to: call mark_start() first")
        marked = {attachment for attachment, _ in self._marked}
        for attachment in self.bonds:
            if attachment not in marked:
                attachment._break()
        self.bonds = [attachment for attachment, _ in self._marked]
        self._restore_bonds()
        self.set_solver_iterations(self._marked_iterations)
        self.filter.rewind()
        bullet.restoreState(self._start, physicsClientId=self.client)
        self._forget_pairs()
        self.sleeping.begin()  # far apart: none wakes another
        bullet.restoreState(self._start, physicsClientId=self.client)
        bullet.performCollisionDetection(physicsClientId=self.client)
        for matter in self.matter:
            matter.rewind()
        self.step_count = 0

    def _forget_pairs(self) -> None:
        """Let the broad phase forget the last episode: pairs, which `restoreState` keeps, order the solver.

        Far away no pair is left, nor one of own links that may not meet.
        """
        for i, body in enumerate(self.bodies):
            body.part_own(True)
            if body.joints or body.is_movable:
                body.set_base(Pose((FAR_AWAY * (i + 1), FAR_AWAY, FAR_AWAY)))
        bullet.performCollisionDetection(physicsClientId=self.client)
        for body in self.bodies:
            body.part_own(False)

    def contacts(self, a: Body, b: Body | None = None) -> list[Contact]:
        """Return the contact points of `a` with `b`, or with anything else, after the last step."""
        found = [Contact(p[3], p[4], p[6], p[7], p[8], p[9]) for p in self._points(a, b)]
        for matter in self.matter:
            found.extend(matter.contacts(a, b))
        return found

    def nearest(self, a: Body, b: Body, *, within: float) -> list[Contact]:
        """Return the nearest points of links of two bodies, closer than `within` [m], without forces."""
        self.show()
        points = bullet.getClosestPoints(a.uid, b.uid, within, physicsClientId=self.client) or ()
        return [Contact(p[3], p[4], p[6], p[7], p[8], 0.0) for p in points]

    def touches(self, a: Body) -> list[Touch]:
        """Return what others' contacts did to `a` in the last step; soft matter's friction is in `force`."""
        found = []
        # Asked for one body, Bullet turns its normals as needed, but not the friction: ask for all.
        for p in self._all_points():
            for own, side in ((p[1], 1), (p[2], -1)):
                if own != a.uid or p[1] == p[2] or p[9] <= 0:
                    continue
                link, other, point = (p[3], p[2], p[6]) if side > 0 else (p[4], p[1], p[5])
                (nx, ny, nz), (ax, ay, az), (bx, by, bz) = p[7], p[11], p[13]
                u, v = side * p[10], side * p[12]
                drag = (u * ax + v * bx, u * ay + v * by, u * az + v * bz)
                push = (side * nx, side * ny, side * nz)
                found.append(Touch(link, other, point, push, p[9], drag))
        for matter in self.matter:
            for c in matter.contacts(a):
                found.append(Touch(c.link_a, -1, c.position, c.normal, c.force, (0.0, 0.0, 0.0)))
        return found

    def held_by(self, body: Body, links: Collection[int] | None = None) -> list[Body]:
        """Return the bodies that bonds of `body` hold at present, and what those hold in turn.

        Args:
            body: Who holds.
            links: With which links; any if None.
        """
        found = [body]
        for holder in found:  # grows as it goes
            for bond in self.bonds:
                if bond.is_active and bond.parent is holder and bond.child not in found:
                    if holder is not body or links is None or bond.link in links:
                        found.append(bond.child)
        return found[1:]

    def contact_force(self, a: Body, b: Body | None = None) -> float:
        """Return the summed normal force on `a` by `b`, or by everything else [N]."""
        total: float = sum([point[9] for point in self._points(a, b)], 0.0)
        for matter in self.matter:
            total += sum([contact.force for contact in matter.contacts(a, b)])
        return total

    def pressing(self, a: Body, spared: Container[int] = ()) -> list[Press]:
        """Return what pressed on `a` in the last step, but for the bodies with ids `spared`.

        It is that of `touches` which takes little time.
        """
        points = self._points(a, None)
        found = [(p[3], p[6], p[9]) for p in points if p[9] > 0 and p[2] not in spared]
        for matter in self.matter:
            found.extend([(c.link_a, c.position, c.force) for c in matter.contacts(a)])
        return found

    def _points(self, a: Body, b: Body | None) -> Sequence[Any]:
        other, own = -1 if b is None else b.uid, a.uid  # no keywords: each costs half a microsecond
        points = bullet.getContactPoints(own, other, ALL_LINKS, ALL_LINKS, self.client) or ()
        return points if b is not None else [p for p in points if p[1] != p[2]]

    def _all_points(self) -> Sequence[Any]:
        return bullet.getContactPoints(physicsClientId=self.client) or ()

    def show(self) -> None:
        """Let Bullet know where everything is, where something else moves it: before asking it for rays."""

    def separation(
        self,
        a: Body,
        b: Body,
        *,
        within: float,
        links: tuple[int, int | None] | None = None,
    ) -> float:
        """Return the least distance between two bodies [m], negative in overlap; `within` at most.

        Args:
            a: A body.
            b: Another.
            within: How far to look [m].
            links: A link of each that alone counts, or of `a` and None; all if None.
        """
        if links is not None:
            other = ALL_LINKS if links[1] is None else links[1]
            return self._separations.exact(a, b, within, links[0], other)
        own = [(a, link) for link in self._separations.boxes(a).links]
        return min(self.gaps(own, b, within=within), default=within)

    def near(
        self,
        a: Body,
        b: Body,
        *,
        within: float,
        links: tuple[int | None, int | None] = (None, None),
    ) -> list[Near]:
        """Return where the links of a body are no farther than `within` [m] from those of another.

        Args:
            a: A body.
            b: Another.
            within: How far to look [m].
            links: The link of each that alone counts, -1 its base; all of a body if None.
        """
        one, other = (ALL_LINKS if link is None else link for link in links)
        return self._separations.near(a, b, within, one, other)

    def gaps(
        self,
        links: Sequence[tuple[Body, int]],
        other: Body,
        *,
        within: float,
        before: Sequence[float] = (),
    ) -> list[float]:
        """Return how far each of some links is from a body [m]; as `separation`, in one go.

        The links must have collision shapes. What was returned shortly `before` makes it faster.
        """
        now = (self.step_count, self.teleports)
        return self._separations.gaps(links, other, within, before, now)

    def close(self) -> None:
        """Disconnect the client; safe to call twice."""
        self._closer()
        self.client = -1

    def _check_unmarked(self, what: str) -> None:
        if self._start is not None:
            raise WorldError(f"cannot {what} after mark_start(): create every body before it")


def _disconnect(client: int) -> None:
    if bullet.isConnected(client):
        bullet.disconnect(client)
