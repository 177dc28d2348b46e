"""Measure how well the coach's camera reads a person who wears marker bands.

python experiments/coaching_camera.py [--avatar kim] [--robot nao] [--width 640] [--noise 0] [--out FOLDER]

A seated person, moved without physics, does each exercise once before a robot whose own camera is rendered,
then once with half the range. For each exercise it prints the errors against the true angles, median and
95 % [degrees], the share of frames in which an angle was known, how many cards were found, what the rules
make of both, and the time a picture took. With --out, pictures at the key poses with the cards found.
"""

from __future__ import annotations

import argparse
import math
import time
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import numpy.typing as npt
from PIL import Image

from rcare_marl.agents.coaching.exercise import Exercise, load_exercises
from rcare_marl.agents.coaching.imitation import Imitation
from rcare_marl.agents.coaching.recognition.recogniser import Frame, Repetition
from rcare_marl.agents.coaching.recognition.rule_recogniser import RuleRecogniser
from rcare_marl.agents.coaching.sources.band_pose import BandPose, Layout
from rcare_marl.agents.coaching.sources.camera_source import CameraReading, CameraSource, resting
from rcare_marl.agents.coaching.sources.joints_source import TO_BODY
from rcare_marl.agents.coaching.sources.marker_band import SEGMENTS, band_set
from rcare_marl.agents.coaching.sources.worn_band import segment_on_link, wear
from rcare_marl.agents.coaching.upper_body import ARM, SIDES, SIGN, UpperBody, directions, turn_y
from rcare_marl.agents.people.avatar import load_avatar, load_posture
from rcare_marl.agents.people.body.skeleton import DOFS
from rcare_marl.agents.people.human import Human
from rcare_marl.agents.robots.robot import Robot
from rcare_marl.agents.robots.robot_config import load_robot
from rcare_marl.agents.sensing.camera import CameraSensor
from rcare_marl.agents.sensing.suite import SensorSuite
from rcare_marl.envs.devices import Wheelchair
from rcare_marl.pose import Array, Pose, quaternion_from_rpy
from rcare_marl.rendering import Camera, make_renderer
from rcare_marl.world import World

Picture = npt.NDArray[np.uint8]
# Where the robot is, facing the chair: root of NAO on a table of 0.72 m, of Pepper on the floor [m], and
# the pitch of its head [rad].
MOUNTS = {"nao": (1.45, 0.72 + 0.3189, 0.08), "pepper": (1.55, 0.0, 0.05)}
COLUMNS = ("left arm", "right arm", "head", "trunk", "elbows", "rotations", "pronations")


