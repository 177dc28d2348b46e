"""MuJoCo's structs and functions for compiled code, by their addresses.

A call of MuJoCo's Python binding, and each look at an array that moves from step to step, costs as much as
a part of the step itself. So compiled code calls the library and reads `mjData` where it is; where each
field lies is told by the package's own description of its structs, and checked when a scene is built.
"""

from __future__ import annotations

import ctypes
from functools import cache
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
from llvmlite import ir
from numba import carray, njit, types  # type: ignore[attr-defined]
from numba.core import cgutils
from numba.extending import intrinsic as _intrinsic

from rcare_marl.errors import ConfigError

intrinsic: Any = _intrinsic  # its stub has the caller give what numba gives
Ints = npt.NDArray[np.int64]
# Each takes a model and its data.
FUNCTIONS = (
    "mj_kinematics",
    "mj_comPos",
    "mj_makeM",
    "mj_factorM",
    "mj_collision",
    "mj_makeConstraint",
    "mj_fwdVelocity",
    "mj_fwdAcceleration",
    "mj_Euler",
    "mj_rnePostConstraint",
)
FIELDS = (  # of mjData
    "ncon",
    "nefc",
    "contact",
    "efc_type",
    "efc_id",
    "efc_J_rownnz",
    "efc_J_rowadr",
    "efc_J_colind",
    "efc_J",
    "efc_pos",
    "efc_diagA",
    "efc_vel",
    "efc_force",
)
CONTACT_FIELDS = ("dist", "pos", "frame", "friction", "dim", "geom", "efc_address")
# Places in `addresses`: of functions, fields, and those of a contact.
(
    MODEL,
    DATA,
    KINEMATICS,
    COM,
    MATRIX,
    FACTORS,
    COLLISION,
    ROWS,
    VELOCITY,
    ACCELERATION,
    EULER,
    RNE,
) = range(12)
(
    NCON,
    NEFC,
    CONTACT,
    EFC_TYPE,
    EFC_ID,
    J_ROWNNZ,
    J_ROWADR,
    J_COLIND,
    EFC_J,
    EFC_POS,
    EFC_DIAG,
    EFC_VEL,
    EFC_FORCE,
) = range(12, 25)
DIST, POS, FRAME, FRICTION, DIM, GEOM, EFC_ADDRESS, CONTACT_SIZE = range(25, 33)
EQUALITY_ROW, FRICTION_ROW, LIMIT_ROW, CONTACT_ROW = 0, 1, 3, 7  # MuJoCo's mjtConstraint
_VALUES: dict[str, Any] = {
    "int": ctypes.c_int,
    "float": ctypes.c_float,
    "mjtNum": ctypes.c_double,
    "mjtSize": ctypes.c_int64,
    "mjtBool": ctypes.c_bool,
    "size_t": ctypes.c_size_t,
    "uintptr_t": ctypes.c_size_t,
    "uint64_t": ctypes.c_uint64,
}


@cache
def struct(name: str) -> Any:
    """Return one of MuJoCo's structs for `ctypes`."""
    from mujoco.introspect import ast_nodes, structs

    def laid_out(name: str, fields: Any) -> Any:
        return type(
            name, (ctypes.Structure,), {"_fields_": [(f.name, type_of(f.type)) for f in fields]}
        )

    def type_of(kind: Any) -> Any:
        if isinstance(kind, ast_nodes.PointerType):
            return ctypes.c_void_p
        if isinstance(kind, ast_nodes.ArrayType):
            return type_of(kind.inner_type) * int(np.prod(kind.extents))
        if isinstance(kind, ast_nodes.AnonymousStructDecl):
            return laid_out("unnamed", kind.fields)
        return _VALUES.get(kind.name) or struct(kind.name)

    return laid_out(name, structs.STRUCTS[name].fields)


def addresses(model: Any, data: Any) -> Ints:
    """Return where a model, its data, functions and fields are; see the constants of this module.

    Raises:
        ConfigError: If this version of MuJoCo lays its data out otherwise than it says.
    """
    kind, contact = struct("mjData"), struct("mjContact")
    seen = kind.from_address(data._address)
    told = (seen.nefc, seen.ncon, seen.qpos, seen.qfrc_applied)
    real = (data.nefc, data.ncon, data.qpos.ctypes.data, data.qfrc_applied.ctypes.data)
    if told != real:
        raise ConfigError(
            f"MuJoCo {version('mujoco')} lays out mjData otherwise than it says: install the version "
            "of constraints.txt"
        )
    return np.array(
        [
            model._address,
            data._address,
            *(function(name) for name in FUNCTIONS),
            *(getattr(kind, name).offset for name in FIELDS),
            *(getattr(contact, name).offset for name in CONTACT_FIELDS),
            contact_size(),
        ],
        np.int64,
    )


def contact_size() -> int:
    """Return how many bytes a contact takes."""
    return ctypes.sizeof(struct("mjContact"))


@cache
def function(name: str) -> int:
    """Return the address of one of MuJoCo's functions."""
    import mujoco

    (path,) = Path(mujoco.__file__).parent.glob("libmujoco*")
    found = ctypes.cast(getattr(ctypes.CDLL(str(path)), name), ctypes.c_void_p).value
    assert found is not None
    return found


@intrinsic  # type: ignore[untyped-decorator]
def _pointer(typing: Any, address: Any) -> Any:
    """Return a pointer to an address."""

    def make(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        return builder.inttoptr(args[0], cgutils.voidptr_t)

    return types.voidptr(types.int64), make


@intrinsic  # type: ignore[untyped-decorator]
def call(typing: Any, function: Any, model: Any, data: Any) -> Any:
    """Call one of MuJoCo's functions at an address, with a model and its data at theirs."""

    def make(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        kind = ir.FunctionType(ir.VoidType(), [ir.IntType(64)] * 2)
        builder.call(builder.inttoptr(args[0], kind.as_pointer()), args[1:])
        return context.get_dummy_value()

    return types.void(types.int64, types.int64, types.int64), make


@njit(cache=True, inline="always")
def word(address):  # type: ignore[no-untyped-def]
    """Return the whole number of 64 bits at an address."""
    return carray(_pointer(address), 1, np.int64)[0]


@njit(cache=True, inline="always")
def whole(address, count):  # type: ignore[no-untyped-def]
    """Return an array of `count` whole numbers of 32 bits at an address."""
    return carray(_pointer(address), count, np.int32)


@njit(cache=True, inline="always")
def real(address, count):  # type: ignore[no-untyped-def]
    """Return an array of `count` real numbers at an address."""
    return carray(_pointer(address), count, np.float64)
