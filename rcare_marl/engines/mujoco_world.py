"""A world that is built in Bullet, and moves in MuJoCo from `mark_start` on.

Bullet keeps what does not move: shapes, masses, surfaces. It is posed anew where somebody asks how far
apart bodies are, and never stepped again.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import TYPE_CHECKING, Any

from rcare_marl.attachment import Attachment
from rcare_marl.body import Body
from rcare_marl.errors import WorldError
from rcare_marl.scene.scene import scene_of
from rcare_marl.separation import Near
from rcare_marl.world import World

from .mujoco_body import MujocoBody
from .native import Ints
from .row_order import BOND, TIE, Row, RowOrder
from .simulation import BodyPlaces, Simulation
from .spare_bonds import SpareBonds

if TYPE_CHECKING:
    from collections.abc import Mapping


class MujocoBond(Attachment):
    """A bond that is an equality of MuJoCo's model once its world was marked."""

    _world: MujocoWorld

    def _make(self) -> None:
        if self._world.sim is not None:
            ends = ((self.parent, self.link), (self.child, self.child_link))
            one, other = (int(self._world.body_places(b).links[link + 1]) for b, link in ends)
            self._world.spare_bonds.make(self, (one, other))
        super()._make()
        self._world.row_order.add((BOND, self, 0))
        self._world.order_rows()

    def _break(self) -> None:
        if self.is_active:
            self._world.row_order.remove((BOND, self, 0))
            if self._world.sim is not None:
                self._world.spare_bonds.end(self)
        super()._break()
        self._world.order_rows()

    def load(self) -> float:
        if self._world.sim is None:
            return super().load()
        return self._world.spare_bonds.load(self) if self.is_active else 0.0

    def set_force(self, force: float) -> None:
        super().set_force(force)
        if self._world.sim is not None and self.is_active:
            self._world.spare_bonds.set_force(self, force)


