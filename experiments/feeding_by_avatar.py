"""Print how well the scripted robot, and chance, feed each of the seven avatars.

Run: python experiments/feeding_by_avatar.py [EPISODES]
"""

from __future__ import annotations

import sys

from rich.console import Console
from rich.table import Table

from rcare_marl import assets
from rcare_marl.baselines.evaluate import evaluate


def main() -> None:
    """Evaluate both policies on every avatar and print one table."""
    episodes = int(sys.argv[1]) if len(sys.argv) > 1 else 20
    table = Table(title=f"Feeding, {episodes} episodes for each avatar and policy")
    for column in ("avatar", "robot's policy", "success rate", "peak force [N]", "spilled pieces"):
        table.add_column(column)
    for avatar in assets.names("avatars"):
        for policy in ("scripted", "random"):
            result = evaluate(
                "feeding", {"robot": policy}, episodes=episodes, seed=0, cast={"recipient": avatar}
            ).to_dict()
            row = (f"{result[key]:.2f}" for key in ("success_rate", "peak_force_n", "spilled"))
            table.add_row(avatar, policy, *row)
    Console().print(table)


if __name__ == "__main__":
    main()
