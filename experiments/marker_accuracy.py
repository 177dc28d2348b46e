"""Measure how exactly a marker's pose is found in a rendered picture.

python experiments/marker_accuracy.py [--renderer gl] [--fov 45] [--samples 6] [--exposures 2]

For each size of the marker [mm], distance [m] and tilt to the line of sight [degrees] it prints the share
of pictures in which the marker was found, and the greatest errors of position [mm] and orientation
[degrees] in these. The marker turns about the line of sight and about the axis of tilt at random, and is
anywhere in the middle two thirds of the picture. Last comes a marker of 50 mm at 0.6 m in many poses.
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence

import numpy as np

from rcare_marl.agents.sensing.marker import Marker, MarkerConfig, fasten
from rcare_marl.agents.sensing.marker_detector import detect
from rcare_marl.agents.sensing.marker_sensor import photograph
from rcare_marl.pose import Pose, quaternion_from_matrix, quaternion_from_rpy, rotation_vector
from rcare_marl.rendering import Camera, Renderer, make_renderer
from rcare_marl.rendering.shot import Look
from rcare_marl.world import World

SIZES = (0.03, 0.05, 0.08)  # [m]
DISTANCES = (0.3, 0.6, 0.9, 1.2)  # [m]
TILTS = (0.0, 5.0, 15.0, 30.0, 45.0, 60.0)  # [deg]
PROMISE = (5.0, 2.0)  # [mm], [deg], of a marker of 50 mm at 0.6 m
WIDTH, HEIGHT = 640, 480  # [pixel]
SHARE = 2 / 3  # of the picture in which the marker's middle may be


def camera_pose(
    marker: Pose, distance: float, tilt: float, fov: float, rng: np.random.Generator
) -> Pose:
    """Return the pose of a camera that sees a marker at `distance` [m] under `tilt` [rad]."""
    high = np.tan(np.radians(fov) / 2)
    slopes = SHARE * high * rng.uniform(-1, 1, 2) * (WIDTH / HEIGHT, 1.0)
    sight = np.append(slopes, 1.0) / np.linalg.norm(np.append(slopes, 1.0))
    # The marker's z points back along the line of sight, then it is tilted about any axis across it.
    across = np.linalg.svd(sight[None])[2][1:]
    turn, azimuth = rng.uniform(0, 2 * np.pi, 2)
    axis = np.cos(azimuth) * across[0] + np.sin(azimuth) * across[1]
    other = np.cross(sight, axis)
    z = -np.cos(tilt) * sight + np.sin(tilt) * other
    x = np.cos(turn) * axis + np.sin(turn) * np.cross(z, axis)
    rotation = np.column_stack((x, np.cross(z, x), z))
    seen = Pose(
        tuple((distance * sight).tolist()), tuple(quaternion_from_matrix(rotation).tolist())
    )
    return marker @ seen.inverse()


def errors(
    renderer: Renderer, marker: Marker, camera: Camera, *, look: Look = "full", exposures: int = 2
) -> tuple[float, float] | None:
    """Return the errors of position [mm] and orientation [deg]; None if the marker is not found."""
    image, seen_by = photograph(renderer, camera, look=look, count=exposures)
    config = marker.config
    found = detect(image, seen_by, {config.id: config.size}, dictionary=config.dictionary)
    if not found:
        return None
    wrong = (camera.pose.inverse() @ marker.pose()).inverse() @ found[0].pose
    turn = np.degrees(np.linalg.norm(rotation_vector(wrong.quaternion)))
    return 1e3 * float(np.linalg.norm(wrong.position)), float(turn)


class Bench:
    """A marker of one size before a plain wall, and a renderer."""

    def __init__(self, size: float, options: argparse.Namespace) -> None:
        """Build it."""
        self._options = options
        self._world = World()
        config = MarkerConfig(7, "world", size, at=(0.0, 0.0, 2.0), rpy_deg=(90.0, 0.0, 0.0))
        self._marker = fasten(self._world, None, config)
        turn = tuple(quaternion_from_rpy(np.pi / 2, 0, 0).tolist())
        self._world.add_box((3.0, 3.0, 0.05), Pose((0.0, 0.2, 2.0), turn))
        self._renderer = make_renderer(self._world, options.renderer)

    def try_out(
        self, distance: float, tilts: Sequence[float], rng: np.random.Generator
    ) -> tuple[float, np.ndarray]:
        """Return the share found, and the errors [mm, deg], shape [n, 2], one a tilt [deg]."""
        options, rows = self._options, []
        for tilt in tilts:
            pose = camera_pose(self._marker.pose(), distance, np.radians(tilt), options.fov, rng)
            camera = Camera.at(pose, fov_deg=options.fov, width=WIDTH, height=HEIGHT)
            rows.append(
                errors(
                    self._renderer,
                    self._marker,
                    camera,
                    look=options.look,
                    exposures=options.exposures,
                )
            )
        found = [row for row in rows if row is not None]
        return len(found) / len(rows), np.array(found).reshape(-1, 2)

    def close(self) -> None:
        """Free everything."""
        self._renderer.close()
        self._world.close()


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--renderer", choices=("gl", "software"), default="gl")
    parser.add_argument("--look", choices=("full", "plain"), default="full")
    parser.add_argument("--exposures", type=int, default=2)
    parser.add_argument("--fov", type=float, default=45.0, help="vertical field of view [deg]")
    parser.add_argument("--samples", type=int, default=6, help="pictures a line")
    parser.add_argument("--many", type=int, default=200, help="pictures of the last line")
    parser.add_argument("--seed", type=int, default=0)
    options = parser.parse_args()
    rng = np.random.default_rng(options.seed)
    print(
        f"{WIDTH} x {HEIGHT}, {options.fov:g} degrees high, {options.renderer}, {options.look}, "
        f"{options.exposures} exposures\n"
    )
    print("| size [mm] | distance [m] | tilt [deg] | found | position [mm] | orientation [deg] |")
    print("|---|---|---|---|---|---|")
    for size in SIZES:
        bench = Bench(size, options)
        for distance in DISTANCES:
            for tilt in TILTS:
                share, rows = bench.try_out(distance, [tilt] * options.samples, rng)
                worst = rows.max(axis=0, initial=0.0) if len(rows) else (np.nan, np.nan)
                print(
                    f"| {1e3 * size:.0f} | {distance} | {tilt:.0f} | {share:.0%} | "
                    f"{worst[0]:.2f} | {worst[1]:.2f} |",
                    flush=True,
                )
        bench.close()
    bench = Bench(0.05, options)
    share, rows = bench.try_out(0.6, rng.uniform(0, 60, options.many).tolist(), rng)
    bench.close()
    inside = (rows <= PROMISE).all(axis=1).mean()
    print(
        f"\n50 mm at 0.6 m, tilted by 0 to 60 degrees, {options.many} pictures: found {share:.1%}; "
        f"within 5 mm and 2 degrees {inside:.1%} of these; median {np.median(rows[:, 0]):.2f} mm and "
        f"{np.median(rows[:, 1]):.2f} degrees, worst {rows[:, 0].max():.2f} mm and "
        f"{rows[:, 1].max():.2f} degrees"
    )


if __name__ == "__main__":
    main()
