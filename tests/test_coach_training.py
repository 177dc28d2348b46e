"""A coach that learns: the configs that ship train, and what they leave plays as it was trained."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

import rcare_marl
from rcare_marl.baselines.policy_file import PolicyFile
from rcare_marl.baselines.training.config import default_config, load_config
from rcare_marl.baselines.training.trainer import train
from rcare_marl.envs.coaching.coaching_task import SIZE
from rcare_marl.errors import ConfigError

BRIEF = {"envs": 2, "workers": 0, "steps": 8, "interval": 8, "evaluation_episodes": 1}
PEOPLE: dict[str, dict[str, Any]] = {  # who turn their heads only, so that a session is short
    "social_coaching": {"variants": [{"recipient": "jose"}]},
    "group_coaching": {"cast": {"recipient": "jose", "second_recipient": "morgan"}},
}


@pytest.mark.slow
@pytest.mark.parametrize("task", PEOPLE)
def test_the_config_that_ships_trains_how_the_coach_leads_its_orders_stay_those_of_the_tree(
    task: str, tmp_path: Path
) -> None:
    config = default_config(task)
    short = {"repetitions": 1, "exercises": ["head_rotation"]}
    small = {**config["algorithm"], "hidden": [16], "rollout": 4}
    train(
        {
            **config,
            **BRIEF,
            **PEOPLE[task],
            "algorithm": small,
            "options": {**config["options"], **short},
        },
        tmp_path,
    )
    file = PolicyFile.read(tmp_path / "policy_last.npz")
    assert not any(np.any(weights[:10]) for weights in file.layers[-1])
    assert file.hold == 80 and isinstance(file.residual, tuple) and not any(file.residual[:10])
    cast: dict[str, Any] = {
        "recipient": "jose",
        **({"second_recipient": "morgan"} if "group" in task else {}),
    }
    players = {"robot": str(tmp_path / "policy_last.npz"), **dict.fromkeys(cast, "learner")}
    env = rcare_marl.make(task, **cast, policies=players, options=short, physics_dt=1 / 30)
    env.reset(seed=1)
    for _ in range(file.hold // 2):
        env.step({})
    action = env.policies["robot"].act()
    assert action.shape == (SIZE,) and np.abs(action).max() <= 1
    assert set(np.abs(action[:9])) == {1.0} and np.abs(action[10:]).max() > 0
    env.close()


def test_demonstrations_do_not_go_with_actions_that_last() -> None:
    given = {"task": "toileting", "hold": 5, "demonstrations": {"episodes": 1}}
    with pytest.raises(ConfigError, match=r"demonstrations are of control steps.*lasts 5"):
        load_config(given)
