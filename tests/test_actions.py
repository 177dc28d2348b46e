"""An action is all that a person does: actions given back without their policies give the same episode."""

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
import pytest
from variants import few

import rcare_marl
from rcare_marl.agents.agent import Array
from rcare_marl.agents.people.actuation.muscular import MuscleDrive
from rcare_marl.agents.people.human import Human
from rcare_marl.agents.policy import Policy
from rcare_marl.envs import CareEnv
from rcare_marl.errors import ActionError

STEPS = 25
CASTS: dict[str, dict[str, Any]] = {
    "skeletal": {},
    **{
        f"muscle {e}": {"actuation": "muscle", "excitation": e}
        for e in ("unit", "group", "posture")
    },
}
Commands = dict[str, list[Array]]
Trace = list[Array]


class Recorded:
    """A policy that plays actions back."""

    def __init__(self, actions: list[Array]) -> None:
        self._actions, self._next = actions, 0

    def reset(self, rng: np.random.Generator) -> None:
        self._next = 0

    def act(self) -> Array:
        self._next += 1
        return self._actions[self._next - 1]


def played(env: CareEnv, seed: int) -> tuple[Commands, Trace]:
    """Return what everybody was commanded in an episode, and all that is known after each step."""
    commands: Commands = {role: [] for role in env.cast}
    for role, agent in env.cast.items():

        def command(
            action: Array,
            duration: float,
            *,
            taken: list[Array] = commands[role],
            obey: Callable[[Array, float], None] = type(agent).command.__get__(agent),
        ) -> None:
            taken.append(action.copy())
            obey(action, duration)

        agent.command = command  # type: ignore[method-assign]
    env.reset(seed=seed)
    for actions in commands.values():
        actions.clear()  # some tasks let people settle in `reset`
    trace: Trace = []
    while not env.is_over and len(trace) < STEPS:
        env.step({})
        trace.append(np.append(env.state().astype(np.float64), env.task.succeeded()))
    return commands, trace


def check_replay(task: str, policy: str, cast: Mapping[str, Any], model: str, seed: int) -> None:
    recipient = {"model": model, **cast}
    env = rcare_marl.make(
        task, recipient=recipient, policies={"robot": "scripted", "recipient": policy}
    )
    commands, trace = played(env, seed)
    env.close()

    def recorded(env: CareEnv, role: str) -> Policy:
        return Recorded(commands[role])

    env = rcare_marl.make(
        task, recipient=recipient, policies=dict.fromkeys(("robot", "recipient"), recorded)
    )
    again, same = played(env, seed)
    env.close()
    assert len(trace) == len(same) and len(commands["recipient"]) == len(trace)
    for step, (then, now) in enumerate(zip(trace, same, strict=True)):
        assert np.array_equal(then, now), f"step {step} differs by {np.abs(then - now).max()}"
    assert np.abs(trace[-1] - trace[0]).max() > 0.01  # something did happen


@pytest.mark.parametrize("mode", few(CASTS, "skeletal", "muscle unit", "muscle posture"))
def test_actions_of_a_meal_give_it_again(mode: str) -> None:
    check_replay("feeding", "cooperative", CASTS[mode], "karan", 0)


@pytest.mark.slow
@pytest.mark.parametrize("policy", ["cooperative", "behaviour", "passive", "resisting"])
@pytest.mark.parametrize("mode", CASTS)
@pytest.mark.parametrize("task", ["feeding", "drinking", "limb_repositioning"])
def test_actions_without_policies_give_the_same_episode(task: str, mode: str, policy: str) -> None:
    check_replay(task, policy, CASTS[mode], "natalia", 1)


def muscular(env: CareEnv) -> tuple[Human, MuscleDrive]:
    person = env.cast["recipient"]
    assert isinstance(person, Human) and isinstance(person.drive, MuscleDrive)
    return person, person.drive


@pytest.mark.parametrize("mode", ["unit", "group", "posture"])
def test_to_ask_for_an_action_does_nothing(mode: str) -> None:
    env = rcare_marl.make(
        "feeding",
        recipient={"model": "kim", **CASTS[f"muscle {mode}"]},
        policies={"robot": "still"},
    )
    person, drive = muscular(env)
    ends = []
    for is_asked in (False, True):
        env.reset(seed=2)
        for step in range(6):
            if is_asked:
                wish = {"jaw_opening": 0.3, "neck_flexion": 0.2}
                first = person.action_towards(wish, 0.1)
                drive.slack_action(0.1)
                assert np.array_equal(first, person.action_towards(wish, 0.1))
            env.step({"recipient": np.full(person.action_size, 0.1 * (step % 3), np.float32)})
        ends.append(env.state())
    env.close()
    assert np.array_equal(ends[0], ends[1])


def test_who_plays_decides_what_an_action_is() -> None:
    def made(policy: object, **how: str) -> tuple[float, str]:
        env = rcare_marl.make(
            "feeding",
            recipient={"model": "kim", "actuation": "muscle", **how},
            policies={"robot": "still"} | ({} if policy is None else {"recipient": policy}),
        )
        agent = env.cast["recipient"]
        env.close()
        return agent.action_low, agent.describe()["actuation"].split(",")[0]

    assert made(None) == (0.0, "muscle by unit")
    assert made("cooperative") == (-1.0, "muscle by posture")
    assert made("cooperative", excitation="group") == (0.0, "muscle by group")
    assert made(None, excitation="posture") == (-1.0, "muscle by posture")


def test_a_posture_is_commanded_as_with_the_skeletal_drive() -> None:
    cast = {"model": "karan", "actuation": "muscle", "excitation": "posture"}
    env = rcare_marl.make("feeding", recipient=cast, policies={"robot": "still"})
    plain = rcare_marl.make("feeding", recipient="karan", policies={"robot": "still"})
    person, drive = muscular(env)
    assert env.action_space("recipient") == plain.action_space("recipient")
    assert person.action_names == plain.cast["recipient"].action_names
    assert "joint_target" in [name for _, name, _ in env.describe("recipient")]
    env.reset(seed=0)
    i = person.movable.index("neck_flexion")
    before = drive.target[i]
    action = np.zeros(person.action_size, np.float32)
    action[i] = 1.0
    for _ in range(3):
        env.step({"recipient": action})
    assert drive.target[i] == pytest.approx(before + 3 * 0.08)
    for _ in range(8):
        env.step({"recipient": 0 * action})
    assert person.angle("neck_flexion") == pytest.approx(drive.target[i], abs=0.05)
    env.step({"recipient": -5 * action})  # cut, like all that moves either way
    with pytest.raises(ActionError, match="finite"):
        env.step({"recipient": np.nan * action})
    env.close()
    plain.close()
