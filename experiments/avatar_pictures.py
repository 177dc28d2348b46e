"""Take pictures of the avatars in their postures, and of their muscles at work.

python experiments/avatar_pictures.py --out runs/avatars [--avatar NAME]

python experiments/avatar_pictures.py --conditions --out docs/images

With `--conditions` it makes `condition_NAME.jpg` for each who is cared for: sitting from the front and from
the side, lying, being fed, and being moved, by the tasks `feeding` and `limb_repositioning`. Else
`sheet.png` shows every avatar in every posture, and `muscles_NAME.png` skeleton, muscles and skin from the
front and the side while the right arm reaches out.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import typer
from PIL import Image, ImageDraw, ImageFont

import rcare_marl
from rcare_marl import assets
from rcare_marl.agents.people.actuation.drive import ActuationConfig
from rcare_marl.agents.people.actuation.muscle_lines import activation_color, show_muscles
from rcare_marl.agents.people.avatar import load_avatar, load_posture
from rcare_marl.agents.people.body.skeleton import JOINT_INDEX
from rcare_marl.agents.people.human import Human
from rcare_marl.body import Body
from rcare_marl.envs.devices import Ventilator, Wheelchair, hang_ventilator, spawn_fitted
from rcare_marl.envs.devices.ventilator import throat
from rcare_marl.pose import Pose, quaternion_from_rpy
from rcare_marl.rendering import Camera
from rcare_marl.rendering.portrait import INK, Picture, contact_sheet, snapshot
from rcare_marl.world import World

POSTURES = ("wheelchair", "bed_raised", "bed_supine", "standing")
RATE = 30  # [Hz], of pictures and of control
REACH = {
    "right_shoulder_flexion": 1.2,
    "right_shoulder_abduction": -0.8,
    "right_elbow_flexion": 0.5,
}
REACHING = 1.2  # [s] until the picture
LONGEST = 120  # control steps of an episode that is looked for
BED = (2.0, 0.9, 0.16)  # [m]
BED_HEIGHT = 0.55
BACK = ("spine1", "spine2", "spine3", "neck", "head")
LINEN, WOOD = (0.86, 0.89, 0.93, 1.0), (0.62, 0.52, 0.42, 1.0)
STAND = (0.35, 0.35, 0.45)  # [m] beside the bed, for a ventilator


def scene(avatar: str, posture: str, *, muscles: bool) -> tuple[World, Human]:
    """Return an avatar in a posture, on the furniture that belongs to it."""
    world = World()
    person = Human(
        "person",
        load_avatar(avatar),
        posture=load_posture(posture),
        actuation=ActuationConfig(kind="muscle" if muscles else "skeletal", excitation="posture"),
    )
    support, furniture = Pose(), list[Body]()
    if posture == "wheelchair":
        chair = Wheelchair(mounts="none")
        support = spawn_fitted(chair, person, world)
        furniture.append(chair.body)
    elif posture.startswith("bed"):
        support = Pose((0.0, 0.0, BED_HEIGHT))
    person.spawn(world, support)
    if furniture and person.avatar.profile.ventilator_rate is not None:
        hang_ventilator(world, chair, person)
    if posture.startswith("bed"):
        make_bed(world, person)
        if person.avatar.profile.ventilator_rate is not None:
            stand_ventilator(world, person)
    for body in furniture:
        world.set_collision(person.body, body, False)
    world.mark_start()
    person.reset(np.random.default_rng(0))
    return world, person


def make_bed(world: World, person: Human) -> None:
    """Add a mattress whose back part is raised up to the back of who lies there, for the eye alone."""
    long, wide, thick = BED
    lean = np.radians(90 - person.posture.recline_deg)
    along = np.array((-np.cos(lean), 0.0, np.sin(lean)))
    out = np.array((np.sin(lean), 0.0, np.cos(lean)))
    upper = np.isin(person.model.owner, [JOINT_INDEX[joint] for joint in BACK])
    reach = float((world.skins[0].vertices()[upper] @ out).min()) + person.posture.sink
    hinge = np.array((-0.12, 0.0, BED_HEIGHT))
    if lean > 0.1:  # where the plane behind the back meets the mattress
        hinge[0] = (reach - BED_HEIGHT * out[2]) / out[0]
    legs, back = 0.55 * long, 0.45 * long
    flat = hinge + (0.5 * legs, 0.0, -0.5 * thick)
    tilted = hinge + 0.5 * back * along - 0.5 * thick * out
    turn = tuple(quaternion_from_rpy(0.0, float(lean), 0.0).tolist())
    for size, middle, turned in ((legs, flat, (0.0, 0.0, 0.0, 1.0)), (back, tilted, turn)):
        at = Pose(tuple(middle.tolist()), turned)
        world.add_box((size, wide, thick), at, rgba=LINEN, collides=False)
    head = world.skins[0].vertices()[person.model.owner == JOINT_INDEX["head"]]
    gap = float((head @ out).min()) - float(hinge @ out)
    pillow = hinge + float((head.mean(axis=0) - hinge) @ along) * along + 0.5 * gap * out
    world.add_box((0.32, 0.5, gap), Pose(tuple(pillow.tolist()), turn), rgba=LINEN, collides=False)
    for x in (flat[0] + 0.5 * legs - 0.1, flat[0] - 0.5 * legs - 0.65):
        tall = BED_HEIGHT - thick
        leg = Pose((float(x), 0.0, 0.5 * tall))
        world.add_box((0.08, 0.9 * wide, tall), leg, rgba=WOOD, collides=False)


def stand_ventilator(world: World, person: Human) -> None:
    """Put a ventilator on a stand beside the bed, its tube to the throat of who lies there."""
    device, end = Ventilator(), throat(person)
    at = Pose((float(end[0]), float(end[1]) + 0.5 * BED[1] + 0.3, STAND[2]))
    middle = Pose((at.position[0], at.position[1], 0.5 * STAND[2]))
    world.add_box(STAND, middle, rgba=WOOD, collides=False)
    way = [end + (0.0, aside, up) for aside, up in ((0.62, 0.1), (0.3, 0.16), (0.05, 0.1), (0, 0))]
    device.lead_tube([point - at.position for point in way])
    device.spawn(world, at)
    person.ignore(device.body)


def camera(person: Human, side: str, *, width: int, height: int, fov: float = 38.0) -> Camera:
    """Return a camera that sees the whole person from the front, the side or between."""
    joints = np.array([person.joint_pose(j).position for j in ("head", "left_foot", "right_foot")])
    middle = 0.5 * (joints[0] + joints[1:].mean(axis=0))
    size = float(np.linalg.norm(joints[0] - joints[1:].mean(axis=0))) + 0.35
    away = 0.5 * size / np.tan(np.radians(fov) / 2) * max(1.0, 0.75 * height / width) + 0.1
    angle = {"front": 8, "between": -42, "side": -82}[side]
    direction = (np.cos(np.radians(angle)), np.sin(np.radians(angle)), 0.22)
    eye = middle + away * np.array(direction)
    return Camera(
        tuple(eye.tolist()), tuple(middle.tolist()), fov_deg=fov, width=width, height=height
    )


def act(world: World, person: Human, seconds: float) -> None:
    """Let a person reach out for one control step after another."""
    for _ in range(round(seconds * RATE)):
        person.command(person.action_towards(REACH, 1 / RATE), 1 / RATE)
        for _ in range(round(1 / RATE / world.physics_dt)):
            person.actuate()
            world.step()
        person.sense()


def sheet(avatars: list[str], file: Path) -> None:
    """Draw each avatar in each posture."""
    size = (270, 246)
    pictures, captions = [], []
    for posture in POSTURES:
        for avatar in avatars:
            world, person = scene(avatar, posture, muscles=False)
            view = "side" if posture == "bed_supine" else "between"
            pictures.append(snapshot(world, camera(person, view, width=size[0], height=size[1])))
            captions.append(f"{person.avatar.name}, {posture}")
            world.close()
    save(contact_sheet(pictures, captions, columns=len(avatars)), file)


def condition(avatar: str, file: Path) -> None:
    """Draw how somebody sits and lies, is fed and is moved."""
    width, height = 330, 330
    pictures, captions = [], []
    views = (("wheelchair", "front"), ("wheelchair", "between"), ("bed_supine", "side"))
    for posture, view in views:
        world, person = scene(avatar, posture, muscles=False)
        pictures.append(snapshot(world, camera(person, view, width=width, height=height)))
        captions.append(f"{person.avatar.name}, {'lying' if 'bed' in posture else 'sitting'}")
        world.close()
    for task, share, caption in (("feeding", 0.75, "fed"), ("limb_repositioning", 0.5, "moved")):
        pictures.append(during(task, avatar, share, width=width, height=height))
        captions.append(f"being {caption}")
    picture = contact_sheet(pictures, captions, columns=len(pictures))
    picture.save(file, quality=86, optimize=True)
    print(file)


def during(task: str, avatar: str, share: float, *, width: int, height: int) -> Picture:
    """Return a picture of the scripted robot at work, after a share of the steps that it takes."""
    policies = {"robot": "scripted", "recipient": "cooperative"}
    env = rcare_marl.make(task, recipient=avatar, policies=policies)
    steps = 0
    for last in (LONGEST, None):
        env.reset(seed=0)
        stop = last or max(1, round(share * steps))
        steps = 0
        while not env.is_over and steps < stop:
            env.step({})
            steps += 1
    person = env.cast["recipient"]
    assert isinstance(person, Human)
    joint = "head" if task == "feeding" else "left_elbow"
    middle = np.array(person.joint_pose(joint).position) + (0.08, 0.0, -0.05)
    eye = middle + ((0.85, 0.65, 0.25) if task == "feeding" else (1.2, 1.15, 0.65))
    view = Camera(
        tuple(eye.tolist()), tuple(middle.tolist()), fov_deg=44, width=width, height=height
    )
    picture = snapshot(env.world, view)
    env.close()
    return picture


def muscles(avatar: str, posture: str, file: Path) -> None:
    """Draw bones and muscles, bare and under the skin, from the front and the side, in a reach."""
    world, person = scene(avatar, posture, muscles=True)
    drawn = show_muscles(person, world)
    act(world, person, REACHING)
    most = drawn.activations().max()
    columns = []
    for opacity in (0.0, 0.3):
        skin = world.skins[0]
        alpha = np.full((len(skin.colors), 1), round(255 * opacity), np.uint8)
        skin.colors = np.hstack((skin.colors[:, :3], alpha))
        for side in ("front", "side"):
            columns.append(snapshot(world, camera(person, side, width=480, height=600)))
    title = (
        f"{person.avatar.name}: {person.avatar.condition}; reaching, greatest activation {most:.2f}"
    )
    picture = contact_sheet([np.hstack(columns)], [title], columns=1)
    add_color_bar(picture)
    save(picture, file)
    world.close()


def add_color_bar(image: Image.Image) -> None:
    """Draw what colour stands for what activation into the lower right corner."""
    bar = np.tile(activation_color(np.linspace(0, 1, 160))[None], (12, 1, 1))
    left, top = image.width - 190, image.height - 24
    pen, font = ImageDraw.Draw(image), ImageFont.load_default(14)
    pen.rectangle((left - 20, top - 24, image.width, image.height), fill=(236, 238, 241))
    image.paste(Image.fromarray(bar), (left, top))
    for x, text in ((left - 14, "0"), (left + 168, "1")):
        pen.text((x, top - 2), text, INK, font)
    pen.text((left + 36, top - 20), "activation", INK, font)


def save(picture: Image.Image, file: Path) -> None:
    """Write a picture, with few colours and so small, and say where."""
    few = picture.quantize(
        256, method=Image.Quantize.MAXCOVERAGE, kmeans=3, dither=Image.Dither.NONE
    )
    few.save(file, optimize=True)
    print(file)


def main(
    out: Path = Path("runs/avatars"),
    avatar: str = "",
    conditions: bool = False,
) -> None:
    """Draw one avatar, or all."""
    if avatar:
        load_avatar(avatar)  # which refuses an unknown name
    out.mkdir(parents=True, exist_ok=True)
    chosen = [avatar] if avatar else list(assets.names("avatars"))
    if conditions:
        for name in chosen:
            if name != "caregiver":
                condition(name, out / f"condition_{name}.jpg")
        return
    sheet(chosen, out / "sheet.png")
    for name in chosen:
        posture = "standing" if name == "caregiver" else "wheelchair"
        muscles(name, posture, out / f"muscles_{name}.png")


if __name__ == "__main__":
    typer.run(main)
