"""Promises of checkpoints."""

from __future__ import annotations

import io
import os
import random
import signal
import zipfile
from collections.abc import Callable
from pathlib import Path
from typing import IO, Any

import numpy as np
import pytest
import torch
from tensordict import TensorDict
from torchrl.data import LazyTensorStorage, ReplayBuffer

from rcare_marl.baselines.training.checkpoint import BEST, FORMAT, LAST, load, restore_rng, save
from rcare_marl.errors import ConfigError


def learnt(network: torch.nn.Module, optimiser: torch.optim.Optimizer, steps: int) -> None:
    for _ in range(steps):
        optimiser.zero_grad()
        network(torch.randn(8, 3)).square().sum().backward()
        optimiser.step()


def test_a_network_learns_on_as_if_it_had_never_stopped(tmp_path: Path) -> None:
    torch.manual_seed(1)
    network = torch.nn.Linear(3, 2)
    optimiser = torch.optim.Adam(network.parameters())
    learnt(network, optimiser, 3)
    file = tmp_path / LAST
    save(file, {"network": network.state_dict(), "optimiser": optimiser.state_dict()})
    learnt(network, optimiser, 3)

    again = torch.nn.Linear(3, 2)
    other = torch.optim.Adam(again.parameters())
    saved = load(file)
    again.load_state_dict(saved["network"])
    other.load_state_dict(saved["optimiser"])
    restore_rng(saved)
    learnt(again, other, 3)
    for name, value in network.state_dict().items():
        assert torch.equal(value, again.state_dict()[name])


def test_shared_generators_go_on_where_they_were(tmp_path: Path) -> None:
    def draw() -> tuple[float, float, float]:
        return random.gauss(0, 1), float(np.random.normal()), float(torch.randn(()))

    draw()  # leaves the spare of a pair of normal numbers behind
    save(tmp_path / LAST, {})
    wanted = [draw() for _ in range(3)]
    restore_rng(load(tmp_path / LAST))
    assert [draw() for _ in range(3)] == wanted


def test_what_was_saved_comes_back_as_it_was(tmp_path: Path) -> None:
    rng = np.random.default_rng(5)
    rng.normal()
    state = {
        "own": rng.bit_generator.state,  # with whole numbers of 128 bits
        "arrays": [np.arange(6, dtype=np.uint64).reshape(2, 3), np.zeros((0, 3), np.float32)],
        "pair": (1, None),
        "by_number": {0: 1.5, 1: float("inf")},
        "text": "lifted",
        "count": np.int64(7),
    }
    save(tmp_path / LAST, state)
    found = load(tmp_path / LAST)
    assert found["own"] == state["own"] and found["pair"] == (1, None)
    for old, new in zip(state["arrays"], found["arrays"], strict=True):
        assert old.dtype == new.dtype and np.array_equal(old, new) and old.shape == new.shape
        new += 1  # not a view of something that cannot be changed
    assert found["by_number"] == state["by_number"] and (found["text"], found["count"]) == (
        "lifted",
        7,
    )


def test_a_replay_buffer_comes_back_with_what_was_in_it(tmp_path: Path) -> None:
    def empty() -> ReplayBuffer:
        return ReplayBuffer(storage=LazyTensorStorage(10))

    buffer = empty()
    data = TensorDict({"a": torch.arange(4.0), ("next", "b"): torch.ones(4, 2)}, [4])
    buffer.extend(data)
    save(tmp_path / LAST, {"buffer": buffer.state_dict()})
    other = empty()
    other.load_state_dict(load(tmp_path / LAST)["buffer"])
    assert len(other) == 4 and torch.equal(other[:]["a"], data["a"])
    assert torch.equal(other[:]["next", "b"], data["next", "b"])


def test_a_part_of_a_tensor_is_saved_without_the_rest(tmp_path: Path) -> None:
    save(tmp_path / LAST, {"part": torch.zeros(1_000_000)[:10]})
    assert (tmp_path / LAST).stat().st_size < 100_000
    assert load(tmp_path / LAST)["part"].shape == (10,)


def die(*_: object) -> None:
    os.kill(os.getpid(), signal.SIGKILL)


def write_half(content: object, stream: IO[bytes]) -> None:
    whole = io.BytesIO()
    torch_save(content, whole)
    stream.write(whole.getvalue()[: len(whole.getvalue()) // 2])
    stream.flush()
    die()


torch_save = torch.save


@pytest.mark.parametrize(
    ("where", "what", "survives"),
    [
        ("torch.save", write_half, 1),
        ("os.fsync", die, 1),
        ("os.replace", die, 1),
        ("os.link", die, 2),
    ],
)
def test_a_kill_at_any_moment_leaves_a_whole_checkpoint(
    tmp_path: Path, where: str, what: Callable[..., None], survives: int
) -> None:
    def write(number: int) -> None:
        save(tmp_path / LAST, {"number": number, "data": np.full(1000, number)}, is_best=True)

    write(1)
    child = os.fork()
    if child == 0:
        pytest.MonkeyPatch().setattr(where, what)
        write(2)
        os._exit(0)
    assert os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]) == -signal.SIGKILL
    for name, number in ((LAST, survives), (BEST, 1)):
        found = load(tmp_path / name)
        assert found["number"] == number and np.all(found["data"] == number)
    assert survives == 2 or list(tmp_path.glob(".*.tmp")), (
        "it was killed too early to show anything"
    )
    write(3)
    assert sorted(each.name for each in tmp_path.iterdir()) == sorted([LAST, BEST])
    assert load(tmp_path / LAST)["number"] == load(tmp_path / BEST)["number"] == 3


