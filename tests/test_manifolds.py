"""Points of contact are on MuJoCo where Bullet has them, and are kept as Bullet keeps them."""

from __future__ import annotations

from contextlib import closing
from pathlib import Path

import numpy as np
import pytest

import rcare_marl
from rcare_marl.engines import make_world
from rcare_marl.pose import Array, Pose, matrix_from_quaternion, quaternion_from_rpy


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


@pytest.mark.parametrize("seed", [600, pytest.param(601, marks=pytest.mark.slow)])
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


FLAT, LENGTH, RADIUS = 0.03, 0.004, 0.0108  # [m] of a wheel's half width and of a fingertip
WHEEL = '<collision><geometry><cylinder radius="0.3" length="0.06"/></geometry></collision>'
TIP = f'<collision><geometry><capsule radius="{RADIUS}" length="{LENGTH}"/></geometry></collision>'
FINGERS = "".join(
    f'<collision><origin xyz="{x} 0 0"/><geometry><box size="0.012 0.022 0.05"/></geometry></collision>'
    for x in (0.0, -0.03)
)
BOX = '<collision><geometry><box size="0.1 0.046 0.084"/></geometry></collision>'


def gaps(engine: str, folder: Path, still: str, moved: str, pose: Pose) -> list[float]:
    """Return the gaps [m] of the contacts of two bodies of these shapes after a step, sorted."""
    with closing(make_world(engine, 1 / 240)) as world:
        bodies = []
        for name, shapes in (("still", still), ("moved", moved)):
            inertia = '<inertia ixx="1e-3" iyy="1e-3" izz="1e-3" ixy="0" ixz="0" iyz="0"/>'
            link = f'<link name="{name}"><inertial><mass value="1"/>{inertia}</inertial>{shapes}</link>'
            path = folder / f"{name}.urdf"
            path.write_text(f'<robot name="{name}">{link}</robot>')
            at = Pose() if name == "still" else Pose((0, 0, 2.0))
            bodies.append(world.load_urdf(path, at, name=name, fixed=name == "still"))
        world.mark_start()
        bodies[1].set_base(pose)
        world.step()
        return sorted(contact.distance for contact in world.contacts(*bodies))


@pytest.mark.parametrize("tilt", [0.0, 0.02, 0.088, 0.3])
def test_a_fingertip_at_the_flat_of_a_wheel_touches_as_in_bullet(
    tmp_path: Path, tilt: float
) -> None:
    """MuJoCo found two points that were a tenth of a millimetre too far away, and let it go."""
    low = np.sin(tilt) * 0.5 * LENGTH  # of the end of the axis that is nearer
    turn = quaternion_from_rpy(0.5 * np.pi + tilt, 0, 0.3)
    pose = Pose((0.1, 0.05, FLAT + RADIUS + low - 2e-5), tuple(turn))
    bullet, mujoco = (gaps(engine, tmp_path, WHEEL, TIP, pose) for engine in ("bullet", "mujoco"))
    assert len(bullet) == 1
    np.testing.assert_allclose(mujoco, bullet, atol=2e-6)


@pytest.mark.parametrize("seed", range(6))
def test_a_corner_that_grazes_one_of_two_fingers_is_not_lost(tmp_path: Path, seed: int) -> None:
    """Boxes round turned shapes were too small by up to 0.7 mm."""
    rng = np.random.default_rng(seed)
    half, fingers = 0.5 * np.array((0.1, 0.046, 0.084)), 0.006
    turn = quaternion_from_rpy(*rng.uniform(-0.6, 0.6, 3).tolist())
    turned = matrix_from_quaternion(turn)
    place = turned @ (-np.sign(turned[0]) * half)  # of the corner that is nearest to the fingers
    spot = np.array((fingers - 5e-5, 0.0, 0.0)) - place
    pose = Pose(tuple(spot.tolist()), tuple(turn))
    bullet, mujoco = (gaps(engine, tmp_path, FINGERS, BOX, pose) for engine in ("bullet", "mujoco"))
    assert len(bullet) == 1
    np.testing.assert_allclose(mujoco, bullet, atol=2e-6)
