"""`rcare-marl home`: pictures of a house, a table of its rooms, and the accessibility audit."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path

import typer
from rich.table import Table

from rcare_marl.atomic_file import draft
from rcare_marl.console import console, progress, table
from rcare_marl.envs.homes import CareHome, Route, audit_home, floor_plan, home_picture
from rcare_marl.rendering.portrait import encoded

Way = tuple[str, str]


def show(
    name: str, level: int, *, rooms: Sequence[str], way: Way | None, output: Path
) -> tuple[Path, ...]:
    """Draw a house into a folder and print what it has; see the command `home`.

    Returns:
        The pictures.

    Raises:
        UnknownNameError: If there is no such house or room; nothing has been written then.
        ConfigError: If the folder cannot be written.
    """
    home = CareHome.load(name, level=level)
    for room in (*rooms, *(way or ())):
        home.room(room)
    route = None if way is None else home.route(*way)
    drawn = _drawings(home, rooms, route)
    with draft(output) as folder:
        with progress("drawing") as bar:
            work = bar.add_task("", total=len(drawn))
            for file, draw in drawn.items():
                bar.update(work, description=file)
                (folder.path / file).write_bytes(draw())
                bar.advance(work)
        console().print(_rooms(home))
        _judge(home)
        if way is not None:
            typer.echo(_told(way, route))
        target = folder.publish()
    paths = tuple(target / file for file in drawn)
    for path in paths:
        typer.echo(path)
    return paths


def _drawings(
    home: CareHome, rooms: Sequence[str], route: Route | None
) -> dict[str, Callable[[], bytes]]:
    """Return what makes each picture, by the name of its file."""
    stem = f"{home.name}_level_{home.level}"
    drawn: dict[str, Callable[[], bytes]] = {
        f"{stem}_plan.png": lambda: floor_plan.png(floor_plan.figure(home, route=route)),
        f"{stem}.png": lambda: encoded(home_picture.perspective(home)),
    }
    for room in rooms:
        drawn[f"{stem}_{room}.png"] = lambda room=room: encoded(  # type: ignore[misc]
            home_picture.room_perspective(home, room)
        )
    return drawn


def _rooms(home: CareHome) -> Table:
    reached = set(home.reached())
    columns = ("room", "used as", "size [m]", "area [m²]", "wheelchair")
    rows = []
    for room in home.rooms():
        inside = room.inside
        rows.append(
            (
                room.name,
                room.use,
                f"{inside.width:.2f} x {inside.depth:.2f}",
                f"{inside.area:.1f}",
                "comes in" if room.name in reached else "stays out",
            )
        )
    title = f"{home.name}: {home.plan.title}, level {home.level} ({floor_plan.LEVELS[home.level]})"
    return table(title, columns, rows, **{"size [m]": True, "area [m²]": True})


def _judge(home: CareHome) -> None:
    """Print what keeps a wheelchair out, or else that nothing does."""
    found = audit_home(home, 3)
    if found.failures:
        console().print(found.table())
    else:
        typer.echo(f"None of {len(found.findings)} findings of the audit fails level 3.")


def _told(way: Way, route: Route | None) -> str:
    if route is None:
        return f"No way for a wheelchair from {way[0]} to {way[1]}."
    return (
        f"From {way[0]} to {way[1]}: {route.length:.1f} m, {route.narrowest:.2f} m wide where it is "
        "narrowest."
    )
