"""The command `bench avatars`: how fast a whole person is, with and without muscles and soft tissue.

The test is that of the RCareWorld paper: one avatar in an empty scene, the pitch of the neck driven for five
seconds. All 112 degrees of freedom move. A frame is 1/60 s, four physics steps of 1/240 s.

Method. Every variant has a world of its own and goes through the same five simulated seconds in blocks
of one control step of 0.1 s: the person is told a new angle of the neck, the physics steps follow with
all torques, and the person senses at the end. In each block all variants run one after the other, and
each block begins with another one, so that whatever slows the machine down meets all of them. The first
frame of a block is not timed, the other five are: it brings the variant's memory back into the cache. A
figure is the median over blocks, a ratio that of two medians.

`bare_physics_fps` is nothing but `stepSimulation`: before each block the state of the skeletal person's
physics is saved, the bare steps run from there, and the state is put back. Without torques a person
slumps into the limits of the joints, and the physics gets two to three times dearer over half a second;
within the 0.1 s of a block it changes by some percent.

- `skeletal_fps`: joint torques that pursue angles.
- `muscle_fps`: Hill muscles, and the controller that finds excitations for the neck's angle, at 60 Hz.
- `tissue_fps`: the skeletal person with flesh on one arm, into which a sphere of 20 mm is held 8 mm deep.
- `tissue_idle_fps`: the same, and the sphere is two metres away, as it is in the scenes without flesh.
- `muscle_kernel_us`: joint angles, rates and excitations to torques for all muscles of one person, every
  call with another posture.
- `batched_person_steps_per_s`: the same for 1,024 people in one call.

Times are processor time of the one thread that does all this. On an idle machine that is the time on
the clock; where other programs want the same core it leaves them out. `processor_share` says how much of
the clock time the thread had.
"""

from __future__ import annotations

import platform
import statistics
import time
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from rcare_marl.agents.people.actuation.drive import ActuationConfig
from rcare_marl.agents.people.actuation.muscle_model import MuscleModel
from rcare_marl.agents.people.actuation.muscular import MuscleDrive
from rcare_marl.agents.people.avatar import AvatarConfig, load_avatar, load_posture
from rcare_marl.agents.people.human import Human
from rcare_marl.bullet import bullet
from rcare_marl.console import console, table
from rcare_marl.errors import ConfigError
from rcare_marl.pose import Array, Pose
from rcare_marl.provenance import versions
from rcare_marl.world import World

from .environment import in_turns

Block = Callable[[], tuple[float, float]]  # does its work and returns processor and clock time [s]

POSTURE = "wheelchair"
SEAT = 0.5  # [m]
PHYSICS_DT = 1 / 240  # [s]
FRAME_STEPS = 4
BLOCK_FRAMES = 6  # 0.1 s
TIMED_FRAMES = BLOCK_FRAMES - 1
CONTROL_DT = 0.1  # [s]
WARM_BLOCKS = 5
SWING, PERIOD = 0.25, 2.5  # [rad], [s] of the neck's pitch
NECK = "neck_flexion"
ARM = "right_arm"
PRESSED = "right_elbow"  # whose segment is the forearm
SPHERE, DEPTH = 0.020, 0.008  # [m] radius and how deep it is held
PEOPLE = 1024
CALLS = 32  # of the kernel in a block, each with another posture
SEED = 0

# What the figures should reach on one core: at least, but for the kernel, which is to take at most that.
WANTED = {
    "skeletal_ratio": 0.6,
    "muscle_ratio": 0.4,
    "tissue_idle_ratio": 0.95,
    "skeletal_fps": 1500.0,
    "muscle_fps": 1000.0,
    "tissue_fps": 120.0,
    "muscle_kernel_us": 60.0,
    "batched_person_steps_per_s": 15000.0,
}
_AT_MOST = ("muscle_kernel_us",)


