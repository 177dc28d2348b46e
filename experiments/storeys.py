"""Draw docs/images/storeys.png: the floors of the package and their rooms, as large as they are.

python experiments/storeys.py [--out FILE]
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import typer
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

ROOT = Path(__file__).resolve().parents[1]
OUT = ROOT / "docs" / "images" / "storeys.png"
# From the top: each floor may import those below it.
FLOORS = {
    "rcare_marl/cli": "#d9d9e8",
    "baselines": "#cfe3d4",
    "envs": "#f3e2c0",
    "agents": "#f1cfc4",
    "rcare_marl": "#cddcec",
}
TITLES = {"rcare_marl/cli": "command line", "rcare_marl": "core"}
NARROWEST = 0.045  # of a floor, so that a room has room for its name


def lines(folder: Path) -> int:
    """Return the lines of Python in a folder and all below it."""
    return sum(file.read_text(encoding="utf-8").count("\n") for file in folder.rglob("*.py"))


def rooms(floor: str) -> dict[str, int]:
    """Return the lines of each room of a floor; files that stand in none are `itself`."""
    folder = ROOT / floor
    found = {
        each.name: lines(each)
        for each in sorted(folder.iterdir())
        if each.is_dir() and not each.is_symlink() and each.name != "cli" and lines(each) > 20
    }
    found["itself"] = sum(f.read_text(encoding="utf-8").count("\n") for f in folder.glob("*.py"))
    return dict(sorted(found.items(), key=lambda room: -room[1]))


def draw(out: Path = OUT) -> None:
    """Draw the floors of the package and their rooms, as large as they are."""
    figure = Figure(figsize=(12, 6.2), dpi=110)
    FigureCanvasAgg(figure)
    axes = figure.add_axes((0.01, 0.01, 0.98, 0.98))
    axes.set_xlim(-0.17, 1.0)
    axes.set_ylim(-0.05, len(FLOORS))
    axes.axis("off")
    for height, (floor, color) in enumerate(reversed(FLOORS.items())):
        found = rooms(floor)
        total = sum(found.values())
        title = f"{TITLES.get(floor, floor)}\n{total / 1000:.1f} thousand lines"
        axes.text(-0.01, height + 0.48, title, ha="right", va="center", fontsize=10)
        shares = {name: max(count / total, NARROWEST) for name, count in found.items()}
        scale, x = 1.0 / sum(shares.values()), 0.0
        for name, share in shares.items():
            width = share * scale
            axes.bar(x, 0.9, width - 0.003, height, align="edge", color=color, edgecolor="#667")
            turned = 90 if width < 0.075 else 0
            text = f"{name.replace('_', ' ')}\n{found[name]:,}"
            style: dict[str, Any] = {
                "ha": "center",
                "va": "center",
                "fontsize": 8.5,
                "rotation": turned,
            }
            axes.text(x + width / 2, height + 0.45, text, **style)
            x += width
    out.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(out)


if __name__ == "__main__":
    typer.run(draw)
