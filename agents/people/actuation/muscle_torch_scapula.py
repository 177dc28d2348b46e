"""Shoulder blades that follow the arm, in torch: the mathematics of `scapula.py` for many people at once."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import torch
from torch import Tensor

from ..body.scapula import ANGLES, T_POSE
from .muscle_layout import (
    AWAY,
    BLADE_ROWS,
    COLLAR,
    COLLAR_TURN,
    FIRST_DOF,
    HUMERUS,
    SECOND_DOF,
    SHAFT,
    SHOULDER,
    SIDE,
    PathLayout,
)


class TorchScapulae(torch.nn.Module):
    """The s shoulder blades of a layout: their frames, after those of the parts."""

    if TYPE_CHECKING:

        def __getattr__(self, name: str) -> Tensor: ...

    def __init__(self, layout: PathLayout, rows: np.typing.NDArray[np.int64]) -> None:
        """Copy what a layout says.

        Args:
            layout: The paths.
            rows: Where the frame of each row of the layout is, shape [n + 1].
        """
        super().__init__()
        table, blades = layout.scapulae, layout.blades
        led = table[:, [FIRST_DOF, SECOND_DOF]]
        side = np.where(
            np.eye(3) + [[0, 0, 0], [0, 0, 1], [0, 1, 0]] > 0, 1, table[:, SIDE, None, None]
        )
        mirrored = table[:, SIDE, None] * [1, 0, 0] + [0, 1, 1]
        for name, values in (
            ("_collar", rows[table[:, COLLAR]]),
            ("_humerus", rows[table[:, HUMERUS]]),
            ("_dofs", np.maximum(rows[led] - 1, 0).ravel()),
            ("_is_led", (led > 0)[..., None, None].astype(float)),
            ("_collar_turn", blades[:, COLLAR_TURN : COLLAR_TURN + 9].reshape(-1, 3, 3, 1)),
            ("_shoulder", blades[:, SHOULDER : SHOULDER + 3, None]),
            ("_away", blades[:, AWAY : AWAY + 3, None]),
            ("_shaft", blades[:, SHAFT : SHAFT + 3, None]),
            ("_side", side[..., None].astype(float)),
            ("_mirrored", mirrored[..., None].astype(float)),
            ("_angles", np.array(ANGLES)),
            ("_rest", T_POSE.T[None, :, :, None].copy()),
        ):
            self.register_buffer(name, torch.tensor(values), persistent=False)

    def forward(
        self, rotations: Tensor, places: Tensor, axes: Tensor
    ) -> tuple[Tensor, Tensor, Tensor]:
        """Return rotations [4 s, 3, 3, n], origins [m] [4 s, 3, n] and screws [4 s, 6, n] of all blades.

        Args:
            rotations: Of the pelvis and all parts, shape [k + 1, 3, 3, n].
            places: Their origins [m], shape [k + 1, 3, n].
            axes: Of the joints, shape [k, 3, n].
        """
        collar = rotations.index_select(0, self._collar)
        arm = rotations.index_select(0, self._humerus)
        base = torch.einsum("sabn,sbcn->sacn", collar, self._collar_turn.expand_as(collar))
        shaft = (arm * self._shaft[:, None]).sum(2)
        centre = (arm * self._shoulder[:, None]).sum(2)
        centre = centre + places.index_select(0, self._humerus)
        around = centre + (base * self._away[:, None]).sum(2)
        turn, spin = self._turned((base * shaft[:, :, None]).sum(1))
        turn = torch.einsum("sabn,sbcn->sacn", base, turn)
        own = axes.index_select(0, self._dofs).view(len(base), 2, 3, -1) * self._is_led
        swept = torch.linalg.cross(own, shaft[:, None].expand_as(own), dim=2)
        swept = torch.einsum("skan,sabn->skbn", swept, base)
        swept = torch.einsum("sabn,skbn->skan", spin, swept)
        swept = torch.einsum("sabn,skbn->skan", base, swept)
        n = turn.shape[-1]
        blade = torch.cat(
            (swept, torch.linalg.cross(around[:, None].expand_as(swept), swept, dim=2)), 2
        )
        humerus = torch.cat(
            (own, torch.linalg.cross(centre[:, None].expand_as(own), own, dim=2)), 2
        )
        return (
            turn[:, None].expand(-1, BLADE_ROWS, -1, -1, -1).reshape(-1, 3, 3, n),
            around[:, None].expand(-1, BLADE_ROWS, -1, -1).reshape(-1, 3, n),
            torch.cat((blade, humerus - blade), 1).reshape(-1, 6, n),
        )

    def _turned(self, direction: Tensor) -> tuple[Tensor, Tensor]:
        """Return the rotation of each blade and its spin by that of the direction, [s, 3, 3, n]."""
        side, up, front = (direction * self._mirrored).unbind(1)
        one = torch.ones_like(up)
        values = torch.stack((one, up, up**3, front - side))
        p, u, t = torch.einsum("ab,bsn->asn", self._angles, values)
        by_up = self._angles[:, 1, None, None] + self._angles[:, 2, None, None] * 3.0 * up * up
        by_front = self._angles[:, 3, None, None].expand_as(by_up)
        slope = torch.stack((-by_front, by_up, by_front), 2)  # [3 angles, s, 3, n]
        sp, cp, su, cu, st, ct = (f(x) for x in (-p, u, -t) for f in (torch.sin, torch.cos))
        entries = (
            *(cp * cu, -cp * su * ct + sp * st, cp * su * st + sp * ct),
            *(su, cu * ct, -cu * st),
            *(-sp * cu, sp * su * ct + cp * st, -sp * su * st + cp * ct),
        )
        whole = torch.stack(entries, 1).reshape(len(p), 3, 3, -1)
        zero = torch.zeros_like(p)
        axes = torch.stack(  # of protraction, upward rotation and posterior tilt
            (
                torch.stack((zero, -one, zero), 1),
                torch.stack((sp, zero, cp), 1),
                -whole[:, :, 0],
            )
        )
        spin = torch.einsum("ksan,ksbn->sabn", axes, slope)
        turn = torch.einsum("sabn,sbcn->sacn", whole, self._rest.expand_as(whole))
        # A mirror image turns the other way about y and z, and its x is the other way.
        around = self._mirrored * self._mirrored[:, :1]
        return turn * self._side, spin * around[:, :, None] * self._mirrored[:, None]
