"""Furniture that stands still as one body: it looks and feels as each piece would alone."""

from __future__ import annotations

import numpy as np
import pytest

from rcare_marl.envs.homes.merging import merged
from rcare_marl.envs.homes.piece import Setting, make_piece, piece_kinds
from rcare_marl.envs.homes.rule import LEVELS, Rules
from rcare_marl.model.shape import Shape
from rcare_marl.model.urdf import Link, Model, joint_pose
from rcare_marl.pose import Pose, quaternion_from_rpy

TURNED = Pose((1.0, 2.0, 0.0), tuple(quaternion_from_rpy(0.0, 0.0, 1.2).tolist()))


def middles(shapes: tuple[Shape, ...], pose: Pose) -> list[np.ndarray]:
    """Return the middles of shapes of a link at `pose` [m]."""
    return [shape.mesh(pose).vertices.mean(axis=0) for shape in shapes]


@pytest.mark.parametrize("kind", piece_kinds())
def test_all_parts_of_a_turned_piece_stay_together(kind: str) -> None:
    for level in LEVELS:
        model = make_piece(kind, Setting(Rules(level))).model
        places = {model.root: TURNED}
        for joint in model.joints.values():
            places[joint.child] = places[joint.parent] @ joint_pose(joint)
        one = merged("room", [(model, TURNED, {})])
        (link,) = one.links.values()
        for part in ("visual", "collision"):
            wanted = [
                middle
                for name, other in model.links.items()
                for middle in middles(getattr(other, part), places[name])
            ]
            got = middles(getattr(link, part), Pose())
            np.testing.assert_allclose(
                np.reshape(got, (-1, 3)), np.reshape(wanted, (-1, 3)), atol=1e-9
            )


def test_joints_stand_where_they_are_told_to() -> None:
    model = make_piece("fridge", Setting(Rules(2))).model
    name, joint = next(iter(model.joints.items()))
    open_door = merged("room", [(model, Pose(), {name: joint.upper})])
    door = middles(model.links[joint.child].visual, joint_pose(joint, joint.upper))
    (link,) = open_door.links.values()
    got = np.array(middles(link.visual, Pose()))
    for middle in door:
        assert np.abs(got - middle).sum(axis=1).min() < 1e-9


def test_a_colour_is_never_mistaken_for_another_of_its_name() -> None:
    def cube(rgba: tuple[float, ...]) -> Model:
        shape = Shape("box", "paint", size=(1.0, 1.0, 1.0))
        return Model("cube", "a test", {"cube": Link(visual=(shape,))}, materials={"paint": rgba})

    red, blue = (1.0, 0.0, 0.0, 1.0), (0.0, 0.0, 1.0, 1.0)
    one = merged("cubes", [(cube(rgba), Pose(), {}) for rgba in (red, blue, red)])
    (link,) = one.links.values()
    assert [one.materials[shape.material] for shape in link.visual] == [red, blue, red]
