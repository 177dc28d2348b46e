"""What fills the openings of a shell: windows, and the linings of doors."""

from __future__ import annotations

from ..rectangle import Rectangle
from .door import hinge_side
from .plan import JAMB, LEAF, OUTSIDE, Opening
from .shell_canvas import Canvas, Span
from .shell_wall import CAVITY

# Lengths in metres; common sizes, from memory, and own choice.
CASING, CASING_OUT = 0.06, 0.015
FRAME, FRAME_DEEP = 0.055, 0.07
PANE = 0.03  # thickness of what collides
WIDEST_PANE = 1.1  # wider windows have a mullion
STOP = 0.012  # strip that a shut leaf rests against


class Fitter:
    """Fits windows and linings into openings."""

    def __init__(self, canvas: Canvas, height: float) -> None:
        self._canvas, self._height = canvas, height

    def fit(self, opening: Opening) -> None:
        """Fit what belongs into an opening; nothing above where walls are cut."""
        if opening.sill >= self._height:
            return
        if opening.kind == "window":
            self._window(opening)
        elif opening.kind == "passage":
            self._reveal(opening)
            self._casings(opening, 0.0)
        else:
            self._lining(opening)
            self._casings(opening, 0.0 if opening.hardware == "slider" else 0.5 * JAMB)

    def _box(
        self,
        opening: Opening,
        material: str,
        x: Span,
        y: Span,
        z: Span,
        *,
        solid: bool = False,
    ) -> None:
        """Add a box given in the frame of an opening, cut where walls are."""
        top = min(z[1], self._height)
        if top - z[0] > 1e-6:
            area = Rectangle(x[0], y[0], x[1], y[1]).moved(opening.pose)
            self._canvas.box(material, area, (z[0], top), solid=solid)

    def _casings(self, opening: Opening, inward: float) -> None:
        """Frame an opening on both faces of the wall; windows on that of the room."""
        half, deep = 0.5 * opening.width - inward, 0.5 * opening.thickness
        head, low = opening.head - inward, opening.sill
        for sign in (1, -1):
            if sign < 0 and opening.rooms[1] == OUTSIDE and opening.kind == "window":
                continue
            y = (deep, deep + CASING_OUT) if sign > 0 else (-deep - CASING_OUT, -deep)
            for x in ((-half - CASING, -half), (half, half + CASING)):
                self._box(opening, "trim", x, y, (low, head))
            wide = (-half - CASING, half + CASING)
            self._box(opening, "trim", wide, y, (head, head + CASING))

    def _reveal(self, opening: Opening, material: str = "wall") -> None:
        """Paint the sides of a gap and what is over it; a window's lower edge, too."""
        half, deep = 0.5 * opening.width, 0.5 * opening.thickness
        head = min(opening.head, self._height)
        thin = 0.001
        for x in ((-half, -half + thin), (half - thin, half)):
            self._box(opening, material, x, (-deep, deep), (opening.sill, head))
        self._box(
            opening, material, (-half, half), (-deep, deep), (opening.head - thin, opening.head)
        )

    def _lining(self, opening: Opening) -> None:
        half, deep = 0.5 * opening.width, 0.5 * opening.thickness
        side, head = hinge_side(opening), opening.head
        is_slider = opening.hardware == "slider"
        for end in (-1, 1):
            if is_slider and end == side:
                x = (end * half - 0.002, end * half + 0.002)
                for y in ((-deep, -0.5 * CAVITY), (0.5 * CAVITY, deep)):
                    self._box(opening, "trim", x, y, (0.0, head))
            else:
                x = (end * half - JAMB, end * half) if end > 0 else (-half, -half + JAMB)
                self._box(opening, "trim", x, (-deep, deep), (0.0, head), solid=True)
        z = (head - JAMB, head)
        self._box(opening, "trim", (-half, half), (-deep, deep), z, solid=True)
        if not is_slider:
            back = deep - LEAF - 0.004
            y = (back - STOP, back)
            clear = half - JAMB
            for x in ((-clear, -clear + STOP), (clear - STOP, clear)):
                self._box(opening, "trim", x, y, (0.0, head - JAMB))
            self._box(opening, "trim", (-clear, clear), y, (head - JAMB - STOP, head - JAMB))

    def _window(self, opening: Opening) -> None:
        half, deep = 0.5 * opening.width, 0.5 * opening.thickness
        low, head = opening.sill, opening.head
        self._reveal(opening, "trim")
        back = -0.25 * opening.thickness  # panes sit towards the outside
        y = (back - 0.5 * FRAME_DEEP, back + 0.5 * FRAME_DEEP)
        bars = [(-half, -half + FRAME), (half - FRAME, half)]
        count = int(opening.width / WIDEST_PANE)
        for k in range(count):
            at = -half + (k + 1) * opening.width / (count + 1)
            bars.append((at - 0.5 * FRAME, at + 0.5 * FRAME))
        for x in bars:
            self._box(opening, "trim", x, y, (low, head))
        for z in ((low, low + FRAME), (head - FRAME, head)):
            self._box(opening, "trim", (-half, half), y, z)
        thin = (back - 0.003, back + 0.003)
        self._box(opening, "glass", (-half, half), thin, (low, head))
        thick = (back - 0.5 * PANE, back + 0.5 * PANE)
        self._box(opening, "", (-half, half), thick, (low, head), solid=True)
        board = (y[1], deep + 0.04)  # window board inside, sill outside
        self._box(opening, "trim", (-half - 0.04, half + 0.04), board, (low - 0.025, low + 0.004))
        out = (-deep - 0.04, y[0])
        self._box(opening, "paving", (-half - 0.03, half + 0.03), out, (low - 0.04, low + 0.004))
        self._casings(opening, 0.0)
