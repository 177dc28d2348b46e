"""A behaviour tree as a picture, from left to right: text, SVG or PNG, coloured by status if it runs."""

from __future__ import annotations

import html
import textwrap
from dataclasses import dataclass
from pathlib import Path

import matplotlib
from PIL import Image, ImageDraw, ImageFont
from py_trees import display
from py_trees.behaviour import Behaviour
from py_trees.common import Status
from py_trees.composites import Composite, Parallel, Selector

from rcare_marl.errors import ConfigError

ROW, BOX, GAP, MARGIN, TITLE, LINE = 40, 30, 46, 24, 34, 22  # [px]
PADDING, FONT_SIZE, SCALE = 12, 15, 2  # PNGs are drawn at twice the size, for sharp text
LOOKS = {  # name, fill and edge of each status
    Status.RUNNING: ("running", "#cfe3ff", "#1f5fbf"),
    Status.SUCCESS: ("success", "#cdeccd", "#2f7d32"),
    Status.FAILURE: ("failure", "#f8d3d0", "#b3261e"),
    Status.INVALID: ("not ticked", "#f1f1f1", "#9a9a9a"),
}
INK, PALE = "#1c1c1c", "#8a8a8a"
LEGEND = "? first that does not fail    → one after the other    ⇉ side by side"


@dataclass(frozen=True)
class Box:
    """Where a node is drawn.

    Attributes:
        label: Its sign and its name.
        status: What the last tick said.
        is_leaf: Whether it has no children.
        x: Left edge [px].
        y: Middle [px].
        width: Width [px].
        parent: Index of the box of its parent; -1 for the root.
    """

    label: str
    status: Status
    is_leaf: bool
    x: float
    y: float
    width: float
    parent: int


