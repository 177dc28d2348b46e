"""Files of policies: what is written is read and played, and what does not fit is refused."""

from __future__ import annotations

import dataclasses
import zipfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from torch import nn, tensor

import rcare_marl
from rcare_marl.agents.agent import Array
from rcare_marl.baselines import trained
from rcare_marl.baselines.ensemble import mean_of
from rcare_marl.baselines.evaluation.evaluate import evaluate, make_players
from rcare_marl.baselines.policy_file import LearnedPolicy, PolicyFile
from rcare_marl.envs.care_env import CareEnv
from rcare_marl.envs.learning import EnvRecipe, LearnerEnv
from rcare_marl.envs.learning.learner_env import moved_by
from rcare_marl.envs.learning.recipe import Scale
from rcare_marl.envs.registry import register_policy_file
from rcare_marl.envs.task import part_name
from rcare_marl.errors import ConfigError

HIDDEN = (16, 16)
LONG = ("dressing", "scratching_everybody")  # which take long to make


def network(env: CareEnv, role: str = "robot", **changes: Any) -> PolicyFile:
    """Return a network of random weights that fits a role."""
    agent, rng = env.cast[role], np.random.default_rng(4)
    observed = [(name, part.stop - part.start) for part, name, _ in env.describe(role)]
    if changes.get("residual") is not None:
        observed.append(("scripted_action", agent.action_size))
    sizes = [sum(size for _, size in observed), *HIDDEN, agent.action_size]
    layers = tuple(
        (
            rng.normal(0, 0.3, (out, n)).astype(np.float32),
            rng.normal(0, 0.3, out).astype(np.float32),
        )
        for n, out in zip(sizes, sizes[1:], strict=False)
    )
    fields = {
        "task": "feeding",
        "group": f"{part_name(role)}s",
        "roles": (role,),
        "observed": tuple(observed),
        "action_size": agent.action_size,
        "action_low": agent.action_low,
        "layers": layers,
        "mean": rng.normal(0, 0.3, sizes[0]).astype(np.float32),
        "scale": rng.uniform(0.5, 2, sizes[0]).astype(np.float32),
        "actions": tuple(agent.action_names),
        "recipe": {"task": "feeding"},
        "training": {"algorithm": "none", "seed": 4},
    }
    return PolicyFile(**{**fields, **changes})


@pytest.fixture(scope="module")
def env() -> Iterator[CareEnv]:
    env = rcare_marl.make("feeding", policies={"recipient": "cooperative"})
    env.reset(seed=0)
    yield env
    env.close()


def test_a_file_comes_back_as_it_was_written(env: CareEnv, tmp_path: Path) -> None:
    file = network(env, residual=0.25)
    file.save(tmp_path / "new" / "a.npz")
    back = PolicyFile.read(tmp_path / "new" / "a.npz")
    for name in (field.name for field in dataclasses.fields(PolicyFile)):
        if name not in ("layers", "mean", "scale"):
            assert getattr(back, name) == getattr(file, name), name
    for old, new in zip(file.layers, back.layers, strict=True):
        np.testing.assert_array_equal(old[0], new[0])
        np.testing.assert_array_equal(old[1], new[1])
    np.testing.assert_array_equal(back.mean, file.mean)
    np.testing.assert_array_equal(back.scale, file.scale)
    assert [each.name for each in (tmp_path / "new").iterdir()] == ["a.npz"]


def test_the_same_policy_gives_the_same_bytes(env: CareEnv, tmp_path: Path) -> None:
    for name in ("a.npz", "b.npz"):
        network(env).save(tmp_path / name)
    assert (tmp_path / "a.npz").read_bytes() == (tmp_path / "b.npz").read_bytes()


