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


def fit(canvas: Canvas, opening: Opening, height: float) -> None:
    """Fit what belongs into an opening; nothing above where walls are cut, at `height` [m]."""
    if opening.sill < height:
        _Fitting(canvas, opening, height).fit()


class _Fitting:
    """What is fitted into one opening, in its frame."""

    def __init__(self, canvas: Canvas, opening: Opening, height: float) -> None:
        self._canvas, self._opening, self._height = canvas, opening, height
        self._half, self._deep = 0.5 * opening.width, 0.5 * opening.thickness

    def fit(self) -> None:
        """Fit it."""
        opening = self._opening
        if opening.kind == "window":
            self._window()
        elif opening.kind == "passage":
            self._reveal("wall")
            self._casings(0.0)
        else:
            self._lining()
            self._casings(0.0 if opening.hardware == "slider" else 0.5 * JAMB)

    def _box(self, material: str, x: Span, y: Span, z: Span, *, solid: bool = False) -> None:
        """Add a box, cut where walls are."""
        top = min(z[1], self._height)
        if top - z[0] > 1e-6:
            area = Rectangle(x[0], y[0], x[1], y[1]).moved(self._opening.pose)
            self._canvas.box(material, area, (z[0], top), solid=solid)

    def _casings(self, inward: float) -> None:
        """Frame an opening on both faces of the wall; windows on that of the room."""
        opening, half, deep = self._opening, self._half - inward, self._deep
        head, low, out = opening.head - inward, opening.sill, half + CASING
        faces = [(deep, deep + CASING_OUT), (-deep - CASING_OUT, -deep)]
        if opening.rooms[1] == OUTSIDE and opening.kind == "window":
            faces.pop()
        for y in faces:
            for x in ((-half - CASING, -half), (half, out)):
                self._box("trim", x, y, (low, head))
            self._box("trim", (-half - CASING, out), y, (head, head + CASING))

    def _reveal(self, material: str) -> None:
        """Paint the sides of a gap and what is over it."""
        half, y, thin = self._half, (-self._deep, self._deep), 0.001
        low, top = self._opening.sill, self._opening.head
        for x in ((-half, -half + thin), (half - thin, half)):
            self._box(material, x, y, (low, min(top, self._height)))
        self._box(material, (-half, half), y, (top - thin, top))

    def _lining(self) -> None:
        half, deep, head = self._half, self._deep, self._opening.head
        side, is_slider = hinge_side(self._opening), self._opening.hardware == "slider"
        for end in (-1, 1):
            if is_slider and end == side:
                x = (end * half - 0.002, end * half + 0.002)
                for y in ((-deep, -0.5 * CAVITY), (0.5 * CAVITY, deep)):
                    self._box("trim", x, y, (0.0, head))
            else:
                x = (end * half - JAMB, end * half) if end > 0 else (-half, -half + JAMB)
                self._box("trim", x, (-deep, deep), (0.0, head), solid=True)
        self._box("trim", (-half, half), (-deep, deep), (head - JAMB, head), solid=True)
        if not is_slider:
            back, clear, over = deep - LEAF - 0.004, half - JAMB, head - JAMB
            y = (back - STOP, back)
            for x in ((-clear, -clear + STOP), (clear - STOP, clear)):
                self._box("trim", x, y, (0.0, over))
            self._box("trim", (-clear, clear), y, (over - STOP, over))

    def _window(self) -> None:
        opening, half, deep = self._opening, self._half, self._deep
        low, head = opening.sill, opening.head
        self._reveal("trim")
        back = -0.25 * opening.thickness  # panes sit towards the outside
        y = (back - 0.5 * FRAME_DEEP, back + 0.5 * FRAME_DEEP)
        bars = [(-half, -half + FRAME), (half - FRAME, half)]
        count = int(opening.width / WIDEST_PANE)
        for k in range(count):
            at = -half + (k + 1) * opening.width / (count + 1)
            bars.append((at - 0.5 * FRAME, at + 0.5 * FRAME))
        for x in bars:
            self._box("trim", x, y, (low, head))
        for z in ((low, low + FRAME), (head - FRAME, head)):
            self._box("trim", (-half, half), y, z)
        self._box("glass", (-half, half), (back - 0.003, back + 0.003), (low, head))
        pane = (back - 0.5 * PANE, back + 0.5 * PANE)
        self._box("", (-half, half), pane, (low, head), solid=True)
        board, out = (y[1], deep + 0.04), (-deep - 0.04, y[0])  # window board inside, sill outside
        self._box("trim", (-half - 0.04, half + 0.04), board, (low - 0.025, low + 0.004))
        self._box("paving", (-half - 0.03, half + 0.03), out, (low - 0.04, low + 0.004))
        self._casings(0.0)
