"""Agents are put into groups that TorchRL can stack."""

from __future__ import annotations

import pytest

import rcare_marl

pytest.importorskip("torchrl")

from rcare_marl.envs.torchrl import group_map


def test_robots_that_are_alike_share_a_group() -> None:
    env = rcare_marl.make("feeding", robot_0={}, robot_1={})
    assert group_map(env) == {"robots": ["robot_0", "robot_1"], "recipients": ["recipient"]}
    env.close()


def test_of_a_kind_that_is_not_alike_each_is_called_by_its_role() -> None:
    camera = {"kind": "camera", "width": 16, "height": 12}
    env = rcare_marl.make("feeding", robot_0={"sensors": [camera]}, robot_1={})
    assert group_map(env) == {
        "robot_0": ["robot_0"],
        "robot_1": ["robot_1"],
        "recipients": ["recipient"],
    }
    env.close()
