"""Pictures of all robots and people, one each and two sheets."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

from PIL import Image

from rcare_marl import assets
from rcare_marl import atomic_file as folder
from rcare_marl.agents.people.avatar import load_avatar, load_posture
from rcare_marl.agents.people.human import Human
from rcare_marl.agents.robots.robot import Robot
from rcare_marl.agents.robots.robot_config import load_robot
from rcare_marl.body import Body
from rcare_marl.config import read_yaml
from rcare_marl.console import progress
from rcare_marl.envs.devices import Wheelchair, hang_ventilator, spawn_fitted
from rcare_marl.errors import ConfigError, check_name
from rcare_marl.pose import Pose
from rcare_marl.rendering.portrait import Picture, contact_sheet, encoded, portrait
from rcare_marl.world import World

SIZE = (480, 600)  # [pixel], width and height of one picture
COLUMNS = 5  # of the sheets, at most
VIEW = (0.78, -0.56, 0.3)  # direction from the subject to the camera: front, right, a little above


@dataclass(frozen=True)
class Plate:
    """A picture of one robot or person.

    Attributes:
        name: Name in `rcare-marl list`.
        about: A few words.
        picture: Shape [height, width, 3].
    """

    name: str
    about: str
    picture: Picture


def make(
    out: Path,
    kinds: Sequence[str],
    names: Sequence[str],
    *,
    meshes: bool = True,
    size: tuple[int, int] = SIZE,
) -> list[Path]:
    """Draw everybody and return the files: `robots/<name>.png`, `robots.jpg`, likewise for avatars.

    Args:
        out: Folder.
        kinds: `robots`, `avatars` or both.
        names: Only these, by name or YAML file; all if empty.
        meshes: Whether to draw robots by real meshes where a package with them is installed.
        size: Width and height of a picture [pixel].

    Raises:
        UnknownNameError: If nobody has such a name.
    """
    subjects = [(kind, name) for kind in kinds for name in assets.names(kind)]
    for name in names:
        if not _is_file(name):
            check_name("robot or avatar", name, [known for _, known in subjects])
    chosen = [(kind, name) for kind, name in subjects if not names or name in names]
    chosen += [(_kind(name), name) for name in names if _is_file(name)]
    draw: dict[str, Callable[[str], Plate]] = {
        "robots": lambda name: robot_plate(name, meshes=meshes, size=size),
        "avatars": lambda name: avatar_plate(name, size=size),
    }
    files: list[Path] = []
    plates: dict[str, list[Plate]] = {}
    with progress("drawing") as bars:
        bar = bars.add_task("", total=len(chosen))
        for kind, name in chosen:
            bars.update(bar, description=name)
            plate = draw[kind](name)
            plates.setdefault(kind, []).append(plate)
            files.append(out / kind / f"{plate.name}.png")
            folder.write_whole(files[-1], encoded(sheet([plate])))
            bars.advance(bar)
    for kind, drawn in plates.items():
        if len(drawn) > 1:
            files.append(out / f"{kind}.jpg")
            folder.write_whole(files[-1], encoded(sheet(drawn).reduce(2), "JPEG"))
    return files


def _is_file(name: str) -> bool:
    return Path(name).suffix in (".yaml", ".yml")


def _kind(file: str) -> str:
    """Return whether a YAML file describes one of the `robots` or of the `avatars`."""
    return "robots" if "arms" in read_yaml(file) else "avatars"


def robot_plate(name: str, *, meshes: bool = True, size: tuple[int, int] = SIZE) -> Plate:
    """Return a picture of a robot at its start posture, on the floor or bolted to it."""
    config = load_robot(name)
    world = World()
    robot = Robot("robot", config, meshes="auto" if meshes else "never")
    robot.spawn(world, robot.mount("floor"))
    picture = portrait(world, [robot.body], VIEW, size)
    world.close()
    arms = f"{len(config.arms)} arm{'s' if len(config.arms) > 1 else ''}"
    drives = config.base.kind if config.base is not None else "bolted down"
    return Plate(Path(name).stem, f"{arms}, {drives}, {robot.files.model.mass:.1f} kg", picture)


def avatar_plate(name: str, *, size: tuple[int, int] = SIZE) -> Plate:
    """Return a picture of a person: in a wheelchair, or standing if they are no care recipient."""
    avatar = load_avatar(name)
    stands = "caregiver" in name
    world = World()
    person = Human("person", avatar, posture=load_posture("standing" if stands else "wheelchair"))
    bodies: list[Body] = []
    support = Pose()
    if not stands:
        chair = Wheelchair(mounts="none")
        support = spawn_fitted(chair, person, world)
        bodies.append(chair.body)
    person.spawn(world, support)
    if not stands and avatar.profile.ventilator_rate is not None:
        hang_ventilator(world, chair, person)
    picture = portrait(world, [person.body, *bodies], VIEW, size)
    world.close()
    return Plate(Path(name).stem, f"{avatar.condition}, {avatar.age_years:g}", picture)


def sheet(plates: Sequence[Plate]) -> Image.Image:
    """Return pictures in rows of equal length, each with a name and a few words below."""
    rows = math.ceil(len(plates) / COLUMNS)
    captions = [f"{plate.name}\n{plate.about}" for plate in plates]
    pictures = [plate.picture for plate in plates]
    return contact_sheet(pictures, captions, columns=math.ceil(len(plates) / rows))


def check_kind(kind: str) -> tuple[str, ...]:
    """Return what `robots`, `avatars` or `all` stands for; ConfigError for anything else."""
    kinds = {"robots": ("robots",), "avatars": ("avatars",), "all": ("robots", "avatars")}
    if kind not in kinds:
        raise ConfigError(f"a gallery shows {', '.join(kinds)}, got {kind!r}")
    return kinds[kind]
