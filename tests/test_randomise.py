"""Perturbations as data: drawn from the seed, told in infos, undone at the next reset, replayed."""

from __future__ import annotations

import json
from collections.abc import Mapping
from contextlib import closing
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from episode import assert_same, rollout
from gymnasium.utils.env_checker import check_env
from pettingzoo.test.parallel_test import parallel_api_test
from torchrl.envs.utils import check_env_specs
from typer.testing import CliRunner

import rcare_marl
from rcare_marl.agents.robots.control import ToolDelta
from rcare_marl.agents.robots.robot import Robot
from rcare_marl.baselines.training.config import load_config
from rcare_marl.cli import app
from rcare_marl.config import plain
from rcare_marl.envs.care_env import CareEnv
from rcare_marl.envs.episode import EpisodeRecorder, RecordedEpisode, replay
from rcare_marl.envs.gym import SingleAgentEnv
from rcare_marl.envs.learning import EnvRecipe
from rcare_marl.envs.randomise import KINDS, Randomisation, randomisation_names
from rcare_marl.errors import ConfigError, UnknownNameError

PLAYED = {"robot": "scripted", "recipient": "cooperative"}
ENGINES = ("bullet", "mujoco")


def scripted(randomise: Any = None, **given: Any) -> CareEnv:
    return rcare_marl.make("feeding", policies=PLAYED, randomise=randomise, **given)


def learned_by(randomise: Any = None, **given: Any) -> CareEnv:
    policies = {"recipient": "cooperative"}
    return rcare_marl.make("feeding", policies=policies, randomise=randomise, **given)


def drawn(env: CareEnv, seed: int) -> dict[str, float]:
    """Return what an episode's infos tell of its perturbations."""
    _, infos = env.reset(seed=seed)
    told = next(iter(infos.values()))
    return {name: value for name, value in told.items() if name.startswith("randomise_")}


def masses(env: CareEnv) -> list[Any]:
    return [
        (*body.mass_and_inertia(link)[1].tolist(), body.mass(link), body.touching(link).friction)
        for body in env.world.bodies
        for link in range(-1, body.link_count)
    ]


@pytest.mark.parametrize("name", randomisation_names())
def test_what_ships_is_read_and_survives_being_written(name: str) -> None:
    found = Randomisation.of(name)
    assert found.spreads
    again = Randomisation.of(json.loads(json.dumps(plain(found.to_dict(), name))))
    assert again == found == Randomisation.of(found)
    for seed in range(50):
        for (kind, _), value in found.draw(seed).items():
            assert KINDS[kind].low <= value <= KINDS[kind].high
        assert found.draw(seed) == again.draw(seed)


def test_draws_are_of_the_seed_alone_and_each_has_chance_of_its_own() -> None:
    two = Randomisation.of({"robot_mass": {"factor": [0.5, 1.5]}, "friction": {"factor": [0.5, 2]}})
    one = Randomisation.of({"friction": {"factor": [0.5, 2]}})
    key = ("friction", "factor")
    values = [one.draw(seed)[key] for seed in range(200)]
    assert values == [two.draw(seed)[key] for seed in range(200)]
    assert len(set(values)) == 200 and min(values) < 0.6 and max(values) > 1.9
    normal = Randomisation.of({"robot_mass": {"factor": {"mean": 1.0, "sd": 0.1}}})
    spread = np.std([normal.draw(seed)["robot_mass", "factor"] for seed in range(400)])
    assert 0.08 < spread < 0.12
    steps = Randomisation.of({"action_delay": {"steps": [0, 2]}})
    counts = np.bincount([int(steps.draw(s)["action_delay", "steps"]) for s in range(300)])
    assert counts.shape == (3,) and counts.min() > 70


def test_a_curriculum_narrows_towards_the_usual() -> None:
    given = {
        "robot_mass": {"factor": 1.4},
        "action_delay": {"steps": 4},
        "drop_out": {"share": 0.2},
    }
    found = Randomisation.of(given)
    assert found.draw(3, 0.5) == {
        ("robot_mass", "factor"): pytest.approx(1.2),
        ("action_delay", "steps"): 2.0,
        ("drop_out", "share"): pytest.approx(0.1),
    }
    assert found.draw(3, 0.0)["robot_mass", "factor"] == 1.0


