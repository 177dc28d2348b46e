"""What a network reads of an observation: names, differences, axes of a turn, and what was before."""

from __future__ import annotations

import numpy as np
import pytest

from rcare_marl.envs.learning import EnvRecipe, LearnerEnv
from rcare_marl.envs.learning.view import View, ViewConfig
from rcare_marl.errors import ConfigError, UnknownNameError
from rcare_marl.pose import matrix_from_quaternion, quaternion_from_axis_angle

TABLE = [
    ("place", slice(0, 3)),
    ("goal", slice(3, 6)),
    ("turn", slice(6, 9)),
    ("touch", slice(9, 10)),
]
SEEN = np.array((1, 2, 3, 5, 5, 5, 0.4, -1.1, 0.7, 0.25), np.float32)


def view(*parts: str, lags: tuple[int, ...] = ()) -> View:
    return View(ViewConfig(parts, lags), TABLE)


def test_parts_come_in_the_order_in_which_they_are_named() -> None:
    read = view("touch", "goal - place", "place").read(SEEN)
    np.testing.assert_allclose(read, (0.25, 4, 3, 2, 1, 2, 3))


def test_axes_of_a_turn_are_the_first_two_columns_of_its_matrix() -> None:
    turn = SEEN[6:9].astype(np.float64)
    matrix = matrix_from_quaternion(quaternion_from_axis_angle(turn, float(np.linalg.norm(turn))))
    np.testing.assert_allclose(view("axes(turn)").read(SEEN), matrix[:, :2].T.ravel(), atol=1e-6)


def test_what_was_before_is_read_again_and_the_beginning_stands_for_what_was_before_it() -> None:
    seen = view("touch", lags=(1, 3))
    rows = [seen.read(np.full(10, k, np.float32)).tolist() for k in range(5)]
    assert rows == [[0, 0, 0], [1, 0, 0], [2, 1, 0], [3, 2, 0], [4, 3, 1]]
    seen.reset()
    assert seen.read(np.full(10, 9, np.float32)).tolist() == [9, 9, 9]
    assert seen.size == 3
    assert seen.parts == (("touch", 1), ("touch@1", 1), ("touch@3", 1))


@pytest.mark.parametrize(
    ("parts", "lags", "message"),
    [
        ((), (), "at least one part"),
        (("place + goal",), (), "'name', 'name - name' or 'axes\\(name\\)', got 'place \\+ goal'"),
        (("place",), (0,), r"lags of a view must lie in 1..100, got 0"),
    ],
)
def test_what_is_no_view_is_refused(
    parts: tuple[str, ...], lags: tuple[int, ...], message: str
) -> None:
    with pytest.raises(ConfigError, match=message):
        ViewConfig(parts, lags)


def test_what_is_not_observed_is_refused_with_the_nearest_name() -> None:
    with pytest.raises(UnknownNameError, match="'plac'.*'place'"):
        view("plac")
    with pytest.raises(ConfigError, match="goal - touch: 3 and 1 values"):
        view("goal - touch")
    with pytest.raises(ConfigError, match=r"axes\(touch\): a rotation has 3 values, got 1"):
        view("axes(touch)")


def test_robots_of_other_joints_are_seen_alike_through_a_view() -> None:
    parts = ["axes(tool_rotation)", "sponge_to_target", "elbow_position - sponge_position"]
    layouts = []
    for robot in ("kinova_gen2", "pr2"):
        recipe = EnvRecipe("bathing", cast={"robot": robot}, views={"robot": {"parts": parts}})
        env = LearnerEnv(recipe)
        env.reset(seed=1)
        layouts.append(
            (env.layout.observed, env.layout.state_size, env.observation["robots"].shape)
        )
        env.close()
    assert layouts[0] == layouts[1]
    assert layouts[0][0] == {"robots": tuple(zip(parts, (6, 3, 3), strict=True))}


def test_a_view_is_for_those_who_learn() -> None:
    with pytest.raises(ConfigError, match="views are for roles that learn"):
        EnvRecipe("bathing", views={"recipient": {"parts": ["touch"]}})
