"""Points of contact are on MuJoCo where Bullet has them, and are kept as Bullet keeps them."""

from __future__ import annotations

from contextlib import closing

import numpy as np
import pytest

import rcare_marl
from rcare_marl.engines import make_world
from rcare_marl.pose import Array, Pose, quaternion_from_rpy


def touching_boxes(engine: str, seed: int) -> Array:
    """Return where a tilted box that is put into another touches it: gap and place [m], shape [n, 4]."""
    rng = np.random.default_rng(seed)
    tilt = (0.6, 0.02)[seed % 2]  # a corner or an edge; nearly a face
    size = rng.uniform(0.06, 0.2, 3)
    spot = (*rng.uniform(-0.24, 0.24, 2), 0.098 + 0.5 * size[2])
    roll, pitch = rng.uniform(-tilt, tilt, 2).tolist()
    turn = quaternion_from_rpy(roll, pitch, float(rng.uniform(-3, 3)))
    with closing(make_world(engine, 1 / 240)) as world:
        plate = world.add_box((0.5, 0.4, 0.1), Pose((0, 0, 0.05)), name="plate")
        box = world.add_box(tuple(size), Pose((0, 0, 1.0)), mass=1.0, name="box")
        world.mark_start()
        box.set_base(Pose(spot, tuple(turn)))
        world.step()
        rows = sorted((c.distance, *c.position) for c in world.contacts(box, plate))
    return np.array(rows).reshape(-1, 4)


@pytest.mark.parametrize("seed", range(20))
def test_boxes_touch_where_they_do_in_bullet(seed: int) -> None:
    bullet, mujoco = (touching_boxes(engine, seed) for engine in ("bullet", "mujoco"))
    assert len(bullet) > 0
    np.testing.assert_allclose(mujoco, bullet, atol=1e-6)


@pytest.mark.parametrize("seed", [600, 601])
def test_an_arm_in_a_cradle_is_pressed_as_in_bullet(seed: int) -> None:
    """Within 0.5 N in 40 control steps; it was off by 1.6 and 2.9 N before points were kept."""
    forces = []
    for engine in ("bullet", "mujoco"):
        played = {"robot": "scripted", "recipient": "cooperative"}
        with closing(rcare_marl.make("limb_repositioning", engine=engine, policies=played)) as env:
            env.reset(seed=seed)
            felt = []
            for _ in range(40):
                env.step({})
                felt.append(env.task.report()["force_n"])
            forces.append(felt)
    assert max(forces[0]) > 10.0
    np.testing.assert_allclose(forces[1], forces[0], atol=0.5)