class Scene:
    """A person with bands in a wheelchair, and a robot that looks at them."""

    def __init__(self, options: argparse.Namespace) -> None:
        """Build it."""
        self.rng = np.random.default_rng(options.seed)
        self._noise = options.noise
        self.world = world = World()
        self.person = person = Human(
            "person", load_avatar(options.avatar), posture=load_posture("wheelchair")
        )
        chair = Wheelchair(mounts="none")
        soles = person.soles(chair.frame("seat_back"))
        chair.fit_footplates(soles["left"], soles["right"])
        seat = chair.spawn(world)
        person.spawn(world, chair.frame_in_world("seat_back"))
        world.set_collision(person.body, seat, False)
        self.bands = band_set(size=options.size)
        careless = 1.0 if options.careless else 0.0
        wear(world, person, self.bands, rng=self.rng, slip=0.005 * careless, twist_deg=3 * careless)
        self._camera = self._robot_camera(options)
        # All ranges are open, so that everybody can do every exercise.
        self._imitation = Imitation({dof.name: (-4.0, 4.0) for dof in DOFS})
        self._layout = Layout(self.bands)
        self.renderer = make_renderer(world)

    def _robot_camera(self, options: argparse.Namespace) -> Camera:
        config = load_robot(options.robot)
        x, z, pitch = MOUNTS[options.robot]
        x = options.distance if options.distance is not None else x
        z = z if options.raised is None else z + options.raised
        pitch = pitch if options.pitch is None else options.pitch
        posture = {**config.postures["home"], "HeadPitch": pitch}
        robot = Robot("robot", config, moves=["right_arm", "head"], posture=posture)
        suite = SensorSuite([{"kind": "camera", "camera": "head"}], "robot")
        robot.equip(suite)
        turn = tuple(quaternion_from_rpy(0, 0, math.pi).tolist())
        robot.spawn(self.world, Pose((x, 0.0, z), turn))
        robot.reset(self.rng)
        suite.bind(self.world, robot)
        sensor = suite.sensors["camera"]
        assert isinstance(sensor, CameraSensor)
        return replace(sensor.view, width=options.width, height=options.width * 3 // 4)

    def put(self, angles: Array) -> Array:
        """Put the person into a posture, and return the angles that they then truly have [rad], [16]."""
        person = self.person
        for dof, angle in self._imitation(angles).items():
            index = person.movable.index(dof)
            person.body.set_joints(person.body.indices([person.movable[index]]), [angle])
        base = person.pelvis.matrix()[:3, :3] @ TO_BODY.T
        turns = []
        for segment in SEGMENTS:
            link, place = segment_on_link(person, segment)
            on_link = person.body.link_pose(link).matrix()[:3, :3]
            turns.append(base.T @ on_link @ place[:3, :3])
        return self._angles(turns)

    def _angles(self, turns: list[Array]) -> Array:
        pose = BandPose.of(self._layout, UpperBody.of_height(1.7), 1.7)
        trunk = turns[0]
        pose.trunk, pose.head = trunk, trunk.T @ turns[1]
        pose.shoulders = np.array([trunk.T @ turns[2], trunk.T @ turns[3]])
        for i, side in enumerate(SIDES):
            upper, fore = turns[2 + i], turns[4 + i]
            bend = math.acos(np.clip(upper[:, 2] @ fore[:, 2], -1, 1))
            twist = (upper @ turn_y(np.float64(-bend))).T @ fore
            angle = math.atan2(twist[1, 0] - twist[0, 1], twist[0, 0] + twist[1, 1])
            pose.elbows[i], pose.forearms[i] = bend, -SIGN[side] * angle
        return pose.angles()

    def shoot(self) -> CameraReading:
        """Return what the camera sees."""
        image = self.renderer.render(self._camera)
        if self._noise:
            noisy = image + self.rng.normal(0.0, self._noise, image.shape)
            image = np.clip(np.rint(noisy), 0, 255).astype(np.uint8)
        return CameraReading(image, self._camera)


class Session:
    """Exercises before the camera, one after another."""

    def __init__(self, scene: Scene, options: argparse.Namespace) -> None:
        """Calibrate: one second of sitting still."""
        self._scene, self._rate, self._out = scene, options.rate, options.out
        self._source = CameraSource(
            bands=scene.bands,
            height=scene.person.avatar.height_m if options.told else None,
            recline=math.radians(scene.person.posture.recline_deg),
        )
        self._time = 0.0
        self.spent: list[tuple[float, float]] = []
        scene.put(resting())
        for _ in range(math.ceil(1.2 * self._rate) + 1):
            self._watch()
        if self._source.height is None:
            raise SystemExit("too few bands are seen for a calibration")
        self.height = self._source.height

    def _watch(self) -> Frame | None:
        reading = self._scene.shoot()
        begun = time.thread_time()
        seen = self._source.find(reading)
        found = time.thread_time()
        frame = self._source.follow(seen, reading.camera, self._time)
        self.spent.append((found - begun, time.thread_time() - found))
        self._time += 1 / self._rate
        self._image = reading.image
        return frame

    def perform(
        self, exercise: Exercise, share: float, name: str
    ) -> tuple[Array, Repetition | None]:
        """Return errors [deg] and number of cards, [frames, 8], and how the repetition was judged."""
        rules, rows, judged = RuleRecogniser(), [], None
        rules.begin(exercise)
        rest = exercise.keys[0]
        first = exercise.poses[0].move_s
        for k in np.arange(-0.6, exercise.duration + 2.5, 1 / self._rate):
            true = self._scene.put(rest + share * (exercise.angles(k) - rest))
            frame = self._watch()
            if frame is not None:
                judged = rules.update(frame).finished or judged
            if 0 <= k <= exercise.duration:
                angles = np.full(16, np.nan) if frame is None else frame.angles
                rows.append([*_errors(angles, true), len(self._source.seen)])
            if self._out is not None and first <= k < first + 1 / self._rate:
                self._draw(Path(self._out) / f"{name}.png")
        return np.array(rows), judged

    def _draw(self, path: Path) -> None:
        seen = self._source.seen
        image = self._image.copy()
        corners = [square.astype(np.float32)[None] for square in seen.values()]
        cv2.aruco.drawDetectedMarkers(image, corners, np.array(list(seen)))
        path.parent.mkdir(parents=True, exist_ok=True)
        Image.fromarray(image).save(path)


def _errors(angles: Array, true: Array) -> list[float]:
    """Return by how much directions and angles are off [deg], as `COLUMNS` has it; of two sides the worse."""
    found, wanted = directions(angles), directions(true)
    out = [
        float(np.arccos(np.clip(found[part] @ wanted[part], -1, 1)))
        for part in ("left_arm", "right_arm", "head", "trunk")
    ]
    off = np.abs((angles - true + np.pi) % (2 * np.pi) - np.pi)
    for k in (3, 2, 4):
        out.append(max(off[ARM["left"].start + k], off[ARM["right"].start + k]))
    return np.degrees(out).tolist()


def _told(judged: Repetition | None) -> str:
    if judged is None:
        return "nothing"
    return "right" if judged.right else f"wrong: {', '.join(judged.errors)}"


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--avatar", default="kim")
    parser.add_argument("--robot", choices=tuple(MOUNTS), default="nao")
    parser.add_argument(
        "--distance", type=float, help="of the robot's root from the seat's back [m]"
    )
    parser.add_argument("--raised", type=float, help="above its usual place [m]")
    parser.add_argument("--pitch", type=float, help="of its head, down [rad]")
    parser.add_argument("--width", type=int, default=640)
    parser.add_argument("--size", type=float, default=0.06, help="edge of the markers [m]")
    parser.add_argument("--noise", type=float, default=0.0, help="of each pixel [grey step of 256]")
    parser.add_argument("--careless", action="store_true", help="bands off by 5 mm and 3 degrees")
    parser.add_argument("--told", action="store_true", help="tell the source the stature")
    parser.add_argument("--rate", type=float, default=10.0, help="pictures a second")
    parser.add_argument("--quick", action="store_true", help="leave out the half range")
    parser.add_argument("--exercises", nargs="*", help="which; all if nothing is said")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--out", help="folder for pictures")
    options = parser.parse_args()
    cv2.setNumThreads(1)
    session = Session(Scene(options), options)
    print(f"stature told {session.height:.2f} m; errors: median / 95 % [deg] (known [%])")
    print(f"| exercise | {' | '.join(COLUMNS)} | cards | right one | half range |")
    for exercise in load_exercises(options.exercises):
        rows, judged = session.perform(exercise, 1.0, exercise.name)
        half = None
        if not options.quick:
            _, half = session.perform(exercise, 0.5, f"{exercise.name}_half")
        cells = []
        for column in rows[:, :-1].T:
            known = column[np.isfinite(column)]
            middle, most = np.percentile(known, (50, 95)) if len(known) else (np.nan, np.nan)
            cells.append(f"{middle:.1f} / {most:.1f} ({100 * len(known) / len(column):.0f})")
        print(
            f"| {exercise.name} | {' | '.join(cells)} | {rows[:, -1].mean():.1f} | {_told(judged)} | "
            f"{'-' if options.quick else _told(half)} |",
            flush=True,
        )
    find, solve = 1e3 * np.array(session.spent).T
    both = find + solve
    print(
        f"milliseconds of one core a picture: finding {np.median(find):.1f}, solving "
        f"{np.median(solve):.1f}, both {np.median(both):.1f} (95 %: {np.percentile(both, 95):.1f})"
    )


if __name__ == "__main__":
    main()