def test_the_action_is_that_of_the_network_in_torch(env: CareEnv) -> None:
    for low in (-1.0, 0.0):
        file = network(env)
        policy = LearnedPolicy(env, "robot", file)
        policy._low = low  # muscles only pull
        layers: list[nn.Module] = []
        for weights, biases in file.layers:
            linear = nn.Linear(weights.shape[1], weights.shape[0])
            linear.weight.data, linear.bias.data = tensor(weights), tensor(biases)
            layers += [linear, nn.ReLU()]
        actor = nn.Sequential(*layers[:-1])
        seen = np.random.default_rng(1).normal(0, 20, (50, file.observation_size)).astype("f")
        normal = ((tensor(seen) - tensor(file.mean)) / tensor(file.scale)).clamp(-10, 10)
        wanted = low + (actor(normal).tanh() + 1) / 2 * (1 - low)
        got = np.array([policy.decide(row) for row in seen])
        np.testing.assert_allclose(got, wanted.detach().numpy(), atol=2e-5)
        assert got.std() > 0.1


def test_rows_for_the_spread_do_not_change_the_action(env: CareEnv) -> None:
    file = network(env)
    weights, biases = file.layers[-1]
    wide = np.vstack([weights, weights + 1]), np.concatenate([biases, biases - 1])
    both = dataclasses.replace(file, layers=(*file.layers[:-1], wide))
    seen = np.ones(file.observation_size, np.float32)
    np.testing.assert_array_equal(
        LearnedPolicy(env, "robot", file).decide(seen),
        LearnedPolicy(env, "robot", both).decide(seen),
    )


def test_the_mean_of_networks_does_the_mean_before_the_tanh(env: CareEnv, tmp_path: Path) -> None:
    drawn = network(env)
    weights, biases = drawn.layers[-1]  # smaller, where the tanh is not flat
    first = dataclasses.replace(
        drawn, layers=(*drawn.layers[:-1], (np.float32(0.2) * weights, biases))
    )
    rng = np.random.default_rng(1)
    others = [
        dataclasses.replace(
            first,
            layers=tuple((w[::-1].copy() * k, b + 0.1 * k) for w, b in first.layers[:-1])
            + (first.layers[-1],),
            mean=first.mean + np.float32(0.1),
            scale=first.scale * np.float32(k),
            training={"seed": k, "minutes": 1.5},
        )
        for k in (0.5, 2.0)
    ]
    together = mean_of([first, *others])
    together.save(tmp_path / "mean.npz")
    assert together.training["seed"] == [4, 0.5, 2.0] and together.training["minutes"] == 3.0
    together = PolicyFile.read(tmp_path / "mean.npz")
    for _ in range(5):
        seen = rng.normal(0, 1, first.observation_size).astype(np.float32)
        each = [LearnedPolicy(env, "robot", one).decide(seen) for one in (first, *others)]
        wanted = np.tanh(np.mean([np.arctanh(own) for own in each], axis=0))
        found = LearnedPolicy(env, "robot", together).decide(seen)
        assert np.ptp(each, axis=0).max() > 0.1
        assert found == pytest.approx(wanted, abs=1e-5)


def test_networks_that_differ_have_no_mean(env: CareEnv) -> None:
    first = network(env)
    with pytest.raises(ConfigError, match="two policies or more, got 1"):
        mean_of([first])
    with pytest.raises(ConfigError, match="policy 2 differs from the first: task, hold"):
        mean_of([first, dataclasses.replace(first, task="drinking", hold=2)])
    with pytest.raises(ConfigError, match="number of layers"):
        single = (np.zeros((first.action_size, first.observation_size), np.float32),)
        flat = ((single[0], np.zeros(first.action_size, np.float32)),)
        mean_of([first, dataclasses.replace(first, layers=flat)])


def test_a_policy_acts_on_what_its_role_observes(env: CareEnv) -> None:
    file = network(env)
    policy = LearnedPolicy(env, "robot", file)
    np.testing.assert_array_equal(policy.act(), policy.decide(env.observe("robot")))


def test_a_residual_is_added_to_the_scripted_action(env: CareEnv) -> None:
    file = network(env, residual=0.1)
    policy = LearnedPolicy(env, "robot", file)
    _, players = make_players(env, "feeding", {"robot": "scripted"})
    script, rng = players["robot"], np.random.default_rng
    env.reset(seed=3)
    policy.reset(rng(0))
    script.reset(rng(0))
    for _ in range(5):
        base = np.array(script.act())
        seen = np.concatenate([env.observe("robot"), base.astype(np.float32)])
        wanted = np.clip(base + 0.1 * policy.decide(seen), -1, 1)
        action = policy.act()
        np.testing.assert_array_equal(action, wanted)
        assert not np.array_equal(action, base)
        env.step({"robot": action.astype(np.float32)})


