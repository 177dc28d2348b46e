"""How far apart things are, by MuJoCo's own geometry."""

from __future__ import annotations

from typing import Any

import numpy as np
from llvmlite import ir
from numba import njit, types
from numba.extending import intrinsic as _intrinsic

from rcare_marl.pose import Array

from .native import Ints, function

intrinsic: Any = _intrinsic  # its stub has the caller give what numba gives


@intrinsic  # type: ignore[untyped-decorator]
def _distance(typing: Any, at: Any, model: Any, data: Any, one: Any, other: Any, most: Any) -> Any:
    """Call `mj_geomDistance` at an address: the distance of two geoms [m], `most` if it is greater."""

    def make(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        real, long, short = ir.DoubleType(), ir.IntType(64), ir.IntType(32)
        kind = ir.FunctionType(real, [long, long, short, short, real, long])
        numbers = [builder.trunc(number, short) for number in args[3:5]]
        told = [args[1], args[2], *numbers, args[5], ir.Constant(long, 0)]
        return builder.call(builder.inttoptr(args[0], kind.as_pointer()), told)

    whole = types.int64
    return types.float64(whole, whole, whole, whole, whole, types.float64), make


class Gaps:
    """Distances of groups of geoms from another group of a scene."""

    def __init__(self, model: Any, data: Any, rounding: Array) -> None:
        """Take a scene, and by how much the geoms are thicker than they are to MuJoCo [m], shape [ngeom]."""
        addresses = (function("mj_geomDistance"), model._address, data._address)
        self._scene = np.array(addresses, np.int64), data.geom_xpos, model.geom_rbound, rounding

    def between(self, geoms: Ints, starts: Ints, others: Ints, within: float) -> list[float]:
        """Return the distance of each group from the others [m], `within` at most, as if there are none.

        Args:
            geoms: Those of all groups, one after the other.
            starts: Where each group begins in them, and the last one ends, shape [groups + 1].
            others: The other geoms.
            within: How far to look [m].
        """
        if not len(others):  # compiled code does not look
            return [within] * (len(starts) - 1)
        found: Array = _gaps(self._scene, geoms, starts, others, within)
        return found.tolist()


@njit(cache=True, error_model="numpy")
def _gaps(scene, geoms, starts, others, within):  # type: ignore[no-untyped-def]
    """Return distances, shape [groups]; spheres round the geoms spare most of the work."""
    calls, spots, reach, rounding = scene
    at, model, data = calls[0], calls[1], calls[2]
    found = np.full(len(starts) - 1, within)
    least = np.empty(len(others))
    for group in range(len(found)):
        for k in range(starts[group], starts[group + 1]):
            one, first = geoms[k], 0
            for i, other in enumerate(others):
                far = 0.0
                for axis in range(3):
                    far += (spots[one, axis] - spots[other, axis]) ** 2
                least[i] = np.sqrt(far) - reach[one] - reach[other]
                least[i] -= rounding[one] + rounding[other]
                if least[i] < least[first]:
                    first = i
            for step in range(-1, len(others)):  # what is likely to be nearest spares others
                i = first if step < 0 else step
                if least[i] < found[group] and step != first:
                    thicker = rounding[one] + rounding[others[i]]
                    gap = _distance(at, model, data, one, others[i], found[group] + thicker)
                    found[group] = min(found[group], gap - thicker)
    return found
