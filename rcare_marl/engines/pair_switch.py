"""Which links meet, switched in an episode: MuJoCo's masks and its list of pairs that do not."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import numpy as np

from rcare_marl.errors import WorldError

from .simulation import BodyPlaces, Simulation


class PairSwitch:
    """Collisions between links of two bodies, switched off and on."""

    def __init__(self, sim: Simulation) -> None:
        """Take a scene whose list of pairs has places to spare."""
        self._model = model = sim.model
        self._off = {int(pair) for pair in model.exclude_signature if pair >> 16}
        self._is_solid = np.zeros(model.nbody, np.bool_)
        self._is_solid[model.geom_bodyid[(model.geom_contype | model.geom_conaffinity) != 0]] = True
        self.mark()

    def switch(
        self,
        a: BodyPlaces,
        b: BodyPlaces,
        enabled: bool,
        *,
        links_a: Iterable[int],
        links_b: Sequence[int],
    ) -> None:
        """Let links, by Bullet's index, of two bodies collide or not.

        Raises:
            WorldError: If more pairs are told apart than there are places for.
        """
        one, other = self._solid(a, links_a), self._solid(b, links_b)
        pairs = {_pair(i, j): (i, j) for i in one for j in other}
        if not enabled:
            self._write(self._off | pairs.keys())
            return
        off = self._off - pairs.keys()
        shut = [pair for pair in pairs.values() if not self._masks_meet(*pair)]
        if shut:
            off |= self._open(a, b, set(pairs.values()))
        self._write(off)

    def _solid(self, places: BodyPlaces, links: Iterable[int]) -> list[int]:
        numbers = places.links[[link + 1 for link in links]].tolist()
        return [number for number in numbers if self._is_solid[number]]

    def _masks_meet(self, i: int, j: int) -> bool:
        kind, met = self._model.body_contype, self._model.body_conaffinity
        return bool(kind[i] & met[j] or kind[j] & met[i])

    def _open(self, a: BodyPlaces, b: BodyPlaces, wanted: set[tuple[int, int]]) -> set[int]:
        """Let all links of two bodies meet by their masks, and return the pairs that were not asked for."""
        every = range(-1, len(a.links) - 1), range(-1, len(b.links) - 1)
        one, other = self._solid(a, every[0]), self._solid(b, every[1])
        rest = {
            _pair(i, j)
            for i in one
            for j in other
            if (i, j) not in wanted and not self._masks_meet(i, j)
        }
        kinds = [np.bitwise_or.reduce(self._model.body_contype[side]) for side in (one, other)]
        for side, kind in zip((one, other), reversed(kinds), strict=True):
            self._model.body_conaffinity[side] |= kind
            self._model.geom_conaffinity[np.isin(self._model.geom_bodyid, side)] |= kind
        return rest

    def _write(self, off: set[int]) -> None:
        places = self._model.exclude_signature
        if len(off) > len(places):
            raise WorldError(
                f"engine 'mujoco' keeps {len(places)} pairs of links apart in this scene, and {len(off)} are "
                "asked for: switch whole bodies before the start, or use engine='bullet'"
            )
        self._off = off
        places[:] = sorted([1] * (len(places) - len(off)) + list(off))  # MuJoCo wants it sorted

    def mark(self) -> None:
        """Remember who meets."""
        model = self._model
        self._marked = set(self._off), model.body_conaffinity.copy(), model.geom_conaffinity.copy()

    def rewind(self) -> None:
        """Return to the marked state."""
        off, bodies, geoms = self._marked
        self._model.body_conaffinity[:], self._model.geom_conaffinity[:] = bodies, geoms
        if off != self._off:
            self._write(set(off))


def _pair(i: int, j: int) -> int:
    """Return a pair of MuJoCo's bodies as one number, as it has them."""
    return (min(i, j) << 16) + max(i, j)