@pytest.mark.parametrize(
    ("residual", "hold"), [(None, 1), (0.3, 1), (0.3, 3), ((0.3, 0.0, 0.1, 0.3, 0.3, 0.2), 3)]
)
def test_a_policy_plays_as_it_did_in_training(
    env: CareEnv, residual: Scale | None, hold: int, tmp_path: Path
) -> None:
    network(env, residual=residual, hold=hold).save(tmp_path / "a.npz")
    file = PolicyFile.read(tmp_path / "a.npz")
    scales = {} if residual is None else {"robot": residual}
    moved = slice(None) if residual is None else moved_by(residual)
    learner = LearnerEnv(EnvRecipe("feeding", residual=scales, hold=hold))
    policy = LearnedPolicy(env, "robot", file)
    learner.reset(6)
    env.reset(seed=6)
    policy.reset(np.random.default_rng([6, 0]))
    for _ in range(12 // hold):
        own = policy.decide(learner.observation["robots"][0])
        learner.step({"robots": own[None, moved]})
        paid = np.zeros(1, np.float32)
        for _ in range(hold):
            _, rewards, *_ = env.step({"robot": policy.act()})  # type: ignore[dict-item]  # float64 will do
            paid += [rewards["robot"]]
        assert learner.reward["robots"][0] == paid[0]
    np.testing.assert_array_equal(learner.state, env.state())
    learner.close()


def test_a_residual_of_nothing_plays_as_the_script(env: CareEnv, tmp_path: Path) -> None:
    file = network(env, residual=0.2)
    weights, biases = file.layers[-1]
    still = dataclasses.replace(file, layers=(*file.layers[:-1], (0 * weights, 0 * biases)))
    still.save(tmp_path / "still.npz")
    by = [str(tmp_path / "still.npz"), "scripted"]
    mine, script = (evaluate("feeding", {"robot": name}, episodes=1, seed=5) for name in by)
    assert mine.success_rate == 1.0
    assert mine.episodes == script.episodes


def test_a_file_stands_wherever_the_name_of_a_policy_does(env: CareEnv, tmp_path: Path) -> None:
    file = tmp_path / "a.npz"
    network(env).save(file)
    for given in (
        {"policies": {"robot": str(file)}},
        {"policies": {"robot": file}},
        {"robot": {"policy": str(file)}},
    ):
        made = rcare_marl.make("feeding", **given)
        assert isinstance(made.policies["robot"], LearnedPolicy)
        made.close()


def test_a_camera_beside_what_was_learned_does_not_matter(env: CareEnv) -> None:
    sensors = [{"kind": "camera", "outputs": ["depth"], "width": 8, "height": 6}]
    seeing = rcare_marl.make("feeding", robot={"sensors": sensors}, policies={"recipient": "still"})
    seeing.reset(seed=0)
    policy = LearnedPolicy(seeing, "robot", network(env))
    np.testing.assert_array_equal(policy.act(), policy.decide(seeing.observe("robot")["vector"]))
    seeing.close()


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"task": "bathing"}, "policy of 'robots' in 'bathing' cannot play Feeding: another task"),
        ({"roles": ("recipient",)}, "plays recipient, not 'robot'"),
        ({"action_low": 0.0}, "6 actions from -1 on, learned were 6 from 0 on"),
        ({"actions": tuple("abcdef")}, "the action 'tool x"),
    ],
)
def test_what_does_not_fit_is_named(env: CareEnv, changes: dict[str, Any], message: str) -> None:
    with pytest.raises(ConfigError, match=message.replace("[", r"\[")):
        LearnedPolicy(env, "robot", network(env, **changes))


