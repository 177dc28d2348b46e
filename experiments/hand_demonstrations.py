"""Feeding as an emulated hand shows it, over the websocket of the page: for `train --demonstrations`.

The hand shakes, and knows no more than the page is told. Episodes that fail are recorded too. Usage:

    python experiments/hand_demonstrations.py runs/by_hand.hdf5 --episodes 40 --seed 50000
    rcare-marl train feeding --demonstrations runs/by_hand.hdf5
"""

from __future__ import annotations

import argparse
import asyncio
from pathlib import Path

from aiohttp import web

from rcare_marl.baselines.teleoperation.hand import feed, play
from rcare_marl.baselines.teleoperation.server import Server
from rcare_marl.baselines.teleoperation.stage import Scenario


async def demonstrate(path: Path, episodes: int, seed: int, noise: float) -> int:
    """Record episodes that a hand plays, and return how many succeeded."""
    server = Server(Scenario("feeding", ["robot"], seed=seed, record=path), waits=True)
    runner = web.AppRunner(server.app)
    await runner.setup()
    try:
        await web.TCPSite(runner, "127.0.0.1", 0).start()
        address = f"http://127.0.0.1:{runner.addresses[0][1]}"
        options = {"episodes": episodes, "noise": noise, "seed": seed}
        return sum(await play(address, server.token, "robot", feed, **options))  # type: ignore[arg-type]
    finally:
        await runner.cleanup()


def main() -> None:
    """Read the command line and say how many succeeded."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("path", type=Path, help="the dataset, as --record takes it")
    parser.add_argument("--episodes", type=int, default=40)
    parser.add_argument("--seed", type=int, default=50_000, help="of the first episode")
    parser.add_argument("--noise", type=float, default=0.1, help="of the hand, of an action")
    given = parser.parse_args()
    done = asyncio.run(demonstrate(given.path, given.episodes, given.seed, given.noise))
    print(f"{done} of {given.episodes} succeeded; recorded to {given.path}")


if __name__ == "__main__":
    main()
