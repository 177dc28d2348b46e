"""A piece of furniture: a model, the floor that it needs, and where things are on it."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

from rcare_marl.errors import check_name
from rcare_marl.model.urdf import Model

from ..devices import Frame
from ..rectangle import Rectangle
from .palette import Palette
from .rule import Rules


@dataclass(frozen=True)
class Setting:
    """What a piece is made for.

    Attributes:
        rules: The rules of the level of accessibility.
        palette: The colours of the house.
    """

    rules: Rules
    palette: Palette = Palette()


@dataclass(frozen=True)
class Zone:
    """Floor that a piece needs beside its own, in the frame of the piece.

    Attributes:
        area: Where.
        why: `use` for where somebody stands, sits or wheels, which other zones may share; `sweep`
            for where a door, drawer or lid of the piece itself moves near the floor.
    """

    area: Rectangle
    why: str = "use"


@dataclass(frozen=True)
class Piece:
    """A piece of furniture.

    Its frame: origin on the floor at the middle of its back, the side that stands against a wall; x
    out of the wall into the room, y to the left as seen by somebody who sits on it and looks along x.

    Attributes:
        kind: Name of its maker.
        model: Links and joints. The root stands still; every other link hangs on joints that move
            or are fixed. `Joint.friction` holds what gravity or a touch would move; `Joint.damping`
            slows it. `lower` is 0 where the joint rests when the house is built.
        footprint: The floor that it covers, up to 2 m above it, at rest.
        height: Of its highest point [m].
        zones: Floor that it needs beside that.
        frames: Named places on it, such as `seat`, `mattress`, `handle_door`.
        measures: Dimensions that rules are about, under the name of the rule [m].
        knee: Floor under it that is free up to the height of knees, for wheelchairs.
        blocks: Whether it keeps people from walking there; rugs and what hangs high do not.
    """

    kind: str
    model: Model
    footprint: Rectangle
    height: float
    zones: tuple[Zone, ...] = ()
    frames: Mapping[str, Frame] = field(default_factory=dict)
    measures: Mapping[str, float] = field(default_factory=dict)
    knee: tuple[Rectangle, ...] = ()
    blocks: bool = True


Maker = Callable[..., Piece]

_MAKERS: dict[str, Maker] = {}


def maker(kind: str) -> Callable[[Maker], Maker]:
    """Return a decorator that makes a maker of pieces known as `kind`.

    A maker takes a `Setting` and keyword options with defaults, and returns a `Piece`.
    """

    def register(make: Maker) -> Maker:
        _MAKERS[kind] = make
        return make

    return register


def make_piece(kind: str, setting: Setting, options: Mapping[str, Any] | None = None) -> Piece:
    """Return a new piece of furniture; UnknownNameError lists the kinds there are."""
    from . import furniture as furniture  # registers the makers

    check_name("piece of furniture", kind, _MAKERS)
    return _MAKERS[kind](setting, **dict(options or {}))


def piece_kinds() -> tuple[str, ...]:
    """Return the kinds of furniture there are, sorted."""
    from . import furniture as furniture

    return tuple(sorted(_MAKERS))
