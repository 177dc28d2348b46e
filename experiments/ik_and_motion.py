"""Whole-body inverse kinematics and motion: figures on the terminal, pictures and a film in a folder.

Measures how often and how fast wrist goals are met; draws reaching, gaze and a walk; and films a caregiver
who walks up to Karan in his wheelchair, takes his weak forearm, lifts it, lays it back and lets go.

Run: python experiments/ik_and_motion.py [--out FOLDER]
"""

from __future__ import annotations

import dataclasses
import math
import time
from pathlib import Path

import numpy as np
import numpy.typing as npt
import typer

from rcare_marl.agents.people.avatar import body_model, body_segments, load_avatar, load_posture
from rcare_marl.agents.people.body.goal import Gaze, Goal, Orientation, Position
from rcare_marl.agents.people.body.ik import WholeBodyIk, reach
from rcare_marl.agents.people.body.skeleton import DOF_INDEX, JOINT_INDEX, forward_kinematics
from rcare_marl.agents.people.human import Human
from rcare_marl.agents.people.motion.caregiving import Caregiving
from rcare_marl.agents.people.motion.gait import LEGS
from rcare_marl.console import console, table
from rcare_marl.envs.devices import Wheelchair, spawn_fitted
from rcare_marl.pose import Pose, quaternion_from_matrix, quaternion_from_rpy
from rcare_marl.rendering import Camera, make_renderer
from rcare_marl.rendering.film import Film
from rcare_marl.rendering.portrait import contact_sheet, snapshot
from rcare_marl.world import World

GOALS = 200
CONTROL_STEPS = 24  # physics steps to a control step
ARM = ("collar", "shoulder", "elbow", "wrist")
HELPER_DOFS = (
    *(*LEGS, "spine1", "spine2", "spine3", "neck", "head", "left_shoulder", "left_elbow"),
    *("right_collar", "right_shoulder", "right_elbow", "right_wrist"),
)
LIFT = 0.15  # [m]


def measure() -> None:
    """Print how many random reachable wrist goals are met, and how fast."""
    columns = ("avatar", "joints", "met", "memetic", "median [ms]", "95 % [ms]", "median [mm]")
    rows = []
    for name in ("caregiver", "karan"):
        for side in ("left", "right"):
            for trunk in ((), ("spine1", "spine2", "spine3")):
                joints = (*trunk, *(f"{side}_{joint}" for joint in ARM))
                arm = f"{side} arm" + (" and trunk" if trunk else "")
                rows.append((name, arm, *_measured(name, side, joints)))
    title = f"{GOALS} random wrist poses within the active range, from standing"
    console().print(table(title, columns, rows))


def _measured(name: str, side: str, movable: tuple[str, ...]) -> list[str]:
    avatar = load_avatar(name)
    model = body_model(avatar.body_path(), avatar.height_m)
    segments = body_segments(avatar.body_path(), avatar.height_m, avatar.mass_kg, avatar.sex)
    limits = avatar.profile.limits("active")
    ik = WholeBodyIk(model.joints, segments, limits, movable=movable)
    start = load_posture("standing").angles(limits)
    rng, wrist = np.random.default_rng(1), f"{side}_wrist"
    chosen = [DOF_INDEX[dof] for dof in ik.dofs]
    found, times = [], []
    for k in range(GOALS + 1):
        angles = start.copy()
        low, high = ik.lower[chosen], ik.upper[chosen]
        angles[chosen] = low + rng.random(len(chosen)) * (high - low)
        rotations, positions = forward_kinematics(model.joints, angles)
        j = JOINT_INDEX[wrist]
        goals: list[Goal] = [
            Position(wrist, positions[j]),
            Orientation(wrist, quaternion_from_matrix(rotations[j])),
        ]
        since = time.perf_counter()
        solution = ik.solve(goals, start)
        if k:  # the first one compiles
            times.append(1e3 * (time.perf_counter() - since))
            found.append(solution)
    met, memetic = (np.mean([getattr(s, key) for s in found]) for key in ("success", "is_memetic"))
    return [
        f"{met:.1%}",
        f"{memetic:.1%}",
        f"{np.median(times):.2f}",
        f"{np.percentile(times, 95):.2f}",
        f"{1e3 * np.median([s.errors[0] for s in found]):.3f}",
    ]