def test_observations_that_differ_are_listed(env: CareEnv) -> None:
    file = network(env)
    (first, size), second, *rest = file.observed
    names = ((f"{first}_then", size), second, *rest)
    with pytest.raises(ConfigError, match=f"{first}_then is not observed"):
        LearnedPolicy(env, "robot", dataclasses.replace(file, observed=names))
    (last, count) = rest[-1]
    wider = dataclasses.replace(
        file,
        observed=((first, size), second, *rest[:-1], (last, count + 1)),
        layers=((np.hstack([file.layers[0][0], np.ones((16, 1), "f")]), file.layers[0][1]),)
        + file.layers[1:],
        mean=np.append(file.mean, np.float32(0)),
        scale=np.append(file.scale, np.float32(1)),
    )
    with pytest.raises(ConfigError, match=f"{last} has {count} values, learned were {count + 1}"):
        LearnedPolicy(env, "robot", wider)


def test_a_network_reads_its_parts_by_name_wherever_they_are_observed(env: CareEnv) -> None:
    file = network(env)
    dropped, *kept = file.observed
    kept = kept[::-1]
    places = {name: at for at, name, _ in env.describe("robot")}
    columns = np.concatenate([np.arange(places[n].start, places[n].stop) for n, _ in kept])
    (weights, biases), *layers = file.layers
    other = dataclasses.replace(
        file,
        observed=tuple(kept),
        layers=((weights[:, columns], biases), *layers),
        mean=file.mean[columns],
        scale=file.scale[columns],
    )
    blind = weights.copy()
    blind[:, places[dropped[0]]] = (
        0.0  # the same network, which does not look at what the other drops
    )
    same = dataclasses.replace(file, layers=((blind, biases), *layers))
    env.reset(seed=3)
    np.testing.assert_allclose(
        LearnedPolicy(env, "robot", other).act(), LearnedPolicy(env, "robot", same).act(), atol=1e-6
    )


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"layers": ()}, "at least one layer"),
        ({"action_size": 4, "actions": ()}, "gives 6 values for 4 actions"),
        ({"mean": np.zeros(3, np.float32)}, "mean of shape"),
        ({"actions": ("x",)}, "1 names for 6"),
        ({"observed": (("x", 2),)}, "mean of shape"),
    ],
)
def test_numbers_that_do_not_fit_each_other_are_refused(
    env: CareEnv, changes: dict[str, Any], message: str
) -> None:
    with pytest.raises(ConfigError, match=message):
        network(env, **changes)


def test_numbers_that_are_not_finite_or_scales_of_zero_are_refused(env: CareEnv) -> None:
    file = network(env)
    with pytest.raises(ConfigError, match="finite"):
        dataclasses.replace(file, mean=file.mean * np.nan)
    with pytest.raises(ConfigError, match="positive"):
        dataclasses.replace(file, scale=file.scale * 0)


def test_a_missing_file_names_those_that_are_near(env: CareEnv, tmp_path: Path) -> None:
    network(env).save(tmp_path / "policy.npz")
    with pytest.raises(ConfigError, match=r"Did you mean .*/policy\.npz\?"):
        rcare_marl.make("feeding", policies={"robot": str(tmp_path / "polcy.npz")})
    with pytest.raises(ConfigError, match="there are policy.npz"):
        PolicyFile.read(tmp_path / "xxxxxxxxxxxxx.npz")
    with pytest.raises(ConfigError, match="There is no folder"):
        PolicyFile.read(tmp_path / "nowhere" / "policy.npz")


def test_a_damaged_file_is_refused_wherever_it_is_cut(env: CareEnv, tmp_path: Path) -> None:
    network(env).save(tmp_path / "whole.npz")
    data = (tmp_path / "whole.npz").read_bytes()
    file = tmp_path / "cut.npz"
    for share in (0.0, 0.01, 0.3, 0.6, 0.9, 0.999):
        file.write_bytes(data[: int(share * len(data))])
        with pytest.raises(ConfigError, match="damaged, or no file of a policy"):
            PolicyFile.read(file)
    middle = len(data) // 2
    file.write_bytes(data[:middle] + bytes(64) + data[middle + 64 :])
    with pytest.raises(ConfigError, match="damaged"):
        PolicyFile.read(file)


