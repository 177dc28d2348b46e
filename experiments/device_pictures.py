"""Take a picture of each assistive device with somebody who sits, lies or hangs in it.

python experiments/device_pictures.py --out docs/images/devices.jpg [--device NAME ...]

People and devices are put in place and stand still; physics runs for a moment before the picture.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from pathlib import Path

import typer
from PIL import Image

from rcare_marl.agents.people.avatar import load_avatar, load_posture
from rcare_marl.agents.people.human import Human
from rcare_marl.body import Body
from rcare_marl.envs.devices import (
    CeilingLift,
    FloorLift,
    HospitalBed,
    ManualWheelchair,
    PlatformLift,
    TransferBench,
    device_kinds,
    make_device,
    spawn_fitted,
)
from rcare_marl.errors import check_name
from rcare_marl.pose import Pose
from rcare_marl.rendering.portrait import contact_sheet, portrait
from rcare_marl.world import World

SIZE = (480, 440)  # [pixel]
COLUMNS, QUALITY = 4, 86
CEILING = 2.4  # [m]
SETTLE, SPREAD = 0.5, 3.0  # [s] of physics, and while legs of a lift spread
WHITE, LINEN = (0.93, 0.94, 0.95, 1.0), (0.80, 0.84, 0.88, 1.0)
Scene = tuple[World, list[Body], tuple[float, float, float]]  # bodies to see, way to the camera


def someone(avatar: str, posture: str) -> Human:
    """Return a person who does not move by themselves."""
    return Human(
        "person", load_avatar(avatar), posture=load_posture(posture), movable=(), fixed_base=False
    )


def slung(
    lift: FloorLift | CeilingLift, avatar: str, at: Pose, control: str, place: float
) -> Scene:
    """Return a lift with somebody in its sling."""
    world = World()
    world.add_box((20, 20, 0.1), Pose((0.0, 0.0, -0.05)), name="floor", rgba=(0, 0, 0, 0))
    lift.spawn(world, at)
    lift.set_position(control, place)
    posture, frame = lift.postures["slung"]
    person = someone(avatar, posture)
    person.spawn(world, lift.frame_in_world(frame))
    lift.carry(person)
    settle(world)
    return world, [lift.body, person.body], (0.75, 0.9, 0.32)


def settle(world: World, seconds: float = SETTLE) -> None:
    """Run physics for a moment; nobody here moves by themselves."""
    for _ in range(round(seconds / world.physics_dt)):
        world.step()


def seat_in_chair(world: World, chair: ManualWheelchair, avatar: str, at: Pose) -> Human:
    """Spawn a chair whose footrests and armrests fit somebody, and seat them."""
    person = someone(avatar, "wheelchair")
    person.spawn(world, spawn_fitted(chair, person, world, at))
    chair.carry(person)
    chair.brake(True)
    return person


def hoyer_lift_sling() -> Scene:
    """Somebody half lies in a universal sling, the legs of the lift spread."""
    lift = FloorLift("hoyer_lift_sling")
    scene = slung(lift, "natalia", Pose(), "boom", 0.25)
    lift.command("legs", lift.limits("legs")[1])
    settle(scene[0], SPREAD)
    return scene


def hoyer_lift_transfer() -> Scene:
    """Somebody sits upright in a sling for transfers."""
    return slung(FloorLift("hoyer_lift_transfer"), "jose", Pose(), "boom", 0.1)


def ceiling_lift() -> Scene:
    """Somebody hangs below a track."""
    lift = CeilingLift(track_length=2.2)
    return slung(lift, "daniel", Pose((0.0, 0.0, CEILING)), "lift", -0.45)


def manual_wheelchair() -> Scene:
    """Somebody sits, feet on the footplates."""
    world, chair = World(), ManualWheelchair()
    person = seat_in_chair(world, chair, "karan", Pose())
    return world, [chair.body, person.body], (0.85, 0.65, 0.3)


def transfer_bench() -> Scene:
    """Somebody sits beside a bathtub, two legs of the bench in it."""
    world, bench = World(solver_iterations=150), TransferBench()
    tub = [
        world.add_box(size, Pose(at), name="tub", rgba=WHITE)
        for size, at in (
            ((1.5, 0.03, 0.4), (0.1, 0.1, 0.2)),
            ((1.5, 0.03, 0.4), (0.1, 0.75, 0.2)),
            ((0.03, 0.65, 0.4), (-0.65, 0.425, 0.2)),
            ((0.03, 0.65, 0.4), (0.85, 0.425, 0.2)),
        )
    ]
    person = someone("kim", "bench")
    soles = person.soles(bench.frame("seat_back"))
    bench.fit_legs(soles["left"], soles["right"])
    bench.spawn(world)
    person.spawn(world, bench.frame_in_world("seat_back"))
    bench.carry(person)
    return world, [bench.body, person.body, *tub], (0.7, -0.85, 0.45)


def slide_board() -> Scene:
    """Somebody sits on a board between a bed and a seat."""
    world, board, height = World(), make_device("slide_board"), 0.5
    person = someone("daniel", "bench")
    seats = []
    for x, size, rgba in ((-0.75, 1.0, LINEN), (0.52, 0.5, (0.30, 0.42, 0.55, 1.0))):
        at = Pose((-0.12, x, 0.5 * height))
        seats.append(world.add_box((0.55, size, height), at, name="seat", rgba=rgba))
    thickness = board.model.figure("thickness")
    turn = (0.0, 0.0, math.sin(math.pi / 4), math.cos(math.pi / 4))
    board.spawn(world, Pose((0.0, 0.0, height + thickness), turn))
    middle = Pose((-0.17, -0.1, height + thickness))
    person.spawn(world, middle)
    return world, [board.body, person.body, *seats], (0.8, 0.55, 0.4)


def hospital_bed() -> Scene:
    """Somebody half sits, knees raised, one side rail up."""
    world, bed, avatar = World(), HospitalBed(), load_avatar("morgan")
    bed.spawn(world)
    for name, angle in (("backrest", 40.0), ("knee", 12.0)):
        bed.set_position(name, math.radians(angle))
    bed.set_position("height", 0.2)
    bed.set_position("rail_right", bed.limits("rail_right")[1])
    person = Human("person", avatar, posture=bed.posture(avatar), movable=())
    person.spawn(world, bed.support(person))
    return world, [bed.body, person.body], (0.55, 0.95, 0.42)


def platform_lift() -> Scene:
    """Somebody in a wheelchair is on the way up."""
    world, chair, lift = World(), ManualWheelchair(), PlatformLift(rise=0.6)
    lift.spawn(world)
    lift.set_position("height", 0.35)
    lift.set_position("ramp", lift.limits("ramp")[1])
    lift.set_position("bar", 0.0)
    person = seat_in_chair(world, chair, "karan", lift.frame_in_world("platform"))
    return world, [lift.body, chair.body, person.body], (0.75, -0.8, 0.35)


SCENES: dict[str, Callable[[], Scene]] = {kind: globals()[kind] for kind in device_kinds()}


def sheet(names: Sequence[str]) -> Image.Image:
    """Return the pictures of devices in rows, each with its name."""
    pictures = []
    for name in names:
        world, bodies, direction = SCENES[name]()
        pictures.append(portrait(world, bodies, direction, SIZE))
        world.close()
    return contact_sheet(pictures, names, columns=COLUMNS)


def main(out: Path = Path("docs/images/devices.jpg"), device: list[str] = list(SCENES)) -> None:  # noqa: B006
    """Draw the devices that are asked for, all if none is."""
    for name in device:
        check_name("device", name, SCENES)
    out.parent.mkdir(parents=True, exist_ok=True)
    sheet(device).save(out, quality=QUALITY, optimize=True)


if __name__ == "__main__":
    typer.run(main)
