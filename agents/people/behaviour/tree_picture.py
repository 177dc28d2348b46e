"""A behaviour tree as a picture, from left to right: text, SVG or PNG, coloured by status if it runs."""

from __future__ import annotations

import textwrap
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import matplotlib
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure
from matplotlib.patches import BoxStyle, FancyBboxPatch
from PIL import ImageFont
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
        # Matplotlib brings a font with it that has arrows.
        fonts = Path(matplotlib.get_data_path()) / "fonts" / "ttf"
        self._font = ImageFont.truetype(fonts / "DejaVuSans.ttf", FONT_SIZE)
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

    def figure(self) -> Figure:
        """Return the picture as a figure of one point to a pixel."""
        width, height = self.size
        figure = Figure(figsize=(width / 72, height / 72), dpi=72)
        axes = figure.add_axes((0, 0, 1, 1), xlim=(0, width), ylim=(height, 0))
        axes.set_axis_off()
        links = [self._link(box) for box in self.boxes if box.parent >= 0]
        axes.add_collection(LineCollection(links, colors=PALE, linewidths=1))
        write = partial(axes.text, family="DejaVu Sans", fontsize=FONT_SIZE, parse_math=False)
        for box in self.boxes:
            _, fill, edge = LOOKS[box.status]
            corners = BoxStyle.Round(pad=0, rounding_size=BOX / 2 if box.is_leaf else 3)
            low = (box.x, box.y - BOX / 2)
            patch = FancyBboxPatch(low, box.width, BOX, boxstyle=corners, fc=fill, ec=edge, lw=1.5)
            axes.add_patch(patch)
            write(box.x + PADDING, box.y, box.label, color=INK, va="center_baseline")
        write(MARGIN, MARGIN + 8, self._title, color=INK, fontsize=FONT_SIZE + 5)
        for i, line in enumerate(self._subtitle):
            write(MARGIN, TITLE + LINE * i + 18, line, color=INK)
        x = float(MARGIN)
        for text, _, color in LOOKS.values():
            write(x, height - MARGIN - LINE, text, color=color)
            x += self._font.getlength(text) + MARGIN
        write(MARGIN, height - MARGIN, LEGEND, color=PALE)
        return figure

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
        if file.suffix == ".txt":
            file.write_text(self.text(), encoding="utf-8")
        elif file.suffix in (".png", ".svg"):
            with matplotlib.rc_context({"svg.fonttype": "none"}):  # text stays text
                self.figure().savefig(file, dpi=72 * SCALE)
        else:
            raise ConfigError(f"a picture of a tree is .png, .svg or .txt, got {file.name!r}")
        return file


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
