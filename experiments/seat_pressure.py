"""Draw the pressure on seats and on a bed as maps, for docs/images/pressure.png.

Run: python experiments/seat_pressure.py [--out FILE] [--avatar NAME]

Above: one person in a wheelchair, seen from above, front to the right: hard board, foam, air cells, slumped
on foam. Below: on a standard mattress, head to the left.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import typer
from matplotlib import pyplot
from matplotlib.axes import Axes

from rcare_marl.agents.people.resting.pressure import PressureMap
from rcare_marl.agents.people.validation.pressure import lying, seated, slumped

FULL = 20.0  # [kPa] at the red end of seats
BED = 10.0  # [kPa] at that of the bed


def draw(axes: Axes, found: PressureMap, title: str, full: float) -> None:
    """Draw what a mat would read on the first pad."""
    mine, cell = found.of(pad=0), found.area**0.5
    corner = found.spots[mine].min(axis=0)
    place = np.rint((found.spots[mine] - corner) / cell).astype(int)
    grid = np.full(place.max(axis=0) + 1, np.nan)
    grid[tuple(place.T)] = found.sensed[mine] / 1e3
    (left, bottom), (right, top) = corner - 0.5 * cell, corner + (np.array(grid.shape) - 0.5) * cell
    axes.imshow(
        grid.T, extent=(left, right, bottom, top), origin="lower", cmap="turbo", vmin=0, vmax=full
    )
    axes.set_xticks([])
    axes.set_yticks([])
    axes.set_title(f"{title}\npeak {found.peak(pad=0) / 1e3:.1f} kPa", fontsize=9)


def main(out: Path = Path("runs/pressure.png"), avatar: str = "natalia") -> None:
    """Draw the maps."""
    figure = pyplot.figure(figsize=(9, 5.6), dpi=130, layout="constrained")
    top, bottom = figure.subfigures(2, 1, squeeze=False, height_ratios=(1.0, 1.05))[:, 0]
    seats = {
        "hard board": seated(avatar, "board", able=False),
        "foam": seated(avatar, "foam", able=False),
        "air cells": seated(avatar, "air", able=False),
        "foam, slumped": slumped(avatar, "foam", able=False),
    }
    for axes, (title, found) in zip(
        np.ravel(top.subplots(1, len(seats))), seats.items(), strict=True
    ):
        draw(axes, found, title, FULL)
        axes.set_xlim(-0.22, 0.22)
        axes.set_ylim(-0.23, 0.23)
    top.colorbar(axes.images[0], ax=top.axes, label="kPa", shrink=0.8)
    bed = bottom.subplots(1, 1)
    draw(bed, lying(avatar, "hospital_foam"), "standard mattress", BED)
    bed.set_xlim(-1.15, 1.15)
    bed.set_ylim(-0.45, 0.45)
    bottom.colorbar(bed.images[0], ax=bed, label="kPa", shrink=0.8)
    out.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(out)


if __name__ == "__main__":
    typer.run(main)
