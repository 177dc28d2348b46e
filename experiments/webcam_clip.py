"""Film a seated person who does an exercise before a webcam, as tests/data/lateral_raise.mp4 is.

python experiments/webcam_clip.py --exercise lateral_raise --out lateral_raise.mp4
"""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import cv2
import numpy as np
import typer

from rcare_marl.agents.coaching.exercise import load_exercise
from rcare_marl.agents.coaching.imitation import Imitation
from rcare_marl.agents.people.avatar import load_avatar, load_posture
from rcare_marl.agents.people.body.skeleton import DOFS
from rcare_marl.agents.people.human import Human
from rcare_marl.envs.devices import Wheelchair
from rcare_marl.rendering import Camera, make_renderer
from rcare_marl.world import World

CAMERA = Camera((2.0, 0.0, 1.15), (0.0, 0.0, 0.95), fov_deg=48, width=480, height=360)
BEFORE, AFTER = 1.5, 1.0  # rest before and after the repetition [s]


def main(
    exercise: str = "lateral_raise",
    avatar: str = "natalia",
    share: Annotated[float, typer.Option(help="of the way that is gone")] = 1.0,
    rate: Annotated[float, typer.Option(help="pictures a second")] = 15.0,
    out: Path = Path("lateral_raise.mp4"),
) -> None:
    """Move the person without physics, and write what the camera sees."""
    world = World()
    person = Human("person", load_avatar(avatar), posture=load_posture("wheelchair"))
    chair = Wheelchair(mounts="none")
    soles = person.soles(chair.frame("seat_back"))
    chair.fit_footplates(soles["left"], soles["right"])
    seat = chair.spawn(world)
    person.spawn(world, chair.frame_in_world("seat_back"))
    world.set_collision(person.body, seat, False)
    imitation = Imitation({dof.name: (-4.0, 4.0) for dof in DOFS})
    renderer, done = make_renderer(world), load_exercise(exercise)
    film = cv2.VideoWriter(
        str(out), cv2.VideoWriter.fourcc(*"mp4v"), rate, (CAMERA.width, CAMERA.height)
    )
    rest = done.angles(0.0)
    for time in np.arange(0.0, BEFORE + done.duration + AFTER, 1 / rate):
        angles = rest + share * (done.angles(max(time - BEFORE, 0.0)) - rest)
        for name, angle in imitation(angles).items():
            if name in person.movable:
                person.body.set_joints(person.body.indices([name]), [angle])
        film.write(renderer.render(CAMERA)[:, :, ::-1])
    film.release()


if __name__ == "__main__":
    typer.run(main)