def bench(avatar: str = "karan", seconds: float = 5.0) -> dict[str, Any]:
    """Return measured speeds of a person, as plain values for JSON.

    Args:
        avatar: Name or YAML file of an avatar.
        seconds: Simulated time of each variant [s].

    Raises:
        ConfigError: If the time is shorter than a block.
        UnknownNameError: If there is no such avatar.
    """
    if not seconds >= CONTROL_DT:
        raise ConfigError(f"seconds must be at least {CONTROL_DT}, got {seconds}")
    who = load_avatar(avatar)
    skeletal = Scene(who)
    muscular = Scene(who, ActuationConfig(kind="muscle", excitation="posture"))
    pressed, idle = Scene(who, tissue=(ARM,)), Scene(who, tissue=(ARM,))
    scenes = (skeletal, muscular, pressed, idle)
    for scene in scenes:
        _add_sphere(scene, is_touched=scene is pressed)
    touched, untouched = pressed.human.tissue, idle.human.tissue
    assert touched is not None and untouched is not None
    drive = muscular.human.drive
    assert isinstance(drive, MuscleDrive)
    forces: list[float] = []

    def press() -> tuple[float, float]:
        spent = pressed.run()
        forces.append(sum(touched.contact_forces().values()))  # [N]
        return spent

    blocks: dict[str, Block] = {
        "bare_physics": skeletal.run_bare,
        "skeletal": skeletal.run,
        "muscle": muscular.run,
        "tissue": press,
        "tissue_idle": idle.run,
        "muscle_kernel": _one_person(drive.model, skeletal.human),
        "batched": _many_people(drive.model, skeletal.human),
    }
    for scene in scenes:
        scene.human.reset(np.random.default_rng(SEED))
    for _ in range(WARM_BLOCKS):
        for block in blocks.values():
            block()
    forces.clear()
    spent = in_turns(blocks, round(seconds / CONTROL_DT))
    times = {name: statistics.median(own for own, _ in found) for name, found in spent.items()}
    processor, clock = np.sum([pair for found in spent.values() for pair in found], axis=0)
    if not min(forces) > 0 or any(body.is_awake for body in untouched.bodies.values()):
        raise ConfigError(f"the arm of {who.name} does not lie as this test wants it")
    return {
        "avatar": who.name,
        "seconds": seconds,
        **_figures(times),
        "processor_share": float(processor / clock),
        "muscles": len(drive.model.names),
        "tissue_particles": touched.particle_count,
        "tissue_force_n": statistics.median(forces),
        "machine": platform.platform(),
        "versions": versions(),
    }


class Scene:
    """A person alone in a world, whose neck nods."""

    def __init__(
        self,
        who: AvatarConfig,
        actuation: ActuationConfig | None = None,
        *,
        tissue: tuple[str, ...] = (),
    ) -> None:
        """Put the person there.

        Args:
            who: The person.
            actuation: How the joints are driven; by joint torques if None.
            tissue: Where flesh yields.
        """
        self.world = World(PHYSICS_DT)
        self.human = Human(
            "person", who, posture=load_posture(POSTURE), actuation=actuation, tissue=tissue
        )
        self.human.spawn(self.world, Pose((0.0, 0.0, SEAT)))
        self._blocks = 0

    def run(self) -> tuple[float, float]:
        """Nod for one block."""
        self._go(1)
        watch = _Watch()
        self._blocks += 1
        phase = 2 * np.pi * self._blocks * CONTROL_DT / PERIOD
        angles = {NECK: float(SWING * np.sin(phase))}
        self.human.command(self.human.action_towards(angles, CONTROL_DT), CONTROL_DT)
        self._go(TIMED_FRAMES)
        self.human.sense()
        return watch.read()

    def _go(self, frames: int) -> None:
        for _ in range(frames * FRAME_STEPS):
            self.human.actuate()
            self.world.step()

    def run_bare(self) -> tuple[float, float]:
        """Let Bullet alone go on for one block, and return to the state before."""
        client, step = self.world.client, bullet.stepSimulation
        before = bullet.saveState(physicsClientId=client)
        for _ in range(FRAME_STEPS):
            step(physicsClientId=client)
        watch = _Watch()
        for _ in range(TIMED_FRAMES * FRAME_STEPS):
            step(physicsClientId=client)
        spent = watch.read()
        bullet.restoreState(before, physicsClientId=client)
        bullet.removeState(before, physicsClientId=client)
        return spent


class _Watch:
    """Processor and clock time since it was made."""

    def __init__(self) -> None:
        self._clock, self._processor = time.perf_counter(), time.thread_time()

    def read(self) -> tuple[float, float]:
        return time.thread_time() - self._processor, time.perf_counter() - self._clock


