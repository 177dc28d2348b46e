"""Pictures of all robots and people, one each and two sheets."""

from __future__ import annotations

import io
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import numpy.typing as npt
from PIL import Image, ImageDraw, ImageFont

from rcare_marl import assets
from rcare_marl.agents.avatar import load_avatar, load_posture
from rcare_marl.agents.human import Human
from rcare_marl.agents.robot import Robot, load_robot
from rcare_marl.body import Body
from rcare_marl.envs.devices.wheelchair import Wheelchair
from rcare_marl.errors import ConfigError, UnknownNameError
from rcare_marl.pose import Pose
from rcare_marl.rendering import Camera, make_renderer
from rcare_marl.world import World

from . import folder
from .console import progress

Picture = npt.NDArray[np.uint8]
SIZE = (480, 600)  # [pixel], width and height of one picture
COLUMNS = 5  # of the sheets, at most
QUALITY = 88  # of the sheets, which are JPEG: a page should load fast
FOV = 30.0  # [degrees]
VIEW = (0.78, -0.56, 0.3)  # direction from the subject to the camera: front, right, a little above
MARGIN = 0.97  # of the picture round the subject
TINT, GREY = (28, 32, 38), (110, 116, 124)


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
    out: Path, kinds: Sequence[str], names: Sequence[str], *, meshes: bool = True
) -> list[Path]:
    """Draw everybody and return the files: `robots/<name>.png`, `robots.jpg`, likewise for avatars.

    Args:
        out: Folder.
        kinds: `robots`, `avatars` or both.
        names: Only these; all if empty.
        meshes: Whether to draw robots by real meshes where a package with them is installed.

    Raises:
        UnknownNameError: If nobody has such a name.
    """
    subjects = [(kind, name) for kind in kinds for name in assets.names(kind)]
    for name in names:
        if name not in [known for _, known in subjects]:
            raise UnknownNameError("robot or avatar", name, [known for _, known in subjects])
    chosen = [(kind, name) for kind, name in subjects if not names or name in names]
    draw: dict[str, Callable[[str], Plate]] = {
        "robots": lambda name: robot_plate(name, meshes=meshes),
        "avatars": avatar_plate,
    }
    files: list[Path] = []
    plates: dict[str, list[Plate]] = {}
    with progress("drawing") as bars:
        bar = bars.add_task("", total=len(chosen))
        for kind, name in chosen:
            bars.update(bar, description=name)
            plate = draw[kind](name)
            plates.setdefault(kind, []).append(plate)
            files.append(out / kind / f"{name}.png")
            folder.write_whole(files[-1], _encoded(captioned(plate), "PNG"))
            bars.advance(bar)
    for kind, drawn in plates.items():
        if len(drawn) > 1:
            files.append(out / f"{kind}.jpg")
            folder.write_whole(files[-1], _encoded(sheet(drawn), "JPEG"))
    return files


def robot_plate(name: str, *, meshes: bool = True) -> Plate:
    """Return a picture of a robot at its start posture, on the floor or bolted to it."""
    config = load_robot(name)
    world = World()
    robot = Robot("robot", config, meshes="auto" if meshes else "never")
    robot.spawn(world, robot.mount("floor"))
    picture = _portrait(world, [robot.body])
    world.close()
    arms = f"{len(config.arms)} arm{'s' if len(config.arms) > 1 else ''}"
    drives = config.base.kind if config.base is not None else "bolted down"
    return Plate(name, f"{arms}, {drives}, {robot.files.model.mass:.1f} kg", picture)