def helper(world: World, pose: Pose) -> Human:
    """Return a caregiver who stands at `pose` and can walk and use her right arm."""
    person = Human(
        "caregiver",
        load_avatar("caregiver"),
        posture=load_posture("standing"),
        movable=HELPER_DOFS,
        moves=("walk", "grasp"),
    )
    person.spawn(world, pose)
    person.reset(np.random.default_rng(0))
    return person


def on_floor() -> World:
    """Return a world with a floor."""
    world = World()
    world.add_box((8, 8, 0.1), Pose((0, 0, -0.05)), name="floor", rgba=(0.75, 0.72, 0.68, 1))
    return world


def draw_reaching(folder: Path) -> None:
    """Draw postures that reach for points around a standing person who looks at them."""
    points = [
        (0.45, -0.3, 0.6),
        (0.5, -0.2, 1.1),
        (0.35, 0.3, 1.3),
        (0.25, -0.45, 1.75),
        (0.6, -0.1, 0.8),
        (0.1, -0.7, 1.2),
    ]
    pictures = []
    for point in points:
        world = on_floor()
        person = helper(world, Pose())
        world.add_sphere(0.03, Pose(point), name="goal", rgba=(0.9, 0.2, 0.1, 1), collides=False)
        person.set_angles(reach(person, "right", point).wish)
        look = WholeBodyIk.of(person, movable=("neck", "head"))
        present = np.array([person.angle(dof) for dof in DOF_INDEX])
        person.set_angles(look.solve([Gaze(point)], present, person.body.base_pose()).wish)
        camera = Camera(eye=(2.2, -1.5, 1.5), target=(0.15, 0, 0.95), width=480, height=640)
        pictures.append(snapshot(world, camera))
        world.close()
    contact_sheet(pictures, columns=3).save(folder / "reaching.png")


def draw_walk(folder: Path) -> None:
    """Draw a walk: forward, then turning about."""
    world = on_floor()
    person = helper(world, Pose((-1.2, 0, 0)))
    dt = CONTROL_STEPS * world.physics_dt
    caregiving = Caregiving(
        person, world, dt, script=lambda do: do.walk_to(0.5, 0.0, math.radians(120))
    )
    caregiving.reset(np.random.default_rng(0))
    pictures, steps = [], 0
    while not (steps and caregiving.is_idle):
        person.command(caregiving.act(), dt)
        for _ in range(CONTROL_STEPS):
            person.actuate()
            world.step()
        steps += 1
        if steps % 3 == 0:
            x, y, _ = person.pelvis.position
            camera = Camera(eye=(x + 0.4, y - 2.8, 1.2), target=(x, y, 0.85), width=320, height=480)
            pictures.append(snapshot(world, camera))
    contact_sheet(pictures, columns=8).save(folder / "walk.png")
    world.close()