def _add_sphere(scene: Scene, *, is_touched: bool) -> None:
    """Hold a sphere in the flesh of the arm from above, or far away."""
    world, human = scene.world, scene.human
    at = np.array((2.0, 0.0, SEAT))
    if is_touched:
        assert human.tissue is not None
        skin, out = human.tissue.skin_point(PRESSED, (0.0, 0.0, 1.0))
        at = skin + (SPHERE - DEPTH) * out
    sphere = world.add_sphere(SPHERE, Pose(tuple(at.tolist())), name="sphere")
    if is_touched:
        world.set_collision(sphere, human.body, False)  # the flesh is what feels it


def _people(model: MuscleModel, human: Human, count: int) -> tuple[Array, Array, Array]:
    """Return angles around the posture, rates and excitations of different people."""
    rng = np.random.default_rng(SEED)
    start = np.array([human.angle(dof) for dof in model.dofs])
    q = start + rng.normal(0.0, 0.1, (count, len(start)))
    return q, rng.normal(0.0, 1.0, q.shape), rng.uniform(0.0, 1.0, (count, len(model.names)))


def _one_person(model: MuscleModel, human: Human) -> Block:
    q, qd, excitation = _people(model, human, CALLS)
    state, out, dt = model.settled_state(q[0]), np.zeros(q.shape[1]), PHYSICS_DT

    def block() -> tuple[float, float]:
        model.step(q[0], qd[0], excitation[0], state, dt, out)
        watch = _Watch()
        for k in range(CALLS):
            model.step(q[k], qd[k], excitation[k], state, dt, out)
        return watch.read()

    return block


def _many_people(model: MuscleModel, human: Human) -> Block:
    q, qd, excitation = _people(model, human, PEOPLE)
    states, out, dt = model.new_states(PEOPLE), np.zeros_like(q), PHYSICS_DT

    def block() -> tuple[float, float]:
        watch = _Watch()
        model.step_many(q, qd, excitation, states, dt, out)
        return watch.read()

    return block


def _figures(times: Mapping[str, float]) -> dict[str, Any]:
    """Return figures, ratios and which of them reach what is wanted."""
    out: dict[str, Any] = {
        f"{name}_fps": TIMED_FRAMES / times[name]
        for name in ("bare_physics", "skeletal", "muscle", "tissue", "tissue_idle")
    }
    out["muscle_kernel_us"] = 1e6 * times["muscle_kernel"] / CALLS
    out["batched_person_steps_per_s"] = PEOPLE / times["batched"]
    out["skeletal_ratio"] = out["skeletal_fps"] / out["bare_physics_fps"]
    out["muscle_ratio"] = out["muscle_fps"] / out["bare_physics_fps"]
    out["tissue_idle_ratio"] = out["tissue_idle_fps"] / out["skeletal_fps"]
    out["wanted"] = dict(WANTED)
    out["met"] = {
        name: bool(out[name] <= bound if name in _AT_MOST else out[name] >= bound)
        for name, bound in WANTED.items()
    }
    return out


def show(result: Mapping[str, Any]) -> None:
    """Print what `bench` returned as a table."""
    labels = {
        "bare_physics_fps": ("bare physics", "{:.0f} frames/s"),
        "skeletal_fps": ("skeletal", "{:.0f} frames/s"),
        "muscle_fps": ("muscles", "{:.0f} frames/s"),
        "tissue_fps": ("soft tissue, pressed", "{:.0f} frames/s"),
        "tissue_idle_fps": ("soft tissue, untouched", "{:.0f} frames/s"),
        "skeletal_ratio": ("skeletal / bare physics", "{:.3f}"),
        "muscle_ratio": ("muscles / bare physics", "{:.3f}"),
        "tissue_idle_ratio": ("untouched tissue / skeletal", "{:.3f}"),
        "muscle_kernel_us": ("muscle kernel", "{:.1f} µs"),
        "batched_person_steps_per_s": ("1,024 people", "{:.0f} person-steps/s"),
    }
    rows = []
    for name, (label, form) in labels.items():
        bound, verdict = "", ""
        if name in result["wanted"]:
            sign = "at most" if name in _AT_MOST else "at least"
            bound = f"{sign} {result['wanted'][name]:g}"
            verdict = "yes" if result["met"][name] else "no"
        rows.append((label, form.format(result[name]), bound, verdict))
    title = (
        f"{result['avatar']}, {result['muscles']} muscles, {result['tissue_particles']} particles"
    )
    console().print(table(title, ("what", "median", "wanted", "met"), rows))
