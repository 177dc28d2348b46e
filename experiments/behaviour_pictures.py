"""Draw the behaviour tree of every avatar, as PNG, SVG and text, in the middle of being fed.

python experiments/behaviour_pictures.py --out runs/trees
"""

from __future__ import annotations

from pathlib import Path

import typer

import rcare_marl
from rcare_marl import assets
from rcare_marl.agents.people.behaviour.avatar_tree import AvatarBehaviour
from rcare_marl.agents.people.behaviour.tree_picture import TreePicture

STEPS = 12  # control steps before the picture, so that the colours show a tree at work
JOINTS = ("eye_smplhf", "collar", "shoulder", "elbow", "hip", "knee")
MOVABLE = ["spine1", "spine2", "neck", "head", "jaw_opening"]
MOVABLE += [f"{side}_{joint}" for side in ("left", "right") for joint in JOINTS]


def draw(avatar: str, out: Path) -> None:
    """Draw one avatar's tree into the folder `out`."""
    env = rcare_marl.make(
        "feeding",
        recipient={"model": avatar, "movable": MOVABLE},
        policies={"robot": "scripted", "recipient": "behaviour"},
    )
    env.reset(seed=0)
    policy = env.policies["recipient"]
    assert isinstance(policy, AvatarBehaviour)
    for _ in range(STEPS):
        if not env.is_over:
            env.step({})
    picture = TreePicture(policy.root, subtitle=policy.config.description)
    for suffix in ("png", "svg", "txt"):
        picture.save(out / f"{avatar}.{suffix}")
    env.close()


def main(out: Path = Path("runs/trees")) -> None:
    """Draw the behaviour tree of every avatar."""
    out.mkdir(parents=True, exist_ok=True)
    for avatar in assets.names("avatars"):
        draw(avatar, out)
        print(out / f"{avatar}.png")


if __name__ == "__main__":
    typer.run(main)