class MujocoWorld(World):
    """A world that moves in MuJoCo from `mark_start` on."""

    body_type = MujocoBody
    bond_type = MujocoBond
    spare_bonds: SpareBonds

    def __init__(self, *args: Any, **settings: Any) -> None:
        self.sim: Simulation | None = None
        self._feels = False
        self.row_order = RowOrder()
        super().__init__(*args, **settings)

    def mark_start(self) -> None:
        """Remember the present state, and go on in MuJoCo.

        Raises:
            ConfigError: If there is something that MuJoCo has not.
        """
        if self.sim is not None:
            self.sim.mark()
            self.spare_bonds.mark()
            self.sim.neighbours.mark()
            self.filter.mark()
            self._marked_iterations = self.solver_iterations
            self._marked = [(bond, bond.is_active) for bond in self.bonds]
            for matter in self.matter:
                matter.mark()
            return
        super().mark_start()
        self.sim = Simulation(scene_of(self), self.bodies)
        self.sim.feels[0] = self._feels
        self._numbers: Mapping[int, int] = {body.uid: i for i, body in enumerate(self.bodies)}
        self.spare_bonds = SpareBonds(self.sim, self.bonds)
        self.order_rows()
        # Some skins have handles of their own on a body; a marker's plate goes with its carrier.
        for body in (*self.bodies, *(skin.body for skin in self.skins)):
            if isinstance(body, MujocoBody) and body.sim is None:
                body.enter(self.sim, self._numbers[body.uid])
        self.sim.mark()

    def order_rows(self) -> None:
        """Let motors, ends of joints, gears and bonds be solved in Bullet's order."""
        if self.sim is not None:
            self.sim.order(self.row_order.sorted(self._is_apart), self.spare_bonds.numbers())

    def _is_apart(self, row: Row) -> bool:
        return isinstance(row[1], Body) and row[1] in self.sleeping

    def _join_islands(self) -> None:
        super()._join_islands()
        for tie in self._ties:
            self.row_order.add((TIE, tie, 0))

    def _part_islands(self) -> None:
        for tie in reversed(self._ties):
            self.row_order.remove((TIE, tie, 0))
        super()._part_islands()

    def step(self) -> None:
        if self.sim is None:
            super().step()
            return
        for matter in self.matter:
            matter.step()
        self.sim.step()
        self.step_count += 1

    @property
    def is_compiled(self) -> bool:
        return self.sim is not None and not self.matter

    def stepped(self, count: int) -> None:
        """Take note that compiled code made physics steps."""
        assert self.sim is not None
        self.sim.stepped()
        self.step_count += count

    def number(self, body: Body) -> int:
        """Return the number of a body in `Simulation.touched`."""
        return self._numbers[body.uid]

    def places(self, body: Body, indices: Sequence[int]) -> tuple[Ints, Ints]:
        """Return where joints are in MuJoCo's `qpos` and `qvel`, each of shape [n]."""
        assert self.sim is not None
        found, chosen = self.sim.places[self.number(body)], list(indices)
        return found.positions[chosen], found.dofs[chosen]

    def rewind(self) -> None:
        if self.sim is None:
            super().rewind()
            return
        marked = {bond for bond, _ in self._marked}
        for bond in self.bonds:
            if bond not in marked:
                bond._break()
        self.bonds = [bond for bond, _ in self._marked]
        self._restore_bonds()
        self.set_solver_iterations(self._marked_iterations)
        self.spare_bonds.rewind()
        self.order_rows()
        self.sim.neighbours.rewind()
        self.filter.rewind()
        self.sim.rewind()
        for matter in self.matter:
            matter.rewind()
        self.teleports += 1
        self.step_count = 0

    def set_solver_iterations(self, count: int) -> None:
        super().set_solver_iterations(count)
        if self.sim is not None:
            self.sim.set_iterations(count)

    def body_places(self, body: Body) -> BodyPlaces:
        """Return where a body is in MuJoCo's arrays, once the world was marked."""
        assert self.sim is not None
        return self.sim.places[self._numbers[body.uid]]

    def feel(self) -> None:
        """Let joint loads be worked out after each physics step."""
        self._feels = True
        if self.sim is not None:
            self.sim.feels[0] = True

    def set_collision(
        self,
        a: Body,
        b: Body,
        enabled: bool,
        *,
        links_a: Iterable[int] | None = None,
        links_b: Sequence[int] | None = None,
    ) -> None:
        super().set_collision(a, b, enabled, links_a=links_a, links_b=links_b)
        if self.sim is None:
            return
        if a.uid == b.uid:
            raise WorldError(
                f"engine 'mujoco' cannot change which own links of {a.name!r} meet in an episode: do it "
                "before mark_start(), or use engine='bullet'"
            )
        first, second = (self.body_places(body) for body in (a, b))
        chosen = range(-1, a.link_count) if links_a is None else links_a
        others = range(-1, b.link_count) if links_b is None else links_b
        one, other = (
            places.links[[link + 1 for link in which]]
            for places, which in ((first, chosen), (second, others))
        )
        self.sim.neighbours.switch(one, other, enabled)

    def _points(self, a: Body, b: Body | None) -> Sequence[Any]:
        if self.sim is None:
            return super()._points(a, b)
        points = self.sim.points(self._numbers[a.uid])
        if b is not None:
            return [p for p in points if p[2] == b.uid]
        return [p for p in points if p[1] != p[2]]

    def _all_points(self) -> Sequence[Any]:
        return super()._all_points() if self.sim is None else self.sim.points(None)

    def show(self) -> None:
        self._mirror(*self.bodies)

    def separation(
        self,
        a: Body,
        b: Body,
        *,
        within: float,
        links: tuple[int, int | None] | None = None,
    ) -> float:
        self._mirror(a, b)
        return super().separation(a, b, within=within, links=links)

    def near(
        self,
        a: Body,
        b: Body,
        *,
        within: float,
        links: tuple[int | None, int | None] = (None, None),
    ) -> list[Near]:
        self._mirror(a, b)
        return super().near(a, b, within=within, links=links)

    def gaps(
        self,
        links: Sequence[tuple[Body, int]],
        other: Body,
        *,
        within: float,
        before: Sequence[float] = (),
    ) -> list[float]:
        if self.sim is None:
            return super().gaps(links, other, within=within, before=before)
        numbers = self._numbers
        return self.sim.gaps([(numbers[b.uid], i) for b, i in links], numbers[other.uid], within)

    def _mirror(self, *bodies: Body) -> None:
        for body in bodies:
            if isinstance(body, MujocoBody):
                body.mirror()