def test_files_of_other_kinds_are_refused(tmp_path: Path) -> None:
    file = tmp_path / "a.npz"
    np.savez(file, x=np.zeros(3))
    with pytest.raises(ConfigError, match="no file of a policy"):
        PolicyFile.read(file)
    pickled: Any = {"about": np.array([{"version": 1}], object)}
    np.savez(file, **pickled)  # must not be unpickled
    with pytest.raises(ConfigError, match="no file of a policy"):
        PolicyFile.read(file)
    np.savez(file, about=np.frombuffer(b'{"version": 99}', np.uint8))
    with pytest.raises(ConfigError, match="version 99 of the format"):
        PolicyFile.read(file)


def test_a_file_holds_no_pickle(env: CareEnv, tmp_path: Path) -> None:
    network(env).save(tmp_path / "a.npz")
    with zipfile.ZipFile(tmp_path / "a.npz") as archive:
        assert archive.testzip() is None
        for name in archive.namelist():
            with archive.open(name) as part:
                np.lib.format.read_array(part, allow_pickle=False)


def test_people_play_trained_networks_too(env: CareEnv) -> None:
    file = network(env, "recipient")
    action = LearnedPolicy(env, "recipient", file).act()
    assert action.shape == (env.cast["recipient"].action_size,)


def test_an_ending_is_registered_once_and_begins_with_a_dot() -> None:
    def never(path: Path) -> Any:
        raise AssertionError

    with pytest.raises(ConfigError, match="policies already"):
        register_policy_file(".npz")(never)
    with pytest.raises(ConfigError, match="begins with a dot"):
        register_policy_file("npz")


def test_files_that_ship_are_chosen_by_level(env: CareEnv, tmp_path: Path) -> None:
    for name in ("feeding", "toileting_level1", "toileting_level3", "phyrc_feeding"):
        network(env).save(tmp_path / f"{name}.npz")
    assert set(trained.shipped("feeding", tmp_path)) == {None}
    assert set(trained.shipped("toileting", tmp_path)) == {1, 3}
    assert trained.file_for("feeding", 2, tmp_path).name == "feeding.npz"
    assert trained.file_for("toileting", 3, tmp_path).name == "toileting_level3.npz"
    with pytest.raises(ConfigError, match="ships for level 2; there are: 1, 3"):
        trained.file_for("toileting", 2, tmp_path)
    assert trained.fits(env, "feeding", folder=tmp_path)
    assert not trained.fits(env, "bathing", folder=tmp_path)


def test_a_robot_is_shown_with_what_it_learned_where_that_ships(
    env: CareEnv, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(trained, "FOLDER", tmp_path)
    assert trained.best_policy(env, "feeding") == "scripted"
    network(env).save(tmp_path / "feeding.npz")
    assert trained.best_policy(env, "feeding") == "learned"
    assert trained.best_policy(env, "feeding", "robot_7") == "scripted"


def test_a_shipped_policy_that_does_not_fit_the_cast_is_not_the_default(
    env: CareEnv, tmp_path: Path
) -> None:
    network(env).save(tmp_path / "feeding.npz")
    other = rcare_marl.make("feeding", robot={"control": "joint_delta"})
    assert not trained.fits(other, "feeding", folder=tmp_path)
    other.close()


@pytest.mark.parametrize(
    "file",
    [
        pytest.param(file, id=file.stem, marks=pytest.mark.slow if file.stem in LONG else ())
        for file in sorted(trained.FOLDER.glob("*.npz"))
    ],
)
def test_every_shipped_policy_plays_its_task_and_is_small(file: Path) -> None:
    policy = PolicyFile.read(file)
    assert file.stat().st_size < 2_000_000
    assert trained.LEVEL.sub(r"\g<task>", file.stem) == policy.task
    level = trained.LEVEL.fullmatch(file.stem)
    place = {"level": int(level["level"])} if level is not None and level["level"] else {}
    of_all = trained.for_everybody(policy.task)
    name = trained.SPECIALIST if of_all is not None and of_all != file else trained.NAME
    made = rcare_marl.make(policy.task, policies={"robot": name}, **place)  # type: ignore[arg-type]
    made.reset(seed=0)
    action: Array = made.policies["robot"].act()
    assert np.isfinite(action).all()
    made.close()
