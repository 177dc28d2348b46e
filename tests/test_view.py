"""What a network reads of an observation: names, differences, axes of a turn, and what was before."""

from __future__ import annotations

import numpy as np
import pytest

from rcare_marl.agents.robots.control.control import ToolMotion
from rcare_marl.envs.learning import EnvRecipe, LearnerEnv
from rcare_marl.envs.learning.view import View, ViewConfig
from rcare_marl.errors import ConfigError, UnknownNameError
from rcare_marl.pose import (
    matrix_from_quaternion,
    multiply,
    quaternion_from_axis_angle,
    rotation_vector,
)

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


@pytest.mark.parametrize("tilted", [False, True])
def test_with_a_heading_it_is_read_and_done_the_same_whichever_way_all_is_turned(
    tilted: bool,
) -> None:
    parts = ("goal - place", "axes(turn)", "turn", "touch")
    config = ViewConfig(parts, (1,), heading="goal", tilted=tilted)
    action = np.array((0.3, -0.4, 0.5, 0.1, 0.2, -0.3, 0.9))  # the last is no velocity of the tool
    reads, done = [], []
    for angle in (0.0, 1.0, -2.5):
        about = quaternion_from_axis_angle((0.0, 0.0, 1.0), angle)
        matrix = matrix_from_quaternion(about)
        turn = SEEN[6:9].astype(np.float64)
        tool = quaternion_from_axis_angle(turn, float(np.linalg.norm(turn)))
        seen = SEEN.copy()
        seen[0:3], seen[3:6] = matrix @ SEEN[0:3], matrix @ SEEN[3:6]
        seen[6:9] = rotation_vector(multiply(about, tool))
        one = View(config, TABLE, (*ToolMotion.NAMES, "gripper"))
        one.read(seen)
        seen[3:6] = matrix @ (1, 2, 2)  # the heading counts once, as the episode begins
        reads.append(one.read(seen))
        back = one.turned_back(action)
        np.testing.assert_allclose(one.turned(back), action, atol=1e-6)
        done.append((matrix.T @ back[:3], matrix.T @ back[3:6], back[6]))
    size = one.size // 2
    # A vector of another turn is no turned vector, and left is elsewhere.
    others = [*range(9, 12), *(range(13, 16) if tilted else ())]
    is_other = [*others, *(size + k for k in others)]
    for read, (linear, angular, gripper) in zip(reads, done, strict=True):
        kept = np.delete(np.arange(len(read)), is_other)
        np.testing.assert_allclose(read[kept], reads[0][kept], atol=1e-5)
        np.testing.assert_allclose(linear, done[0][0], atol=1e-6)
        np.testing.assert_allclose(angular, done[0][1], atol=1e-6)
        assert gripper == 0.9


def test_a_tilted_view_has_the_heading_ahead_and_knows_what_is_left_and_up() -> None:
    seen, way = SEEN.copy(), np.array((1.0, -2.0, 2.0))
    seen[3:6] = way
    config = ViewConfig(("goal", "place"), heading="goal", tilted=True)
    one = View(config, TABLE, ToolMotion.NAMES)
    read = one.read(seen)
    assert one.parts == (("goal", 3), ("place", 3), ("left_and_up", 6))
    np.testing.assert_allclose(read[:3], (3, 0, 0), atol=1e-6)
    np.testing.assert_allclose(read[9:], (2 / 3, 0, 5**0.5 / 3), atol=1e-6)
    np.testing.assert_allclose(read[3:6] @ read[6:9], SEEN[1], atol=1e-6)  # as far left as it was,
    np.testing.assert_allclose(read[3:6] @ read[9:], SEEN[2], atol=1e-6)  # and as high
    with pytest.raises(ConfigError, match="tilted by its heading, and there is none"):
        ViewConfig(("goal",), tilted=True)


def test_a_heading_that_points_up_turns_nothing_and_one_of_no_tool_is_refused() -> None:
    seen = SEEN.copy()
    seen[3:6] = (0.01, 0, 5)
    config = ViewConfig(("place",), heading="goal")
    np.testing.assert_array_equal(View(config, TABLE, ToolMotion.NAMES).read(seen), (1, 2, 3))
    with pytest.raises(
        ConfigError, match="a heading turns the velocities of a tool, and .* has lid"
    ):
        View(config, TABLE, ("lid",))
    with pytest.raises(ConfigError, match="a heading has 3 values, 'touch' has not"):
        View(ViewConfig(("place",), heading="touch"), TABLE, ToolMotion.NAMES)


def test_what_a_script_shows_through_a_heading_does_in_the_world_what_the_script_does() -> None:
    views = {"robot": {"parts": ["bowl_to_mouth"], "heading": "face_direction"}}
    env = LearnerEnv(
        EnvRecipe("feeding", cast={"recipient": "kim"}, views=views, taught=True),
    )
    env.reset(seed=1)
    while not (env.terminated or env.truncated):
        shown = env.observation["robots"][:, -env.layout.action_sizes["robots"] :]
        env.step({"robots": shown})
    assert env.success
    env.close()
    with pytest.raises(
        ConfigError, match=r"\(residual\) sees as it does: 'robot' can have no heading"
    ):
        EnvRecipe("feeding", views=views, residual={"robot": 0.2})


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