class Care:
    """The scene of the film: Karan in his wheelchair, the caregiver some steps away."""

    def __init__(self) -> None:
        self.world = on_floor()
        self.chair = Wheelchair(mounts="none")
        avatar = load_avatar("karan")
        # The armrest itself carries the left arm here, so the posture's support leaves it out.
        seated = load_posture("wheelchair")
        trunk = tuple(
            joint for joint in JOINT_INDEX if not joint.startswith("left_") and joint != "pelvis"
        )
        seated = dataclasses.replace(seated, supported=trunk)
        self.karan = Human(
            "recipient",
            avatar,
            posture=seated,
            movable=("left_collar", "left_shoulder", "left_elbow", "left_wrist"),
        )
        self.karan.spawn(self.world, spawn_fitted(self.chair, self.karan, self.world))
        self.helper = helper(self.world, _standing(1.9, 1.3, math.pi))
        floor = self.world.bodies[0]
        forearm = {self.karan.frames[JOINT_INDEX[f"left_{j}"]].link for j in ("elbow", "wrist")}
        for link in range(-1, self.karan.body.link_count):
            if link not in forearm:  # the posture keeps the rest of him apart from the chair
                self.world.set_collision(self.karan.body, self.chair.body, False, links_a=(link,))
        self.world.set_collision(self.helper.body, floor, False)
        self.control_dt = CONTROL_STEPS * self.world.physics_dt
        self.caregiving = Caregiving(self.helper, self.world, self.control_dt, script=self._script)
        self.helper.may_take(self.karan, "left_elbow", hand="right")
        self.karan.reset(np.random.default_rng(0))
        self.world.mark_start()

    def forearm(self) -> npt.NDArray[np.float64]:
        """Return a point of Karan's left forearm near the wrist, on its upper side [m]."""
        elbow, wrist = (
            np.array(self.karan.joint_pose(f"left_{joint}").position)
            for joint in ("elbow", "wrist")
        )
        return wrist + 0.12 * (elbow - wrist) + (0.0, 0.0, 0.045)

    def _script(self, do: Caregiving) -> None:
        do.walk_to(0.5, 0.68, math.radians(-140))
        do.reach(lambda: self.forearm() + (0.0, 0.0, 0.12), palm=(0, 0, -1), fingers=(-0.3, -1, 0))
        do.reach(self.forearm, palm=(0, 0, -1), fingers=(-0.3, -1, 0), speed=0.2)
        do.grasp(self.karan, "left_elbow")
        do.move_by((0.0, 0.0, LIFT), speed=0.2)
        do.move_by((0.0, 0.0, -LIFT), speed=0.2, near=0.03)
        do.release()
        do.move_by((0.0, 0.02, 0.15))
        do.lower_arm()

    def reset(self) -> None:
        """Begin an episode."""
        self.world.rewind()
        for person in (self.karan, self.helper):
            person.reset(np.random.default_rng(0))
        self.caregiving.reset(np.random.default_rng(0))

    def step(self) -> None:
        """Take one control step; Karan lets his arm be moved: he pursues what angles it has."""
        self.helper.command(self.caregiving.act(), self.control_dt)
        present = {dof: self.karan.angle(dof) for dof in self.karan.movable}
        self.karan.command(self.karan.action_towards(present, self.control_dt), self.control_dt)
        for _ in range(CONTROL_STEPS):
            self.karan.actuate()
            self.helper.actuate()
            self.world.step()
        for person in (self.karan, self.helper):
            person.sense()


def film_care(folder: Path) -> None:
    """Film the caregiver who lifts Karan's forearm, and print what was lifted and with what force."""
    care = Care()
    care.reset()
    renderer = make_renderer(care.world)
    film = Film(folder / "care.mp4", care.world, fps=1 / care.control_dt)
    camera = Camera(eye=(3.2, -2.2, 1.8), target=(0.8, 0.55, 0.8), fov_deg=45)
    near = Camera(eye=(1.5, -0.75, 1.5), target=(0.3, 0.4, 0.9), fov_deg=45)
    start, highest, pictures, walked = None, 0.0, [], False
    for step in range(400):
        if care.caregiving.is_idle and step:
            break
        care.step()
        wrist = care.karan.joint_pose("left_wrist").position[2]
        legs = care.helper.legs
        walked = walked or (legs is not None and legs.stands and step > 2)
        if start is None and walked:
            start = wrist
        highest = max(highest, wrist)
        film.add(near if walked else camera, "Caregiver and Karan", f"{care.world.time:.1f} s")
        if step % 10 == 0:
            pictures.append(renderer.render(near if walked else camera))
    film.hold()
    film.close()
    renderer.close()
    end = care.karan.joint_pose("left_wrist").position[2]
    contact_sheet(pictures, columns=5).save(folder / "care.png")
    console().print(
        f"the wrist rose by {100 * (highest - (start or 0.0)):.1f} cm and came back to within "
        f"{100 * abs(end - (start or 0.0)):.1f} cm; greatest force of the grasp "
        f"{care.caregiving.greatest_grip:.0f} N; trouble: {care.caregiving.trouble or 'none'}"
    )


def _standing(x: float, y: float, heading: float) -> Pose:
    return Pose((x, y, 0.0), tuple(quaternion_from_rpy(0, 0, heading).tolist()))


def main(out: Path = Path("runs/ik_and_motion")) -> None:
    """Measure inverse kinematics; draw and film motion."""
    out.mkdir(parents=True, exist_ok=True)
    measure()
    draw_reaching(out)
    draw_walk(out)
    film_care(out)
    console().print(f"pictures and film in {out}")


if __name__ == "__main__":
    typer.run(main)
