"""Take the picture of what cameras give: a robot's wrist and another's head, while they feed a person.

python experiments/sensor_pictures.py --out docs/images/sensors.png

Each row is a camera, each column an output: colours, depth, normals, segmentation by link.
"""

from __future__ import annotations

import colorsys
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import typer

import rcare_marl
from rcare_marl.rendering.portrait import Picture, contact_sheet

SIZE = (288, 216)  # [pixel] of a picture
NEAREST, FARTHEST = 0.1, 3.0  # [m], ends of the colours of depths
ROWS = (("kinova_gen3", "wrist", 1.2), ("stretch_re1", "head", 2.4))  # robot, camera, time [s]
OUTPUTS = ("rgb", "depth", "normals", "segmentation")
TITLES = ("rgb", f"depth, {NEAREST} to {FARTHEST} m", "normals", "segmentation")


def readings(robot: str, camera: str, seconds: float) -> dict[str, npt.NDArray[Any]]:
    """Return what a camera of a robot sees after some time of feeding, by output."""
    sensor: dict[str, Any] = {
        "kind": "camera",
        "camera": camera,
        "outputs": OUTPUTS,
        "look": "full",
    }
    sensor |= {"width": SIZE[0], "height": SIZE[1]}
    env = rcare_marl.make(
        "feeding", robot={"model": robot, "sensors": [sensor], "policy": "scripted"}
    )
    env.reset(seed=0)
    while env.world.time < seconds - 1e-9 and env.agents:
        env.step({a: np.zeros(env.action_space(a).shape, np.float32) for a in env.agents})
    suite = env.cast["robot"].sensors
    assert suite is not None
    out = {output: suite.reading("camera", output).copy() for output in OUTPUTS}
    env.close()
    return out


def colored(output: str, values: npt.NDArray[Any]) -> Picture:
    """Return an output as colours, shape [height, width, 3]."""
    if output == "rgb":
        return values
    if output == "depth":
        return depth_colors(values)
    if output == "normals":  # right is red, up is green, towards the camera is blue
        light = 0.5 + 0.5 * values * (1, -1, -1)
        seen = values.any(axis=2, keepdims=True)
        return np.where(seen, np.round(255 * light), 30).astype(np.uint8)
    return label_colors(values)


def depth_colors(depth: npt.NDArray[np.float32]) -> Picture:
    """Return near as bright, far as dark, nothing as grey."""
    from matplotlib import colormaps

    share = (FARTHEST - depth) / (FARTHEST - NEAREST)
    bright = colormaps["magma"](np.clip(share, 0, 1))[:, :, :3]
    return np.where((depth > 0)[:, :, None], np.round(255 * bright), 30).astype(np.uint8)


def label_colors(labels: npt.NDArray[np.int32]) -> Picture:
    """Return a colour for each label; hues of neighbours lie far apart. Nothing is grey."""
    count = int(labels.max()) + 1
    palette = np.full((count + 1, 3), 30.0)
    for label in range(count):
        turn = 0.618034 * label  # the golden section spreads any number of hues
        palette[label + 1] = colorsys.hsv_to_rgb(turn % 1, 0.45 + 0.4 * (label % 2), 0.95)
        palette[label + 1] *= 255
    return np.round(palette)[labels + 1].astype(np.uint8)


def main(out: Path = Path("runs/sensors.png")) -> None:
    """Take the picture of what cameras give."""
    out.parent.mkdir(parents=True, exist_ok=True)
    pictures, captions = list[Picture](), list[str]()
    for robot, camera, seconds in ROWS:
        seen = readings(robot, camera, seconds)
        pictures += [colored(output, seen[output]) for output in OUTPUTS]
        captions += [f"{robot}, {camera}: {TITLES[0]}", *TITLES[1:]]
    contact_sheet(pictures, captions, columns=len(OUTPUTS)).save(out, optimize=True)
    print(out)


if __name__ == "__main__":
    typer.run(main)
