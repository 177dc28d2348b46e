"""How many pictures of 1280 x 720 a second the page draws, in headless Chromium without a graphics card.

Needs `make browser`. Usage:

    python experiments/pictures_a_second.py feeding
    python experiments/pictures_a_second.py bathing --pictures runs
"""

from __future__ import annotations

import argparse
import os
import sys
import tempfile
from pathlib import Path

from rcare_marl.baselines.teleoperation.server import Server
from rcare_marl.baselines.teleoperation.stage import Scenario


def main() -> None:
    """Read the command line and say what was measured."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("task")
    parser.add_argument("--settles", type=float, default=8.0, help="before it is measured [s]")
    parser.add_argument("--seconds", type=float, default=10.0)
    parser.add_argument("--pictures", help="folder for a picture of the page")
    given = parser.parse_args()
    sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "tests"))
    from browser import WEB, serving, watched

    scene = Scenario(given.task, (), policies={"robot": "scripted"})
    server = Server(scene, three=WEB / "node_modules" / "three" / "build")
    with serving(server.app) as url, tempfile.TemporaryDirectory() as scratch:
        job = {
            "url": f"{url}/?token={server.token}",
            "kind": "rate",
            "name": given.task,
            "viewport": {"width": 1280, "height": 720},
            "settles": given.settles,
            "seconds": given.seconds,
            "pictures": given.pictures,
        }
        seen = watched("teleoperation_page.mjs", Path(scratch), job)
    once, load = seen["once"], os.getloadavg()[0]
    wide, high = once["size"]
    print(f"{given.task}: {seen['rate']:.1f} pictures a second at {wide} x {high}, ", end="")
    print(
        f"{100 * once['ratio']:.0f} % of its pixels a side; load {load:.1f}, {os.cpu_count()} cores"
    )
    print(f"one picture of all pixels {once['whole_ms']:.0f} ms, of these ", end="")
    print(f"{once['triangles_ms']:.0f} for {once['triangles']:,} triangles")


if __name__ == "__main__":
    main()
