"""Bonds that are made and broken in an episode: equalities that MuJoCo's model has to spare."""

from __future__ import annotations

from typing import Any

import mujoco
import numpy as np

from rcare_marl.attachment import Attachment
from rcare_marl.errors import WorldError
from rcare_marl.pose import Pose

from .simulation import Simulation

_WELD, _CONNECT = int(mujoco.mjtEq.mjEQ_WELD), int(mujoco.mjtEq.mjEQ_CONNECT)
_IS_BOND = int(mujoco.mjtConstraint.mjCNSTR_EQUALITY)


class SpareBonds:
    """Which equality of MuJoCo's model each bond of a world is."""

    def __init__(self, sim: Simulation, bonds: list[Attachment]) -> None:
        """Take the bonds that the scene had, in its order."""
        self._sim, model = sim, sim.model
        names = [model.equality(i).name for i in range(model.neq)]
        self._own = {bond: names.index(f"bond:{i}") for i, bond in enumerate(bonds)}
        self._spare = [i for i, name in enumerate(names) if name.startswith("spare:")]
        self._taken: dict[Attachment, int] = {}
        self.mark()

    def make(self, bond: Attachment, ends: tuple[int, int]) -> None:
        """Let a bond hold from now on.

        Args:
            bond: The bond.
            ends: MuJoCo's numbers of the link that holds and the one that is held.

        Raises:
            WorldError: If no equality is left.
        """
        if bond in self._own:
            self._sim.data.eq_active[self._own[bond]] = True
            return
        free = [number for number in self._spare if number not in self._taken.values()]
        if not free:
            raise WorldError(
                f"engine 'mujoco' holds {len(self._spare)} bonds at a time that are made in an episode: "
                "break one first, or use engine='bullet'"
            )
        number, model = free[0], self._sim.model
        self._taken[bond] = number
        model.eq_type[number] = _WELD if bond.pivot is None else _CONNECT
        model.eq_obj1id[number], model.eq_obj2id[number] = ends
        row = model.eq_data[number]
        row[:] = 0.0
        if bond.pivot is None:
            x, y, z, w = bond.child_in_link.quaternion
            row[3:11] = (*bond.child_in_link.position, w, x, y, z, 1.0)
        else:
            row[:3] = bond.pivot
            row[3:6] = (bond.child_in_link.inverse() @ Pose(bond.pivot)).position
        self._sim.strengths[number] = bond.force
        self._sim.data.eq_active[number] = True

    def end(self, bond: Attachment) -> None:
        """Let a bond hold no more."""
        number = self._own.get(bond)
        if number is None:
            number = self._taken.pop(bond)
        self._sim.data.eq_active[number] = False

    def set_force(self, bond: Attachment, force: float) -> None:
        """Change the greatest force of a bond that holds [N]."""
        self._sim.strengths[self._number(bond)] = force

    def load(self, bond: Attachment) -> float:
        """Return the force that a bond bore in the last physics step [N]."""
        data = self._sim.data
        kinds, ids = data.efc_type, data.efc_id
        rows = np.flatnonzero((kinds == _IS_BOND) & (ids == self._number(bond)))
        return float(np.linalg.norm(data.efc_force[rows[:3]]))  # those of turning come after

    def numbers(self) -> dict[Attachment, int]:
        """Return which equality each bond is."""
        return self._own | self._taken

    def _number(self, bond: Attachment) -> int:
        return self._own[bond] if bond in self._own else self._taken[bond]

    def _arrays(self) -> list[Any]:
        model = self._sim.model
        return [model.eq_type, model.eq_obj1id, model.eq_obj2id, model.eq_data]

    def mark(self) -> None:
        """Remember which bond is which."""
        self._marked = dict(self._taken), [array.copy() for array in self._arrays()]

    def rewind(self) -> None:
        """Return to the marked state."""
        taken, kept = self._marked
        self._taken = dict(taken)
        for array, marked in zip(self._arrays(), kept, strict=True):
            array[:] = marked