def test_some_episodes_are_spared() -> None:
    given = {"robot_mass": {"factor": [1.1, 1.4]}, "drop_out": {"share": 0.2}}
    whole, some = Randomisation.of(given), Randomisation.of({**given, "spared": {"share": 0.3}})
    usual = {("robot_mass", "factor"): 1.0, ("drop_out", "share"): 0.0}
    drawn = [some.draw(seed) for seed in range(300)]
    spared = [values == usual for values in drawn]
    assert 60 < sum(spared) < 120
    for seed, (values, is_spared) in enumerate(zip(drawn, spared, strict=True)):
        assert is_spared or values == whole.draw(seed)


@pytest.mark.parametrize(
    ("given", "said"),
    [
        ({"robot_mas": {"factor": 1.1}}, "robot_mass"),
        ({"robot_mass": {"kg": 1.1}}, "factor"),
        ({"robot_mass": 1.1}, "needs a unit"),
        ({"robot_mass": {"factor": 0.0}}, "must lie in"),
        ({"robot_mass": {"factor": [1.2, 0.9]}}, "low, high"),
        ({"robot_mass": {"factor": [1.2]}}, "low, high"),
        ({"robot_mass": {"factor": "heavy"}}, "expected a number"),
        ({"robot_mass": {"factor": float("nan")}}, "finite"),
        ({"robot_mass": {"factor": {"mean": 1.0}}}, "mean and sd"),
        ({"robot_mass": {"factor": {"mean": 1.0, "std": 0.1}}}, "sd"),
        ({"action_delay": {"steps": 0.5}}, "whole number"),
        ({"drop_out": {"share": 1.0}}, "must lie in"),
        ({"observation_noise": {"mm": 20}}, "m"),
        ("milde", "mild"),
        (7, "mapping"),
    ],
)
def test_what_cannot_be_is_refused_by_name(given: Any, said: str) -> None:
    with pytest.raises((ConfigError, UnknownNameError), match=said):
        Randomisation.of(given)


@pytest.mark.parametrize(
    ("task", "model", "factor", "start"),
    [
        ("drinking", "kinova_gen3", 0.75, 0.0),
        pytest.param("drinking", "kinova_gen3", 1.0, 0.0, marks=pytest.mark.slow),
        pytest.param("drinking", "pr2", 1.3, 0.0, marks=pytest.mark.slow),
        ("feeding", "stretch_re1_dex", 1.0, 0.0),
        # What speeds up must not be taken for weight: neither the arm's nor that of a heavy sponge.
        ("bathing", "kinova_gen2", 1.0, 0.6),
        ("bathing", "kinova_gen2", 1.3, 0.6),
        ("bathing", "kinova_gen2", 0.7, 0.6),
    ],
)
def test_an_arm_that_is_not_as_heavy_as_its_model_weighs_itself(
    task: str, model: str, factor: float, start: float
) -> None:
    randomise = {"robot_mass": {"factor": factor}}
    policies = {"recipient": "still"}
    with closing(rcare_marl.make(task, robot=model, policies=policies, randomise=randomise)) as env:
        env.reset(seed=4)
        robot = env.cast["robot"]
        assert isinstance(robot, Robot) and isinstance(robot.control, ToolDelta)
        heights = []
        for k in range(15):
            wish = start if k == 0 else 0.0
            env.step({"robot": np.full(env.action_space("robot").shape, wish, np.float32)})
            heights.append(robot.tool_pose().position[2])
        # The cup or spoon in its hand is no part of the arm.
        assert robot.control.weight_share == pytest.approx(factor, abs=0.03)
        assert (robot.control.weight_share == 1.0) == (factor == 1.0)
        assert abs(heights[-1] - heights[4]) < 0.002


