"""The list of what is near leaves out nothing that MuJoCo would find by itself."""

from __future__ import annotations

from contextlib import closing
from typing import Any

import mujoco
import numpy as np

import rcare_marl
from rcare_marl.engines import make_world
from rcare_marl.engines.mujoco_world import MujocoWorld
from rcare_marl.pose import Pose
from rcare_marl.scene.mjcf import mjcf
from rcare_marl.scene.scene import Scene, scene_of
from rcare_marl.world import World

POSED = ("xpos", "xquat", "xmat", "xipos", "ximat", "geom_xpos", "geom_xmat")


class Rival:
    """The same scene, in which MuJoCo looks for contacts by itself."""

    def __init__(self, scene: Scene, world: World) -> None:
        assert isinstance(world, MujocoWorld)
        assert world.sim is not None
        self._data = world.sim.data
        files = mjcf(scene, drives=False, parts=False, as_bullet=True)
        assets = {name: text.encode() for name, text in files.items()}
        self._model = mujoco.MjModel.from_xml_string(files["scene.xml"], assets)
        for name in ("geom_margin", "geom_size"):
            getattr(self._model, name)[:] = getattr(world.sim.model, name)
        self._own = mujoco.MjData(self._model)

    def compare(self, spared: frozenset[int] = frozenset()) -> int:
        """See that all overlaps of the last step were found, but of `spared` geoms; tell how many."""
        for name in POSED:
            getattr(self._own, name)[:] = getattr(self._data, name)
        mujoco.mj_collision(self._model, self._own)
        found = overlapping(self._own, spared)
        assert found <= {tuple(sorted(pair)) for pair in self._data.contact.geom.tolist()}
        return len(found)


def half(shape: tuple[int, ...]) -> Any:
    return np.full(shape, 0.5, np.float32)


def overlapping(data: Any, spared: frozenset[int]) -> set[tuple[int, ...]]:
    """Return which geoms overlap."""
    pairs = {tuple(sorted(c.geom.tolist())) for c in data.contact if c.dist < 0.0}
    return {pair for pair in pairs if not spared.issuperset(pair)}


def test_what_falls_fast_is_found_as_mujoco_finds_it() -> None:
    rng = np.random.default_rng(0)
    world = make_world("mujoco", 1 / 240)
    world.add_box((4, 4, 0.2), Pose((0, 0, -0.1)), name="floor")
    for i in range(12):
        spot = (*rng.uniform(-0.3, 0.3, 2), rng.uniform(0.2, 1.0))
        turn = rng.normal(size=4)
        pose = Pose(spot, tuple(turn / np.linalg.norm(turn)))
        if i % 2:
            world.add_box(tuple(rng.uniform(0.05, 0.3, 3)), pose, mass=1.0)
        else:
            world.add_sphere(0.08, pose, mass=0.5)
    scene = scene_of(world)
    world.mark_start()
    rival, found = Rival(scene, world), 0
    for _ in range(2):
        for step in range(120):
            if step == 0:
                for body in world.bodies[1:]:
                    body.apply_force(-1, tuple(rng.normal(0, 2000, 3)), body.base_pose().position)
            world.step()
            found += rival.compare()
        world.rewind()
    assert found > 100
    first, second = world.bodies[1], world.bodies[2]
    for on in (False, True):
        world.set_collision(first, second, on)
        first.set_base(Pose((1.0, 1.0, 1.0)))
        second.set_base(Pose((1.0, 1.0, 1.02)))
        world.step()
        assert bool(world.contacts(first, second)) == on
        rival.compare(frozenset() if on else frozenset((1, 2)))


def test_in_an_episode_nothing_that_touches_is_left_out() -> None:
    with closing(rcare_marl.make("feeding", engine="mujoco")) as env:
        env.reset(seed=3)
        rival = Rival(scene_of(env.world), env.world)
        found = 0
        for _ in range(40):
            if env.is_over:
                break
            env.step({role: half(env.action_space(role).shape) for role in env.agents})
            env.world.step()  # of which nobody has looked where it ended
            found += rival.compare()
    assert found > 40
