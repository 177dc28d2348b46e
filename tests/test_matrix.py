"""The matrix of people, robots, partners and homes: what its axes mean, and that no cell ends the others."""

from __future__ import annotations

import json
import os
import signal
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from pathlib import Path

import pytest
from typer.testing import CliRunner

from rcare_marl.agents.people.avatar import load_avatar
from rcare_marl.agents.people.sampling.population import person_hash
from rcare_marl.baselines.evaluation import matrix as module
from rcare_marl.baselines.evaluation.axes import axis_values, parse_over
from rcare_marl.baselines.evaluation.evaluate import Evaluation, evaluate, lead_policies
from rcare_marl.baselines.evaluation.matrix import (
    Cell,
    Matrix,
    MatrixPlan,
    Outcome,
    run_matrix,
)
from rcare_marl.baselines.workers import run_each
from rcare_marl.cli import app
from rcare_marl.errors import ConfigError, UnknownNameError, WorkerError

Finished = Callable[[int, Outcome], None]

SIX = ("morgan", "jose", "natalia", "daniel", "kim", "karan")


def test_axes_stand_for_single_values() -> None:
    over = parse_over("people=six+population:test:0-1, robots=reachable,partners=all,homes=2")
    found = {axis: axis_values("feeding", axis, values) for axis, values in over.items()}
    assert found["people"] == (*SIX, "population:test:0", "population:test:1")
    assert "kinova_gen3" in found["robots"] and "nao" not in found["robots"]
    assert found["partners"][:3] == ("cooperative", "behaviour", "still")
    assert {"refusing", "tremor", "muscle"} < set(found["partners"])
    assert found["homes"] == ("house_01", "house_02")
    assert "nao" in axis_values("feeding", "robots", ("all",))
    assert axis_values("feeding", "homes", ("bare", "house_07:3")) == ("bare", "house_07:3")
    assert "caregiver:still" in axis_values("dressing", "partners", ("all",))


@pytest.mark.parametrize(
    ("over", "said"),
    [
        ("peopel=six", "Did you mean 'people'"),
        ("people=karn", "Did you mean 'karan'"),
        ("people=population:tst", "Did you mean 'test'"),
        ("people=population:test:5-900", "one from 0 to 199"),
        ("people=population:test:900", "people 0..199"),
        ("people=no/such.yaml", "No such file"),
        ("robots=no/such.yaml", "No such file"),
        ("people=", "needs values"),
        ("people=six,people=six", "stands there twice"),
        ("robots=pr3", "Did you mean 'pr2'"),
        ("partners=tremr", "Did you mean 'tremor'"),
        ("homes=huose_07", "Did you mean 'house_07'"),
        ("homes=0", "from 1 to 16"),
        ("homes=house_07:4", "house_07:2"),
    ],
)
def test_bad_axes_are_refused_by_name(over: str, said: str) -> None:
    with pytest.raises((ConfigError, UnknownNameError), match=said):
        MatrixPlan("feeding", parse_over(over))


def test_an_axis_takes_nothing_beside_it() -> None:
    with pytest.raises(ConfigError, match="robots are an axis"):
        MatrixPlan("feeding", parse_over("robots=pr2"), cast={"robot": "ur5"})
    with pytest.raises(ConfigError, match="nobody plays the recipient"):
        MatrixPlan("toileting", parse_over("partners=still"))
    with pytest.raises(ConfigError, match="nobody plays the caregiver"):
        MatrixPlan("bathing", parse_over("partners=caregiver:still"))


