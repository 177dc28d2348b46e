"""Draw the pictures of homes in the documentation.

python experiments/home_pictures.py --output docs/images

home_plans.png has the floor plans of all houses at one scale, with a wheelchair's ways from the front door.
home_house.jpg is a house seen from above; bathroom_levels.jpg and kitchen_levels.jpg show the same room at
the three levels side by side, home_rooms.jpg other rooms.
"""

from __future__ import annotations

import io
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import typer
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle
from PIL import Image

import rcare_marl
from rcare_marl import CareHome
from rcare_marl.envs.homes import Route, floor_plan, home_picture
from rcare_marl.errors import check_name
from rcare_marl.rendering.portrait import contact_sheet

HOUSE = "house_07"  # that is shown from above
BATHROOM = ("house_11", "bathroom_2", ("w", "e", "n"))  # house, room, where from at each level
KITCHEN = ("house_11", "kitchen_1", ("w", "nw", "w"))
ROOMS = (  # house, level, room
    ("house_02", 1, "living_1"),
    ("house_06", 1, "dining_1"),
    ("house_07", 3, "bedroom_4"),
    ("house_04", 3, "bedroom_1"),
    ("house_10", 3, "lounge_1"),
    ("house_02", 2, "kitchen_1"),
)
SHEET = 98.0  # [m] across the sheet of plans
PIXELS = 24  # a metre of plan
GAP, TITLE = 1.6, 3.0  # [m] between plans, and of the title over each
TOP = 4.0  # [m] of the line over all plans
TILE = (640, 480)  # [pixel]


def plans(level: int = 3) -> Image.Image:
    """Return the floor plans of all houses on one sheet."""
    homes = [CareHome.load(name, level=level) for name in rcare_marl.home_names()]
    rows = _rows(homes)
    heights = [TITLE + max(floor_plan.extent(home).depth for home in row) + GAP for row in rows]
    total = TOP + sum(heights)
    inch = PIXELS / 100
    sheet = Figure(figsize=(SHEET * inch, total * inch), dpi=100)
    points = 72 * inch  # of a metre
    y = total - TOP
    for row, height in zip(rows, heights, strict=True):
        spare = SHEET - sum(floor_plan.extent(home).width for home in row)
        x = 0.0
        for home in row:
            x += spare / (len(row) + 1)
            bounds = floor_plan.extent(home)
            low = y - TITLE - bounds.depth
            axes = sheet.add_axes(
                (x / SHEET, low / total, bounds.width / SHEET, bounds.depth / total)
            )
            floor_plan.draw(axes, home, labels="kinds", routes=_ways(home), weight=0.11 * points)
            _title(sheet, home, x + floor_plan.MARGIN, y - TITLE, total, points)
            x += bounds.width
        y -= height
    _legend(sheet, level, total, points)
    out = io.BytesIO()
    sheet.savefig(out, facecolor="white")
    return Image.open(out).convert("RGB").quantize(192, dither=Image.Dither.NONE)


def _rows(homes: Sequence[CareHome]) -> list[list[CareHome]]:
    """Return the homes in their order, in rows as long as the sheet is wide."""
    rows: list[list[CareHome]] = [[]]
    for home in homes:
        width = sum(floor_plan.extent(h).width + GAP for h in (*rows[-1], home)) + GAP
        if rows[-1] and width > SHEET:
            rows.append([])
        rows[-1].append(home)
    return rows


def _ways(home: CareHome) -> list[Route]:
    """Return the ways of a wheelchair from the front door to each room that must be reached."""
    way = home.way()
    entrance = next(o for o in home.plan.openings.values() if o.kind == "entrance")
    start = home.room(entrance.rooms[0]).inside
    found = [way.route(start, home.room(room).inside) for room in home.required_rooms()]
    return [route for route in found if route is not None]


def _title(sheet: Figure, home: CareHome, x: float, y: float, total: float, points: float) -> None:
    area = sum(room.inside.area for room in home.rooms())
    for text, up, size, weight in (
        (f"{home.name} · {area:.0f} m²", 1.55, 1.05, "bold"),
        (home.plan.title, 0.35, 0.8, "normal"),
    ):
        sheet.text(
            x / SHEET,
            (y + up) / total,
            text,
            fontsize=size * points,
            color=floor_plan.INK,
            weight=weight,
        )


def _legend(sheet: Figure, level: int, total: float, points: float) -> None:
    axes = sheet.add_axes((0, 1 - TOP / total, 1, TOP / total))
    axes.set_xlim(0, SHEET)
    axes.set_ylim(0, TOP)
    axes.axis("off")
    style: dict[str, Any] = {"color": floor_plan.INK, "va": "center"}
    title = f"Sixteen houses at level {level}, {floor_plan.LEVELS[level]}"
    axes.text(1.6, 2.2, title, fontsize=1.5 * points, **style)
    x = 38.5
    for kind, color in floor_plan.FLOORS.items():
        axes.add_patch(Rectangle((x, 1.8), 0.8, 0.8, fc=color, ec="#b9bec6", lw=0.5))
        axes.text(x + 1.1, 2.2, kind, fontsize=0.85 * points, **style)
        x += 2.1 + 0.58 * len(kind)
    for length, color, text in (
        (1.5, floor_plan.ROUTE, "wheelchair"),
        (5.0, floor_plan.INK, "5 m"),
    ):
        axes.plot((x, x + length), (2.2, 2.2), color=color, lw=0.12 * points)
        axes.text(x + length + 0.4, 2.2, text, fontsize=0.85 * points, **style)
        x += length + 1.4 + 0.58 * len(text)


def levels(house: str, room: str, views: Sequence[str]) -> Image.Image:
    """Return one room at the three levels side by side, with captions."""
    pictures = [
        home_picture.room_perspective(
            CareHome.load(house, level=level), room, width=TILE[0], height=TILE[1], view=view
        )
        for level, view in zip(floor_plan.LEVELS, views, strict=True)
    ]
    captions = [f"level {k}: {v}" for k, v in floor_plan.LEVELS.items()]
    return contact_sheet(pictures, captions, columns=3, gap=8)


def rooms() -> Image.Image:
    """Return rooms of several houses, with captions."""
    pictures, captions = [], []
    for house, level, room in ROOMS:
        home = CareHome.load(house, level=level)
        pictures.append(home_picture.room_perspective(home, room, width=TILE[0], height=TILE[1]))
        captions.append(f"{house}, {room.replace('_', ' ')}, level {level}")
    return contact_sheet(pictures, captions, columns=3, gap=8)


def house() -> Image.Image:
    """Return a house from above."""
    home = CareHome.load(HOUSE, level=3)
    return Image.fromarray(home_picture.perspective(home, width=1600, height=950))


PICTURES: dict[str, Callable[[], Image.Image]] = {
    "home_plans.png": plans,
    "home_house.jpg": house,
    "bathroom_levels.jpg": lambda: levels(*BATHROOM),
    "kitchen_levels.jpg": lambda: levels(*KITCHEN),
    "home_rooms.jpg": rooms,
}


def main(output: Path = Path("runs/home_pictures"), only: list[str] = []) -> None:  # noqa: B006
    """Write the pictures, or only those that are named."""
    for name in only:
        check_name("picture", name, PICTURES)
    output.mkdir(parents=True, exist_ok=True)
    for name in only or PICTURES:
        path = output / name
        PICTURES[name]().save(
            path, **({"quality": 82} if path.suffix == ".jpg" else {"optimize": True})
        )
        print(path)


if __name__ == "__main__":
    typer.run(main)