def test_an_arm_whose_lift_alone_bears_its_weight_takes_no_reaching_out_for_weight() -> None:
    with closing(rcare_marl.make("toileting", policies={"robot": "scripted"})) as env:
        env.reset(seed=93105)
        for _ in range(3):
            env.step({})
        robot = env.cast["robot"]
        assert isinstance(robot, Robot) and isinstance(robot.control, ToolDelta)
        assert robot.control.weight_share == 1.0


def test_motors_that_know_no_position_have_no_gain() -> None:
    robot = {"model": "kinova_gen3", "control": "joint_torque"}
    with pytest.raises(ConfigError, match="motor_gain does nothing"):
        learned_by({"motor_gain": {"factor": 0.5}}, robot=robot)


@pytest.mark.parametrize("engine", ENGINES)
def test_an_environment_made_with_nothing_of_it_is_bit_equal(engine: str) -> None:
    usual = {
        "robot_mass": {"factor": 1.0},
        "friction": {"factor": 1},
        "motor_gain": {"factor": 1.0},
    }
    usual |= {"action_delay": {"steps": 0}, "observation_noise": {"m": 0.0}}
    with (
        closing(learned_by(engine=engine)) as plainly,
        closing(learned_by(usual, engine=engine)) as same,
    ):
        for seed in (1, 2):  # but for the last array, which has what was drawn too
            left, right = ([step[:2] for step in rollout(e, seed, 8)] for e in (plainly, same))
            assert_same(left, right)


@pytest.mark.parametrize("engine", ENGINES)
def test_masses_change_the_motion_and_do_not_drift(engine: str) -> None:
    given = {name: {"factor": [0.6, 1.6]} for name in ("robot_mass", "person_mass", "object_mass")}
    given["friction"] = {"factor": [0.5, 1.5]}
    with closing(learned_by(given, engine=engine)) as env:
        first = masses(env)
        sim = getattr(env.world, "sim", None)
        model = None if sim is None else sim.model
        kept = None if model is None else (model.body_mass.copy(), model.body_subtreemass.copy())
        told = drawn(env, 5)
        assert set(told) == {f"randomise_{name}" for name in given}
        robot = env.cast["robot"].body
        assert (
            robot.mass()
            == pytest.approx(
                told["randomise_robot_mass"] * sum(row[-2] for row in first[: robot.link_count + 1])
            )
            or robot is not env.world.bodies[0]
        )
        heavy = [list(map(np.array, rows)) for rows in rollout(env, 5, 6)]
        for seed in range(50):
            env.reset(seed=seed)
        again = [list(map(np.array, rows)) for rows in rollout(env, 5, 6)]
        assert_same(heavy, again)  # whatever was played between
        env.randomiser.randomisation = Randomisation.of({})
        env.reset(seed=5)
        assert masses(env) == first
        if model is not None and kept is not None:
            np.testing.assert_array_equal(model.body_mass, kept[0])
            np.testing.assert_allclose(model.body_subtreemass, kept[1], rtol=1e-12)
        plainly = [list(map(np.array, rows)) for rows in rollout(env, 5, 6)]
        assert not np.array_equal(plainly[-1][0], heavy[-1][0])


def test_mujoco_falls_as_a_scene_that_was_built_heavier() -> None:
    """The mass matrix of the robot is the nominal one times the factor, as MuJoCo works it out."""
    with closing(learned_by({"robot_mass": {"factor": 1.5}}, engine="mujoco")) as env:
        sim, robot = env.world.sim, env.cast["robot"].body  # type: ignore[attr-defined]
        env.randomiser.randomisation = Randomisation.of({})
        env.reset(seed=0)
        dofs = [int(d) for d in env.world.body_places(robot).dofs if d >= 0]  # type: ignore[attr-defined]
        light, weight = sim.at_rest()
        env.randomiser.randomisation = Randomisation.of({"robot_mass": {"factor": 1.5}})
        env.reset(seed=0)
        heavy, more = sim.at_rest()
        block = np.ix_(dofs, dofs)
        np.testing.assert_allclose(heavy[block], 1.5 * light[block], rtol=1e-6, atol=1e-12)
        np.testing.assert_allclose(more[dofs], 1.5 * weight[dofs], rtol=1e-6, atol=1e-9)