class TreePicture:
    """A picture of a tree as it is now.

    Attributes:
        boxes: The nodes, depth first.
        size: Width and height [px].
    """

    def __init__(self, root: Behaviour, *, title: str = "", subtitle: str = "") -> None:
        """Lay the tree out: a column for each depth, a row for each leaf.

        Args:
            root: The tree.
            title: Written above it; the name of the root if empty.
            subtitle: Written below the title, in lines as wide as the tree.
        """
        self._root, self._title = root, title or root.name
        self._font = _font(FONT_SIZE)
        nodes = _flattened(root)
        widths = [self._font.getlength(_label(node)) + 2 * PADDING for node, _, _ in nodes]
        columns = [0.0] * (1 + max(depth for _, depth, _ in nodes))
        for (_, depth, _), width in zip(nodes, widths, strict=True):
            columns[depth] = max(columns[depth], width)
        lefts = [MARGIN + sum(columns[:depth]) + GAP * depth for depth in range(len(columns))]
        below = self._font.getlength(LEGEND) + 2 * MARGIN
        wide = max(lefts[-1] + columns[-1] + MARGIN, below)
        letters = int((wide - 2 * MARGIN) / self._font.getlength("n"))
        self._subtitle = textwrap.wrap(subtitle, letters)
        top = TITLE + LINE * len(self._subtitle) + MARGIN
        rows = _rows(nodes)
        self.boxes = []
        for (node, depth, parent), width, row in zip(nodes, widths, rows, strict=True):
            x, y = lefts[depth], top + ROW * (row + 0.5)
            box = Box(_label(node), node.status, not node.children, x, y, width, parent)
            self.boxes.append(box)
        leaves = sum(box.is_leaf for box in self.boxes)
        self.size = (round(wide), round(top + ROW * leaves + 3 * LINE + MARGIN))

    def text(self) -> str:
        """Return the tree as indented lines of text with the status of each node."""
        return str(display.unicode_tree(self._root, show_status=True))

    def svg(self) -> str:
        """Return the picture as SVG."""
        width, height = self.size
        lines = [
            f'<svg xmlns="http://www.w3.org/2000/svg" width="{width}" height="{height}" '
            f'viewBox="0 0 {width} {height}" font-family="DejaVu Sans, sans-serif" '
            f'font-size="{FONT_SIZE}">',
            f'<rect width="{width}" height="{height}" fill="white"/>',
            f'<text x="{MARGIN}" y="{MARGIN + 8}" font-size="{FONT_SIZE + 5}" fill="{INK}">'
            f"{html.escape(self._title)}</text>",
        ]
        for i, line in enumerate(self._subtitle):
            lines.append(
                f'<text x="{MARGIN}" y="{TITLE + LINE * i + 18}" fill="{INK}">'
                f"{html.escape(line)}</text>"
            )
        for box in self.boxes:
            if box.parent >= 0:
                points = " ".join(f"{x:.1f},{y:.1f}" for x, y in self._link(box))
                lines.append(f'<polyline points="{points}" fill="none" stroke="{PALE}"/>')
        for box in self.boxes:
            radius = BOX / 2 if box.is_leaf else 3
            lines.append(
                f'<rect x="{box.x:.1f}" y="{box.y - BOX / 2:.1f}" width="{box.width:.1f}" '
                f'height="{BOX}" rx="{radius}" fill="{LOOKS[box.status][1]}" '
                f'stroke="{LOOKS[box.status][2]}" stroke-width="1.5"/>'
                f'<text x="{box.x + PADDING:.1f}" y="{box.y + 5:.1f}" fill="{INK}">'
                f"{html.escape(box.label)}</text>"
            )
        for x, text, color in self._colour_key():
            lines.append(
                f'<text x="{x:.1f}" y="{height - MARGIN - LINE}" fill="{color}">{text}</text>'
            )
        lines.append(
            f'<text x="{MARGIN}" y="{height - MARGIN}" fill="{PALE}">{LEGEND}</text></svg>'
        )
        return "\n".join(lines) + "\n"

    def _colour_key(self) -> list[tuple[float, str, str]]:
        """Return where the name of each status stands below the tree [px], and its colour."""
        out, x = [], float(MARGIN)
        for text, _, color in LOOKS.values():
            out.append((x, text, color))
            x += self._font.getlength(text) + MARGIN
        return out

    def image(self) -> Image.Image:
        """Return the picture as pixels, at twice the size."""
        big = _font(FONT_SIZE * SCALE)
        image = Image.new("RGB", (self.size[0] * SCALE, self.size[1] * SCALE), "white")
        pen = ImageDraw.Draw(image)
        place = (MARGIN * SCALE, 10 * SCALE)
        pen.text(place, self._title, fill=INK, font=_font((FONT_SIZE + 5) * SCALE))
        for box in self.boxes:
            if box.parent >= 0:
                points = [(x * SCALE, y * SCALE) for x, y in self._link(box)]
                pen.line(points, fill=PALE, width=SCALE)
        for box in self.boxes:
            low, high = box.y - BOX / 2, box.y + BOX / 2
            pen.rounded_rectangle(
                [SCALE * v for v in (box.x, low, box.x + box.width, high)],
                radius=(BOX / 2 if box.is_leaf else 3) * SCALE,
                fill=LOOKS[box.status][1],
                outline=LOOKS[box.status][2],
                width=round(1.5 * SCALE),
            )
            middle = ((box.x + PADDING) * SCALE, box.y * SCALE)
            pen.text(middle, box.label, fill=INK, font=big, anchor="lm")
        for i, line in enumerate(self._subtitle):
            at = (MARGIN * SCALE, (TITLE + LINE * i + 18) * SCALE)
            pen.text(at, line, fill=INK, font=big, anchor="ls")
        level = (self.size[1] - MARGIN - LINE) * SCALE
        for x, text, color in self._colour_key():
            pen.text((x * SCALE, level), text, fill=color, font=big, anchor="ls")
        bottom = (MARGIN * SCALE, (self.size[1] - MARGIN) * SCALE)
        pen.text(bottom, LEGEND, fill=PALE, font=big, anchor="ls")
        return image

    def _link(self, box: Box) -> list[tuple[float, float]]:
        """Return the corners of the line from a box's parent to it."""
        parent = self.boxes[box.parent]
        bend = box.x - GAP / 2
        start = (parent.x + parent.width, parent.y)
        return [start, (bend, parent.y), (bend, box.y), (box.x, box.y)]

    def save(self, path: str | Path) -> Path:
        """Write the picture as `.png`, `.svg` or `.txt` and return where.

        Raises:
            ConfigError: If the name ends in something else.
        """
        file = Path(path)
        if file.suffix == ".png":
            self.image().save(file)
        elif file.suffix in (".svg", ".txt"):
            file.write_text(self.svg() if file.suffix == ".svg" else self.text(), encoding="utf-8")
        else:
            raise ConfigError(f"a picture of a tree is .png, .svg or .txt, got {file.name!r}")
        return file


def _font(size: int) -> ImageFont.FreeTypeFont:
    # Matplotlib brings a font with it that has arrows.
    return ImageFont.truetype(
        Path(matplotlib.get_data_path()) / "fonts" / "ttf" / "DejaVuSans.ttf", size
    )


def _label(node: Behaviour) -> str:
    if not isinstance(node, Composite):
        return node.name
    sign = "?" if isinstance(node, Selector) else "⇉" if isinstance(node, Parallel) else "→"
    return f"{sign}  {node.name}"


def _flattened(root: Behaviour) -> list[tuple[Behaviour, int, int]]:
    """Return (node, depth, index of the parent) of all nodes, depth first."""
    out: list[tuple[Behaviour, int, int]] = []

    def visit(node: Behaviour, depth: int, parent: int) -> None:
        index = len(out)
        out.append((node, depth, parent))
        for child in node.children:
            visit(child, depth + 1, index)

    visit(root, 0, -1)
    return out


def _rows(nodes: list[tuple[Behaviour, int, int]]) -> list[float]:
    """Return the row of each node: leaves one below the other, parents in the middle of their children."""
    rows, leaf = [0.0] * len(nodes), 0
    for i, (node, _, _) in enumerate(nodes):
        if not node.children:
            rows[i], leaf = leaf, leaf + 1
    for i in range(len(nodes) - 1, -1, -1):
        children = [rows[k] for k in range(i + 1, len(nodes)) if nodes[k][2] == i]
        if children:
            rows[i] = 0.5 * (children[0] + children[-1])
    return rows
