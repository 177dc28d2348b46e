"""`rcare-marl home`: pictures of a house, a table of its rooms, and the accessibility audit."""

from __future__ import annotations

import io
from collections.abc import Sequence
from pathlib import Path

import typer
from PIL import Image
from rich.table import Table

from rcare_marl.envs.homes.audit import audit
from rcare_marl.envs.homes.care_home import CareHome
from rcare_marl.envs.homes.route import Route

from . import floor_plan, home_picture
from .console import console
from .folder import write_whole


def show(
    name: str, level: int, *, rooms: Sequence[str], way: tuple[str, str] | None, output: Path
) -> None:
    """Draw a house into a folder and print what it has; see the command `home`.

    Raises:
        UnknownNameError: If there is no such house or room; nothing has been written then.
    """
    home = CareHome.load(name, level=level)
    for room in rooms:
        home.room(room)
    route = None if way is None else home.route(*way)
    console().print(_rooms(home))
    console().print(audit(home, 3).table())
    if way is not None:
        typer.echo(_told(way, route))
    stem = f"{name}_level_{level}"
    _write(output / f"{stem}_plan.png", floor_plan.png(floor_plan.figure(home, route=route)))
    _write(output / f"{stem}.png", _png(home_picture.perspective(home)))
    for room in rooms:
        _write(output / f"{stem}_{room}.png", _png(home_picture.room_perspective(home, room)))


def _rooms(home: CareHome) -> Table:
    table = Table(title=f"{home.name}, {home.plan.title}, level {home.level}")
    for column in ("room", "size [m]", "area [m²]", "a wheelchair"):
        table.add_column(column, justify="left" if column in ("room", "a wheelchair") else "right")
    reached = set(home.reached())
    for room in home.rooms():
        inside = room.inside
        table.add_row(
            room.name,
            f"{inside.width:.2f} x {inside.depth:.2f}",
            f"{inside.area:.1f}",
            "comes in" if room.name in reached else "stays out",
        )
    return table


def _told(way: tuple[str, str], route: Route | None) -> str:
    if route is None:
        return f"No way for a wheelchair from {way[0]} to {way[1]}."
    return (
        f"From {way[0]} to {way[1]}: {route.length:.1f} m, {route.narrowest:.2f} m wide where it is "
        "narrowest."
    )


def _png(picture: home_picture.Picture) -> bytes:
    out = io.BytesIO()
    Image.fromarray(picture).save(out, "PNG")
    return out.getvalue()


def _write(path: Path, data: bytes) -> None:
    write_whole(path, data)
    typer.echo(path)


__all__ = ["show"]