def tool(env: CareEnv) -> np.ndarray:
    robot = env.cast["robot"]
    assert isinstance(robot, Robot)
    return np.array(robot.tool_pose().position)


def test_actions_come_later_and_lag() -> None:
    with (
        closing(learned_by({"action_delay": {"steps": 2}})) as late,
        closing(learned_by()) as prompt,
    ):
        for env in (late, prompt):
            env.reset(seed=1)
        begin, push = tool(late), {"robot": np.array([1, 0, 0, 0, 0, 0], np.float32)}
        for _ in range(2):
            late.step(push)
        assert np.abs(tool(late) - begin).max() < 1e-3
        np.testing.assert_array_equal(late.commands["robot"], push["robot"])
        late.step(push)
        prompt.step(push)
        assert tool(late)[0] - begin[0] == pytest.approx(tool(prompt)[0] - begin[0], abs=2e-3)
    with closing(learned_by({"motor_lag": {"s": 0.2}})) as slow:
        slow.reset(seed=1)
        slow.step({"robot": np.zeros(6, np.float32)})
        begin = tool(slow)
        slow.step(push)
        assert 0.002 < tool(slow)[0] - begin[0] < 0.7 * 0.025


def test_a_hand_is_led_astray_for_a_while_and_obeys_again() -> None:
    with closing(learned_by({"led_astray": {"share": 0.05}})) as env, closing(learned_by()) as own:
        still, moved = {"robot": np.zeros(6, np.float32)}, []
        for each in (env, own):
            each.reset(seed=5)
        before, begin = tool(env), tool(own)
        for _ in range(60):
            env.step(still)
            own.step(still)
            moved.append(float(np.linalg.norm(tool(env) - before)) > 0.002)
            before = tool(env)
            np.testing.assert_array_equal(env.commands["robot"], still["robot"])
        assert 6 <= sum(moved) <= 40 and not all(moved[:6])
        assert np.allclose(tool(own), begin, atol=2e-3)
        assert drawn(env, 4)["randomise_led_astray"] == 0.05
    with closing(rcare_marl.make("ambulating", randomise={"led_astray": {"share": 1.0}})) as door:
        door.reset(seed=1)
        told = door.randomiser.passed_on({"robot": np.full(7, 0.5, np.float32)}, 0.1)["robot"]
        assert told[6] == 0.5 and np.abs(told[:6]).max() <= 0.3 and len(set(told.tolist())) == 7
    for control in ("joint_position", "tool_pose"):
        robot = {"model": "kinova_gen3", "control": control}
        with pytest.raises(ConfigError, match=f"under '{control}', which is told no speeds"):
            rcare_marl.make("feeding", robot=robot, randomise={"led_astray": {"share": 0.1}})


@pytest.mark.parametrize("engine", ENGINES)
def test_a_robot_stands_beside_its_place_and_its_task_still_begins_right(engine: str) -> None:
    asked = {"robot_place": {"m": 0.03, "rad": 0.05}}
    with (
        closing(learned_by(asked, engine=engine)) as env,
        closing(learned_by(engine=engine)) as usual,
    ):
        places, states = [], list[list[np.ndarray]]()
        usual.reset(seed=3)
        home = usual.cast["robot"].body.base_pose()
        for seed in (3, 4, 3):
            assert drawn(env, seed) == {
                "randomise_robot_place_m": 0.03,
                "randomise_robot_place_rad": 0.05,
            }
            place = home.inverse() @ env.cast["robot"].body.base_pose()
            places.append((*place.position, *place.quaternion))
            states.append([body.state() for body in env.world.bodies])
            if seed == 3:  # the spoon begins over the bowl all the same
                np.testing.assert_allclose(tool(env), tool(usual), atol=2e-3)
        x, y, z, *turn = places[0]
        assert places[2] == places[0] != places[1]
        assert_same(states[:1], states[2:])  # whatever was played between
        assert 0.003 < np.hypot(x, y) < 0.12 and abs(z) < 1e-9 and abs(turn[2]) > 1e-3
        env.randomiser.randomisation = Randomisation.of({})
        assert_same(*([list(s[:2]) for s in rollout(e, 3, 5)] for e in (env, usual)))
    with pytest.raises(ConfigError, match="robot_place cannot move 'robot', which rides"):
        rcare_marl.make(
            "ambulating", options={"goal": "through", "clear_width": 0.9}, randomise=asked
        )