def test_each_person_has_seeds_of_their_own_the_same_in_every_cell(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    over = parse_over("people=kim+karan,partners=still+passive")
    plan = MatrixPlan("feeding", over, episodes=3, seed=7)
    expected = [("kim", 7), ("kim", 7), ("karan", 10), ("karan", 10)]
    assert [(cell.person, cell.seed) for cell in plan.cells()] == expected
    whole = MatrixPlan("feeding", parse_over("people=population:test"), episodes=1, seed=20)
    assert [cell.seed for cell in whole.cells()] == list(range(20, 220))
    part = MatrixPlan("feeding", parse_over("people=population:test:10-19"), episodes=1, seed=30)
    assert [cell.seed for cell in part.cells()] == [cell.seed for cell in whole.cells()[10:20]]
    monkeypatch.setattr(module, "evaluate", lambda *_, **given: given["seed"])
    found: list[object] = [cell.evaluation() for cell in plan.cells()]
    assert found == [7, 7, 10, 10]
    assert {cell.seed for cell in replace(plan, own_seeds=False).cells()} == {7}


def test_cells_are_evaluations_and_refusals_are_rows(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The short form of the matrix: a cell is what `evaluate` gives, and nothing ends the others."""
    real = Cell.evaluation

    def faulty(cell: Cell, *args: object) -> Evaluation:
        if cell.robot == "ur5":
            raise RuntimeError("a fault of ours")
        return real(cell, *args)  # type: ignore[arg-type]

    monkeypatch.setattr(Cell, "evaluation", faulty)
    file = tmp_path / "matrix.json"
    axes = "people=karan,robots=kinova_gen3+nao+ur5"
    given = ["--over", axes, "--episodes", "1", "--seed", "3", "--out", str(file), "--json"]
    result = CliRunner().invoke(app, ["evaluate", "feeding", *given])
    assert result.exit_code == 1 and "ur5: crashed: RuntimeError: a fault" in result.stderr
    brief, record = json.loads(result.stdout), json.loads(file.read_text())
    done, refused, crashed = record["cells"]
    assert [cell["state"] for cell in record["cells"]] == ["done", "refused", "crashed"]
    assert "no mount" in refused["reason"] and "a fault of ours" in crashed["reason"]
    policies = lead_policies("feeding", "scripted")
    alone = evaluate("feeding", policies, episodes=1, seed=3, cast={"recipient": "karan"})
    assert done["peak_force_n_greatest"] == alone.peak_force
    assert done["success_interval_95"] == list(alone.success_interval)
    assert (
        done["episodes_by_column"]["seed"] == [3] and "episodes_by_column" not in brief["cells"][0]
    )
    assert record["people"] == {"karan": person_hash(load_avatar("karan"))}
    assert record["complete"] and record["total"] == brief["total"]
    assert record["total"] | {"peak_force_n_mean": 0, "peak_force_n_greatest": 0} == {
        "cells": 3,
        "done": 1,
        "refused": 1,
        "crashed": 1,
        "infeasible": 0,
        "episodes": 1,
        "feasible_episodes": 1,
        "successes": 1,
        "success_rate_of_feasible": 1.0,
        "success_interval_95": list(alone.success_interval),
        **dict.fromkeys(("room_contacts", "room_near_misses", "room_clearance_m")),
        "peak_force_n_mean": 0,
        "peak_force_n_greatest": 0,
    }
    assert record["sums"]["robots"]["nao"]["refused"] == 1


def test_ctrl_c_keeps_what_was_finished(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    real = Cell.evaluation

    def interrupted(cell: Cell, *args: object) -> Evaluation:
        if cell.robot == "ur5":
            raise KeyboardInterrupt
        return real(cell, *args)  # type: ignore[arg-type]

    monkeypatch.setattr(Cell, "evaluation", interrupted)
    file = tmp_path / "matrix.json"
    given = ["--over", "robots=nao+ur5", "--out", str(file)]
    result = CliRunner().invoke(app, ["evaluate", "feeding", *given])
    assert result.exit_code == 130 and "1 cells were not finished" in result.stdout
    record = json.loads(file.read_text())
    assert not record["complete"] and [cell["state"] for cell in record["cells"]] == ["refused"]


def give(number: int) -> int:
    if number == 1:
        os.kill(os.getpid(), signal.SIGKILL)
    if number == 2:
        raise ValueError("bad")
    return number


def test_several_processes_share_a_cell_in_which_others_play_each_time(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """In parts of a few episodes, each with its own seeds; the cell comes out as if it had been run whole."""
    cast = {"recipient": "population:test:0-99"}
    plan = MatrixPlan("feeding", {}, episodes=2, seed=40, cast=cast)
    runs: list[list[int]] = []

    def in_turn(calls: list[Callable[[], Outcome]], _: int, on_done: Finished) -> None:
        runs.append([])
        for number, call in reversed(list(enumerate(calls))):  # the last is the first to be done
            on_done(number, call())

    def noted(cell: Cell, *args: object) -> Evaluation:
        runs[-1].append(cell.plan.episodes)
        return real(cell, *args)  # type: ignore[arg-type]

    real = Cell.evaluation
    monkeypatch.setattr(Cell, "evaluation", noted)
    monkeypatch.setattr(module, "CHUNK", 1)
    monkeypatch.setattr(module, "run_each", in_turn)
    told: list[int] = []
    whole = run_matrix(plan)
    parted = run_matrix(plan, processes=2, on_progress=told.append)
    assert runs == [[2], [1, 1]] and sum(told) == 2
    assert parted.to_dict() | {"machine": 0} == whole.to_dict() | {"machine": 0}
    assert [e.seed for e in parted.outcomes[0].result.episodes] == [40, 41]  # type: ignore[union-attr]

    def refusing(cell: Cell, *args: object) -> Evaluation:
        if cell.seed == 41:
            raise ConfigError("nobody can be cast")
        return whole.outcomes[0].result  # type: ignore[return-value]

    monkeypatch.setattr(Cell, "evaluation", refusing)
    (refused,) = run_matrix(plan, processes=2).outcomes
    assert (refused.state, refused.reason) == ("refused", "nobody can be cast")
    assert refused.cell == plan.cells()[0]


@pytest.mark.slow
def test_a_killed_process_costs_its_own_call() -> None:
    found: dict[int, int | BaseException] = {}
    run_each([partial(give, number) for number in range(5)], 2, found.__setitem__)
    assert [found[number] for number in (0, 3, 4)] == [0, 3, 4]
    assert isinstance(found[1], WorkerError) and isinstance(found[2], ValueError)


def test_partners_differ_in_policy_or_body() -> None:
    plan = MatrixPlan("feeding", parse_over("people=kim,partners=tremor+still"), episodes=1)
    made: list[Matrix] = []
    matrix = run_matrix(plan, on_cell=lambda so_far, _: made.append(so_far))
    assert not made[0].is_complete and made[-1].is_complete
    tremor, still = (each.result for each in matrix.outcomes)
    assert tremor is not None and tremor.policies["recipient"] == "cooperative"
    assert still is not None and still.policies["recipient"] == "still"
    assert set(tremor.people.values()).isdisjoint(still.people.values())


def test_axes_may_be_given_one_by_one_and_none_is_lost() -> None:
    who, how = "people=population:test:400-409", "partners=passive"
    result = CliRunner().invoke(app, ["evaluate", "feeding", "--over", who, "--over", how])
    assert result.exit_code == 2 and "'400-409' is none of its people" in result.output
