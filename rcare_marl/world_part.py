"""What a world has beside its bodies, as protocols: skins, lines, matter that Bullet does not know."""

from __future__ import annotations

from typing import TYPE_CHECKING, Protocol

import numpy as np
import numpy.typing as npt

from .contact import Contact

if TYPE_CHECKING:
    from .body import Body


class Skin(Protocol):
    """A deforming surface to draw in place of a body's own shapes.

    `colors` has shape [n, 3], or [n, 4] with opacity. It may be replaced, not written into.
    """

    body: Body
    faces: npt.NDArray[np.int32]
    colors: npt.NDArray[np.uint8]

    def vertices(self) -> npt.NDArray[np.float32]:
        """Return the present vertices in the world [m], shape [n, 3]."""

    def rest_pieces(self) -> list[tuple[int, npt.NDArray[np.float32], npt.NDArray[np.int32]]]:
        """Return (link, vertices in the link's frame, indices of its faces) of rigid pieces."""


class Lines(Protocol):
    """Polylines to draw as thin round tubes; they may move and change colour at any time.

    Attributes:
        starts: First point of each line, and the end of the last, shape [m + 1].
        radii: Radius at each point [m], shape [p].
    """

    starts: npt.NDArray[np.int64]
    radii: npt.NDArray[np.float32]

    def points(self) -> npt.NDArray[np.float32]:
        """Return the present points in the world [m], shape [p, 3]."""

    def colors(self) -> npt.NDArray[np.uint8]:
        """Return the present colour of each point, shape [p, 3]."""


class SteppedMatter(Protocol):
    """Matter that Bullet does not know; it moves with the world and is rewound with it."""

    def step(self) -> None:
        """Go on to the end of the coming physics step, and push the rigid bodies."""

    def contacts(self, a: Body, b: Body | None = None) -> list[Contact]:
        """Return where `a`, or matter on it, pressed on `b` or matter on that, as `World.contacts`."""

    def mark(self) -> None:
        """Remember the present state."""

    def rewind(self) -> None:
        """Return to the state that was marked."""