def test_the_best_one_stays_when_others_follow(tmp_path: Path) -> None:
    last, best = tmp_path / LAST, tmp_path / BEST
    save(last, {"n": 1})
    assert not best.exists()
    for number, is_best in ((2, True), (3, False), (4, False)):
        save(last, {"n": number}, is_best=is_best)
    assert load(last)["n"] == 4 and load(best)["n"] == 2
    save(last, {"n": 5}, is_best=True)
    assert load(best)["n"] == 5
    assert sorted(each.name for each in tmp_path.iterdir()) == sorted([LAST, BEST])


def cut(data: bytes) -> bytes:
    return data[: len(data) // 2]


def flip(data: bytes) -> bytes:
    at = data.index(np.full(50, 7.0).tobytes())
    return data[:at] + bytes([data[at] ^ 1]) + data[at + 1 :]


@pytest.mark.parametrize("damage", [cut, flip, lambda data: data[:-1], lambda data: b""])
def test_a_damaged_file_is_refused(tmp_path: Path, damage: Callable[[bytes], bytes]) -> None:
    file = tmp_path / LAST
    save(file, {"data": torch.full((1000,), 7.0, dtype=torch.float64)})
    file.write_bytes(damage(file.read_bytes()))
    with pytest.raises(ConfigError, match="damaged or was cut short"):
        load(file)


def test_a_file_of_another_format_is_refused(tmp_path: Path) -> None:
    file = tmp_path / LAST
    torch.save({"format": FORMAT + 1, "version": "9.9"}, file)
    with pytest.raises(ConfigError, match=f"has format {FORMAT + 1}, written by rcare-marl 9.9"):
        load(file)
    torch.save({"weights": torch.zeros(2)}, file)
    with pytest.raises(ConfigError, match="checkpoint of this package"):
        load(file)
    with zipfile.ZipFile(file, "w") as archive:
        archive.writestr("readme", "hello")
    with pytest.raises(ConfigError, match="checkpoint of this package"):
        load(file)


class Intruder:
    def __init__(self, trace: Path) -> None:
        self.trace = trace

    def __reduce__(self) -> tuple[Any, ...]:
        return (Path.touch, (self.trace,))


def test_no_code_in_a_file_is_run(tmp_path: Path) -> None:
    torch.save({"format": FORMAT, "state": Intruder(tmp_path / "trace")}, tmp_path / LAST)
    with pytest.raises(ConfigError, match="could run as a program"):
        load(tmp_path / LAST)
    assert not (tmp_path / "trace").exists()


CONFIG = {"task": "feeding", "algorithm": {"gamma": 0.99, "layers": (256, 256)}, "steps": 100}


def test_a_checkpoint_that_does_not_fit_says_which_field_differs(tmp_path: Path) -> None:
    save(tmp_path / LAST, {}, config=CONFIG)
    other = {**CONFIG, "task": "bathing", "algorithm": {"gamma": 0.98, "layers": (256, 256)}}
    with pytest.raises(ConfigError) as caught:
        load(tmp_path / LAST, config=other)
    message = str(caught.value)
    assert "task is 'feeding' in the checkpoint and 'bathing' in the config" in message
    assert "algorithm.gamma is 0.99 in the checkpoint and 0.98 in the config" in message
    assert "layers" not in message and "steps" not in message


def test_a_field_that_only_one_of_them_has_is_a_difference(tmp_path: Path) -> None:
    save(tmp_path / LAST, {}, config=CONFIG)
    with pytest.raises(ConfigError, match="algorithm.tau is not set in the checkpoint and 0.5"):
        load(tmp_path / LAST, config={**CONFIG, "algorithm": {**CONFIG["algorithm"], "tau": 0.5}})  # type: ignore[dict-item]
    with pytest.raises(ConfigError, match="algorithm.gamma is 0.99 in the checkpoint and not set"):
        load(tmp_path / LAST, config={**CONFIG, "algorithm": {"layers": [256, 256]}})


def test_a_run_may_be_made_longer(tmp_path: Path) -> None:
    save(tmp_path / LAST, {"n": 1}, config=CONFIG)
    longer = {**CONFIG, "steps": 200, "algorithm": {"gamma": 0.99, "layers": [256, 256]}}
    assert load(tmp_path / LAST, config=longer)["n"] == 1


def test_a_missing_file_is_answered_with_the_nearest_one(tmp_path: Path) -> None:
    save(tmp_path / "run" / LAST, {})
    with pytest.raises(ConfigError, match=f"Did you mean .*run/{LAST}"):
        load(tmp_path / "run" / "chekpoint.pt")
    with pytest.raises(ConfigError, match="Did you mean .*run[?]"):
        load(tmp_path / "runs" / LAST)
    with pytest.raises(ConfigError, match=f"there are {LAST}"):
        load(tmp_path / "run" / "x.pt")


def test_what_cannot_be_kept_is_named(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match=r"state\.nets\[1\] is a Linear"):
        save(tmp_path / LAST, {"nets": [1, torch.nn.Linear(1, 1)]})
    with pytest.raises(ConfigError, match=r"state\.a: .*not \(1, 2\)"):
        save(tmp_path / LAST, {"a": {(1, 2): 3}})
    assert not list(tmp_path.iterdir())


def test_a_place_that_cannot_be_written_is_named(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(ConfigError, match="cannot write .*file/checkpoint.pt"):
        save(tmp_path / "file" / LAST, {})