@pytest.mark.slow
def test_shorts_hang_in_the_hand_of_a_robot_that_stands_beside_its_place() -> None:
    asked = {"robot_place": {"m": 0.03, "rad": 0.05}}
    with closing(rcare_marl.make("dressing", randomise=asked)) as env:
        hands, strains = [], []
        for seed in range(3):
            env.reset(seed=seed)
            hands.append(tool(env))
            env.step(
                {role: np.zeros(env.action_space(role).shape, np.float32) for role in env.agents}
            )
            strains.append(env.task.report()["peak_strain"])
        np.testing.assert_allclose(hands, [hands[0]] * 3, atol=5e-3)
        assert max(strains) < 0.5  # moved along with the base it would be drawn by 5 cm


def test_a_misplaced_camera_sees_from_elsewhere_what_its_robot_believes_to_see_from_its_place() -> (
    None
):
    camera = {"kind": "camera", "outputs": ["rgb", "points"], "width": 32, "height": 24}
    robot = {"sensors": [camera]}
    seen = []
    for asked in (
        None,
        {"camera_place": {"m": 0.05}},
        {"light": {"factor": 0.4}},
        {"light_turn": {"rad": 0.5}},
    ):
        with closing(learned_by(asked, robot=robot)) as env:
            (observed, _), suite = env.reset(seed=2), env.cast["robot"].sensors
            assert suite is not None
            view = suite.sensors["camera"].view  # type: ignore[attr-defined]
            points = observed["robot"]["camera_points"].reshape(24, 32, 3)
            seen.append((observed["robot"]["camera_rgb"].astype(float), points, view.pose))
    (rgb, points, pose), misplaced, dim, turned = seen
    assert all(other[2] == pose for other in (misplaced, dim, turned))
    assert not np.array_equal(misplaced[0], rgb) and not np.allclose(
        misplaced[1], points, atol=0.01
    )
    np.testing.assert_array_equal(dim[1], points)
    np.testing.assert_array_equal(turned[1], points)
    hit = points.any(axis=2)  # the sky keeps its colour
    assert dim[0][hit].mean() < 0.8 * rgb[hit].mean() and not np.array_equal(turned[0], rgb)
    with pytest.raises(ConfigError, match="light does nothing: no robot has a camera"):
        learned_by({"light": {"factor": 0.5}})


def test_what_a_robot_sees_is_noisy_biased_and_held() -> None:
    given = {
        "observation_noise": {"m": 0.02},
        "observation_bias": {"m": 0.05},
        "joint_noise": {"rad": 0.01},
        "drop_out": {"share": 0.3},
    }
    with closing(learned_by(given)) as env, closing(learned_by()) as clear:
        parts = {name: part for part, name, _ in env.describe("robot")}
        errors, held, before = [], 0, None
        for each in (env, clear):
            each.reset(seed=3)
        for _ in range(60):
            still = {"robot": np.zeros(6, np.float32)}
            if env.is_over or clear.is_over:
                break
            env.step(still)
            clear.step(still)
            seen = env.observe("robot")
            np.testing.assert_array_equal(seen, env.observe("robot"))
            if before is not None and np.array_equal(seen, before):
                held += 1
            else:
                errors.append(seen - clear.observe("robot"))
            before = seen
        off = np.array(errors)
        assert 8 <= held <= 30
        place = off[:, parts["bowl_to_mouth"]]
        assert 0.01 < place.std(axis=0).mean() < 0.03
        assert np.abs(place.mean(axis=0)).max() > 0.01  # of a sum of three biases of 50 mm each
        assert 0.005 < off[:, parts["joint_position"]].std(axis=0).mean() < 0.015
        np.testing.assert_array_equal(off[:, parts["time_left"]][0], 0.0)
        np.testing.assert_array_equal(env.observe("recipient"), clear.observe("recipient"))
        assert drawn(env, 4)["randomise_observation_noise_m"] == 0.02


