"""Collecting on a cluster: what workers may be, and two workers of a Ray that the test starts."""

from __future__ import annotations

import contextlib
import importlib.util
import json
import os
import secrets
import socket
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch

from rcare_marl.baselines.training import cluster as place
from rcare_marl.baselines.training.cluster import Cluster
from rcare_marl.errors import ClusterError, ConfigError, MissingPackageError

ENVS, STEPS = 4, 10  # steps of each environment in a batch


def policy_for(env: Any) -> Any:
    from rcare_marl.baselines.algorithms.network import Actor, ExploringPolicy, group_shapes

    torch.manual_seed(0)
    actors = {name: Actor(shape, (32, 32)) for name, shape in group_shapes(env).items()}
    return ExploringPolicy(actors, warming=False)


@pytest.mark.parametrize(
    "text", ["ray", "ray://", "ray://head", "ray://:6379", "ray://head:x", "4"]
)
def test_workers_of_another_form_are_refused(text: str) -> None:
    with pytest.raises(ConfigError, match="ray://HOST:PORT"):
        Cluster.parse(text)


def test_an_address_is_read() -> None:
    assert Cluster.parse("ray://10.0.0.5:6379").address == "10.0.0.5:6379"
    assert Cluster.parse("ray://local:2").is_local
    assert not Cluster.parse("ray://localhost:2").is_local


