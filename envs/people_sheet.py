"""A contact sheet of people: each dressed and seated in a wheelchair."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from PIL import Image

from rcare_marl.agents.people.avatar import AvatarConfig, load_posture
from rcare_marl.agents.people.human import Human
from rcare_marl.rendering import Camera
from rcare_marl.rendering.portrait import Picture, contact_sheet, snapshot
from rcare_marl.world import World

from .devices import Wheelchair, spawn_fitted

_DISTANCE, _EYE_HEIGHT, _LOOKS_AT = 2.6, 1.25, 0.7  # [m]: everybody at one scale


def draw_people(
    avatars: Sequence[AvatarConfig], *, columns: int = 8, size: tuple[int, int] = (190, 230)
) -> Image.Image:
    """Return a contact sheet of people, with name, age, stature and mass.

    Args:
        avatars: Who is drawn.
        columns: People in a row.
        size: Width and height of each picture [pixels].
    """
    pictures, captions = [], []
    for avatar in avatars:
        pictures.append(seated(avatar, size))
        captions.append(
            f"{avatar.age_years:.0f} y, {avatar.height_m:.2f} m, {avatar.mass_kg:.0f} kg"
        )
    return contact_sheet(pictures, captions, columns=min(columns, len(pictures)))


def seated(avatar: AvatarConfig, size: tuple[int, int]) -> Picture:
    """Return a picture of one person in a wheelchair, `size` [pixels] wide and high."""
    world = World()
    person = Human("person", avatar, posture=load_posture("wheelchair"))
    chair = Wheelchair(mounts="none")
    person.spawn(world, spawn_fitted(chair, person, world))
    world.set_collision(person.body, chair.body, False)
    world.mark_start()
    person.reset(np.random.default_rng(0))
    turn = np.radians(-38.0)
    eye = (_DISTANCE * np.cos(turn), _DISTANCE * np.sin(turn), _EYE_HEIGHT)
    view = Camera(eye, (0.05, 0.0, _LOOKS_AT), fov_deg=34, width=size[0], height=size[1])
    picture = snapshot(world, view)
    world.close()
    return picture