def avatar_plate(name: str) -> Plate:
    """Return a picture of a person: in a wheelchair, or standing if they are no care recipient."""
    avatar = load_avatar(name)
    stands = "caregiver" in name
    world = World()
    person = Human("person", avatar, posture=load_posture("standing" if stands else "wheelchair"))
    bodies: list[Body] = []
    support = Pose()
    if not stands:
        chair = Wheelchair(mounts="none")
        soles = person.soles(chair.frame("seat_back"))
        chair.fit_footplates(soles["left"], soles["right"])
        bodies.append(chair.spawn(world))
        rests = (chair.frame_in_world(f"armrest_{side}") for side in ("left", "right"))
        person.use_arm_rests(*rests)
        support = chair.frame_in_world("seat_back")
    person.spawn(world, support)
    picture = _portrait(world, [person.body, *bodies])
    world.close()
    return Plate(name, f"{avatar.condition}, {avatar.age_years:g}", picture)


def _portrait(world: World, bodies: Sequence[Body]) -> Picture:
    """Return a picture in which bodies just fit."""
    lows, highs = zip(*(body.bounds() for body in bodies), strict=True)
    low, high = np.min(lows, axis=0), np.max(highs, axis=0)
    corners = np.array([[(low, high)[b >> k & 1][k] for k in range(3)] for b in range(8)])
    middle = (low + high) / 2
    back = np.array(VIEW) / np.linalg.norm(VIEW)
    right = np.cross((0.0, 0.0, 1.0), back)
    right /= np.linalg.norm(right)
    up = np.cross(back, right)
    seen = (corners - middle) @ np.stack((right, up, back), axis=1)
    half_tall = math.tan(math.radians(FOV / 2))
    half_wide = half_tall * SIZE[0] / SIZE[1]
    # Far enough for each corner to be inside the picture both ways.
    need = np.maximum(np.abs(seen[:, 0]) / half_wide, np.abs(seen[:, 1]) / half_tall) + seen[:, 2]
    eye = middle + MARGIN * float(need.max()) * back
    camera = Camera(
        eye=tuple(eye.tolist()),
        target=tuple(middle.tolist()),
        fov_deg=FOV,
        width=SIZE[0],
        height=SIZE[1],
    )
    renderer = make_renderer(world)
    picture = renderer.render(camera)
    renderer.close()
    return picture


def captioned(plate: Plate) -> Image.Image:
    """Return the picture with the name and a few words below."""
    wide, tall = SIZE
    band = 64
    out = Image.new("RGB", (wide, tall + band), "white")
    out.paste(Image.fromarray(plate.picture), (0, 0))
    pen = ImageDraw.Draw(out)
    pen.text((14, tall + 8), plate.name, TINT, ImageFont.load_default(24))
    about = plate.about
    small = ImageFont.load_default(15)
    while pen.textlength(about, small) > wide - 28:
        about = about.rsplit(" ", 1)[0].rstrip(" ,…") + "…"
    pen.text((14, tall + 38), about, GREY, small)
    return out


def sheet(plates: Sequence[Plate]) -> Image.Image:
    """Return all pictures in rows, at half size."""
    tiles = [captioned(plate) for plate in plates]
    wide, tall = tiles[0].width // 2, tiles[0].height // 2
    rows = math.ceil(len(tiles) / COLUMNS)
    columns = math.ceil(len(tiles) / rows)
    out = Image.new("RGB", (columns * wide, rows * tall), "white")
    for k, tile in enumerate(tiles):
        small = tile.resize((wide, tall), Image.Resampling.LANCZOS)
        out.paste(small, (k % columns * wide, k // columns * tall))
    return out


def _encoded(picture: Image.Image, kind: str) -> bytes:
    data = io.BytesIO()
    picture.save(data, kind, quality=QUALITY, optimize=True)
    return data.getvalue()


def check_kind(kind: str) -> tuple[str, ...]:
    """Return what `robots`, `avatars` or `all` stands for; ConfigError for anything else."""
    kinds = {"robots": ("robots",), "avatars": ("avatars",), "all": ("robots", "avatars")}
    if kind not in kinds:
        raise ConfigError(f"a gallery shows {', '.join(kinds)}, got {kind!r}")
    return kinds[kind]