def test_without_ray_it_is_said_what_to_install(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(importlib.util, "find_spec", lambda name: None)
    with pytest.raises(MissingPackageError, match=r"pip install 'rcare-marl\[dist\]'"):
        Cluster.parse("ray://local:2").worker_count(4)


def test_environments_that_do_not_divide_are_refused() -> None:
    pytest.importorskip("ray")
    with pytest.raises(
        ConfigError, match="5 environments do not divide among 2 workers: .* 4 or 6"
    ):
        Cluster.parse("ray://local:2").worker_count(5)


def test_a_closed_address_is_refused_at_once() -> None:
    pytest.importorskip("ray")
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    with pytest.raises(ClusterError, match="no Ray cluster can be reached at 127.0.0.1"):
        Cluster.parse(f"ray://127.0.0.1:{port}").worker_count(4)


def test_who_listens_and_is_no_cluster_is_given_up(monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("ray")
    monkeypatch.setattr(place, "ANSWER_TIME", 1.0)
    with socket.socket() as mute:
        mute.bind(("127.0.0.1", 0))
        mute.listen()
        with pytest.raises(ClusterError, match="did not answer as a Ray cluster within 1 s"):
            Cluster.parse(f"ray://127.0.0.1:{mute.getsockname()[1]}").worker_count(4)


def test_batches_in_this_process_are_whole_and_new() -> None:
    from rcare_marl.baselines.training.collector import make_collector, shut_down
    from rcare_marl.envs.learning import BatchedEnv, EnvRecipe

    recipe = EnvRecipe("toileting")
    env = BatchedEnv(recipe, count=2, seed=3)
    collector = make_collector(
        recipe,
        policy_for(env),
        envs=2,
        workers=0,
        seed=3,
        frames_per_batch=2 * STEPS,
        total_frames=4 * STEPS - 1,
        env=env,
    )
    try:
        first, second = [batch["robots", "observation"] for batch in collector]
    finally:
        shut_down(collector)
    assert first.shape[:2] == second.shape[:2] == (2, STEPS)
    assert first.data_ptr() != second.data_ptr()
    assert env.is_closed


def test_a_batch_of_unequal_shares_is_refused() -> None:
    from rcare_marl.baselines.training.collector import make_collector
    from rcare_marl.envs.learning import EnvRecipe

    with pytest.raises(
        ConfigError, match="frames_per_batch must be a multiple of envs, got 7 and 2"
    ):
        make_collector(
            EnvRecipe("toileting"),
            None,
            envs=2,
            workers=0,
            seed=0,
            frames_per_batch=7,
            total_frames=7,
        )


@pytest.fixture
def ray_cluster(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Iterator[str]:
    """Two nodes of one core each, with a token of their own; yields the address."""
    pytest.importorskip("ray")
    monkeypatch.setenv("RAY_USAGE_STATS_ENABLED", "0")
    script = Path(__file__).with_name("ray_nodes.py")
    token = tmp_path / "token"
    token.write_text(secrets.token_hex(32))
    monkeypatch.setenv("RAY_AUTH_MODE", "token")
    monkeypatch.setenv("RAY_AUTH_TOKEN_PATH", str(token))
    nodes = subprocess.Popen(
        [sys.executable, script], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
    )
    try:
        assert nodes.stdout is not None
        yield nodes.stdout.readline().strip()
    finally:
        nodes.communicate("end\n", timeout=60)
    assert nodes.returncode == 0


def left_over(token: str) -> list[str]:
    """Return the processes with that token in their environment, once they had time to end."""
    psutil = pytest.importorskip("psutil")
    deadline = time.monotonic() + 30
    while True:
        found = []
        for process in psutil.process_iter():
            with contextlib.suppress(psutil.Error):
                if process.environ().get("RAY_AUTH_TOKEN") == token and process != psutil.Process():
                    found.append(process.name())
        if not found or time.monotonic() > deadline:
            return found
        time.sleep(0.2)


COLLECTS = """
import json, sys, warnings
import torch
sys.path.insert(0, {tests!r})
from rcare_marl.baselines.training.collector import make_collector, set_stage, shut_down
from rcare_marl.envs.learning import BatchedEnv, EnvRecipe
from test_ray import ENVS, STEPS, policy_for

warnings.simplefilter("error", UserWarning)
torch.set_num_threads(1)
recipe = EnvRecipe("toileting")
specs = BatchedEnv(recipe, count=1)
policy = policy_for(specs)
specs.close()
collector = make_collector(recipe, policy, envs=ENVS, workers={workers!r}, seed=0,
                           frames_per_batch=ENVS * STEPS, total_frames=3 * ENVS * STEPS)
workers, out = collector.num_collectors, []
try:
    for batch in collector:
        assert policy.actors["robots"].layers[-1].bias.numel() == 12
        action = batch["robots", "action"]
        out.append(dict(shape=list(batch.shape), action=action.flatten(1).tolist(),
                        seen=batch["robots", "observation"][:, 0].flatten(1).tolist()))
        with torch.no_grad():  # from here on it does one thing only, without chance
            policy.actors["robots"].layers[-1].weight.zero_()
            policy.actors["robots"].layers[-1].bias[:6] = len(out)
            policy.actors["robots"].layers[-1].bias[6:] = -20
        set_stage(collector, {{"spread": 0.5}})
finally:
    shut_down(collector)
print(json.dumps(dict(workers=workers, batches=out)))
"""


def collect(workers: str) -> dict[str, Any]:
    code = COLLECTS.format(tests=str(Path(__file__).parent), workers=workers)
    done = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, timeout=300, cwd=os.sep
    )
    assert done.returncode == 0, done.stderr[-3000:]
    return json.loads(done.stdout.splitlines()[-1])


def check(told: dict[str, Any]) -> None:
    assert told["workers"] == 2
    assert [batch["shape"] for batch in told["batches"]] == [[ENVS, STEPS]] * 3
    first, second, third = (np.array(batch["action"]) for batch in told["batches"])
    # Each environment has an episode and a chance of its own.
    for rows in (np.array(told["batches"][0]["seen"]), first):
        assert len(np.unique(rows.round(6), axis=0)) == ENVS
    # What the learner did to the policy is in the next batch of both workers.
    for batch, bias in ((second, 1), (third, 2)):
        assert np.abs(batch - np.tanh(bias)).max() < 0.05


@pytest.mark.slow
def test_two_workers_of_a_cluster_collect_with_new_weights(ray_cluster: str) -> None:
    check(collect(f"ray://{ray_cluster}"))


@pytest.mark.slow
def test_two_workers_of_a_local_ray_end_with_the_training(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    pytest.importorskip("ray")
    monkeypatch.setenv("RAY_AUTH_MODE", "token")
    token = secrets.token_hex(32)
    monkeypatch.setenv("RAY_AUTH_TOKEN", token)
    check(collect("ray://local:2"))
    assert not left_over(token)


@pytest.mark.slow
def test_a_cluster_that_wants_a_token_says_so(
    ray_cluster: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.delenv("RAY_AUTH_TOKEN_PATH")
    monkeypatch.setenv("RAY_AUTH_MODE", "disabled")
    with pytest.raises(ClusterError, match="Ray cannot use the cluster at"):
        Cluster.parse(f"ray://{ray_cluster}").worker_count(4)