@pytest.mark.parametrize("engine", ENGINES)
def test_an_episode_of_it_is_replayed_to_the_bit(engine: str, tmp_path: Path) -> None:
    with closing(learned_by("strong", engine=engine)) as env:
        env.task.set_stage(spread=0.7)
        recorder = EpisodeRecorder(env)
        for _ in rollout(env, 11, 12):
            pass
        told = env.randomiser.numbers()
        recorder.episode().save(tmp_path / "strong.npz")
    episode = RecordedEpisode.read(tmp_path / "strong.npz")
    assert episode.header.setup["randomise"] == Randomisation.of("strong").to_dict()
    at = [episode.header.measures.index(name) for name in told]
    np.testing.assert_array_equal(episode.numbers[-1, at], list(told.values()))
    assert replay(episode).difference == ""


def test_the_interfaces_still_hold() -> None:
    with closing(learned_by("strong")) as env:
        parallel_api_test(env, num_cycles=5)
    with closing(
        rcare_marl.make_vector("feeding", num_envs=2, engine="bullet", randomise="mild")
    ) as many:
        first, _ = many.reset(seed=1)
        assert np.isfinite(first).all() and not np.array_equal(first[0], first[1])


def test_learners_get_it_in_each_of_their_forms() -> None:
    with closing(SingleAgentEnv("feeding", randomise="strong")) as one:
        check_env(one, skip_render_check=True)
    batch = rcare_marl.make_batch("feeding", num_envs=2, engine="bullet", randomise="strong")
    try:
        check_env_specs(batch)
    finally:
        batch.close()
    config = load_config({"task": "feeding", "randomise": "mild"})
    assert config.recipe().randomise == config.randomise == Randomisation.of("mild").to_dict()
    with pytest.raises(ConfigError, match="Did you mean 'mild'"):
        load_config({"task": "feeding", "randomise": "mildly"})


def test_a_recipe_holds_what_a_file_says(tmp_path: Path) -> None:
    file = tmp_path / "mine.yaml"
    file.write_text("description: mine\nfriction: {factor: [0.8, 1.2]}\n", encoding="utf-8")
    recipe = EnvRecipe("feeding", randomise=str(file))
    assert recipe.to_dict()["randomise"] == {"friction": {"factor": [0.8, 1.2]}}
    again: Mapping[str, Any] = json.loads(json.dumps(recipe.to_dict()))
    assert EnvRecipe(**again).randomise == recipe.randomise


def test_people_who_take_turns_are_perturbed_too() -> None:
    given = {"person_mass": {"factor": 1.2}}
    with (
        closing(learned_by(given, recipient="six")) as env,
        closing(learned_by(recipient="six")) as light,
    ):
        for seed in (1, 2):
            env.reset(seed=seed)
            light.reset(seed=seed)
            whole, usual = env.cast["recipient"].body.mass(), light.cast["recipient"].body.mass()
            assert whole == pytest.approx(1.2 * usual)


def test_evaluation_tells_what_was_perturbed() -> None:
    runner = CliRunner()
    line = "evaluate feeding --episodes 2 --seed 3 --json --randomise".split()
    out = runner.invoke(app, [*line, "{action_delay: {steps: 1}}"])
    assert out.exit_code == 0, out.output
    assert json.loads(out.stdout)["randomise_action_delay_mean"] == 1.0
    wrong = runner.invoke(app, [*line, "delay_11"])
    assert wrong.exit_code == 2 and "delay_1" in wrong.output
