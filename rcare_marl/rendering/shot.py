"""What to read of a camera, in what light, and what a reading is."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Literal, get_args

import numpy as np
import numpy.typing as npt

from ..errors import ConfigError, check_name
from ..pose import Array
from ..world import World
from .camera import Camera

Output = Literal["rgb", "depth", "normals", "segmentation"]
Look = Literal["full", "plain"]
Picture = dict[str, npt.NDArray[Any]]

OUTPUTS: tuple[Output, ...] = get_args(Output)
LOOKS: tuple[Look, ...] = get_args(Look)
KEY_DIRECTION = (0.42, -0.5, 0.95)  # towards the light, not normalised


@dataclass(frozen=True)
class Light:
    """One far light that casts shadows, and a softer one from everywhere.

    A picture under a sky is the mean of pictures under several lights. The software renderer knows
    `direction`, `key` and `fill`.

    Attributes:
        direction: Towards the far light; need not be of unit length.
        key: Strength of the far light, 1 as usual.
        fill: Strength of the light from everywhere, 1 as usual.
        bounce: How much of that comes from below as in a room with bright walls, in [0, 1].
        reach: How far from what the camera looks at shadows are seen [m].
        lid: Up to where things cast shadows, however large they are [m]: if lower than the ceiling, light
            comes from all of the ceiling. If None, walls and other still things of their size cast no
            shadow, everything else does, and shadows reach no farther than the picture does.

    Raises:
        ConfigError: If `direction` is zero, or strength or `reach` is negative.
    """

    direction: tuple[float, float, float] = KEY_DIRECTION
    key: float = 1.0
    fill: float = 1.0
    bounce: float = 0.0
    reach: float = 4.0
    lid: float | None = None

    def __post_init__(self) -> None:
        if not np.linalg.norm(self.direction) > 0:
            raise ConfigError(f"the direction of a light must not be zero, got {self.direction}")
        if min(self.key, self.fill) < 0 or not 0 <= self.bounce <= 1 or not self.reach > 0:
            raise ConfigError(
                "a light needs key and fill of at least 0, bounce within 0 and 1 and reach above 0, "
                f"got {self}"
            )

    @property
    def height(self) -> float:
        """Height above which nothing casts a shadow [m]."""
        return math.inf if self.lid is None else self.lid

    def axes(self) -> Array:
        """Return right, up and the way to the far light in the world as rows, shape [3, 3]."""
        back = np.asarray(self.direction, np.float64)
        back = back / np.linalg.norm(back)
        right = np.cross((0.0, 0.0, 1.0) if abs(back[2]) < 0.999 else (1.0, 0.0, 0.0), back)
        right /= np.linalg.norm(right)
        return np.array((right, np.cross(back, right), back))


@dataclass(frozen=True)
class Shot:
    """A camera and what to read of it.

    Outputs, each one array of the picture that `Renderer.read` returns:

    - `rgb`: colours, uint8, shape [height, width, 3];
    - `depth`: distance along the optical axis [m], float32, shape [height, width]; inf for nothing;
    - `normals`: unit normals of what is seen in the optical frame (z forward, x right, y down),
      float32, shape [height, width, 3]; zero for nothing;
    - `segmentation`: which link is seen, by the numbers of `Renderer.labels`, int32, shape
      [height, width]; -1 for nothing and for what belongs to no body.

    What is transparent is seen by `rgb` alone. The middle of a pixel counts: there is no mixing of what
    is near and far at an edge, except in the colours of a `full` look.

    Attributes:
        camera: Where from.
        outputs: What to read.
        look: Of `rgb`: `full` as in films, or `plain` without shadows, ambient occlusion and smooth
            edges, several times as fast.
        light: Of `rgb`.

    Raises:
        UnknownNameError: If an output or a look does not exist.
        ConfigError: If there is no output.
    """

    camera: Camera
    outputs: Sequence[Output] = ("rgb",)
    look: Look = "full"
    light: Light = Light()

    def __post_init__(self) -> None:
        check_name("look of a picture", self.look, LOOKS)
        if isinstance(self.outputs, str) or not self.outputs:
            raise ConfigError(f"outputs must be some of {', '.join(OUTPUTS)}, got {self.outputs!r}")
        for output in self.outputs:
            check_name("output of a camera", output, OUTPUTS)

    @property
    def wants_rgb(self) -> bool:
        """Whether colours are wanted."""
        return "rgb" in self.outputs

    @property
    def wants_shape(self) -> bool:
        """Whether anything but colours is wanted."""
        return any(output != "rgb" for output in self.outputs)


class Labels:
    """The numbers of all links of a world in segmentations, bodies in the order of loading.

    Attributes:
        names: Name of body and link by number.
    """

    def __init__(self, world: World) -> None:
        self._first: dict[int, int] = {}
        self.names: dict[int, tuple[str, str]] = {}
        for body in world.bodies:
            self._first[body.uid] = len(self.names)
            for link in range(-1, body.link_count):
                self.names[len(self.names)] = body.name, body.link_names.get(link, str(link))

    def of(self, uid: int, link: int) -> int:
        """Return the number of a link; -1 is the base."""
        return self._first[uid] + 1 + link
